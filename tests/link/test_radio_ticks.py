"""The radio of those who send when they like, in ticks of a frame; and packets that are lost."""

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omni_mj.link.radio import Radio
from omni_mj.scenarios.faults import Delay
from omni_mj.scenarios.settings import RadioSettings

NOTHING = [0.0, -1.0]


def radio_of(ticks: int, robots: int = 1, faults: tuple[Delay, ...] = (), **radio: float) -> Radio:
    chosen = RadioSettings(**{"delay_frames": 0, **radio})
    return Radio([chosen] * robots, [(i,) for i in range(robots)], [faults] * robots, ticks, NOTHING)


@settings(deadline=None, max_examples=60, derandomize=True)
@given(st.integers(1, 16), st.integers(0, 4), st.lists(st.booleans(), min_size=1, max_size=120))
def test_a_packet_arrives_its_dead_time_after_the_tick_in_which_it_was_sent(
    ticks: int, delay: int, sends: list[bool]
) -> None:
    """Dead times are whole frames; a robot holds the last that arrived, and is told when one does."""
    radio, sent = radio_of(ticks, delay_frames=delay), dict[int, float]()
    for tick, sends_now in enumerate(sends):
        if sends_now:
            sent[tick] = float(tick)
            radio.send(np.array([[tick, 0.0]]))
        came = [value for at, value in sent.items() if at + delay * ticks <= tick]
        expected = [came[-1], 0.0] if came else NOTHING
        assert radio.quiet == min(
            (late for at in sent if (late := at + delay * ticks - tick) >= 0), default=sys.maxsize
        )
        held, new, age = radio.deliver()
        np.testing.assert_array_equal(held[0], expected)
        assert new[0] == (tick - delay * ticks in sent)
        assert not came or age[0] == tick - came[-1]


def test_packets_to_some_robots_leave_the_others_with_what_they_hold() -> None:
    """Two in a tick: to each robot the last of those sent to it."""
    radio = radio_of(16, robots=3)
    radio.send(np.full((3, 2), 1.0), np.array([0, 1]))
    radio.send(np.full((3, 2), 2.0), np.array([1]))
    held, new, _ = radio.deliver()
    np.testing.assert_array_equal(held, [[1, 1], [2, 2], NOTHING])
    assert new.tolist() == [True, True, False]
    for _ in range(200):  # however long ago
        held, new, _ = radio.deliver()
    np.testing.assert_array_equal(held, [[1, 1], [2, 2], NOTHING])
    assert not new.any()


def test_waiting_is_delivering_what_nobody_asks_for() -> None:
    asked, waited = radio_of(4, delay_frames=1), radio_of(4, delay_frames=1)
    for _ in range(5):
        asked.deliver()
    waited.wait(5)
    for radio in (asked, waited):
        radio.send(np.array([[7.0, 7.0]]))
    for _ in range(8):
        first, second = asked.deliver(), waited.deliver()
        assert all((one == other).all() for one, other in zip(first, second, strict=True))


def test_a_fault_s_dead_time_begins_and_ends_with_its_frames() -> None:
    """From 2/60 to 4/60 s three frames in place of none, in ticks of a quarter of a frame."""
    fault = Delay(**{"kind": "delay", "at": 2 / 60, "for": 2 / 60, "to": 3})
    radio, arrivals = radio_of(4, faults=(fault,)), []
    for tick in range(40):
        radio.send(np.array([[tick, 0.0]]))
        held, new, _ = radio.deliver()
        arrivals += [(tick, held[0, 0])] if new[0] else []
    assert arrivals[:8] == [(tick, tick) for tick in range(8)]
    assert arrivals[8:] == [(tick, tick) for tick in range(16, 40)]  # those sent during it were overtaken


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_as_many_packets_are_lost_as_said_and_robots_hold_the_one_before(share: float) -> None:
    """A binomial share, within five deviations."""
    radio, count, kept, last = radio_of(1, loss_probability=share), 3000, 0, -1.0
    for tick in range(count):
        radio.send(np.array([[tick, 0.0]]))
        held, new, _ = radio.deliver()
        kept += bool(new[0])
        last = float(tick) if new[0] else last
        assert held[0, 0] == max(last, 0.0)
    assert 1 - kept / count == pytest.approx(share, abs=5 * np.sqrt(share * (1 - share) / count) + 1e-12)
