"""Laws of the motor correction factor's estimate, on the plant of equation 7 with known factors."""

import numpy as np
from benches.control import AlphaEstimator, Array, CommandHistory
from hypothesis import given
from hypothesis import strategies as st

T = 1 / 60
EQUAL_WEIGHT_M = 0.02

alphas = st.tuples(st.floats(0.5, 1.1), st.floats(0.5, 1.1))


def travelled(commands: Array, alpha: Array, delay: int) -> Array:
    """Return positions for commands, (frames, n, 2 or 3): x(k+1) = x(k) + alpha T u(k - k_d)."""
    frames = len(commands)
    acting_command = np.concatenate([np.zeros((delay + 1, *commands.shape[1:])), commands])[:frames]
    return alpha * T * np.cumsum(acting_command[..., :2], axis=0)


def estimate(positions: Array, commands: Array, window: int, delay: int) -> Array:
    """Return the estimates of all frames, (frames, n, 2)."""
    n = commands.shape[1]
    sent, estimator = CommandHistory(n, window + delay), AlphaEstimator(n, window, delay, T)
    values = []
    for k, position in enumerate(positions):
        sent.append(commands[k - 1] if k else np.zeros((n, 3)))
        values.append(estimator.update(position, sent).copy())
    return np.array(values)


@given(alphas, st.integers(1, 20), st.integers(0, 12), st.integers(0, 2**32 - 1))
def test_the_error_shrinks_by_the_weight_of_the_old_value(
    alpha: tuple[float, float], window: int, delay: int, seed: int
) -> None:
    """Without noise, a window with displacement d leaves c^2 / (c^2 + d^2) of the error.

    The displacement seen is alpha d, so that alpha - (alpha d^2 + c^2 old) / (d^2 + c^2) is that
    part of alpha - old; from frame to frame the parts multiply.
    """
    commands = np.random.default_rng(seed).uniform(-2, 2, (80, 1, 3))
    values = estimate(travelled(commands, np.array(alpha), delay), commands, window, delay)
    passed = travelled(commands, np.ones(2), delay)
    displacement = (
        passed - np.concatenate([np.repeat(passed[:1], window, axis=0), passed])[: len(passed)]
    )
    remaining_error = np.cumprod(EQUAL_WEIGHT_M**2 / (EQUAL_WEIGHT_M**2 + displacement**2), axis=0)
    # Positions of up to 1 m are rounded at 1e-16, hundredfold where a displacement of 1 cm divides
    # them.
    np.testing.assert_allclose(
        values, alpha + (1 - np.array(alpha)) * remaining_error, rtol=0, atol=1e-12
    )


@given(st.integers(0, 6), st.integers(0, 2**32 - 1))
def test_at_standstill_the_estimate_keeps_its_value(delay: int, seed: int) -> None:
    """Commands of zero do not change the estimate, even with vision errors of 5 mm."""
    rng = np.random.default_rng(seed)
    window, driven, stood = 15, 60, 200
    commands = np.zeros((driven + stood, 2, 3))
    commands[:driven] = rng.uniform(0.5, 2, (driven, 2, 3))
    positions = travelled(commands, np.array([0.7, 0.9]), delay)
    positions[driven + delay + window :] += rng.normal(
        0, 0.005, positions[driven + delay + window :].shape
    )
    values = estimate(positions, commands, window, delay)
    settled = values[driven + delay + window]
    np.testing.assert_allclose(
        settled, [[0.7, 0.9]] * 2, atol=1e-9
    )  # The drive contracts the error as above.
    # rho times the value, over rho: two roundings that may repeat in each of 200 frames.
    np.testing.assert_allclose(
        values[driven + delay + window :], np.broadcast_to(settled, (185 - delay, 2, 2)), atol=1e-13
    )
