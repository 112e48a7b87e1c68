"""Identification of robots whose truth is known, by a law written apart: within its errors, and misfits named."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from synthetic import Logs, Truth, logs

from omni_control.errors import OmniError
from omni_mj.scenarios.scenario import scenario
from omni_mj.studies.identify import axes, law, motion, suspects
from omni_mj.studies.identify.logs import Log
from omni_mj.studies.identify.predict import first_poses
from omni_mj.studies.identify.segments import cut
from omni_mj.studies.identify.wheels import twists

TRUTHS = [
    Truth(),
    Truth(late=0.08, stiffness=3.0, pile=0.03, rollers=0.05, give=0.02, friction=0.005),
]
SETTINGS = scenario("rect").settings
DRIVEN = 6.0  # s
LEAN = 0.3 + 0.1j  # of the carpet: 1.8 degrees


def log(of: Logs, robot: int) -> Log:
    """One robot's."""
    speeds = np.diff(of.angle[:, robot], axis=0) / np.diff(of.time)[:, None]
    wheels = np.concatenate([speeds, speeds[-1:]])
    return Log("log", of.time, of.pose[:, robot], of.command[:, robot], False, wheels)


@cache
def driven() -> Logs:
    return logs(SETTINGS, TRUTHS, DRIVEN, seed=1, speed=2.2, lean=LEAN)


@cache
def rolled(robot: int) -> motion.Part:
    part = motion.by_wheels([log(driven(), robot)], SETTINGS)
    assert part is not None
    return part


@cache
def commanded(robot: int) -> motion.Part:
    """By commands alone."""
    part = motion.by_commands([log(driven(), robot)], SETTINGS, None)
    assert part is not None
    return part


def told(part: motion.Part | None) -> dict[str, tuple[float, float]]:
    assert part is not None
    return {e.name: (e.value, e.error) for e in part.estimates}


@pytest.mark.parametrize("robot", range(len(TRUTHS)))
def test_a_robot_comes_out_of_its_log(robot: int) -> None:
    """Within four standard errors, and creep within 10 %, latency 0.3 frame: from a start that has other numbers."""
    truth, one = TRUTHS[robot], log(driven(), robot)
    by_wheels = told(rolled(robot))
    by_commands = told(motion.by_commands([one], SETTINGS, rolled(robot).fitted))
    assert not rolled(robot).fitted.misfit
    assert not rolled(robot).odd
    for found, name, value in (
        (by_wheels, "creep_stiffness", truth.stiffness),
        (by_wheels, "arm_m", SETTINGS.wheels.arm_m),
        (by_wheels, "clock_s", 0.0),
        (by_wheels, "slope_x_rad", LEAN.real / 9.81),
        (by_wheels, "slope_y_rad", LEAN.imag / 9.81),
        (by_commands, "latency_s", truth.late),
        (by_commands, "stiffness_n_s_m", SETTINGS.body.mass_kg / truth.give),
    ):
        assert abs(found[name][0] - value) < 4 * found[name][1], name
    assert by_wheels["creep_stiffness"][0] == pytest.approx(truth.stiffness, rel=0.1)
    assert by_commands["latency_s"][0] == pytest.approx(truth.late, abs=0.3 / 60)
    directions = SETTINGS.wheels.kinematics.matrix
    lag = truth.give / (directions[:, 0] ** 2).sum()  # and what rotors add, 2 ms
    assert by_commands["lag_forward_s"][0] == pytest.approx(lag, abs=0.004)


def test_commands_alone_tell_creep_too() -> None:
    found = told(commanded(1))
    assert found["creep_stiffness"][0] == pytest.approx(TRUTHS[1].stiffness, rel=0.1)


@pytest.mark.parametrize("wheel", [0, 2])
def test_a_wheel_whose_angle_is_wrong_is_named(wheel: int) -> None:
    """An encoder that shows 2 % too much: its rim goes 2 % less than it says, within four standard errors."""
    part, body = rolled(0), law.Body.of(SETTINGS)
    scale = np.ones(4)
    scale[wheel] = 1.02
    segments = replace(part.segments, inputs=part.segments.inputs * scale, summed=part.segments.summed * scale)
    (line,) = suspects.odd_rims(part.fitted, body, segments)
    found = re.match(rf"wheel {wheel + 1}: it goes (\S+) \+- (\S+) %", line)
    assert found
    assert abs(float(found[1]) + 2) < 4 * float(found[2])


@pytest.mark.parametrize("lacks", ["push", "weak"])
def test_what_the_law_lacks_is_a_misfit(lacks: str) -> None:
    """Accelerations of 0.6 m/s^2 that swing at 1.1 Hz; or one wheel whose creep is five times the others'."""
    of = logs(SETTINGS, TRUTHS[:1], 4.6, seed=3, **({"push": 0.6} if lacks == "push" else {"weak": 0.2}))
    part = motion.by_wheels([log(of, 0)], SETTINGS)
    assert part is not None
    assert part.fitted.misfit


