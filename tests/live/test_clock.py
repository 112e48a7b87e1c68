"""Clocks are matched by the packets that took the shortest: offset, rate, restarts, pauses."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omni_mj.live.clock import Clock

PERIOD_S = 1 / 60
JITTER_S = 0.003  # mean of what packets take above the least, exponentially distributed


def fed(offset: float, rate: float, seconds: float, seed: int = 0) -> tuple[Clock, float]:
    """A clock that has heard packets of a peer whose clock is `rate` times ours, and our time at the end."""
    rng, clock = np.random.default_rng(seed), Clock()
    for k in range(round(seconds / PERIOD_S)):
        ours = 100.0 + k * PERIOD_S
        assert not clock.add(offset + rate * ours, ours + rng.exponential(JITTER_S))
    return clock, ours


@given(st.floats(-1e6, 2e9), st.floats(0.8, 1.25), st.integers(0, 1000))
@settings(max_examples=25, deadline=None)
def test_offset_and_rate_are_found_through_jitter(offset: float, rate: float, seed: int) -> None:
    """Of 15 packets in each quarter of a second the fastest is JITTER_S / 15 late, with as much spread.

    Over the 37 of ten seconds that are left, as the first three were chosen before the rate was known, a line's value
    at its end has twice the spread over the root of 37; ten times that is allowed, and that the line lies below the
    fastest of all, by five times the spread of one. Their times' variance is 7.1 s^2: the rate's spread is 1.2e-5, of
    which ten times is allowed.
    """
    clock, now = fed(offset, rate, 10.0, seed)
    spread = JITTER_S / 15
    resolution = 1e-6 if abs(offset) > 1e7 else 1e-9  # of numbers as large as times since 1970
    assert clock.ours(offset + rate * now) == pytest.approx(
        now, abs=6 * spread + 20 * spread / np.sqrt(37) + resolution
    )
    assert clock.rate == pytest.approx(rate, rel=1.2e-4)
    assert clock.theirs(clock.ours(offset + 3.0)) == pytest.approx(offset + 3.0, abs=1e-6)


@given(st.integers(0, 1000))
@settings(max_examples=10, deadline=None)
def test_no_packet_arrives_before_it_was_sent(seed: int) -> None:
    """The line is below every packet of its last bucket."""
    rng, clock = np.random.default_rng(seed), Clock()
    for k in range(400):
        stamp, arrival = k * PERIOD_S, 7.0 + k * PERIOD_S + rng.exponential(JITTER_S)
        clock.add(stamp, arrival)
        assert clock.ours(stamp) <= arrival + 1e-9


@pytest.mark.parametrize("jump", [-100.0, -1.0, 1.0, 1e9], ids=str)
def test_a_peer_that_is_started_anew_is_noticed_at_once(jump: float) -> None:
    clock, now = fed(0.0, 1.0, 5.0)
    stamp = now + PERIOD_S + jump
    assert clock.add(stamp, now + PERIOD_S)
    assert clock.restarts == 1
    assert clock.ours(stamp) == pytest.approx(now + PERIOD_S, abs=1e-9)


def test_a_simulation_that_is_held_is_followed_within_a_second() -> None:
    """Its stamps go on where they were, two seconds later: no restart, but all packets are late by as much."""
    clock, now = fed(0.0, 1.0, 5.0)
    for k in range(60):
        clock.add(now + k * PERIOD_S, now + 2.0 + k * PERIOD_S)
    assert clock.restarts == 0
    assert clock.ours(now + 59 * PERIOD_S) == pytest.approx(now + 2.0 + 59 * PERIOD_S, abs=1e-3)


def test_packets_that_were_held_up_together_change_nothing() -> None:
    """As when this computer was busy for 0.3 s: those that waited arrive at one time, and the line stays."""
    clock, now = fed(0.0, 1.0, 5.0)
    before = clock.ours(now)
    for k in range(18):
        clock.add(now + k * PERIOD_S, now + 0.3)
    assert clock.ours(now) == pytest.approx(before, abs=1e-4)
