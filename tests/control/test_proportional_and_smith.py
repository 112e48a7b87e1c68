"""Laws of proportional control and the Smith predictor, in closed loop with dead time and lag."""

import numpy as np
import pytest
from benches.control import NominalRobot, Proportional, SmithPredictor, compute_simc_gain
from closed_loop import LaggedPlant, T, discretize_lag, run_controller
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq
from team_setup import LIMITS, REST, STRAIGHT, make_model

from omni_control import CommandHistory, TimedReference

delays = st.integers(0, 9)
CYCLES = 16  # per frame, to which fractional dead times are rounded here


@given(
    st.integers(0, 9 * CYCLES) | delays.map(lambda frames: CYCLES * frames),
    st.sampled_from([1e-4, 0.02, 0.1]),
    st.integers(0, 99),
)
def test_the_nominal_robot_samples_its_differential_equation(
    delay_cycles: int, lag: float, seed: int
) -> None:
    """Displacement and prediction are those of scipy's discretization, 16 cycles per frame."""
    commands = np.random.default_rng(seed).uniform(-3, 3, (14, 1, 3))
    delay = delay_cycles / CYCLES
    robot = NominalRobot(make_model(delay, lag), 1)
    queue = CommandHistory(1, int(np.ceil(delay)) + 1)
    for command in commands:
        queue.append(command)
        robot.advance(queue)
    transition, effect = discretize_lag(lag, T / CYCLES)
    state, states = np.zeros((2, 3)), []
    for cycle in range(delay_cycles + CYCLES * len(commands)):
        sent = (cycle - delay_cycles) // CYCLES
        states.append(state)
        state = transition @ state + effect * (commands[sent] if sent >= 0 else 0)
    now = CYCLES * len(commands)
    present = states[now] if delay_cycles else state
    displacement = present[0] - states[now - CYCLES][0]
    np.testing.assert_allclose(robot.displacement[0], displacement, rtol=0, atol=1e-12)
    pose, velocity = robot.predict(np.array([[1.0, 2.0, 3.0]]), queue)
    np.testing.assert_allclose(pose[0] - [1, 2, 3], state[0] - present[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(velocity[0], state[1], rtol=0, atol=1e-12)


@pytest.mark.parametrize("latency", [0.01, 0.14])
def test_the_gain_has_the_margins_of_the_simc_rule(latency: float) -> None:
    """The open loop K exp(-j w L) / (j w) has a phase margin of 61 degrees, a gain margin of pi."""
    gain = compute_simc_gain(latency)

    def phase(w: float) -> float:
        return -np.pi / 2 - w * latency

    crossover = brentq(lambda w: gain / w - 1, 1e-3, 1e3)
    reversal = brentq(lambda w: phase(w) + np.pi, 1e-3, 1e3)
    assert np.degrees(np.pi + phase(crossover)) == pytest.approx(61.35, abs=0.01)
    assert gain / reversal == pytest.approx(1 / np.pi)


def test_p_returns_to_rest_along_the_poles_of_its_loop() -> None:
    """Without a lag e(k+1) = e(k) - K T e(k - k_d): poles in the unit circle and well damped.

    A phase margin of 61 degrees is about that of a second-order loop with a damping of 0.6, which
    overshoots by 9 %.
    """
    for delay in range(10):
        controller = Proportional(make_model(delay, 0.0), REST, 1)
        start = np.array([[0.1, -0.1, 0.5]])
        error = run_controller(controller, LaggedPlant(start, delay, 0.0), 400).pose[:, 0] / start
        polynomial = np.zeros(delay + 2)
        polynomial[:2] = 1, -1
        polynomial[-1] += controller.gain * T
        assert np.abs(np.roots(polynomial)).max() < 1
        assert error.min() > -0.09
        # Roundings of numbers of size 1.
        np.testing.assert_allclose(
            np.diff(error[delay:], axis=0), -controller.gain * T * error[: 399 - delay], atol=1e-14
        )


def test_with_a_lag_smith_has_a_known_error_in_acceleration() -> None:
    """It looks ahead by the lag and subtracts what the robot will move in it at the speed of then.

    Under an acceleration a that is a lag (lag + T) / 2 too much: the half square of the lag, and
    half a frame of the reference's velocity, which is the mean over the frame to come.
    """
    for lag_frames in [1, 2, 5]:
        reference, lag = TimedReference(STRAIGHT, LIMITS, T), lag_frames * T
        run = run_controller(
            SmithPredictor(make_model(3, lag), reference, 1),
            LaggedPlant(np.zeros((1, 3)), 3, lag),
            200,
        )
        error = reference.poses[199, 0] - run.pose[-1, 0, 0]
        # The transient of a loop with a gain of 5 / s and more is 1e-6 of its first error after 3
        # s.
        assert error == pytest.approx(LIMITS.acceleration * lag * (lag + T) / 2, abs=1e-6)
