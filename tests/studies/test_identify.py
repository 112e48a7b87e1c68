"""Test identification of robots with known parameters: errors, missing excitation, bad logs."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic_logs import (
    COMMAND,
    CREEP_STIFFNESS,
    DEAD_TIME_S,
    POSE,
    SETTINGS,
    WHEELS,
    Columns,
    make_log,
    write_csv,
)

import omni_mj as om
from omni_mj.config import nominal_model
from omni_mj.studies.identify.derived_parameters import Estimate
from omni_mj.studies.identify.identify_study import IdentificationResult
from omni_mj.studies.identify.robot_file_writer import list_changes

OTHER: dict[str, Any] = {
    "radio": {"delay_frames": 5},
    "drivetrain": {"creep_stiffness": 3.0, "roller_friction": 0.05},
    "carpet": {"rolling_resistance": 0.03},
    "fault": [{"kind": "tilt", "start_s": 0.0, "angle_deg": 1.8, "direction_deg": 20.0}],
}


def identify_log(columns: Columns, folder: Path) -> IdentificationResult:
    return om.identify([write_csv(folder / "log.csv", columns)])


@pytest.mark.parametrize("is_other_robot", [False, True], ids=["default", "other"])
def test_parameters_are_identified_from_a_log(is_other_robot: bool, tmp_path: Path) -> None:
    """Within four standard errors; creep stiffness within 10 %, dead time within 0.3 frames."""
    result = identify_log(make_log(**OTHER if is_other_robot else {}), tmp_path)
    dead_time, stiffness, slope = (
        (5 / 60, 3.0, 0.0314) if is_other_robot else (DEAD_TIME_S, CREEP_STIFFNESS, 0.0)
    )
    assert not result.misfits
    for name, value in (
        ("wheels.creep_stiffness", stiffness),
        ("wheels.arm_m", SETTINGS.wheels.arm_m),
        ("wheels.clock_offset_s", 0.0),
        ("wheels.slope_x_rad", slope * np.cos(np.radians(20))),
        ("wheels.slope_y_rad", slope * np.sin(np.radians(20))),
        ("commands.dead_time_s", dead_time),
    ):
        assert (
            abs(result.estimates[name].value - value) < 4 * result.estimates[name].standard_error
        ), name
    assert result.estimates["wheels.creep_stiffness"].value == pytest.approx(stiffness, rel=0.1)
    assert result.estimates["commands.dead_time_s"].value == pytest.approx(dead_time, abs=0.3 / 60)
    lag = om.load_robot("tigers-v2016").facts["lag_forward_s"]
    assert result.estimates["commands.lag_forward_s"].value == pytest.approx(lag, abs=0.005)


def test_robot_found_has_the_lag_of_wheel_loops_that_its_file_has_wrong(tmp_path: Path) -> None:
    """Commands tell the gain, which the start robot has wrong by a factor of two."""
    loops = {"firmware": {"kp": 0.15}}
    identify_log(make_log(4.0, wheels=False, **loops), tmp_path).save(tmp_path)
    found = om.load_robot(str(tmp_path / "robot.toml")).settings
    lag = nominal_model.compute_lag(SETTINGS.replace(**loops))
    np.testing.assert_allclose(nominal_model.compute_lag(found), lag, rtol=0.15)


def test_commands_alone_identify_creep(tmp_path: Path) -> None:
    result = identify_log(make_log(wheels=False, **OTHER), tmp_path)
    assert result.estimates["commands.creep_stiffness"].value == pytest.approx(3.0, rel=0.1)


@pytest.mark.parametrize("step_rad", [1e-6, 0.1])
def test_unmodeled_motion_is_a_misfit(step_rad: float, tmp_path: Path) -> None:
    """The robot oscillates by 12 mm at 1.1 Hz, which is 0.6 m/s^2, or the log may be too coarse."""
    log = make_log(commands=False)
    log["x_m"] += 0.012 * np.sin(2 * np.pi * 1.1 * log["time_s"])
    log |= {name: np.round(log[name] / step_rad) * step_rad for name in WHEELS}
    result = identify_log(log, tmp_path)
    assert any("lacks a property" in line for line in result.misfits)
    assert all(("too coarse" in line) == (step_rad == 0.1) for line in result.misfits)


def test_a_folder_with_numbers_is_complete(tmp_path: Path) -> None:
    """Nothing is written for NaN, and numbers not before the robot's file."""
    start = om.load_scenario("rect")
    estimate = Estimate("arm_m", "wheels", 0.08, np.nan, np.nan, np.nan, None, True)
    with pytest.raises(ValueError, match="not JSON compliant"):
        IdentificationResult(start, [], {"wheels.arm_m": estimate}).save(tmp_path)
    assert not list(tmp_path.iterdir())
    (tmp_path / "robot.toml").mkdir()
    with pytest.raises(OSError, match=r"robot\.toml"):
        IdentificationResult(start, []).save(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["robot.toml"]


def test_slow_motion_does_not_identify_creep(tmp_path: Path) -> None:
    """At 0.4 m/s and 0.8 m/s^2 the reason is reported."""
    result = identify_log(make_log(speed=0.4, acceleration=0.8, commands=False), tmp_path)
    creep = result.estimates["wheels.creep_stiffness"]
    assert "it needs 1 m/s and 1 m/s^2" in (creep.why_not or "")
    assert creep.report()["value"] is None
    assert result.estimates["wheels.radius_m"].value == pytest.approx(
        SETTINGS.wheels.radius_m, rel=0.15
    )


def test_motion_along_one_axis_does_not_identify_the_other(tmp_path: Path) -> None:
    time = np.arange(360) / 60
    speed, pose = (
        0.6 * np.sin(3 * time),
        np.random.default_rng(0).normal(size=(360, 3)) * [0.0013, 0.0013, 0.003],
    )
    pose[:, 0] += np.concatenate([[0.0], np.cumsum(speed)[:-1]]) / 60
    wheels = SETTINGS.wheels.kinematics.wheel_speeds(np.stack([speed, 0 * speed, 0 * speed], 1))
    names = ("time_s", *POSE, *(f"{name}_s" for name in WHEELS))
    result = identify_log(dict(zip(names, [time, *pose.T, *wheels.T], strict=True)), tmp_path)
    assert result.estimates["wheels.gain_forward"].is_identified
    assert "moves sideways at 0.0" in (result.estimates["wheels.gain_sideways"].why_not or "")
    assert "turns at 0.0" in (result.estimates["wheels.gain_turning"].why_not or "")


def slow(seconds: float = 40.0) -> Columns:
    """Return a slow log at 25 Hz: wheels 4 % and arm 2 % smaller, clock offset 70 ms."""
    dense, t = np.arange(-1.0, seconds + 1.0, 1e-3), np.arange(0.0, seconds, 1 / 25)
    vx, vy, w = 0.2 * np.sin(1.1 * dense), 0.15 * np.sin(1.7 * dense + 1), 0.5 * np.sin(0.7 * dense)
    heading = np.cumsum(w) * 1e-3
    path = np.cumsum((vx + 1j * vy) * np.exp(1j * heading)) * 1e-3
    speeds = SETTINGS.wheels.kinematics.wheel_speeds(np.stack([vx, vy, 0.98 * w], 1) / 0.96)
    encoder_time = t + 0.07
    noise = np.random.default_rng(0).normal(size=(3, len(t))) * 5e-4
    poses = [
        np.interp(t, dense, c) + n
        for c, n in zip((path.real, path.imag, heading), noise, strict=True)
    ]
    angles = [np.interp(encoder_time, dense, np.cumsum(s) * 1e-3) for s in speeds.T]
    return dict(zip(("time_s", *POSE, *WHEELS), [t, *poses, *angles], strict=True))


def test_wheels_identify_radius_arm_and_clock_offset(tmp_path: Path) -> None:
    """Within 0.5 % to 1 %, and 10 ms."""
    result = identify_log(slow(), tmp_path)
    for name, value, within in (
        ("radius_m", 0.96 * SETTINGS.wheels.radius_m, {"rel": 0.005}),
        ("arm_m", 0.98 * SETTINGS.wheels.arm_m, {"rel": 0.01}),
        ("gain_forward", 0.96, {"rel": 0.005}),
        ("clock_offset_s", 0.07, {"abs": 0.01}),
    ):
        assert result.estimates[f"wheels.{name}"].value == pytest.approx(value, **within), name
    assert not result.estimates["wheels.creep_stiffness"].is_identified
    assert not result.misfits


def test_encoders_may_be_logged_more_often_than_poses(tmp_path: Path) -> None:
    """Wheels at 480 Hz and poses at 60 Hz give the same creep stiffness."""
    log = make_log(commands=False)
    time = np.arange(0, log["time_s"][-1], 1 / 480)
    columns = {"time_s": time}
    for name in WHEELS:
        columns[name] = np.interp(time, log["time_s"], log[name])
    for name in POSE:
        has_pose = np.arange(len(time)) % 8 == 0
        columns[name] = np.where(has_pose, np.repeat(log[name], 8)[: len(time)], np.nan)
    creep = identify_log(columns, tmp_path).estimates["wheels.creep_stiffness"]
    assert creep.is_identified
    assert creep.value == pytest.approx(CREEP_STIFFNESS, abs=4 * creep.standard_error)


def test_logs_that_were_resampled_at_a_higher_rate_are_identified(tmp_path: Path) -> None:
    """Poses and wheels at 60 Hz, interpolated at 1 kHz, give creep stiffness within 6 %."""
    log = make_log(commands=False)
    time = np.arange(0, log["time_s"][-1], 1e-3)
    columns = {name: np.interp(time, log["time_s"], values) for name, values in log.items()}
    creep = identify_log(columns, tmp_path).estimates["wheels.creep_stiffness"]
    assert creep.value == pytest.approx(CREEP_STIFFNESS, rel=0.06)


def test_a_carried_robot_and_false_detections_are_cut_out(tmp_path: Path) -> None:
    """Carried 1 m with resting wheels; one false detection; 0.2 s at the origin."""
    log = make_log(commands=False)
    carry = np.interp(np.arange(180), [30, 150], [0.0, 1.0])
    columns: Columns = {}
    for name, values in log.items():
        moved = carry if name == "x_m" else 0 * carry
        parts = [values[:200], values[200] + moved, values[200:] + moved[-1]]
        columns[name] = np.concatenate(parts)
    columns["time_s"] = np.arange(len(columns["x_m"])) / 60
    columns["y_m"][100] += 1.5
    for name in POSE:
        columns[name][480:492] = 0.0
    result = identify_log(columns, tmp_path)
    (remark,) = (line for line in result.remarks if "cut out" in line)
    assert remark.count(" to ") == 3
    assert not result.misfits
    creep = result.estimates["wheels.creep_stiffness"]
    assert creep.value == pytest.approx(CREEP_STIFFNESS, rel=0.06)
    assert creep.standard_error < 0.03 * CREEP_STIFFNESS


def test_estimates_beyond_the_limits_of_settings_are_not_written() -> None:
    """At most 2 for a gain, at least 0.02 m for an arm, at most 600 frames for a dead time."""
    for name, value, is_written in (
        ("commands.gain_forward", 1.9, True),
        ("commands.gain_forward", 2.1, False),
        ("wheels.arm_m", 0.03, True),
        ("wheels.arm_m", 0.01, False),
        ("commands.dead_time_s", 9.9, True),
        ("commands.dead_time_s", 10.1, False),
    ):
        source, parameter = name.split(".")
        estimate = Estimate(parameter, source, value, 0.0, value, value, None, False)
        assert bool(list_changes({name: estimate}, [])) == is_written, (name, value)


def test_false_detections_all_over_a_log_give_one_line(tmp_path: Path) -> None:
    """Ten per second at 500 Hz, with a margin of 0.1 s around each: no pose remains."""
    log = {name: values[:180] for name, values in make_log(wheels=False).items()}
    time = np.arange(0, log["time_s"][-1], 1 / 500)
    columns = {name: np.interp(time, log["time_s"], values) for name, values in log.items()}
    columns["x_m"][25::50] += 3.0
    with pytest.raises(om.OmniError, match="0 lines with a pose are too few") as error:
        identify_log(columns, tmp_path)
    assert str(error.value).count("\n") == 0


@pytest.mark.parametrize(
    ("noise_m", "step_m"), [(1.0, 0.01), (1.0, 0.05), (0.0, 1e-6), (0.0, 1e-3), (0.0, 0.01)]
)
def test_coarse_poses_give_true_numbers(noise_m: float, step_m: float, tmp_path: Path) -> None:
    """Positions and headings with noise or without, rounded: within four standard errors."""
    log = make_log(commands=False)
    if not noise_m:
        log |= {name: make_log(noise=False)[name] for name in POSE}
    log |= {name: np.round(log[name] / step_m) * step_m for name in POSE}
    result = identify_log(log, tmp_path)
    result.save(tmp_path)
    for name, truth in (("creep_stiffness", CREEP_STIFFNESS), ("arm_m", SETTINGS.wheels.arm_m)):
        estimate = result.estimates[f"wheels.{name}"]
        assert estimate.is_identified
        assert abs(estimate.value - truth) < 4 * estimate.standard_error, name
    assert not any("times the noise" in (e.why_not or "") for e in result.estimates.values())


def swapped(log: Columns, name: str, other_name: str) -> Columns:
    return log | {name: log[other_name], other_name: log[name]}


MIRRORED = "x or y is mirrored, or they are swapped"
WRONG: dict[str, tuple[Callable[[Columns], Columns], str]] = {
    "wheel 2": (lambda log: log | {WHEELS[1]: -log[WHEELS[1]]}, "wheel 2 turns the other way"),
    "wheels 1 and 2": (lambda log: swapped(log, WHEELS[0], WHEELS[1]), "turn as 2, 1, 3, 4 of"),
    "all wheels": (
        lambda log: log | {name: -log[name] for name in WHEELS},
        "wheels 1, 2, 3, 4 turn the other way",
    ),
    "a dead encoder": (lambda log: log | {WHEELS[2]: 0 * log[WHEELS[2]]}, "turn as 1, 2, 0, 4 of"),
    "one gear": (
        lambda log: log | {WHEELS[0]: 2 * log[WHEELS[0]]},
        "wheel 1 turns (1.9|2|2.1) times as fast",
    ),
    "gear": (lambda log: log | {name: 3 * log[name] for name in WHEELS}, "wheels behind the gear"),
    "headings by 180 degrees": (
        lambda log: log | {"heading_rad": log["heading_rad"] + np.pi},
        "rotated by -?1[78]. degrees from the wheels",
    ),
    "three wheels": (
        lambda log: {k: v for k, v in log.items() if k != WHEELS[3]},
        "3 wheels, but the robot's file has 4",
    ),
    "axes": (lambda log: swapped(log, "x_m", "y_m"), MIRRORED),
    "headings": (
        lambda log: log | {"heading_rad": -log["heading_rad"]},
        "if headings turn clockwise",
    ),
}
BAD: dict[str, tuple[Callable[[Columns], Columns], str]] = {
    "cm": (
        lambda c: c | {"x_m": 100 * c["x_m"], "y_m": 100 * c["y_m"]},
        "times as fast as the commands say",
    ),
    "degrees": (
        lambda c: c | {"heading_rad": np.degrees(c["heading_rad"])},
        "turns .* as fast as the commands say",
    ),
    "swapped": (lambda c: swapped(c, *COMMAND[:2]), MIRRORED),
    "clockwise": (lambda c: c | {"heading_rad": -c["heading_rad"]}, "headings turn clockwise"),
    "turned": (lambda c: c | {"x_m": -c["x_m"], "y_m": -c["y_m"]}, "rotated by -?1[78]. degrees"),
    "body": (
        lambda c: {k.replace("world", "body"): v for k, v in c.items()},
        "along the field's axes",
    ),
    "another robot's": (
        lambda c: c | {name: c[name][::-1] for name in COMMAND},
        "are they this robot's",
    ),
    "short": (lambda c: {k: v[:100] for k, v in c.items()}, "too few to identify anything"),
    "time in ms": (lambda c: c | {"time_s": 1e3 * c["time_s"]}, "did you mean time_ms"),
}


@pytest.mark.parametrize(
    ("cases", "kind"), [*(("wheels", k) for k in WRONG), *(("commands", k) for k in BAD)]
)
def test_wrong_units_axes_and_wheels_give_one_line(cases: str, kind: str, tmp_path: Path) -> None:
    damage, message = WRONG[kind] if cases == "wheels" else BAD[kind]
    with pytest.raises(om.OmniError, match=message) as error:
        identify_log(
            damage(make_log(wheels=cases == "wheels", commands=cases == "commands")), tmp_path
        )
    assert str(error.value).count("\n") == 0
