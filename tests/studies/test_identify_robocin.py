"""Test identification of a real robot of the league, see tests/data/robocin."""

from pathlib import Path

import pytest
from robocin_logs import FOLDER, write_robocin_log

import omni_mj as om

GEOMETRY = om.load_robot("tigers-v2016").settings.wheels.kinematics


def test_weak_estimates_of_a_real_robot_are_shown(tmp_path: Path) -> None:
    """25 s at 23 Hz: K and T are as published for others; parts of the drag are not identified."""
    result = om.identify(write_robocin_log("igs_03", tmp_path, GEOMETRY))
    estimates = {
        name: result.estimates[f"wheels.{name}"] for name in ("gain_forward", "creep_forward_s2_m")
    }
    for name, (value, tolerance) in {
        "gain_forward": (0.95, 0.04),
        "creep_forward_s2_m": (0.06, 0.02),
    }.items():
        assert estimates[name].value == pytest.approx(value, abs=tolerance)
        assert estimates[name].is_identified
        assert estimates[name].report()["weak"] is True
    assert "gain K forward (weak)" in result.table()
    assert not result.estimates["wheels.roller_friction"].is_identified
    assert result.misfits
    prediction = result.predictions["wheels"]
    assert prediction
    assert prediction.n_segments < len(result.fits["wheels"].segments), "it stands still in some"


def test_the_robot_found_predicts_better_than_those_that_ship(tmp_path: Path) -> None:
    """The first 13 s of squares are predicted from odometry, with a robot's creep and drag."""
    errors = {}
    for robot in (str(FOLDER / "robot.toml"), "tigers-v2016"):
        geometry = om.load_robot(robot).settings.wheels.kinematics
        log = write_robocin_log("sqr_02", tmp_path, geometry, 300)
        prediction = om.identify(log, robot).predictions["wheels"]
        assert prediction
        errors[robot] = prediction.start_m
    assert min(errors, key=errors.__getitem__) == str(FOLDER / "robot.toml"), errors