def test_slow_data_do_not_tell_creep() -> None:
    """As of a robot in a laboratory: 0.4 m/s and 0.8 m/s^2. Creep is not told, and it says why."""
    of = logs(SETTINGS, TRUTHS[:1], DRIVEN, seed=4, speed=0.4, pull=0.8)
    part = motion.by_wheels([log(of, 0)], SETTINGS)
    assert part is not None
    found = {e.name: e for e in part.estimates}
    assert "it needs 1 m/s and 1 m/s^2" in (found["creep_stiffness"].why_not or "")
    assert found["creep_stiffness"].report()["value"] is None
    assert "--plan" in found["creep_stiffness"].would_tell
    assert found["radius_m"].value == pytest.approx(SETTINGS.wheels.radius_m, rel=0.15)  # less what drag creeps, K


def test_motion_along_one_axis_tells_nothing_of_the_other() -> None:
    one = log(driven(), 0)
    lines, rate = len(one.time), 60.0
    speed = 0.6 * np.sin(3 * np.arange(lines) / rate)
    pose = np.zeros((lines, 3))
    pose[:, 0] = np.concatenate([[0.0], np.cumsum(speed)[:-1]]) / rate
    pose += np.random.default_rng(0).normal(size=pose.shape) * [0.0013, 0.0013, 0.003]
    wheels = SETTINGS.wheels.kinematics.wheel_speeds(np.stack([speed, 0 * speed, 0 * speed], 1))
    part = motion.by_wheels([Log("log", one.time, pose, None, False, wheels)], SETTINGS)
    assert part is not None
    found = {e.name: e for e in part.estimates}
    assert found["gain_forward"].told
    assert "the robot moves sideways at 0.0" in (found["gain_sideways"].why_not or "")
    assert "the robot turns at 0.0" in (found["gain_turning"].why_not or "")


def test_what_was_found_predicts_what_was_not_fitted_to() -> None:
    """Stretches held out are after those fitted to; the law's own error is that of a parabola through noise, 8 mm."""
    used, held = cut([log(driven(), 1)], [driven().command[:, 1]], [False]).held_out()
    assert held.time.min() > used.time.max()
    part = commanded(1)
    assert part.prediction is not None
    assert part.prediction.identified < 0.008
    assert part.prediction.start > 1.5 * part.prediction.identified


def test_a_first_look_finds_delay_and_axes() -> None:
    one = log(driven(), 0)
    assert one.command is not None
    seen = axes.look(one, one.command, False, "commands")
    assert TRUTHS[0].late < seen.delay < TRUTHS[0].late + 0.15  # latency, lag, and creep
    assert seen.follows > 0.8
    assert seen.turning == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda p: p[:, [1, 0, 2]], "x and y are swapped"),
        (lambda p: p * [1, -1, 1], "y is mirrored"),
        (lambda p: p * [-1, 1, 1], "x is mirrored"),
    ],
)
def test_other_axes_of_the_field_are_seen_by_wheels_of_a_robot_that_turns(
    spoil: Callable[[np.ndarray], np.ndarray], says: str
) -> None:
    """Along the robot's own axes, such motion is another in each heading."""
    one = log(driven(), 0)
    assert one.wheels is not None
    with pytest.raises(OmniError, match=says):
        axes.look(replace(one, pose=spoil(one.pose)), twists(one, SETTINGS), True, "wheels")


def test_a_log_that_is_too_short_for_any_stretch_has_none() -> None:
    one = log(driven(), 0)
    assert one.command is not None
    assert not len(cut([one.part(slice(0, 20))], [one.command[:20]], [False]))


@pytest.mark.parametrize("wheels", [True, False])
def test_half_the_step_gives_the_same(wheels: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The solver is of second order: within a quarter of the noise, 0.3 mm over 3/4 s."""
    one, body = log(driven(), 0), law.Body.of(SETTINGS)
    assert one.wheels is not None
    assert one.command is not None
    segments = cut([one], [one.wheels if wheels else one.command], [wheels], wheels)
    parameters = (motion.of_wheels if wheels else motion.of_commands)(SETTINGS)[None]
    start, late = first_poses(segments)[:, None, 1:].real, np.full((len(segments), 1), 0.0 if wheels else 0.1)
    coarse = law.simulate(body, segments, parameters, late, start)
    monkeypatch.setattr(law, "COARSEST_S", law.COARSEST_S / 4)
    fine = law.simulate(body, segments, parameters, late, start)
    assert np.sqrt((np.abs(coarse.way - fine.way) ** 2).mean()) < 3e-4
