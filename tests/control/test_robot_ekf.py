"""Motion model and extended Kalman filter of a robot, wheel compliance, and slew-rate limits."""

import math
from dataclasses import replace

import numpy as np
import pytest
from benches.control import (
    COM_HEIGHT_M,
    CREEP,
    DEAD_TIME,
    DISTURBANCE,
    FRICTION,
    INVERSE_GAIN,
    LAG,
    POSE,
    STATE_SIZE,
    VELOCITY,
    Array,
    FilterStep,
    MotionModel,
    RobotEkf,
    YawCoupling,
    anticipate,
    compute_contact_speeds,
    wrap_angle,
)
from closed_loop import (
    CONTACT_RATIO,
    NOISE,
    SIDE,
    WHEELS,
    CreepingPlant,
    T,
    compute_creep_speeds,
    to_measured_pose,
)
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from omni_control import CommandHistory, MotionLimits, Observation, TeamModel

MODEL = TeamModel(
    T,
    6,
    lag_s=0.0267,
    creep_s2_m=0.06,
    friction_loss_m_s=0.0375,
    friction=0.0,
    alpha=(0.92, 0.87),
    geometry=WHEELS,
)
FRICTIONLESS = replace(MODEL, friction_loss_m_s=0.0)
# Without geometry, driving does not turn the robot.
UNCOUPLED = replace(FRICTIONLESS, lag_s=0.04, alpha=(0.9, 0.8), geometry=None)
number, small = st.floats(-1, 1), st.floats(-0.1, 0.1)


def make_filter(n: int = 1) -> RobotEkf:
    return RobotEkf(MODEL, n, tuple(NOISE))


def make_observation(pose: Array, measured: Array, sent: CommandHistory) -> Observation:
    return Observation(pose, np.zeros_like(pose), measured, sent.select(slice(None)), T, 6)


# --- motion model ---


@given(st.tuples(*[number] * 5))
def test_a_step_solves_the_equation_of_motion(drawn: tuple[float, ...]) -> None:
    """(tau + g T S(v) g) v' = u - g v in the body's axes; each short step uses its initial S."""
    model, steps = MotionModel(UNCOUPLED), 64
    state = model.prior.copy()[None]
    state[0, 3:5], command = drawn[:2], np.array([[*drawn[2:4], 0.0]])
    gain = model.prior[INVERSE_GAIN]

    def derivative(_: float, z: Array) -> Array:
        creep = model.prior[CREEP] * np.outer(gain[:2], gain[:2])
        lags = model.prior[LAG] * np.diag([1.0, SIDE]) + creep * compute_creep_speeds(
            np.array([[*z[2:], 0.0]])
        )
        return np.concatenate([z[2:], np.linalg.solve(lags[0], command[0, :2] - gain[:2] * z[2:])])

    true = solve_ivp(derivative, (0, T), [0, 0, *state[0, 3:5]], rtol=1e-10, atol=1e-12).y[:, -1]
    for _ in range(steps):
        state = model.step(state, command, T / steps)
    np.testing.assert_allclose(state[0, 3:5], true[2:], rtol=0, atol=4e-3)
    np.testing.assert_allclose(state[0, :2], true[:2], rtol=0, atol=4e-5)


