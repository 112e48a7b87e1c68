"""Laws of the fuzzy controllers in closed loop with the plant of equation 7."""

import numpy as np
import pytest
from benches.control import Array, make_controller
from closed_loop import LaggedPlant, Run, T, run_controller
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from team_setup import LIMITS, MODES, make_reference

from omni_control import Controller, MotionLimits, TeamModel, TimedReference

FRAMES = 120
FUZZY = ("flc", "comp-flc")
both_references = pytest.mark.parametrize("kind", MODES)

# Robots that start within the controller's range; headings less than half a turn off, which has no
# shorter side.
starts = st.tuples(st.floats(-0.12, 0.12), st.floats(-0.12, 0.12), st.floats(-3, 3))


def follow(
    controller: Controller,
    start: ArrayLike,
    delay: int,
    noise: Array | int = FRAMES,
    *,
    first_frame: int = 0,
    highest: float = np.inf,
) -> Run:
    """Close the loop with equation 7; clip commands at `highest`; feed back noisy poses."""
    return run_controller(
        controller,
        LaggedPlant(start, delay),
        noise,
        limits=lambda wanted, last: np.clip(wanted, -highest, highest),
        first_frame=first_frame,
    )


def test_without_dead_time_both_controllers_are_the_same() -> None:
    """With k_d = 0 there is nothing to compensate: the commands are equal bit for bit."""
    for kind in MODES:
        rng = np.random.default_rng(0)
        start, noise = rng.uniform(-0.1, 0.1, (4, 3)), rng.normal(0, 0.01, (FRAMES, 4, 3))
        flc, comp_flc = (
            follow(
                make_controller(name, TeamModel(T, 0), make_reference(kind, 4), 4), start, 0, noise
            )
            for name in FUZZY
        )
        assert np.array_equal(flc.sent, comp_flc.sent)
        assert np.array_equal(flc.predicted_pose, comp_flc.predicted_pose)


@both_references
@settings(max_examples=12)
@given(start=starts, delay=st.integers(0, 12), highest=st.floats(0.1, 2))
def test_the_prediction_is_the_pose_at_the_end_of_the_dead_time(
    kind: str, start: tuple[float, ...], delay: int, highest: float
) -> None:
    """On a perfect plant x_p of frame k is x(k + k_d), also when limits clip the commands."""
    run = follow(
        make_controller("comp-flc", TeamModel(T, delay), make_reference(kind), 1),
        [start],
        delay,
        highest=highest,
    )
    # Twelve additions to poses of size 3; the estimate of alpha is 1 to 1e-12.
    np.testing.assert_allclose(
        run.predicted_pose[: FRAMES - delay], run.pose[delay:], rtol=0, atol=1e-12
    )


def fuzzy_velocity(error: float) -> float:
    """Brute force: the centroid of ZO and PS, clipped at the degrees of an error below 0.05 m."""
    z, degree = np.linspace(-0.5, 1, 30001), error / 0.05
    small, zero = np.maximum(0, 1 - 2 * np.abs(z - 0.5)), np.maximum(0, 1 - 2 * np.abs(z))
    mu = np.maximum(np.minimum(small, degree), np.minimum(zero, 1 - degree))
    return float(np.trapezoid(z * mu, z) / np.trapezoid(mu, z))


def test_flc_lags_a_constant_acceleration_by_a_known_error_and_comp_flc_does_not() -> None:
    """The feedforward arrives k_d frames late; FLC corrects it with a lasting error.

    In the steady state of x(k+1) = x(k) + T u(k - k_d) under a reference that accelerates at a, the
    error e solves v(e) = a k_d T with v the fuzzy controller.
    """
    delay, frames = 3, 200
    reference = TimedReference([[0, 0, 0], [20, 0, 0]], MotionLimits(speed=10), T)
    error = {}
    for name in FUZZY:
        run = follow(
            make_controller(name, TeamModel(T, delay), reference, 1),
            np.zeros((1, 3)),
            delay,
            frames,
        )
        error[name] = reference.poses[frames - 1, 0] - run.pose[-1, 0, 0]
    lag = brentq(lambda e: fuzzy_velocity(e) - LIMITS.acceleration * delay * T, 0, 0.05)
    # Integration in steps of 5e-5 is good to 1e-8 m/s, which a gain of 10 / s makes 1e-9 m; the
    # transient of a loop with gain 15 / s and 0.05 s of dead time halves in 5 frames and less.
    assert error["flc"] == pytest.approx(lag, abs=1e-7)
    assert abs(error["comp-flc"]) < 1e-9


def test_the_heading_returns_the_short_way_at_the_gain() -> None:
    """The heading error shrinks by 1 - g T a frame, from -3 to 3 rad over pi and not over 0."""
    for name in FUZZY:
        gain = 5.0
        reference = TimedReference([[0, 0, 3.0]], LIMITS, T)
        run = follow(
            make_controller(name, TeamModel(T, 0, heading_gain=gain), reference, 1),
            [[0.0, 0.0, -3.0]],
            0,
            60,
        )
        error = (2 * np.pi - 6) * (1 - gain * T) ** np.arange(60)
        # Roundings of angles of size 6.
        np.testing.assert_allclose(run.pose[:, 0, 2], 3 - 2 * np.pi + error, rtol=0, atol=1e-14)
