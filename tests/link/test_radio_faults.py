"""Packets that are lost, come twice or after younger ones: against lists of what was sent, and laws of chance."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from omni_mj.link.radio import Radio
from omni_mj.scenarios.faults import KINDS, Fault
from omni_mj.scenarios.settings import RadioSettings

FRAME_S, SIGMAS = 1 / 60, 5
EACH: dict[str, dict[str, Any]] = {
    "radio-loss": {"probability": 0.4},
    "radio-bursts": {"frames": 6.0, "share": 0.4},
    "radio-duplicates": {"probability": 0.5, "frames": 4},
    "radio-reorder": {"probability": 0.5, "frames": 3},
    "radio-out": {},
}


def made(kind: str, start: int = 0, lasts: int = 0, **values: Any) -> Fault:
    return KINDS[kind](kind=kind, at=start * FRAME_S, **{"for": lasts * FRAME_S}, **values)


def held(robots: list[list[Fault]], frames: int, delay: int = 2, ticks: int = 1, **radio: Any) -> NDArray:
    """The tick in which the packet was sent that each robot holds, (frames * ticks, n); -1 for none. One a tick."""
    link = Radio(
        [RadioSettings(delay_frames=delay, **radio)] * len(robots), [(3,)] * len(robots), robots, ticks, nothing=(-1.0,)
    )
    found, ages = [], []
    for tick in range(frames * ticks):
        link.send(np.full((len(robots), 1), float(tick)))
        packet, _, age = link.deliver()
        found.append(packet[:, 0])
        ages.append(np.where(packet[:, 0] < 0, -1, tick - age))
    np.testing.assert_array_equal(found, ages)  # the age that robots are told is that of what they hold
    return np.array(found, int)


def test_as_many_packets_are_lost_as_said_while_it_goes_on() -> None:
    """A binomial share; each fault by itself, so that of two as many come as the product says."""
    one, two = [made("radio-loss", 100, 4000, probability=0.3)], [made("radio-loss", 0, 0, probability=0.5)]
    got = held([[], one, [*one, *two]], 5000)
    fresh = np.diff(got, axis=0) > 0
    assert fresh[2:, 0].all()
    assert fresh[2:101, 1].all()
    assert fresh[4102:, 1].all()
    for row, passes in ((1, 0.7), (2, 0.35)):
        share = fresh[101:4101, row].mean()
        assert share == pytest.approx(passes, abs=SIGMAS * np.sqrt(passes * (1 - passes) / 4000))


@pytest.mark.parametrize(("length", "share"), [(4.0, 0.2), (12.0, 0.4)])
def test_bursts_are_as_long_and_as_frequent_as_gilbert_and_elliott_say(length: float, share: float) -> None:
    """Lengths of bursts are geometric with that mean, gaps with the mean that the share leaves for them."""
    frames = 8_000
    got = held([[made("radio-bursts", frames=length, share=share)]], frames, delay=0)[:, 0]
    lost = np.diff(got) == 0
    edges = np.flatnonzero(np.diff(lost.astype(int)))
    runs = np.diff(edges)
    bursts, gaps = (runs[::2], runs[1::2]) if lost[edges[0] + 1] else (runs[1::2], runs[::2])
    for found, mean in ((bursts, length), (gaps, length * (1 - share) / share)):
        # The deviation of a geometric number of mean m is sqrt(m (m - 1)).
        assert found.mean() == pytest.approx(mean, abs=SIGMAS * np.sqrt(mean * (mean - 1) / len(found)))


def test_nothing_that_is_sent_to_a_radio_that_is_out_arrives() -> None:
    """What is in flight does; robots hold the last."""
    got = held([[made("radio-out", 10, 7)]], 40, delay=3)[:, 0]
    sent = np.maximum.accumulate([tick if not 10 <= tick < 17 else -1 for tick in range(40)])
    np.testing.assert_array_equal(got[3:], sent[:-3])


@settings(deadline=None, max_examples=15, derandomize=True)
@given(st.integers(0, 9), st.integers(1, 9), st.integers(0, 30), st.integers(1, 30))
def test_where_all_packets_are_late_or_come_again_the_last_counts(delay: int, k: int, start: int, lasts: int) -> None:
    """The youngest, unless an older one comes in its frame."""
    got = held(
        [[made(kind, start, lasts, probability=1.0, frames=k)] for kind in ("radio-reorder", "radio-duplicates")],
        90,
        delay,
    )
    for row, original in ((0, False), (1, True)):
        holds = -1
        for tick in range(90):
            sent, behind = tick - delay, tick - delay - k
            if sent >= 0 and (original or not start <= sent < start + lasts):
                holds = sent
            if behind >= 0 and start <= behind < start + lasts:
                holds = behind
            assert got[tick, row] == holds


@pytest.mark.parametrize("ticks", [1, 4])
def test_some_packets_come_late_and_the_others_as_ever(ticks: int) -> None:
    """Which do is seen where they come so late that nothing else is new; by a list they are obeyed when they come."""
    frames, k, delay, share = 400, 3, 2, 0.3
    own = [[made("radio-reorder", probability=share, frames=each)] for each in (120, k)]
    revealed, got = held(own, frames, delay, ticks).T
    count, d = frames * ticks, delay * ticks
    seen = 110 * ticks  # before any of the very late ones comes
    late = np.ones(count, bool)
    late[revealed[d:seen][revealed[d:seen] >= 0]] = False
    holds = -1
    for tick in range(seen):
        if tick >= d and not late[tick - d]:
            holds = tick - d
        if tick >= d + k * ticks and late[tick - d - k * ticks]:
            holds = tick - d - k * ticks
        assert got[tick] == holds
    part = late[: seen - d].mean()
    assert part == pytest.approx(share, abs=SIGMAS * np.sqrt(share * (1 - share) / (seen - d)))


@pytest.mark.parametrize(("kind", "values"), EACH.items())
def test_a_fault_that_is_over_leaves_the_radio_as_it_was_and_concerns_no_other_row(
    kind: str, values: dict[str, Any]
) -> None:
    """To the bit, with losses and jitter of the radio's own."""
    one = made(kind, 20, 30, **values)
    own = {"jitter_frames": 2, "loss_probability": 0.1}
    beside, met = held([[], [one]], 100, 4, **own).T
    np.testing.assert_array_equal(beside, held([[]], 100, 4, **own)[:, 0])
    np.testing.assert_array_equal(met, held([[one]], 100, 4, **own)[:, 0])
    np.testing.assert_array_equal(met[:22], beside[:22])
    np.testing.assert_array_equal(met[64:], beside[64:])
    assert (met != beside).any()
