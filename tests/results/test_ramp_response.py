"""Gain and lag of a drive, against systems whose gain and lag are known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete, lfilter

from omni_mj.results.ramp_response import RampProfile, RampResponse, measure_ramp_response

T = 1 / 60
PROFILES = st.builds(RampProfile, st.floats(1.0, 2.0), st.floats(0.8, 2.0))


def linear(profile: RampProfile, numerator: list[float], denominator: list[float]) -> RampResponse:
    """Return the response of a transfer function, exact for commands held over a frame."""
    system = [*numerator], [*denominator, 0.0]  # the way is the integral of the speed
    (num,), den, _ = cont2discrete(system, T)
    displacement = lfilter(num, den, np.append(profile.command(), 0.0))
    return measure_ramp_response(profile, displacement[:, None])


@given(PROFILES, st.floats(0.5, 1.1), st.floats(0.002, 0.03))
def test_gain_and_lag_of_a_first_order_system(
    profile: RampProfile, gain: float, lag: float
) -> None:
    response = linear(profile, [gain], [lag, 1.0])
    assert response.steady_gain == pytest.approx(gain, rel=1e-6)
    assert response.lag_s == pytest.approx(lag, rel=1e-6)
    # The second half of the ramp begins 0.25 s, at least eight time constants, after the start:
    # exp(-8) = 3e-4.
    assert response.acceleration_gain == pytest.approx(gain, rel=1e-3)


@given(PROFILES, st.floats(0.5, 1.1), st.integers(0, 6))
def test_a_dead_time_is_a_lag(profile: RampProfile, gain: float, frames: int) -> None:
    command = profile.command()
    displacement = np.concatenate([[0.0], np.cumsum(gain * command) * T])
    late = np.concatenate([np.zeros(frames), displacement])[: len(displacement)]
    response = measure_ramp_response(profile, np.stack([displacement, late], axis=1))
    np.testing.assert_allclose(response.lag_s, [0, frames * T], atol=1e-12)
    np.testing.assert_allclose(response.steady_gain, gain)
    np.testing.assert_allclose(response.acceleration_gain, gain)


@given(PROFILES, st.floats(0.0, 0.1))
def test_dry_friction_costs_gain_and_no_lag(profile: RampProfile, cost: float) -> None:
    """A constant loss of speed lowers the steady gain, not the slope."""
    displacement = np.concatenate([[0.0], np.cumsum(np.maximum(profile.command() - cost, 0.0)) * T])
    response = measure_ramp_response(profile, displacement[:, None])
    assert response.steady_gain == pytest.approx(1 - cost / profile.speed_m_s)
    assert response.acceleration_gain == pytest.approx(1.0)
    # The ramps' frames are mirror images but for the one in which either begins; of it no more than
    # `cost` is missing.
    assert np.abs(response.lag_s) <= cost * T / profile.speed_m_s + 1e-12


@pytest.mark.parametrize("softness", [0.05, 0.12])
@pytest.mark.parametrize("gain", [0.75, 1.0])
def test_creep_is_a_lag_that_grows_with_speed(gain: float, softness: float) -> None:
    """With (T |v| + e) v' = u - v / g, e = 1 ms, the lag is T g^2 U / 2 + e g."""
    rest = 0.001
    for profile in (RampProfile(0.75, 2.0), RampProfile(1.5, 1.0), RampProfile(1.5, 3.0)):
        command = np.append(profile.command(), 0.0)

        def rates(
            time: float, state: NDArray[np.float64], command: NDArray[np.float64] = command
        ) -> tuple[float, float]:
            lost_speed = command[int(time / T)] - state[1] / gain
            return state[1], lost_speed / (softness * abs(state[1]) + rest)

        frames = np.arange(len(command)) * T
        displacement = solve_ivp(
            rates, (0, frames[-1]), (0.0, 0.0), "LSODA", frames, max_step=T / 4, rtol=1e-6
        ).y[0]
        response = measure_ramp_response(profile, displacement[:, None])
        lag = softness * gain**2 * profile.speed_m_s / 2 + rest * gain
        assert response.lag_s == pytest.approx(lag, rel=0.01)  # commands are held over a frame
        assert response.steady_gain == pytest.approx(gain, rel=1e-3)
        curve = softness * profile.acceleration_m_s2
        slope = (np.sqrt(1 / gain**2 + 4 * curve) - 1 / gain) / (2 * curve)
        assert response.acceleration_gain == pytest.approx(slope, abs=0.005)