class Brush:
    """Wheels in steady motion along an axis: the traction of each is mu N (1 - (1 - x)^3).

    x is the slip of its rim over that of full sliding (Pacejka, Tire and Vehicle Dynamics).
    """

    def __init__(self, axis: int, friction: float) -> None:
        cosines = np.abs([np.sin(WHEELS.azimuths), np.cos(WHEELS.azimuths)])
        self._rims = cosines[axis]
        # Loads of tigers-v2016 per mass, by statics; creep stiffness 4.35
        limits = friction * 9.81 * np.array([0.293, 0.207, 0.207, 0.293])
        self._forces = limits * self._rims
        self._sliding_slip = (
            3 * friction / 4.35 * np.hypot(self._rims, CONTACT_RATIO * cosines[1 - axis])
        )
        self.limit = float(self._forces.sum())

    def find_slip(self, traction: float) -> float:
        """Return the slip over the speed at a traction per mass, m/s^2."""

        def compute_excess(slip: float) -> float:
            sticking = 1 - np.minimum(self._rims * slip / self._sliding_slip, 1)
            return float((self._forces * (1 - sticking**3)).sum()) - traction

        return float(brentq(compute_excess, 0, 2, xtol=1e-13))


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("utilization", "linear_error"), [(0.6, 0.15), (0.8, 0.35)])
def test_rubber_softens_as_in_a_brush_contact(
    axis: int, utilization: float, linear_error: float
) -> None:
    """Accelerations are right within 10 %; of the linear law, they are too high by `linear_error`.

    The team knows gain and slope of steady driving. Wheels lack speed by their loops, too.
    """
    friction, drag, speed, short = 0.8, (1.2, 1.5), 1.5, 1e-4
    brushes = [Brush(i, friction) for i in (0, 1)]
    slips = [
        [b.find_slip(d + change) for change in (0, short)]
        for b, d in zip(brushes, drag, strict=True)
    ]
    alpha = tuple(1 / (1 + steady) for steady, _ in slips)
    forward, sideways = (
        a**2 * (high - low) / short for a, (low, high) in zip(alpha, slips, strict=True)
    )
    acceleration = utilization * brushes[axis].limit - drag[axis]
    slip = brushes[axis].find_slip(utilization * brushes[axis].limit)
    reached = []
    for assumed_friction in (friction, 0.0):
        known = {"creep_s2_m": forward, "creep_sideways_s2_m": sideways, "alpha": alpha}
        model = MotionModel(replace(UNCOUPLED, **known, lag_s=0.01, friction=assumed_friction))
        state, command = model.prior.copy()[None], np.zeros((1, 3))
        loop_lag = state[0, LAG] * (1.0, SIDE)[axis]
        state[0, 3 + axis] = speed
        command[0, axis] = speed * (1 + slip) + loop_lag * acceleration
        reached.append((model.step(state, command, short)[0, 3 + axis] - speed) / short)
    assert reached[0] == pytest.approx(acceleration, rel=0.1)
    assert reached[1] > (1 + linear_error) * acceleration


@pytest.mark.parametrize("friction", [0.0, 0.8])
@given(st.tuples(*[number] * 7))
def test_the_inverse_leads_from_one_velocity_to_another(
    friction: float, drawn: tuple[float, ...]
) -> None:
    """Exact but for slow friction, loads that follow the real command, and few iterations."""
    model = MotionModel(replace(FRICTIONLESS, friction=friction))
    velocity = np.array([[2 * drawn[0], 2 * drawn[1], 0.0]])
    next_velocity = velocity + 0.05 * np.array([[drawn[2], drawn[3], 0.0]])
    heading = np.array([3 * drawn[4]])
    command = model.invert(model.prior[None], velocity, next_velocity, heading)
    state = model.prior.copy()[None]
    state[0, 2], state[0, 3:6] = heading[0], velocity[0]
    reached = model.step(state, command, T)[0, 3:6]
    tolerance = 1.5e-3 if friction else 1e-9
    np.testing.assert_allclose(reached[:2], next_velocity[0, :2], rtol=0, atol=tolerance)
    assert abs(reached[2]) < 0.02


@given(
    drive=st.tuples(small, small),
    velocity=st.tuples(small, small),
    lag=st.floats(0.005, 0.05),
    friction=st.floats(0.05, 0.15),
)
def test_dry_friction_stops_a_robot_but_does_not_reverse_it(
    drive: tuple[float, ...], velocity: tuple[float, ...], lag: float, friction: float
) -> None:
    """A body's velocity with friction is between zero and that without, per axis."""
    model = MotionModel(replace(UNCOUPLED, creep_s2_m=0.0))
    states = np.tile(model.prior, (2, 1))
    states[:, 3:5], states[:, LAG], states[:, FRICTION] = velocity, lag, [friction, 0.0]
    slow, free = model.step(states, np.array([[*drive, 0.0]]), T)[:, 3:5]
    assert (slow * free >= -1e-15).all()
    assert (np.abs(slow) <= np.abs(free) + 1e-15).all()


# --- filter ---


