"""The first example of a controller in the documentation runs and keeps to the reference."""

import json
import re
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "write-a-controller.md"
LINES = 20  # of the example; blank ones do not count


def example() -> str:
    """Return the first Python program of the page."""
    return re.split(r"```python.*\n", PAGE.read_text(encoding="utf-8"))[1].split("```")[0]


def test_the_example_is_short() -> None:
    assert len([line for line in example().splitlines() if line.strip()]) <= LINES


def test_the_example_keeps_an_ideal_robot_on_the_reference(tmp_path: Path) -> None:
    """Dead time alone costs it nothing: kinematic plant, alpha 1, measurements without noise."""
    (tmp_path / "mine.py").write_text(example(), encoding="utf-8")
    name = re.search(r"^class (\w+)\((?:om\.)?Controller\)", example(), re.MULTILINE)
    assert name is not None
    exact = [
        "kinematic.alpha_low=1", "kinematic.alpha_high=1",
        "vision.position_noise_m=0", "vision.heading_noise_rad=0", "vision.miss_probability=0",
    ]  # fmt: skip
    command = [
        sys.executable, "-m", "omni_mj.run", "--scenario", "rect", "--plant", "kinematic",
        "--controller", f"mine.py:{name[1]}", "--no-record", "--no-figures", "--out", "out",
    ]  # fmt: skip
    command += [word for setting in exact for word in ("--set", setting)]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    entry = json.loads((tmp_path / "out" / "summary.json").read_text())["scenarios"]["rect"]
    error = entry["results"][name[1]]["error_m"]
    # Roundings of metres.
    assert all(error[axis]["max"]["median"] < 1e-9 for axis in "xy")
