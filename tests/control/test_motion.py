"""The law by which robots that creep answer to commands: a step of it, its inverse, and what turning adds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from omni_control import Kinematics
from omni_control.estimation.motion import Motion, pairs, plane, softness
from omni_control.estimation.turning import Turning
from omni_control.kinematics import Array

T = 1 / 60
WHEELS = Kinematics(np.radians([60, 135, 225, 300]), 0.083, 0.0285)
PARAMETERS = [0.02, 1.1, 1.2, 0.06, 0.1, 0.03, 0.0, 0.02]  # compass to lag, as in `motion.NAMES`


def robots(n: int = 1, **changes: float) -> Motion:
    """Robots that are alike, with creep and friction that may be changed."""
    values = np.tile(PARAMETERS, (n, 1))
    if "creep" in changes:
        values[:, 3:5] = changes["creep"]
    if "friction" in changes:
        values[:, 5] = changes["friction"]
    return Motion(values, WHEELS)


def integrated(law: Motion, velocity: Array, command: Array, duration: float) -> tuple[Array, Array]:
    """Displacement and velocity at the end, in the body's axes, by scipy, with |v| as it goes."""
    _, gf, gs, cf, cs, c, _, lag = law.parameters[0]
    g, creep, gives = np.array([gf, gs]), np.array([cf, cs]), np.array([1, 2.5 / 1.5])

    def slope(_: float, state: Array) -> Array:
        v = state[2:]
        size = np.hypot(*v)
        rubbed = c * gives * v / max(size, 0.05)
        return np.concatenate([v, (command - rubbed - g * v) / (lag * gives + g**2 * creep * size)])

    end = solve_ivp(slope, (0, duration), [0, 0, *velocity], rtol=1e-9, atol=1e-12).y[:, -1]
    return end[:2], end[2:]


@pytest.mark.parametrize("velocity", [(1.5, 0.0), (0.3, -1.0), (-2.0, 1.0)])
@pytest.mark.parametrize("command", [(2.0, 0.0), (0.5, -2.0)])
def test_a_step_is_the_solution_of_the_law(velocity: tuple[float, float], command: tuple[float, float]) -> None:
    """Of a frame, to what |v| changes in it: the lag is that at its start, and the mean off by half of its change.

    That is at most 0.4 m/s of speed, 0.05 of 0.3 s.
    """
    law, v, u = robots(), np.array([velocity]), np.array([command])
    step = law.step(plane(v), plane(u), np.ones(1, complex), T)
    moved, later = integrated(law, v[0], u[0], T)
    gained = np.abs(later - v[0]).max()
    np.testing.assert_allclose(step.velocity[0], later, atol=0.09 * gained + 1e-3)
    np.testing.assert_allclose(step.moved[0], moved, atol=T * (0.09 * gained + 1e-3))


def test_without_creep_and_friction_a_step_is_exact_however_long() -> None:
    """The law is then linear with constant coefficients."""
    law, v, u = robots(creep=0.0, friction=0.0), np.array([[1.0, -0.5]]), np.array([[0.2, 1.0]])
    for duration in (0.001, T, 0.5):
        step = law.step(plane(v), plane(u), np.ones(1, complex), duration)
        moved, later = integrated(law, v[0], u[0], duration)
        np.testing.assert_allclose(step.moved[0], moved, atol=1e-8)
        np.testing.assert_allclose(step.velocity[0], later, atol=1e-7)


speeds = st.complex_numbers(min_magnitude=0.2, max_magnitude=3.0, allow_nan=False, allow_infinity=False)


@given(before=speeds, turned=st.floats(-np.pi, np.pi), change=st.complex_numbers(max_magnitude=0.05))
def test_what_is_asked_leads_from_one_velocity_to_another(before: complex, turned: float, change: complex) -> None:
    """`ask` inverts `step`, but for the direction of friction, which turns by the change at most: 0.03 m/s of it."""
    law, heading = robots(), np.exp(1j * np.array([turned]))
    after = np.array([before + change])
    command = law.ask(np.array([before]), after, heading, T)
    reached = plane(law.step(np.array([before]), command, heading, T).velocity) * heading
    assert abs(reached[0] - after[0]) < 0.03 * 5 / 3 * 2 * 0.05 / 0.2 + 1e-12


