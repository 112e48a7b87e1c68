"""What the documents say of learning: their lines run, and the example learns."""

import re
import runpy
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def test_the_example_learns_and_drives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """On a path of 0.25 m three generations halve the error, and beat `p` on other seeds."""
    tmp_path.joinpath("short.toml").write_text(
        "[reference]\nwaypoints = [[0, 0], [0.2, 0.1]]\nsettle_s = 0.1\n"
    )
    monkeypatch.chdir(tmp_path)
    arguments = ["--scenario", "short.toml", "--generations", "3"]
    monkeypatch.setattr(sys, "argv", ["learn.py", *arguments])
    learned = runpy.run_path(str(ROOT / "examples" / "learn" / "learn.py"))
    printed = capsys.readouterr().out
    errors_cm = [float(error) for error in re.findall(r"mean error ([0-9.]+) cm", printed)]
    assert errors_cm[-1] < errors_cm[0] / 2
    errors = learned["result"].rows().group_by("controller")
    errors = errors.aggregate([("position_mean_m", "max")]).to_pylist()
    error = {row["controller"]: row["position_mean_m_max"] for row in errors}
    assert error["Learned"] < error["p"]


def test_the_lines_of_the_document_run() -> None:
    for text in re.findall(
        r"^```python\n(.*?)^```",
        (ROOT / "docs" / "how-to" / "train-a-policy.md").read_text(),
        re.MULTILINE | re.DOTALL,
    ):
        exec(text, {"__name__": "printed"})
