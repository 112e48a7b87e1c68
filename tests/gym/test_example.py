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
    """On a path of 0.25 m a few iterations beat proportional control on other seeds."""
    tmp_path.joinpath("short.toml").write_text(
        "[reference]\nwaypoints = [[0, 0], [0.2, 0.1]]\nsettle_s = 0.1\n"
        "[physics]\nbackend = 'numpy'\n"
    )
    monkeypatch.chdir(tmp_path)
    arguments = ["--scenario", "short.toml", "--iterations", "5", "--robots", "64"]
    monkeypatch.setattr(sys, "argv", ["ppo.py", *arguments])
    learned = runpy.run_path(str(ROOT / "examples" / "learn" / "ppo.py"))
    printed = capsys.readouterr().out
    assert "iteration 0: mean error" in printed
    rows = learned["result"].rows()
    errors = rows.group_by("controller").aggregate([("position_mean_m", "max")]).to_pylist()
    error = {row["controller"]: row["position_mean_m_max"] for row in errors}
    assert error["Learned"] < error["p"]


def test_the_lines_of_the_document_run() -> None:
    for text in re.findall(
        r"^```python\n(.*?)^```",
        (ROOT / "docs" / "how-to" / "train-a-policy.md").read_text(),
        re.MULTILINE | re.DOTALL,
    ):
        exec(text, {"__name__": "printed"})