def test_friction_stops_a_robot_and_does_not_push_it_back() -> None:
    """One that goes slower than friction takes in a step comes to rest."""
    law = robots(friction=0.1)
    step = law.step(np.array([0.02 + 0j]), np.zeros(1, complex), np.ones(1, complex), 0.5)
    assert abs(step.velocity[0, 0]) < 0.002


def test_a_robot_gives_way_sideways_as_its_wheels_share_the_force() -> None:
    """In proportion to 1 / sum of the squared cosines between rims and direction, 2.5 forward and 1.5 aside."""
    assert softness(WHEELS) == pytest.approx(2.5 / 1.5)
    assert softness(None) == pytest.approx(2.5 / 1.5)
    np.testing.assert_allclose(pairs(plane(np.array([[1.0, 2.0]]))), [[1.0, 2.0]])


def test_turning_is_its_law_and_asked_for_by_its_inverse() -> None:
    """(lag) w' + g w = u + b, from rest: closed form; `ask` leads there."""
    turning = Turning(np.zeros(1), T, 0.01, 0.02)
    turning.bias, turning.effort, turning.lag = np.array([0.1]), np.array([1.2]), np.array([0.03])
    rest = np.zeros(1)
    heading, rate = turning.step(rest, rest, np.array([2.0]), 0.1, rest)
    final, decay = 2.1 / 1.2, np.exp(-0.1 * 1.2 / 0.03)
    assert rate[0] == pytest.approx(final * (1 - decay))
    assert heading[0] == pytest.approx(final * (0.1 - 0.03 / 1.2 * (1 - decay)))
    command = turning.ask(np.array([1.0]), np.array([1.3]), rest)
    assert turning.step(rest, np.array([1.0]), command, T, rest)[1][0] == pytest.approx(1.3)


def test_wheels_creep_and_rub_in_turning_as_in_driving() -> None:
    """Against wheels: each rim slips by |travel| f / (N C), and loses the same speed to friction; gyro loop of gain 1.

    Driving forward at v: T |v| v' of slip and c of speed. From a wheel's force and loss follow those of turning,
    through the inverse kinematics; the loop sees the rate that is missing and asks for it again, which leaves half.
    """
    turning = Turning(np.zeros(1), T, 0.01, 0.0, 0.04, WHEELS)
    turning.effort, turning.lag, turning.creep = np.ones(1), np.full(1, 1e-9), np.array([0.06])
    turning.friction /= 0.8  # believed to be 80 % of what it may be
    drive, inertia = WHEELS.matrix[:, 0], 0.7 * WHEELS.arm**2  # per mass
    lost = 0.04 / WHEELS.body_twist(np.sign(drive) / WHEELS.radius)[0]  # of each rim, so that forward 0.04 are
    spinning = WHEELS.body_twist(np.full(4, lost / WHEELS.radius))[2]
    assert turning.friction[0] == pytest.approx(spinning / 2)
    # T: pulling forward with v' = 1, the share d / sum d^2 of the mass at each wheel; rims slip by that times `soft`.
    soft = 0.06 * (drive**2).sum()
    speed, change = 1.5, 2.0
    rims = soft * speed * change * inertia / WHEELS.arm / 4 * np.ones(4)
    slip = WHEELS.body_twist(rims / WHEELS.radius)[2]
    late = turning._answer(np.zeros(1), np.array([speed]))[0]
    assert late[0] * change == pytest.approx(slip / 2)
    driving, _, on_the_spot = (turning.step(np.zeros(1), np.zeros(1), np.array([u]), 1.0, np.array([v]))[1][0]
                               for u, v in ((0.5, 3.0), (0.0, 0.0), (2.0, 0.0)))  # fmt: skip
    assert on_the_spot == pytest.approx(2.0 - spinning / 2), "all wheels rub against the turn"
    assert driving == pytest.approx(0.5, rel=0.01), "wheels that drive rub against that"


