"""`omni-mj limit` as a user types it."""

from pathlib import Path

import pytest
from commands import invoke, strict
from matplotlib.image import imread

from omni_mj.studies.limit import practice

ROUTE = ("--set", "reference.waypoints=[[0,0],[0.05,0.02,0.1]]", "--set", "reference.settle_s=0.1")


def test_the_limit_is_a_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It prints a table, and leaves numbers, frames, the scenario and a picture; of fewer seeds of practice."""
    monkeypatch.setattr(practice, "SEEDS", 2)
    out = tmp_path / "out"
    words = ("rect", "--plant", "kinematic", *ROUTE, "--seeds", 2, "--seed", 3, "--iterations", 2, "--out", out)
    assert invoke("limit", *words) == 0
    printed = capsys.readouterr().out
    assert [line.split("  ")[0] for line in printed.splitlines()[2:4]] == ["limit", "limit without noise"]
    files = {"summary.json", "scenario.toml", "trajectory.parquet", "limit.png", "provenance.json", "sources"}
    assert {path.name for path in out.iterdir()} == files
    summary = strict(out / "summary.json")
    assert summary["seeds"] == [3, 4]
    assert summary["complete"]
    assert len(summary["limit"]["attempts"]) >= 2
    assert min(imread(out / "limit.png").shape[:2]) > 800
    assert invoke("verify", out) == 0
    assert capsys.readouterr().out.startswith("repeats: ")
    assert summary["repeat"].startswith("omni-mj limit rect --plant kinematic --seed 3 --seeds 2 --set")
    assert summary["repeat"].endswith(" --iterations 2")


def test_bad_input_is_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, says in (
        (("rekt",), "did you mean 'rect'"),
        (("rect", "--robot", "tigers"), "unknown robot 'tigers'"),
        (("rect", "--iterations", 1), "at least 2 iterations"),
        (("rect", "--seeds", 0), "seeds"),
        ((), "Missing argument"),
    ):
        assert invoke("limit", *words, "--out", tmp_path / "bad") == 2
        assert says in capsys.readouterr().err
    assert not (tmp_path / "bad").exists()
