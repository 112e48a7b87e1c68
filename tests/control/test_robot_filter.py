"""Laws of the filter that the adaptive controllers share: its model, what it finds, and what it must not learn."""

import math

import numpy as np
import pytest
from benches.control import (
    CENTER_HEIGHT_M,
    CREEP,
    DISTURBANCE,
    INVERSE_GAIN,
    LAG,
    LATENCY,
    Array,
    MotionModel,
    RobotEkf,
    WheelCompliance,
    anticipate,
)
from closed_loop import NOISE, WHEELS, CreepingPlant, T
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from omni_control import CommandHistory, Kinematics, Observation, TeamModel

KNOWN = {"lag_s": 0.0267, "creep_s2_m": 0.06, "drag_m_s": 0.0375, "alpha": (0.92, 0.87)}
PLAIN = TeamModel(
    T, 6, lag_s=0.04, creep_s2_m=0.06, drag_m_s=0.0, alpha=(0.9, 0.8)
)  # no geometry, no coupling of turning
number = st.floats(-1, 1)


def filter_of(model: TeamModel, n: int = 1) -> RobotEkf:
    return RobotEkf(model, n, tuple(NOISE))


@given(st.tuples(*[number] * 5))
def test_a_step_is_the_solution_of_the_law(drawn: tuple[float, ...]) -> None:
    """(tau + g^2 T |v|) v' = u - g v in the body's axes; |v| is that at the beginning of each of many steps."""
    model, fine = MotionModel(PLAIN), 64
    state = model.prior.copy()[None]
    state[0, 3:5], command = drawn[:2], np.array([[*drawn[2:4], 0.0]])
    gain, ratio = model.prior[INVERSE_GAIN], np.array([1.0, 5 / 3])

    def law(_: float, z: Array) -> Array:
        late = model.prior[LAG] * ratio + gain[:2] ** 2 * model.prior[CREEP] * ratio * np.hypot(
            *z[2:]
        )
        return np.concatenate([z[2:], (command[0, :2] - gain[:2] * z[2:]) / late])

    true = solve_ivp(law, (0, T), [0, 0, *state[0, 3:5]], rtol=1e-10, atol=1e-12).y[:, -1]
    for _ in range(fine):
        state = model.step(state, command, T / fine)
    np.testing.assert_allclose(state[0, 3:5], true[2:], rtol=0, atol=4e-3)
    np.testing.assert_allclose(state[0, :2], true[:2], rtol=0, atol=4e-5)


@given(st.tuples(*[number] * 7))
def test_the_inverse_leads_from_one_velocity_to_another(drawn: tuple[float, ...]) -> None:
    """With all that the law knows, but for friction where motions are slow, and loads that follow the real command."""
    model = MotionModel(TeamModel(T, 6, geometry=WHEELS, **{**KNOWN, "drag_m_s": 0.0}))  # type: ignore[arg-type]
    before = np.array([[2 * drawn[0], 2 * drawn[1], 0.0]])
    after = before + 0.05 * np.array([[drawn[2], drawn[3], 0.0]])
    heading = np.array([3 * drawn[4]])
    command = model.invert(model.prior[None], before, after, heading)
    state = model.prior.copy()[None]
    state[0, 2], state[0, 3:6] = heading[0], before[0]
    reached = model.step(state, command, T)[0, 3:6]
    np.testing.assert_allclose(reached[:2], after[0, :2], rtol=0, atol=1e-9)
    assert abs(reached[2]) < 0.02


