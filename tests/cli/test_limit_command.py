"""`omni-mj limit` on the command line."""

from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import pytest
from commands import invoke, strict
from matplotlib.image import imread

SEEDS, FIRST = 2, 3
COMMON = f"--plant kinematic --set reference.settle_s=0.1 --seeds {SEEDS} --seed {FIRST}"


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("given") / "tiny.toml"
    path.write_text("[reference]\nwaypoints = [[0, 0], [0.05, 0.02, 0.1]]\n")
    return path


@pytest.fixture(scope="module")
def limited(tiny: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Run the command; return its folder and the printed text."""
    out = tmp_path_factory.mktemp("limited") / "out"
    with redirect_stdout(StringIO()) as printed:
        assert invoke("limit", tiny, COMMON, "--iterations 2 --out", out) == 0
    return out, printed.getvalue()


def test_limit_prints_a_table_and_saves_files(
    limited: tuple[Path, str], tiny: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It prints a table and saves numbers, frames, the scenario and a figure."""
    out, printed = limited
    assert [line.split("  ")[0] for line in printed.splitlines()[2:4]] == [
        "limit",
        "limit without noise",
    ]
    files = {"summary.json", "scenario.toml", "trajectory.parquet", "provenance.json", "sources"}
    assert {path.name for path in out.iterdir()} == files | {"limit.png", "limit.svg"}
    summary = strict(out / "summary.json")
    assert summary["seeds"] == [3, 4]
    assert summary["complete"]
    assert len(summary["limit"]["trials"]) >= 2
    assert min(imread(out / "limit.png").shape[:2]) > 700
    assert invoke("verify", out) == 2
    assert f"repeat the study: omni-mj limit {tiny}" in capsys.readouterr().err
    assert summary["repeat_command"].startswith(f"omni-mj limit {tiny} --plant kinematic --set")


def test_invalid_input_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, expected_error in (
        ("rekt", "did you mean 'rect'"),
        ("rect --robot tigers", "unknown robot 'tigers'"),
        ("rect --iterations 1", "iterations must be at least 2, got 1"),
        ("rect --seeds 0", "seeds"),
        ("rect --set world.start_poses=[[0,0,0],[0,1,0]]", "has 2 poses"),
        ("", "Missing argument"),
    ):
        assert invoke("limit", words, "--out", tmp_path / "bad") == 2
        assert expected_error in capsys.readouterr().err
    assert not (tmp_path / "bad").exists()
