"""Laws of adaptive-comp-flc's lead: what it damps, that errors of any size end, and that it holds no robot back."""

import numpy as np
from closed_loop import Lagged, T, drive, limited
from hypothesis import given
from hypothesis import strategies as st
from laws import LAW

from omni_control import MotionLimits, TimedReference, Told
from omni_control.controllers import make
from omni_control.controllers.planning import lead
from omni_control.fuzzy.rules import FuzzyLaw
from omni_control.kinematics import Array

FUZZY = FuzzyLaw()
efforts, lags = st.floats(0.85, 1.9), st.floats(1e-3, 0.6)  # the lag of 3 m/s on wheels that creep by 0.2 s^2/m


def lead_of(effort: float, lag: float) -> float:
    """T, s."""
    return float(lead(np.array(effort), np.array(lag / effort), FUZZY.stiffness))


@LAW
@given(effort=efforts, lag=lags, slope=st.floats(0.01, 40.0))
def test_small_errors_are_damped_at_every_slope_of_the_correction(effort: float, lag: float, slope: float) -> None:
    """By the roots of lag e'' + (g + f T) e' + f e = 0: where f is the slope at no error, by 1/sqrt(2) or more."""
    stiff = np.sqrt(effort**2 + 2 * FUZZY.stiffness * lag)
    for f, least in ((FUZZY.stiffness, np.sqrt(0.5)), (slope, min(1, np.sqrt(2 * effort / (effort + stiff))))):
        roots = np.roots([lag, effort + f * lead_of(effort, lag), f])
        assert (
            -roots.real / np.abs(roots)
        ).min() > least - 1e-6  # that of a double root is known to half of the digits


def test_the_stiffness_is_the_slope_of_the_fuzzy_surface_at_no_error() -> None:
    """By a difference over a millionth of the range, which the next order of the surface changes by as much."""
    for law in (FUZZY, FuzzyLaw(0.2, 0.7)):
        error = 1e-6 * law.error_range_m
        np.testing.assert_allclose(law([error, 0.0])[0] / error, law.stiffness, rtol=1e-5)


def test_errors_of_any_size_end() -> None:
    """Of lag e'' + g e' + F(e + T e') = 0, integrated (Runge-Kutta): from 3 m and 4 m/s, all robots end at no error.

    The slowest need 3 m / (0.83 m/s / 1.9) to where F falls, and are within a millimetre 3 s later.
    """
    rng, n, step = np.random.default_rng(3), 100, 0.02
    effort, lag = rng.uniform(0.85, 1.9, n), rng.uniform(0.03, 0.6, n)
    ahead = lead(effort, lag / effort, FUZZY.stiffness)
    state = np.array([rng.uniform(-3, 3, n), rng.uniform(-4, 4, n)])

    def rate(state: Array) -> Array:
        error, change = state
        correction = FUZZY(np.stack([error + ahead * change, np.zeros(n)], axis=1))[:, 0]
        return np.array([change, -(effort * change + correction) / lag])

    for _ in range(round((3 * 1.9 / 0.83 + 4 * 0.6 + 3) / step)):
        a = rate(state)
        b = rate(state + step / 2 * a)
        c = rate(state + step / 2 * b)
        state = state + step / 6 * (a + 2 * b + 2 * c + rate(state + step * c))
    assert np.abs(state[0]).max() < 1e-3


def test_a_robot_that_is_far_off_comes_back_as_fast_as_the_correction_asks() -> None:
    """At 5/6 m/s, whatever the lag: 21.6 frames from 0.5 to 0.2 m off. A damping that held it back would take up to 50.

    It then overshoots by less than under comp-flc, whose predictor does not know the lag.
    """
    reference = TimedReference([[0, 0, 0], [1e-3, 0, 0]], MotionLimits(), T, settle_frames=180)
    start = np.array([[-1.0, 0, 0], [0, 1, 0], [-1, -1, 0]])
    driven, overshoot = start[:, :2] != 0, {}
    for lag in (0.02, 0.15):
        told = Told(T, 6, lag_s=lag, drag_m_s=0, creep_s2_m=0, position_noise_m=1e-4, heading_noise_rad=1e-4)
        for name in ("adaptive-comp-flc", "comp-flc"):
            run = drive(make(name, told, reference, 3), Lagged(start, 6, lag), 180, limits=limited)
            off = (run.pose[..., :2] - reference.poses[180, :2]) * np.sign(start[:, :2])
            overshoot[name] = -off.min(0)[driven]
            if name == "adaptive-comp-flc":
                frames = ((off > 0.2) & (off <= 0.5)).sum(0)[driven]
                assert set(frames.tolist()) <= {21, 22}
        assert (overshoot["adaptive-comp-flc"] < overshoot["comp-flc"]).all()