def identify(robots: CreepingPlant, frames: int, rest_frames: int = 0) -> RobotEkf:
    """Return the filter after robots wove about, each on its own path, and then rested."""
    n, rng = len(robots.pose), np.random.default_rng(0)
    ekf = make_filter(n)
    sent = CommandHistory(n, ekf.memory_frames)
    phase, rate = rng.uniform(0, 2 * np.pi, (2, 1, n, 3))
    angle = phase + 0.4 * rate * T * np.arange(frames)[:, None, None]
    commands = np.array([1.0, 1.0, 2.0]) * np.sin(angle)
    commands *= np.minimum(np.arange(frames) / 30, 1)[:, None, None]
    commands[frames - rest_frames :] = 0
    for command in commands:
        measured = to_measured_pose(robots.pose + NOISE * rng.standard_normal((n, 3)))
        ekf.update(make_observation(robots.pose, measured, sent))
        sent.append(command)
        robots.advance(command)
    return ekf


def test_parameters_are_found_and_their_uncertainty_is_honest() -> None:
    """Errors are within 2.5 of the filter's standard deviations (rms) for a wrong model."""
    alpha = 0.98, 0.92, 0.95
    robots = CreepingPlant(np.zeros((20, 3)), delay=7, creep=0.075, lag=0.025, alpha=alpha)
    ekf = identify(robots, 480)
    sigma = np.sqrt(np.diagonal(ekf.covariance, axis1=1, axis2=2))
    true = np.array([1 / 0.98, 1 / 0.92, 1 / 0.95, 7.0, 0.075])
    columns = [11, 12, 13, DEAD_TIME, CREEP]
    error = ekf.state[:, columns] - true
    normalized = error / sigma[:, columns]
    assert (np.sqrt((normalized**2).mean(0)) < 2.5).all()
    assert (np.abs(error).mean(0) < [0.03, 0.04, 0.03, 0.8, 0.02]).all()


@pytest.mark.parametrize("offset", [-0.05, -0.01, 0.0, 0.01])
def test_the_covariance_after_a_late_image_is_the_textbook_s(offset: float) -> None:
    """P - P H' (H P H' + R)^-1 H P with H = [I, t I, 0], t the time from state to capture.

    P is the covariance of the same filter without that image.
    """
    filters, sent = (make_filter(2), make_filter(2)), CommandHistory(2, 40)
    step = FilterStep(np.zeros(2), np.zeros(2, bool), np.full(2, offset))
    for frame in range(60):
        sent.append(np.tile([np.sin(frame / 7), 0.5, np.cos(frame / 9)], (2, 1)))
        pose = np.tile(frame * T * np.array([0.3, 0.2, 0.1]), (2, 1))
        for is_late, ekf in enumerate(filters):
            is_last = frame == 59
            measured = np.full((2, 3), np.nan) if is_last and not is_late else pose
            observation = make_observation(pose, measured, sent)
            if is_last:
                observation = replace(observation, filter_steps=(step,))
            ekf.update(observation)
    prior, posterior = (ekf.covariance for ekf in filters)
    h = np.zeros((3, STATE_SIZE))
    h[:, POSE], h[:, VELOCITY] = np.eye(3), offset * np.eye(3)
    cross = prior @ h.T
    noise = np.diag(np.square(NOISE))
    expected = prior - cross @ np.linalg.solve(h @ cross + noise, cross.swapaxes(1, 2))
    np.testing.assert_allclose(posterior, expected, rtol=0, atol=1e-12)
    assert np.abs(posterior - prior).max() > 1e-7


@pytest.mark.parametrize("offset", [-0.02, 0.02])
def test_a_late_heading_is_corrected_once(offset: float) -> None:
    """The state is that of its own time, whenever the robot's turn was measured."""
    ekf, sent = make_filter(), CommandHistory(1, 40)
    step = FilterStep(np.zeros(1), np.zeros(1, bool), np.array([offset]))
    rate = np.array([[0.0, 0.0, 2.0]])
    for frame in range(120):
        sent.append(rate / [1, 1, 0.98])
        measured = to_measured_pose(rate * (frame * T + offset))
        ekf.update(replace(make_observation(0 * rate, measured, sent), filter_steps=(step,)))
    assert wrap_angle(ekf.state[0, 2] - 2.0 * frame * T) == pytest.approx(0, abs=0.004)