def identify(
    model: TeamModel, robots: CreepingPlant, frames: int, seed: int = 0, tail: int = 0
) -> RobotEkf:
    """What is found of robots that weave about, each its own way; in the last `tail` frames nothing is asked."""
    n, rng = len(robots.pose), np.random.default_rng(seed)
    ekf = filter_of(model, n)
    sent = CommandHistory(n, ekf.memory_frames)
    phase, rate = rng.uniform(0, 2 * np.pi, (2, 1, n, 3)) * [1, 1, 1]
    commands = np.array([1.0, 1.0, 2.0]) * np.sin(
        phase + 0.4 * rate * T * np.arange(frames)[:, None, None]
    )
    commands *= np.minimum(np.arange(frames) / 30, 1)[:, None, None]
    commands[frames - tail :] = 0
    for command in commands:
        image = robots.pose + NOISE * rng.standard_normal(robots.pose.shape)
        image[:, 2] = np.angle(np.exp(1j * image[:, 2]))
        ekf.update(
            Observation(
                robots.pose,
                np.zeros((n, 3)),
                image,
                sent.select(slice(None)),
                T,
                model.delay_frames,
            )
        )
        sent.append(command)
        robots.advance(command)
    return ekf


def test_parameters_are_found_and_their_uncertainty_is_honest() -> None:
    """Robots that differ from what is told, within twice the standard deviations that the filter states, on average."""
    truth = {"delay": 7, "creep": 0.075, "lag": 0.025, "alpha": (0.98, 0.92, 0.95)}
    found = identify(
        TeamModel(T, 6, geometry=WHEELS, **KNOWN), CreepingPlant(np.zeros((20, 3)), **truth), 480
    )  # type: ignore[arg-type]
    sigma = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    actual = np.array([1 / 0.98, 1 / 0.92, 1 / 0.95, 7.0, 0.075])
    columns = [11, 12, 13, LATENCY, CREEP]
    off = (found.state[:, columns] - actual) / sigma[:, columns]
    assert (np.sqrt((off**2).mean(0)) < 2.5).all()
    assert (np.abs(found.state[:, columns] - actual).mean(0) < [0.03, 0.04, 0.03, 0.8, 0.02]).all()


def test_what_is_not_shown_is_forgotten() -> None:
    """At rest parameters go back to what is told, with a time constant of 12 s."""
    model, away = TeamModel(T, 6, geometry=WHEELS, **KNOWN), []  # type: ignore[arg-type]
    for tail in (10, 730):
        found = identify(
            model, CreepingPlant(np.zeros((1, 3)), alpha=(1.05, 1.0, 1.0)), 240 + tail, tail=tail
        )
        away.append(abs(found.state[0, 11] - 1 / 0.92))
    assert away[1] == pytest.approx(away[0] * math.exp(-1), rel=0.15)


@pytest.mark.parametrize("hand", [0.05, 0.3, 1.0])
def test_a_robot_that_is_put_elsewhere_has_not_driven_there(hand: float) -> None:
    """It is where it is seen; velocity, what pushes it and its parameters stay."""
    model = TeamModel(T, 6, geometry=WHEELS, **KNOWN)  # type: ignore[arg-type]
    robots = CreepingPlant(np.zeros((1, 3)))
    found = identify(model, robots, 200)
    before = found.state.copy()
    image = robots.pose + np.array([hand, 0, 0])
    image[:, 2] = np.angle(np.exp(1j * image[:, 2]))
    sent = CommandHistory(1, found.memory_frames)
    found.update(Observation(robots.pose, np.zeros((1, 3)), image, sent.select(slice(None)), T, 6))
    np.testing.assert_allclose(found.state[0, :2], image[0, :2], rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.state[0, 9:], before[0, 9:], rtol=0.01, atol=0.01)
    assert np.abs(found.state[0, DISTURBANCE] - before[0, DISTURBANCE]).max() < 0.02


def test_a_row_of_a_batch_is_what_it_is_alone() -> None:
    model = TeamModel(T, 6, geometry=WHEELS, **KNOWN)  # type: ignore[arg-type]

    def found(rows: list[int]) -> Array:
        rng, ekf = np.random.default_rng(0), filter_of(model, len(rows))
        sent, images = (
            CommandHistory(len(rows), ekf.memory_frames),
            rng.normal(0, 0.01, (40, 3, 3)),
        )
        images[rng.random((40, 3)) < 0.1] = np.nan
        for image in images:
            pose = np.zeros((len(rows), 3))
            ekf.update(Observation(pose, pose, image[rows], sent.select(slice(None)), T, 6))
            sent.append(20 * np.nan_to_num(image[rows]))
        return ekf.state

    together = found([0, 1, 2])
    for row in range(3):
        np.testing.assert_array_equal(found([row])[0], together[row])


