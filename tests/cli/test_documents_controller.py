"""The first example of a controller in the documentation runs and keeps to the reference."""

import json
import re
from pathlib import Path

import pytest
from commands import invoke

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "write-a-controller.md"
LINES = 20  # of the example; blank ones do not count


def example() -> str:
    """Return the first Python program of the page."""
    return re.split(r"```python.*\n", PAGE.read_text(encoding="utf-8"))[1].split("```")[0]


def test_the_example_is_short() -> None:
    assert len([line for line in example().splitlines() if line.strip()]) <= LINES


def test_the_example_keeps_an_ideal_robot_on_the_reference(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Dead time alone costs it nothing: kinematic plant, alpha 1, measurements without noise."""
    (tmp_path / "mine.py").write_text(example(), encoding="utf-8")
    name = re.search(r"^class (\w+)\((?:om\.)?Controller\)", example(), re.MULTILINE)
    assert name is not None
    exact = [
        "kinematic.alpha_low=1", "kinematic.alpha_high=1",
        "vision.position_noise_m=0", "vision.heading_noise_rad=0", "vision.miss_probability=0",
    ]  # fmt: skip
    words = [
        "run", "--scenario", "rect", "--plant", "kinematic", "--controller", f"mine.py:{name[1]}",
        "--no-record", "--no-figures", "--quiet", "--out", "out",
    ]  # fmt: skip
    words += [word for setting in exact for word in ("--set", setting)]
    monkeypatch.chdir(tmp_path)
    assert invoke(*words) == 0
    entry = json.loads((tmp_path / "out" / "summary.json").read_text())["scenarios"]["rect"]
    error = entry["results"][name[1]]["error_m"]
    # Roundings of metres.
    assert all(error[axis]["max"]["median"] < 1e-9 for axis in "xy")