@pytest.mark.parametrize("spinning", [True, False])
def test_turning_is_identified(spinning: bool) -> None:
    """Friction and effort of robots that turn on the spot; lag by creep of those that drive at 1.5 m/s meanwhile.

    The robots are integrated in 20 steps a frame, with friction by rate. Friction is found within 0.03 of 0.17 rad/s
    (vision's 0.01 rad over some seconds), effort within 2 %, the rate of robots that speed up within 0.1 rad/s.
    """
    rng, n, frames = np.random.default_rng(5), 10, 480
    lag, effort, friction, creep, speed = 0.008, 1.04, 0.17, 0.06, 0.0 if spinning else 1.5
    found = Turning(np.zeros(n), T, 0.01, 0.02, 0.04, WHEELS)
    found.creep = np.full(n, creep)
    late = lag + 0.5 * 0.7 * 0.625 * creep * speed
    heading, rate, off = np.zeros(n), np.zeros(n), []
    for k in range(frames):
        command = np.full(n, 3.0 * np.sin(2 * np.pi * k * T / 2.5))
        for _ in range(20):
            rubbed = friction * np.tanh(rate / 0.05) * spinning
            rate = rate + T / 20 * (command - rubbed - effort * rate) / late
            heading = heading + T / 20 * rate
        found.update(heading + rng.normal(0, 0.01, n), command, np.full(n, speed))
        off.append(found.rate - rate)
    assert np.sqrt(np.mean(np.square(off[120:]))) < 0.1
    assert found.effort.mean() == pytest.approx(effort, abs=0.02)
    if spinning:
        assert found.friction.mean() == pytest.approx(friction, abs=0.03)


def test_following_commands_is_step_after_step() -> None:
    """Robots whose commands act for differing times, some for none; sums in another order differ by roundings."""
    rng, n, count = np.random.default_rng(2), 5, 9
    law = Motion(rng.uniform([-0.1, 0.9, 0.9, 0, 0, 0, 0, 0.002], [0.1, 1.4, 1.4, 0.1, 0.2, 0.1, 1, 0.05], (n, 8)))
    commands = plane(rng.normal(0, 1.5, (count, n, 2)))
    headings, durations = np.exp(1j * rng.normal(0, 2, (count, n))), T * rng.uniform(0, 1, (count, n))
    durations[:4] *= rng.integers(0, 2, (4, n))
    start = velocity = plane(rng.normal(0, 1, (n, 2)))
    moved = np.zeros(n, complex)
    for command, heading, duration in zip(commands, headings, durations, strict=True):
        step = law.step(velocity, command, heading, duration[:, None])
        moved, velocity = moved + plane(step.moved) * heading, plane(step.velocity) * heading
    followed = law.follow(start, commands, headings, durations)
    np.testing.assert_allclose(followed, (moved, velocity), rtol=0, atol=1e-14)
    stayed = law.follow(start, commands, headings, 0 * durations)
    assert np.array_equal(stayed, (np.zeros(n), start)), "commands that act for no time change nothing"
    none = law.follow(start, commands[:0], headings[:0], durations[:0])
    assert np.array_equal(none, stayed)


def test_turning_follows_commands_step_after_step() -> None:
    """The same of headings."""
    rng, n, count = np.random.default_rng(3), 4, 9
    turning = Turning(rng.normal(0, 9, n), T, 0.01, 0.02)
    turning.rate, turning.bias, turning.effort = rng.normal(0, 3, n), rng.normal(0, 0.1, n), rng.uniform(0.9, 1.2, n)
    turning.friction, turning.creep, speed = rng.uniform(0, 0.2, n), rng.uniform(0, 0.1, n), rng.uniform(0, 2, n)
    commands, durations = rng.normal(0, 3, (count, n)), T * rng.uniform(0, 1, (count, n))
    durations[:4] *= rng.integers(0, 2, (4, n))
    heading, rate, headings = turning.heading, turning.rate, [turning.heading]
    for command, duration in zip(commands, durations, strict=True):
        heading, rate = turning.step(heading, rate, command, duration, speed)
        headings.append(heading)
    speeds = np.tile(speed, (count, 1))
    followed = turning.follow(commands, durations, speeds)
    np.testing.assert_allclose(followed, headings, rtol=0, atol=1e-13)  # roundings of headings of 20 rad
    stayed = turning.follow(commands, 0 * durations, speeds)
    assert np.array_equal(stayed, np.repeat(turning.heading[None], count + 1, axis=0))
