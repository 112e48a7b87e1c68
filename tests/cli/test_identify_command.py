"""`omni-mj identify` as a user types it: logs in files, bad ones, our own recordings, and moves to drive."""

import tomllib
from collections.abc import Callable
from pathlib import Path

import compiled
import numpy as np
import pytest
from commands import invoke, strict
from synthetic import Truth, logs

import omni_mj as om
from omni_mj.studies.slip.law import expected

HEAD = ["time_s", "x_m", "y_m", "heading_rad", "vx_cmd_world_m_s", "vy_cmd_world_m_s", "w_cmd_rad_s"]


def write(path: Path, columns: dict[str, np.ndarray]) -> Path:
    body = np.stack(list(columns.values()), 1)
    np.savetxt(path, body, delimiter=",", header=",".join(columns), comments="")
    return path


@pytest.fixture(scope="module")
def columns() -> dict[str, np.ndarray]:
    of = logs(om.scenario("rect").settings, [Truth()], 6.5, seed=1, speed=2.2)
    return dict(zip(HEAD, np.column_stack([of.time, of.pose[:, 0], of.command[:, 0]]).T, strict=True))


def test_a_log_becomes_numbers_a_report_and_a_robot(
    columns: dict[str, np.ndarray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write(tmp_path / "log.csv", columns)
    assert invoke("identify", log, "--out", tmp_path / "out") == 0
    printed = capsys.readouterr().out
    assert "stretches not fitted to are predicted within" in printed
    found = strict(tmp_path / "out" / "identify.json")
    late = found["estimates"]["commands.latency_s"]
    assert late["value"] == pytest.approx(0.1, abs=0.005)
    low, high = late["interval_95"]
    assert low < late["value"] < high
    text = (tmp_path / "out" / "robot.toml").read_text()
    data = tomllib.loads(text)
    assert data["radio"]["delay_frames"] == 6
    assert data["body"]["mass_kg"] == 2.65  # as it was
    assert "delay_frames = 6 # identified from commands: " in text
    assert "(standard error)" in text
    robot = om.scenario("rect", robot=str(tmp_path / "out" / "robot.toml"))
    assert robot.settings.radio.delay_frames == 6


def test_the_robot_is_written_to_the_file_that_is_named(
    columns: dict[str, np.ndarray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As the folder beside it has it; a file that is there stays unless it may be replaced."""
    log, out = write(tmp_path / "log.csv", columns), tmp_path / "mine.toml"
    assert invoke("identify", log, "--out", out) == 0
    assert out.read_text() == (tmp_path / "mine" / "robot.toml").read_text()
    assert f"the robot in {out}" in capsys.readouterr().out
    assert invoke("identify", log, "--out", out) == 2
    assert "--overwrite" in capsys.readouterr().err


def swapped(c: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return c | {"vx_cmd_world_m_s": c["vy_cmd_world_m_s"], "vy_cmd_world_m_s": c["vx_cmd_world_m_s"]}


BAD: dict[str, tuple[Callable[[dict[str, np.ndarray]], dict[str, np.ndarray]], str]] = {
    "a pose is missing": (lambda c: {k: v for k, v in c.items() if k != "y_m"}, "column y_m is missing"),
    "no inputs": (lambda c: {k: c[k] for k in HEAD[:4]}, "neither commands nor wheels"),
    "time goes back": (lambda c: c | {"time_s": np.append(c["time_s"][:-1], 1.0)}, "time_s does not increase"),
    "mm": (lambda c: c | {"x_m": 1e3 * c["x_m"], "y_m": 1e3 * c["y_m"]}, "are x_m and y_m in mm?"),
    "feet": (lambda c: c | {"x_m": c["x_m"] / 0.3048, "y_m": c["y_m"] / 0.3048}, "times as far as the commands say"),
    "mm/s": (lambda c: c | {"vx_cmd_world_m_s": 1e3 * c["vx_cmd_world_m_s"]}, "are they in cm/s or mm/s?"),
    "degrees": (lambda c: c | {"heading_rad": np.degrees(c["heading_rad"])}, "is heading_rad in degrees?"),
    "ms": (lambda c: c | {"time_s": 1e3 * c["time_s"]}, "is time_s in ms?"),
    "swapped": (swapped, "x and y are swapped"),
    "mirrored": (lambda c: c | {"vy_cmd_world_m_s": -c["vy_cmd_world_m_s"]}, "y is mirrored"),
    "clockwise": (lambda c: c | {"heading_rad": -c["heading_rad"]}, "is one clockwise?"),
    "body": (
        lambda c: {k.replace("world", "body"): v for k, v in c.items()},
        "name their columns for the field's axes",
    ),
    "short": (lambda c: {k: v[:100] for k, v in c.items()}, "too few to identify anything"),
}


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_log_is_a_line(
    kind: str, columns: dict[str, np.ndarray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil, says = BAD[kind]
    assert invoke("identify", write(tmp_path / "log.csv", spoil(columns)), "--out", tmp_path / "out") == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert says in error
    assert "log.csv" in error or kind == "short"
    assert not (tmp_path / "out").exists()


def test_what_is_no_log_is_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "log.txt").write_text("time_s\n0\n")
    (tmp_path / "log.parquet").write_text("time_s\n0\n")
    for words, says in (
        ((), "name at least one log"),
        ((tmp_path / "none.csv",), "there is no log"),
        ((tmp_path / "log.txt",), "a .csv or .parquet file"),
        ((tmp_path / "log.parquet",), "cannot be read"),
        ((tmp_path / "log.txt", "--plan"), "takes no logs"),
    ):
        assert invoke("identify", *words) == 2
        assert says in capsys.readouterr().err


def test_gaps_are_named_and_bridged_by_nothing(
    columns: dict[str, np.ndarray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Half a second is missing, and the numbers are the same within their intervals."""
    kept = (columns["time_s"] < 3.1) | (columns["time_s"] > 3.6)
    log = write(tmp_path / "log.csv", {k: v[kept] for k, v in columns.items()})
    assert invoke("identify", log, "--out", tmp_path / "out") == 0
    found = strict(tmp_path / "out" / "identify.json")
    assert [note for note in found["notes"] if "a gap of 0.533 s" in note]
    late = found["estimates"]["commands.latency_s"]
    assert late["value"] == pytest.approx(0.1, abs=5 * late["standard_error"])
    capsys.readouterr()


def test_lines_without_a_pose_are_passed_over(columns: dict[str, np.ndarray], tmp_path: Path) -> None:
    """One in ten is empty; latency is told as before."""
    lost = np.random.default_rng(0).random(len(columns["time_s"])) < 0.1
    log = write(tmp_path / "log.csv", columns | {k: np.where(lost, np.nan, columns[k]) for k in HEAD[1:4]})
    log.write_text(log.read_text().replace("nan", ""))
    assert invoke("identify", log, "--out", tmp_path / "out", "--quiet") == 0
    late = strict(tmp_path / "out" / "identify.json")["estimates"]["commands.latency_s"]
    assert late["value"] == pytest.approx(0.1, abs=5 * late["standard_error"])


def test_our_own_recording_of_our_own_robot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Eight seconds of the plant: gains as the law of creep has them, with room for drag of the wheel loops."""
    route = {
        "waypoints": [[0, 0], [1.2, 0], [0.4, 0.7], [0.4, -0.5], [0, 0]],
        "max_acceleration_m_s2": 2.0,
        "settle_s": 0.5,
    }
    compiled.once("mujoco")
    rect = om.scenario("rect", reference=route, wheels={"model": "two-rollers"}, physics=compiled.NUMBA)
    om.run(rect, ["comp-flc"], seeds=[0]).save(tmp_path / "run")
    assert invoke("identify", tmp_path / "run" / "trajectory.parquet", "--out", tmp_path / "out") == 0
    out = capsys.readouterr().out
    found = strict(tmp_path / "out" / "identify.json")
    by_wheels = {name: e["value"] for name, e in found["estimates"].items() if name.startswith("wheels.gain")}
    law = expected(rect.settings)
    for axis, name in enumerate(("forward", "sideways")):
        if (value := by_wheels[f"wheels.gain_{name}"]) is not None:
            assert value == pytest.approx(law.gain[axis], abs=0.04)
    assert any(value is not None for value in by_wheels.values())
    held = found["fits"]["wheels"]["held_out"]
    assert held["identified_m"] < held["start_m"]
    assert "the robot turns at" in out


def test_the_plan_is_a_scenario_within_the_limits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke("identify", "--plan", "--out", tmp_path / "out") == 0
    printed = capsys.readouterr().out
    moves = [line.split() for line in printed.splitlines()[2:-2]]
    assert {move[0] for move in moves} == {"forward", "sideways", "diagonal", "turning"}
    assert max(float(move[-1]) for move in moves if move[0] == "forward") > 1.7
    plan = om.scenario(str(tmp_path / "out" / "plan.toml"))
    assert plan.settings.reference.max_acceleration_m_s2 == 2.0
    assert plan.settings.reference.friction > 0  # wheels are regarded