@given(st.tuples(*[number] * 7), st.floats(0.005, 0.05), st.floats(0.0, 0.1))
def test_compliance_is_the_turn_rate_at_which_the_wheels_have_no_moment(
    drawn: tuple[float, ...], lag: float, creep: float
) -> None:
    """Each wheel gives way by (tau + T |V| / n) f; loads n are those that the weight's lever over four feet leaves."""
    v, w, a, e = (
        2 * complex(*drawn[:2]),
        5 * drawn[2],
        2 * complex(*drawn[3:5]),
        complex(*drawn[5:]),
    )
    feet = 0.083 * np.exp(1j * WHEELS.azimuths)

    def moment(lacking: float) -> float:
        balance = np.array([np.ones(4), feet.real, feet.imag])
        loads = np.linalg.lstsq(
            balance,
            [4, -4 * CENTER_HEIGHT_M / 9.81 * a.real, -4 * CENTER_HEIGHT_M / 9.81 * a.imag],
            rcond=None,
        )
        total = 0.0
        for azimuth, load in zip(WHEELS.azimuths, loads[0], strict=True):
            rim = complex(-math.sin(azimuth), math.cos(azimuth))
            gives = lag + creep * abs(v + w * 0.083 * rim) / max(load, 0.1)
            total += ((rim.conjugate() * e).real + 0.083 * lacking) / gives
        return total

    rows = (np.array([[z.real, z.imag, turn]]) for z, turn in ((v, w), (a, 0.0), (e, 0.0)))
    turned = WheelCompliance(WHEELS, 1.0).compute_turn_rate(
        *rows, np.array([lag]), np.array([creep])
    )
    assert turned[0] == pytest.approx(-brentq(moment, -100, 100, xtol=1e-12), abs=1e-9)


def test_wheels_at_right_angles_turn_nothing_at_a_steady_pace() -> None:
    square = WheelCompliance(
        Kinematics(np.radians([45.0, 135.0, 225.0, 315.0]), 0.083, 0.0285), 1.0
    )
    turned = square.compute_turn_rate(
        np.array([[0.7, 0.4, 0]]),
        np.zeros((1, 3)),
        np.array([[0.4, 1, 0]]),
        np.array([0.02]),
        np.array([0.05]),
    )
    assert turned[0] == pytest.approx(0, abs=1e-12)


STEP = 0.1  # m/s a frame
paths = st.lists(st.tuples(st.floats(-3, 3), st.floats(-3, 3)), min_size=1, max_size=12).map(
    np.array
)


@given(paths)
def test_what_can_be_reached_is_commanded_as_it_is(path: Array) -> None:
    steps = np.diff(path, axis=0, prepend=0.0)
    within = np.cumsum(steps * (0.99 * STEP / max(np.hypot(*steps.T).max(), STEP)), axis=0)
    np.testing.assert_array_equal(anticipate(within[:, None], STEP)[0], within[0])


@given(st.lists(st.floats(-3, 3), min_size=1, max_size=12), st.floats(0, 7))
def test_along_a_line_no_command_misses_less(along: list[float], angle: float) -> None:
    path, direction = np.array(along), np.array([math.cos(angle), math.sin(angle)])
    command = anticipate(path[:, None, None] * direction, STEP)[0]
    assert abs(command @ [-direction[1], direction[0]]) < 1e-12

    def missed(one: float) -> float:
        return float((np.abs(path - one) - STEP * np.arange(len(path))).max())

    assert (
        missed(command @ direction)
        <= min(missed(other) for other in np.linspace(-3, 3, 601)) + 1e-9
    )
