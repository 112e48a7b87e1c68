"""The radio: what is sent arrives, unchanged, k_d frames later; its jitter, losses and faults."""

from typing import Any

import numpy as np
import pytest
from benches.link import FRAME_S, fault, hold, radio
from hypothesis import given
from hypothesis import strategies as st

import omni_mj as om

SIGMAS = 5  # of a statistic's own spread


@given(delay=st.integers(0, 20), robots=st.integers(1, 4), frames=st.integers(1, 60))
def test_packets_arrive_after_the_dead_time(delay: int, robots: int, frames: int) -> None:
    """Commands and headings are copies of the sender's; before the first, zero without heading."""
    rng, link = np.random.default_rng(0), radio([{"delay_frames": delay}] * robots)
    commands, headings = rng.normal(size=(frames, robots, 3)), rng.normal(size=(frames, robots))
    for k in range(frames):
        command, heading = commands[k].copy(), headings[k].copy()
        received = link.exchange(command, heading)
        command[:], heading[:] = 7.0, 7.0
        came = k >= delay
        np.testing.assert_array_equal(received.command, commands[k - delay] if came else 0.0)
        np.testing.assert_array_equal(received.heading, headings[k - delay] if came else np.nan)
        assert not came or (received.age == delay).all()
        received.command[:] = received.heading[:] = 9.0


def late(delay: int, faults: list[dict[str, Any]], frames: int) -> list[int]:
    """Return when each packet arrives that nothing but changes of the dead time delays."""
    arrivals = []
    for frame in range(frames):
        arrives = frame + delay
        for each in faults:
            start, lasts = (
                round(each["start_s"] / FRAME_S),
                round(each["duration_s"] / FRAME_S) or np.inf,
            )
            if start <= frame < start + lasts:
                arrives = frame + each["delay_frames"]
        arrivals.append(arrives)
    return arrivals


delays = st.builds(
    lambda start, frames, to: fault("radio-delay", start, frames, delay_frames=to),
    *[st.integers(0, 40)] * 2,
    st.integers(0, 15),
)


