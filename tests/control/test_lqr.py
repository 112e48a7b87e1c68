"""Laws of the LQR: optimal on the model with dead time, exact preview, no steady-state error."""

import numpy as np
import pytest
from benches.control import Array, Lqr
from closed_loop import (
    LaggedPlant,
    T,
    discretize_lag,
    make_empty_history,
    make_observation,
    run_controller,
)
from scipy.linalg import solve_discrete_are
from team_setup import LIMITS, REST, STRAIGHT, make_model

from omni_control import MotionLimits, TimedReference

LITTLE = 2.0**-10


def augmented(delay: int, lag: float) -> tuple[Array, Array, Array, float]:
    """Return A, B, Q, r of the state [position, velocity, commands in flight, oldest first]."""
    transition, effect = discretize_lag(lag)
    size = 2 + delay
    a, b = np.eye(size, k=1), np.zeros((size, 1))
    a[:2] = 0
    a[:2, :2] = transition
    if delay:
        a[:2, 2:3], b[-1] = effect, 1
    else:
        b[:] = effect
    weight = np.zeros((size, size))
    weight[0, 0] = 0.1**-2  # error_range_m
    return a, b, weight, 1.0**-2  # speed_range_m_s


def gain_of(delay: int, lag: float) -> Array:
    """Return the gain (m,) of the controller on the augmented state, by small changes of each part.

    A little, so that a robot can brake within the error: a millimetre, or what comes of a
    millimetre a second.
    """
    gains: list[Array] = []
    for index in range(2 + delay):
        controller = Lqr(make_model(delay, lag), REST, 1)
        robot, sent = controller.nominal, make_empty_history(controller)
        pose, commands = (
            np.full((1, 3), LITTLE * (index == 0)),
            np.zeros((2 + delay, 1, 3)),
        )  # none, last to act, in flight
        if index:
            # Brings a robot from rest to a mm/s
            commands[index] = LITTLE / (1 - robot.velocity_decay) if index == 1 else LITTLE
        for command in commands[:-1]:
            sent.append(command)
            controller.command(0, make_observation(controller.model, pose, sent))
        if index == 1:
            pose = (T - robot.coast_time_s) * commands[
                1
            ]  # where it is then, so that there is no disturbance
        sent.append(commands[-1])
        response = (
            -controller.command(0, make_observation(controller.model, pose, sent))[0] / LITTLE
        )
        assert (response == response[0]).all(), "the same for all axes"
        gains.append(response[0] - gains[0] * pose[0, 0] / LITTLE if index == 1 else response[0])
    return np.array(gains)


def test_gain_is_optimal_for_the_model_with_dead_time() -> None:
    """Gain and cost of the augmented state solve its Riccati equation."""
    for lag in [0.005, 0.02, 0.1]:
        for delay in [0, 1, 6]:
            a, b, q, r = augmented(delay, lag)
            p = solve_discrete_are(a, b, q, np.array([[r]]))
            optimal = np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)[0]
            gain = gain_of(delay, lag)
            # The solver's accuracy; the gains are of size 10.
            np.testing.assert_allclose(gain, optimal, rtol=0, atol=1e-8)
            assert np.abs(np.linalg.eigvals(a - b @ gain[None])).max() < 1


def test_with_a_lag_it_follows_a_constant_acceleration_exactly() -> None:
    for lag_frames in [1, 2, 6]:
        for delay in [0, 6]:
            reference = TimedReference(STRAIGHT, LIMITS, T)
            plant = LaggedPlant(np.zeros((1, 3)), delay, lag_frames * T)
            run = run_controller(Lqr(make_model(delay, lag_frames * T), reference, 1), plant, 220)
            # Poles of 0.87 and less have forgotten the start after 200 frames.
            np.testing.assert_allclose(
                run.pose[210:, 0], reference.poses[210:220], rtol=0, atol=1e-11
            )


def test_a_weak_robot_has_no_steady_state_error() -> None:
    """The shortfall is then a constant disturbance, which is estimated and added to the command."""
    for alpha in [0.6, 0.8, 1.1]:
        reference = TimedReference(STRAIGHT, MotionLimits(speed=1.0), T)
        controller = Lqr(make_model(6), reference, 1)
        run = run_controller(controller, LaggedPlant(np.zeros((1, 3)), 6, 0.02, alpha), 900)
        assert reference.poses[899, 0] < 20 - 1, "still under way"
        # The estimate's loop has a gain of 1 - alpha and some 0.15 s a round: 0.4^(14 s / 0.15 s)
        # is only rounding.
        np.testing.assert_allclose(run.pose[-1], reference.poses[899:900], rtol=0, atol=1e-10)
        assert controller.disturbance[0, 0] == pytest.approx(1 - 1 / alpha)
