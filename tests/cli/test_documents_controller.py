"""The first example of a controller in the documentation runs and keeps to the reference."""

import json
import re
from pathlib import Path

import pytest
from commands import BARE, invoke

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
    exact = (
        "--set kinematic.alpha_low=1 --set kinematic.alpha_high=1 --set vision.position_noise_m=0 "
        "--set vision.heading_noise_rad=0 --set vision.miss_probability=0"
    )
    run = f"run --scenario rect --plant kinematic --controller mine.py:{name[1]}"
    monkeypatch.chdir(tmp_path)
    assert invoke(run, exact, BARE, "--out out") == 0
    entry = json.loads((tmp_path / "out" / "summary.json").read_text())["scenarios"]["rect"]
    error = entry["results"][name[1]]["error_m"]
    # Roundings of metres.
    assert all(error[axis]["max"]["median"] < 1e-9 for axis in "xy")
