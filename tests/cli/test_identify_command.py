"""`omni-mj identify`: its files, gaps in logs, our own recordings, moves to drive."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from commands import invoke, strict
from synthetic_logs import POSE, make_log, write_csv

import omni_mj as om


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return write_csv(tmp_path / "log.csv", make_log(wheels=False))


def test_a_log_gives_parameters_a_report_and_a_robot_file(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert invoke("identify", log, "--out", tmp_path / "out") == 0
    assert "motion by commands: residuals of positions" in capsys.readouterr().out
    late = strict(tmp_path / "out" / "identify.json")["estimates"]["commands.dead_time_s"]
    assert late["value"] == pytest.approx(0.1, abs=0.005)
    low, high = late["interval_95"]
    assert low < late["value"] < high
    text = (tmp_path / "out" / "robot.toml").read_text()
    data = tomllib.loads(text)
    assert data["radio"]["delay_frames"] == pytest.approx(60 * late["value"], abs=1e-3)
    assert data["body"]["mass_kg"] == 2.65  # as it was
    assert f"delay_frames = {data['radio']['delay_frames']} # identified from commands: " in text
    robot = om.load_scenario("rect", robot=str(tmp_path / "out" / "robot.toml"))
    assert robot.settings.radio.delay_frames == data["radio"]["delay_frames"]


def test_an_invalid_log_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("log.txt", "log.parquet"):
        (tmp_path / name).write_text("time_s\n0\n")
    short = write_csv(tmp_path / "short.csv", {k: v[:100] for k, v in make_log().items()})
    for words, expected_error in (
        ((), "Missing argument"),
        ((tmp_path / "none.csv",), "there is no log"),
        ((tmp_path / "log.txt",), "a .csv or .parquet file"),
        ((tmp_path / "log.parquet",), "cannot be read"),
        ((short, "--out", tmp_path / "out"), "too few to identify anything"),
    ):
        assert invoke("identify", *words) == 2
        error = capsys.readouterr().err
        assert expected_error in error
        assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_gaps_and_lines_without_a_pose_are_skipped(log: Path, tmp_path: Path) -> None:
    """Half a second and one pose in ten are missing: dead time within five standard errors."""
    columns = make_log(wheels=False)
    lost = np.random.default_rng(0).random(len(columns["time_s"])) < 0.1
    columns |= {name: np.where(lost, np.nan, columns[name]) for name in POSE}
    is_kept = (columns["time_s"] < 3.1) | (columns["time_s"] > 3.6)
    write_csv(log, {name: values[is_kept] for name, values in columns.items()})
    assert invoke("identify", log, "--out", tmp_path / "out", "--quiet") == 0
    late = strict(tmp_path / "out" / "identify.json")["estimates"]["commands.dead_time_s"]
    assert late["value"] == pytest.approx(0.1, abs=5 * late["standard_error"])


def test_identifies_a_simulated_robot_from_its_recording(tmp_path: Path) -> None:
    """Eight seconds give the creep stiffness within four standard errors."""
    route = {
        "waypoints": [[0, 0], [1.2, 0], [0.4, 0.7], [0.4, -0.5], [0, 0]],
        "max_acceleration_m_s2": 2.0,
    }
    wheels = {"model": "two-rollers"}
    rect = om.load_scenario("rect", reference=route | {"settle_s": 0.5}, wheels=wheels)
    om.run(rect, ["comp-flc"], seeds=[0]).save(tmp_path / "run")
    assert (
        invoke(
            "identify",
            tmp_path / "run" / "trajectory.parquet",
            "--out",
            tmp_path / "out",
            "--quiet",
        )
        == 0
    )
    identified = strict(tmp_path / "out" / "identify.json")
    creep = identified["estimates"]["wheels.creep_stiffness"]
    truth = rect.settings.drivetrain.creep_stiffness
    assert creep["value"] == pytest.approx(truth, abs=4 * creep["standard_error"])
    assert identified["estimates"]["wheels.gain_turning"]["value"] is None


def test_a_users_model_is_named_and_copied(log: Path, tmp_path: Path) -> None:
    """The robot file names a copy in its own folder."""
    model = tmp_path / "robot.xml"
    model.write_text((Path(om.__file__).parents[1] / "models" / "ssl_robot.xml").read_text())
    assert invoke("identify", log, "--model", model, "--out", tmp_path / "out", "--quiet") == 0
    robot = om.load_scenario("rect", robot=str(tmp_path / "out" / "robot.toml"))
    assert Path(robot.settings.model.file) == tmp_path / "out" / "model" / "robot.xml"