@given(st.integers(0, 12), st.lists(delays, max_size=3), st.sampled_from([1, 4]))
def test_packets_have_the_dead_time_of_their_sending_frame(
    delay: int, faults: list[dict[str, Any]], ticks: int
) -> None:
    """A robot holds the newest of the packets that have arrived."""
    frames = 90
    got = hold([faults], frames, delay, ticks)[:, 0]
    by_frame = late(delay, faults, frames)
    arrivals = [by_frame[tick // ticks] * ticks + tick % ticks for tick in range(frames * ticks)]
    for tick in range(frames * ticks):
        assert got[tick] == max(
            (sent for sent in range(tick + 1) if arrivals[sent] <= tick), default=-1
        )


@pytest.mark.parametrize(("delay", "jitter"), [(6, 4), (3, 3)])
def test_jitter_is_uniform_and_packets_that_are_overtaken_are_dropped(
    delay: int, jitter: int
) -> None:
    """A command is older than m frames if no packet of the last m arrived."""
    robots, frames = 1000, delay + jitter + 1
    got = hold([[]] * robots, frames + 20, delay, seeds=range(robots), jitter_frames=jitter)
    assert (np.diff(got, axis=0) >= 0).all()
    age = frames - 1 - got[frames - 1]
    # A packet sent a frames ago has arrived if it is late by a - k_d or less, one of 2 j + 1 equal
    # chances each.
    ages = np.arange(delay - jitter, delay + jitter + 1)
    arrived = (ages - (delay - jitter) + 1) / (2 * jitter + 1)
    expected = np.concatenate([[1.0], np.cumprod(1 - arrived)[:-1]]) * arrived
    share = np.array([(age == a).mean() for a in ages])
    assert expected.sum() == pytest.approx(1)
    assert (np.abs(share - expected) <= SIGMAS * np.sqrt(expected * (1 - expected) / robots)).all()


def test_losses_have_their_probability_and_robots_hold_the_last_packet() -> None:
    """Several causes multiply the probabilities that a packet passes."""
    one, two = fault("radio-loss", 100, 4000, probability=0.3), fault("radio-loss", probability=0.5)
    got = hold([[], [one], [one, two], [fault("radio-loss", 10, 7)]], 4200, loss_probability=0.2)
    fresh = np.diff(got, axis=0) > 0
    for row, passes in enumerate((0.8, 0.56, 0.28)):
        share = fresh[101:4101, row].mean()
        assert share == pytest.approx(passes, abs=SIGMAS * np.sqrt(passes * (1 - passes) / 4000))
    assert not fresh[11:18, 3].any()
    np.testing.assert_array_equal(got[4110:, 1], got[4110:, 0])


@pytest.mark.parametrize(("length", "share"), [(4.0, 0.2), (12.0, 0.4)])
def test_bursts_follow_the_gilbert_elliott_model(length: float, share: float) -> None:
    """Lengths of bursts are geometric with their mean; gaps have the mean that follows."""
    lost = (
        np.diff(
            hold(
                [[fault("radio-burst-loss", mean_burst_frames=length, burst_fraction=share)]],
                8000,
                delay=0,
            )[:, 0]
        )
        == 0
    )
    edges = np.flatnonzero(np.diff(lost.astype(int)))
    runs = np.diff(edges)
    bursts, gaps = (runs[::2], runs[1::2]) if lost[edges[0] + 1] else (runs[1::2], runs[::2])
    for found, mean in ((bursts, length), (gaps, length * (1 - share) / share)):
        # The deviation of a geometric number of mean m is sqrt(m (m - 1)).
        assert found.mean() == pytest.approx(
            mean, abs=SIGMAS * np.sqrt(mean * (mean - 1) / len(found))
        )


@given(st.integers(0, 9), st.integers(1, 9), st.integers(0, 30), st.integers(1, 30))
def test_late_and_duplicate_packets_arrive_last_in_their_frame(
    delay: int, k: int, start: int, lasts: int
) -> None:
    """A robot applies whatever comes last; here all packets of a while do so."""
    kinds = {"radio-reorder": False, "radio-duplicates": True}
    got = hold(
        [[fault(kind, start, lasts, probability=1.0, delay_frames=k)] for kind in kinds], 90, delay
    )
    for row, original in enumerate(kinds.values()):
        held = -1
        for tick in range(90):
            sent, behind = tick - delay, tick - delay - k
            if sent >= 0 and (original or not start <= sent < start + lasts):
                held = sent
            if behind >= 0 and start <= behind < start + lasts:
                held = behind
            assert got[tick, row] == held


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        ("radio-loss", {"probability": 0.4}),
        ("radio-burst-loss", {"mean_burst_frames": 6.0, "burst_fraction": 0.4}),
        ("radio-duplicates", {"probability": 0.5, "delay_frames": 4}),
        ("radio-reorder", {"probability": 0.5, "delay_frames": 3}),
        ("radio-delay", {"delay_frames": 7}),
    ],
)
def test_radio_faults_end_without_trace_and_affect_their_row_only(
    kind: str, values: dict[str, Any]
) -> None:
    """To the bit, with losses and jitter of the radio's own."""
    one, own = fault(kind, 20, 30, **values), {"jitter_frames": 2, "loss_probability": 0.1}
    other, met = hold([[], [one]], 100, 4, **own).T
    np.testing.assert_array_equal(other, hold([[]], 100, 4, **own)[:, 0])
    np.testing.assert_array_equal(met, hold([[one]], 100, 4, **own)[:, 0])
    np.testing.assert_array_equal(met[:22], other[:22])
    np.testing.assert_array_equal(met[64:], other[64:])
    assert (met != other).any()


def test_packets_to_some_robots_do_not_change_the_others() -> None:
    """Two packets in a tick: each robot holds the last one. Skipping ticks equals delivering."""
    link = radio([{"delay_frames": 0}] * 3, ticks_per_frame=16, initial_packet=(0.0, -1.0))
    link.send(np.full((3, 2), 1.0), np.array([0, 1]))
    link.send(np.full((3, 2), 2.0), np.array([1]))
    assert link.ticks_to_next_arrival == 0
    held, new, _ = link.deliver()
    np.testing.assert_array_equal(held, [[1, 1], [2, 2], [0, -1]])
    assert new.tolist() == [True, True, False]
    assert link.ticks_to_next_arrival > 1000
    link.skip_ticks(200)
    again, new, age = link.deliver()
    np.testing.assert_array_equal(again, held)
    assert not new.any()
    assert age[0] == 201


def test_a_radio_delay_equals_a_radio_whose_dead_time_is_unknown() -> None:
    """To the last bit."""
    chosen = om.load_scenario(
        "rect", plant="planar", reference={"waypoints": [[0, 0, 0], [0.2, 0, 1.0]], "settle_s": 0.2}
    )
    told = chosen.settings.replace(radio={"delay_frames": 9}, control={"delay_error_frames": -3})
    met = chosen.settings.replace(fault=[{"kind": "radio-delay", "start_s": 0, "delay_frames": 9}])
    one, other = (
        om.run(chosen.replace(settings=own), ["comp-flc"]).frames() for own in (told, met)
    )
    for name in ("x_m", "heading_rad", "command_vx_m_s", "wheel_speed_1_rad_s"):
        np.testing.assert_array_equal(one[name], other[name])