def drive_straight(command: Array, limits: MotionLimits) -> RobotEkf:
    """Return the filter after commands forward (frames,) moved a robot with the gain 0.7."""
    ekf = RobotEkf(replace(MODEL, limits=limits), 1, tuple(NOISE))
    sent = CommandHistory(1, ekf.memory_frames)
    robot = CreepingPlant(np.zeros((1, 3)), 6, alpha=(0.7, 0.87, 0.98))
    for speed in command:
        ekf.update(make_observation(robot.pose, robot.pose, sent))
        twist = np.array([[speed, 0.0, 0.0]])
        sent.append(twist)
        robot.advance(twist)
    return ekf


def test_no_gain_is_learned_while_the_limiter_acts() -> None:
    """The robot accelerates at the limit of commands, or just below it."""
    ramp = 1.5 * T * np.arange(60)
    gains = [
        drive_straight(ramp, MotionLimits(3.0, acceleration, 26.0, 50.8)).state[0, INVERSE_GAIN]
        for acceleration in (1.5, 1.51)
    ]
    np.testing.assert_allclose(gains[0], 1 / np.array([*MODEL.alpha, 0.98]), rtol=0, atol=1e-12)
    assert gains[1][0] > gains[0][0] + 0.02


def test_gains_are_learned_more_slowly_in_hard_acceleration() -> None:
    """The command swings by 1 m/s about its mean, or not at all.

    The speed swings by 0.3 m/s, which alone costs a factor of 3 in the variance.
    """
    limits = MotionLimits(10.0, 1000.0, 26.0, 50.8)
    swing = 2 + np.sign(np.sin(np.arange(60) * np.pi / 4 + 0.1))
    variances = [
        drive_straight(command, limits).covariance[0, 11, 11] for command in (swing, 2 + 0 * swing)
    ]
    assert variances[0] > 5 * variances[1]


def test_a_hard_braking_robot_was_not_carried() -> None:
    """Measured without noise, wheels that stop dead look like a jump. The velocity follows it."""
    ekf, sent = RobotEkf(MODEL, 1, (1e-4, 1e-4, 1e-3)), CommandHistory(1, 40)
    braking = 9.8 * T**2  # by friction with a coefficient of 1
    for frame in range(90):
        velocity = ekf.state[0, VELOCITY].copy()
        measured = np.array([[2.0 * frame * T - braking * (frame == 89), 0.0, 0.0]])
        ekf.update(make_observation(measured, measured, sent))
        sent.append(np.array([[2.0 / 0.92 + 0.05, 0.0, 0.0]]))
    assert ekf.state[0, VELOCITY][0] < velocity[0] - 0.03


def test_unobservable_parameters_are_forgotten() -> None:
    """At rest they return to the model with a time constant of 12 s."""
    errors = []
    for rest_frames in (10, 730):
        robots = CreepingPlant(np.zeros((1, 3)), alpha=(1.05, 1.0, 1.0))
        ekf = identify(robots, 240 + rest_frames, rest_frames)
        errors.append(abs(ekf.state[0, 11] - 1 / 0.92))
    assert errors[1] == pytest.approx(errors[0] * math.exp(-1), rel=0.15)


@pytest.mark.parametrize("distance", [0.05, 0.3, 1.0])
def test_a_robot_that_is_carried_has_not_driven_there(distance: float) -> None:
    """It is where it is seen. Its disturbance and parameters stay."""
    robots = CreepingPlant(np.zeros((1, 3)))
    ekf = identify(robots, 200)
    state = ekf.state.copy()
    measured = to_measured_pose(robots.pose + np.array([distance, 0, 0]))
    ekf.update(make_observation(robots.pose, measured, CommandHistory(1, ekf.memory_frames)))
    np.testing.assert_allclose(ekf.state[0, :2], measured[0, :2], rtol=0, atol=1e-6)
    np.testing.assert_allclose(ekf.state[0, 9:], state[0, 9:], rtol=0.01, atol=0.01)
    assert np.abs(ekf.state[0, DISTURBANCE] - state[0, DISTURBANCE]).max() < 0.02


