"""Commands that change no faster than they may set out in time: missed by least, whichever way, by both forms."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from laws import LAW
from numpy.typing import NDArray

from omni_control.controllers.planning import in_time

STEP = 0.1  # m/s a frame
parts = st.floats(-3, 3)
ways = st.lists(st.tuples(parts, parts), min_size=1, max_size=12).map(
    lambda way: np.array([complex(*at) for at in way])
)


def of(way: NDArray) -> complex:
    return complex(in_time(way[:, None], STEP)[0])


def missed(way: NDArray, command: complex) -> float:
    """By how much most those that come are out of reach, m/s."""
    return float((np.abs(way - command) - STEP * np.arange(len(way))).max())


@LAW
@given(ways)
def test_what_can_be_reached_is_left_as_it_is(way: NDArray) -> None:
    steps = np.diff(way, prepend=0.0)
    within = np.cumsum(steps * (0.99 * STEP / max(np.abs(steps).max(), STEP)))
    assert of(within) == within[0]


@LAW
@given(st.lists(parts, min_size=1, max_size=12), st.floats(0, 7))
def test_along_a_line_no_command_misses_less(along: list[float], angle: float) -> None:
    way = np.array(along) * np.exp(1j * angle)
    command = of(way)
    others = np.linspace(-3, 3, 6001) * np.exp(1j * angle)
    least = min(missed(way, 0.0 + other) for other in others[::10])
    least = min(least, *(missed(way, other) for other in others[np.abs(others - command) < 0.01]))
    assert missed(way, command) <= least + 1e-9  # least over a grid is no less than the least


@LAW
@given(ways, st.floats(0, 7))
def test_directions_are_alike(way: NDArray, angle: float) -> None:
    turned = np.exp(1j * angle)
    ahead, reach = np.abs(way - way[0]), STEP * np.arange(len(way))
    worst = np.sort(ahead - reach)[-2:]
    if len(worst) < 2 or worst[1] - worst[0] > 1e-9:  # two that are as far out of reach: rounding chooses
        np.testing.assert_allclose(of(way * turned), of(way) * turned, rtol=0, atol=1e-9)


def farthest(look: int, lag: float = 0.08, gain: float = 15.0) -> float:
    """How far a robot with a lag strays that speeds up at 3 m/s^2, brakes as hard, and looks so many frames ahead, m.

    Its command, by the inverse of its lag and a correction of its error, changes by 4.7 m/s^2 at most.
    """
    period, step = 1 / 60, 4.7 / 60
    decay, fading = np.exp(-period / lag), np.exp(-gain * period * np.arange(look))
    speeds = np.concatenate([np.arange(61), np.arange(59, -1, -1), np.zeros(60)]) * 3.0 * period
    asked = (speeds[1:] - decay * speeds[:-1]) / (1 - decay)
    asked = np.concatenate([asked, np.zeros(look)])
    error, speed, sent, most = 0.0, 0.0, asked[0], 0.0
    for k in range(len(speeds) - 1):
        coming = (asked[k : k + look] + fading * gain * error).astype(complex)
        sent += np.clip(in_time(coming[:, None], step)[0].real - sent, -step, step)
        after = sent + (speed - sent) * decay
        moved = period * sent + lag * (speed - after)
        error += (speeds[k] + speeds[k + 1]) / 2 * period - moved
        speed, most = after, max(most, abs(error))
    return most


def test_a_robot_that_brakes_hard_strays_by_less_than_a_fifth_if_it_looks_ahead() -> None:
    # The command that is asked for jumps by 6 m/s^2 times the lag, 0.48 m/s: six frames too late if it is waited for.
    assert farthest(10) < 0.2 * farthest(1)  # 5 and 46 mm
