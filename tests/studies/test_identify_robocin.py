"""Test identification of a real robot of the league, see tests/data/robocin."""

from pathlib import Path

import pytest
from robocin_logs import FOLDER, write_robocin_log

import omni_mj as om
from omni_mj.studies.identify.identify_study import IdentificationResult


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> IdentificationResult:
    """Return a robot identified from 25 s at 23 Hz."""
    folder = tmp_path_factory.mktemp("igs_03")
    geometry = om.load_robot("tigers-v2016").settings.wheels.kinematics
    return om.identify(write_robocin_log("igs_03", folder, geometry))


def test_weak_estimates_of_a_real_robot_are_shown(result: IdentificationResult) -> None:
    """K and T are as published for others; the slope of the carpet is not identified."""
    for name, value, tolerance in (
        ("gain_forward", 0.95, 0.02),
        ("gain_sideways", 0.87, 0.03),
        ("creep_forward_s2_m", 0.06, 0.01),
        ("creep_sideways_s2_m", 0.12, 0.02),
    ):
        estimate = result.estimates[f"wheels.{name}"]
        assert estimate.value == pytest.approx(value, abs=tolerance)
        assert estimate.is_identified
    assert result.estimates["wheels.gain_sideways"].report()["weak"] is True
    assert "gain K sideways (weak)" in result.table()
    assert not result.estimates["wheels.slope_x_rad"].is_identified
    assert result.misfits


def test_a_fit_predicts_segments_of_its_log_that_it_has_not_seen(
    result: IdentificationResult,
) -> None:
    """A prior by the start robot prevents that 18 segments are fitted too closely."""
    prediction, segments = result.predictions["wheels"], result.fits["wheels"].problem.segments
    assert prediction
    assert prediction.n_segments < len(segments), "it stands still in some"
    assert prediction.fitted_m < prediction.start_m


def test_robots_found_predict_another_log_better_than_those_that_ship(
    result: IdentificationResult, tmp_path: Path
) -> None:
    """The first 6 s of squares, by the closest of the robots that ship."""
    result.save(tmp_path)
    errors = {}
    found = [str(folder / "robot.toml") for folder in (FOLDER, tmp_path)]
    for robot in (*found, "tigers-v2020-planetary"):
        geometry = om.load_robot(robot).settings.wheels.kinematics
        log = write_robocin_log("sqr_02", tmp_path, geometry, 135)
        prediction = om.identify(log, robot).predictions["wheels"]
        assert prediction
        errors[robot] = prediction.start_m
    *found_errors, closest_error = errors.values()
    assert max(found_errors) < closest_error, errors