# --- wheel compliance ---


@given(st.tuples(*[number] * 7), st.floats(0.005, 0.05), st.floats(0.0, 0.1))
def test_compliance_is_the_turn_rate_at_which_the_wheels_have_no_moment(
    drawn: tuple[float, ...], lag: float, creep: float
) -> None:
    """Each wheel yields by (tau + T |V|_c / n) f; statics of four feet gives the loads n.

    |V|_c is the speed through an elliptic contact, relative to its mean in forward motion.
    """
    velocity, turn_rate = 2 * complex(*drawn[:2]), 5 * drawn[2]
    acceleration, deficit = 2 * complex(*drawn[3:5]), complex(*drawn[5:])
    feet = 0.083 * np.exp(1j * WHEELS.azimuths)
    shift = -4 * COM_HEIGHT_M / 9.81 * acceleration
    balance = np.array([np.ones(4), feet.real, feet.imag])
    loads = np.linalg.lstsq(balance, [4, shift.real, shift.imag], rcond=None)[0]

    def contact_speed(azimuth: float, velocity: complex, turn_rate: float) -> float:
        axle, rim = (velocity * np.exp(-1j * azimuth)).real, (velocity * np.exp(-1j * azimuth)).imag
        return float(np.hypot(CONTACT_RATIO * axle, rim + 0.083 * turn_rate))

    squares = np.sin(WHEELS.azimuths) ** 2
    speeds = [contact_speed(azimuth, 1.0, 0.0) for azimuth in WHEELS.azimuths]
    forward_speed = squares.sum() / (squares / speeds).sum()

    def moment(turn_deficit: float) -> float:
        total = 0.0
        for azimuth, load in zip(WHEELS.azimuths, loads, strict=True):
            rim = complex(-math.sin(azimuth), math.cos(azimuth))
            speed = contact_speed(azimuth, velocity, turn_rate) / forward_speed
            compliance = lag + creep * speed / max(load, 0.1)
            total += ((rim.conjugate() * deficit).real + 0.083 * turn_deficit) / compliance
        return total

    state = np.zeros((1, STATE_SIZE))
    state[:, [LAG, CREEP]] = lag, creep
    twist, *vectors = (
        np.array([[z.real, z.imag, turn]])
        for z, turn in ((velocity, turn_rate), (acceleration, 0.0), (deficit, 0.0))
    )
    contact_speeds = compute_contact_speeds(WHEELS, twist)
    result = YawCoupling(WHEELS, 1.0).compute_turn_rate(state, contact_speeds, *vectors)
    assert result[0] == pytest.approx(-brentq(moment, -100, 100, xtol=1e-12), abs=1e-9)


# --- slew-rate limits ---

STEP = 0.1  # m/s a frame
points = st.tuples(st.floats(-3, 3), st.floats(-3, 3))
paths = st.lists(points, min_size=1, max_size=12).map(np.array)


@given(paths)
def test_reachable_commands_are_not_changed(path: Array) -> None:
    steps = np.diff(path, axis=0, prepend=0.0)
    within = np.cumsum(steps * (0.99 * STEP / max(np.hypot(*steps.T).max(), STEP)), axis=0)
    np.testing.assert_array_equal(anticipate(within[:, None], STEP)[0], within[0])


@given(st.lists(st.floats(-3, 3), min_size=1, max_size=12), st.floats(0, 7))
def test_no_command_on_a_line_has_a_smaller_deviation(line: list[float], angle: float) -> None:
    path, direction = np.array(line), np.array([math.cos(angle), math.sin(angle)])
    command = anticipate(path[:, None, None] * direction, STEP)[0]
    assert abs(command @ [-direction[1], direction[0]]) < 1e-12

    def compute_deviation(candidate: float) -> float:
        return float((np.abs(path - candidate) - STEP * np.arange(len(path))).max())

    best = min(compute_deviation(candidate) for candidate in np.linspace(-3, 3, 601))
    assert compute_deviation(command @ direction) <= best + 1e-9
