"""Folders of runs in which somebody changed something: read, or refused in lines that can be printed."""

import json
import shutil
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from commands import invoke, strict
from mutations import mutated

CASES = 12
SHORT = ("--set", "reference.waypoints=[[0, 0], [0.1, 0]]", "--set", "reference.settle_s=0", "--plant", "kinematic")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("folder") / "run"
    given = ("--controller", "flc", "--seeds", "2", "--no-record", "--no-figures", "--quiet")
    assert invoke("run", "--scenario", "rect", *SHORT, *given, "--out", folder) == 0
    return folder


@pytest.mark.parametrize("name", ["summary.json", "provenance.json"])
def test_what_was_changed_is_read_or_refused(
    folder: Path, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = folder / name
    before, content = file.read_bytes(), strict(file)
    try:
        for seed in range(CASES):
            file.write_text(json.dumps(mutated(content, seed)))
            for command in (("report", folder, "--out", tmp_path / "report.html"), ("verify", folder, "--quiet")):
                code = invoke(*command)  # an exception would pass through
                err = capsys.readouterr().err
                assert code in (0, 1, 2), (seed, command)
                assert (code == 0) == (err == ""), (seed, command)
                assert all(line.startswith("error: ") and line.isprintable() for line in err.splitlines()), (seed, err)
    finally:
        file.write_bytes(before)


@pytest.mark.parametrize(
    "text", ["[" * 100_000, "9" * 5000, '{"format": 1e999}', "\x00", "{}", "[]", '"' + "a" * 9999 + '"']
)
def test_what_is_no_record_is_refused(folder: Path, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("summary.json", "provenance.json"):
        before = (folder / name).read_bytes()
        (folder / name).write_text(text)
        for command in ("verify", "report"):
            if (name, command) != ("provenance.json", "report"):
                assert invoke(command, folder) == 2
                assert capsys.readouterr().err.count("\n") == 1
        (folder / name).write_bytes(before)


@pytest.mark.parametrize("name", ["frame", "place", "x_m"])
def test_a_table_that_lacks_numbers_is_refused(
    folder: Path, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By whatever reads it, in a line."""
    copy = shutil.copytree(folder, tmp_path / "copy")
    table = pq.read_table(folder / "trajectory.parquet")
    nothing = pa.array([None] * table.num_rows, pa.float64())
    pq.write_table(table.set_column(table.column_names.index(name), name, nothing), copy / "trajectory.parquet")
    for command in (("verify", copy, "--quiet"), ("film", copy, tmp_path / "film.gif")):
        code, err = invoke(*command), capsys.readouterr().err
        assert code == 2 or (name, command[0], code) == ("x_m", "verify", 1)
        assert all(line.startswith("error: ") for line in err.splitlines())


@pytest.mark.parametrize(
    "wrong",
    [
        {"axes": []},
        {"axes": ""},
        {"axes": [{"name": "carpet.friction", "values": [10**400]}]},
        {"at_once": float("inf")},
        {"format": None},
    ],
)
def test_a_sweep_that_varies_nothing_or_what_cannot_be_is_refused(
    folder: Path, wrong: dict[str, object], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(folder / "scenario.toml", tmp_path)
    plan = {"format": 1, "controllers": ["flc"], "at_once": 2, "axes": [{"name": "carpet.friction", "values": [0.3]}]}
    (tmp_path / "sweep.json").write_text(json.dumps(plan | wrong))
    assert invoke("sweep", "--resume", tmp_path, "--quiet") == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_table_whose_columns_have_no_names_is_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Bytes that are no text."""
    copy = shutil.copytree(folder, tmp_path / "copy")
    table = copy / "trajectory.parquet"
    table.write_bytes(table.read_bytes().replace(b"ref_heading_rad", b"ref_headin\xdf_rad"))
    assert invoke("film", copy, tmp_path / "film.gif") == 2
    assert "cannot be read" in capsys.readouterr().err
