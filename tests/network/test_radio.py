"""The radio: packets arrive unchanged k_d frames later; jitter, losses and faults."""

from typing import Any

import numpy as np
import pytest
from benches.camera_and_radio import FRAME_S, make_fault, make_radio, receive_packets
from hypothesis import given
from hypothesis import strategies as st

import omni_mj as om

SIGMAS = 5  # of a statistic's own spread


@given(delay=st.integers(0, 20), robots=st.integers(1, 4), frames=st.integers(1, 60))
def test_packets_arrive_after_the_dead_time(delay: int, robots: int, frames: int) -> None:
    """Commands and headings are copies of the sender's; before the first, zero without heading."""
    rng, link = np.random.default_rng(0), make_radio([{"delay_frames": delay}] * robots)
    commands, headings = rng.normal(size=(frames, robots, 3)), rng.normal(size=(frames, robots))
    for k in range(frames):
        command, heading = commands[k].copy(), headings[k].copy()
        received = link.exchange(command, heading)
        command[:], heading[:] = 7.0, 7.0
        has_arrived = k >= delay
        np.testing.assert_array_equal(received.command, commands[k - delay] if has_arrived else 0.0)
        np.testing.assert_array_equal(
            received.heading, headings[k - delay] if has_arrived else np.nan
        )
        assert not has_arrived or (received.age == delay).all()
        received.command[:] = received.heading[:] = 9.0


def compute_arrivals(delay: int, faults: list[dict[str, Any]], frames: int) -> list[int]:
    """Return when each packet arrives that nothing but changes of the dead time delays."""
    arrivals = []
    for frame in range(frames):
        arrival = frame + delay
        for fault_i in faults:
            start, duration = (
                round(fault_i["start_s"] / FRAME_S),
                round(fault_i["duration_s"] / FRAME_S) or np.inf,
            )
            if start <= frame < start + duration:
                arrival = frame + fault_i["delay_frames"]
        arrivals.append(arrival)
    return arrivals


delays = st.builds(
    lambda start, frames, to: make_fault("radio-delay", start, frames, delay_frames=to),
    *[st.integers(0, 40)] * 2,
    st.integers(0, 15),
)


@given(st.integers(0, 12), st.lists(delays, max_size=3), st.sampled_from([1, 4]))
def test_packets_have_the_dead_time_of_their_sending_frame(
    delay: int, faults: list[dict[str, Any]], ticks: int
) -> None:
    """A robot holds the newest of the packets that have arrived."""
    frames = 90
    received_ticks = receive_packets([faults], frames, delay, ticks)[:, 0]
    frame_arrivals = compute_arrivals(delay, faults, frames)
    arrivals = [
        frame_arrivals[tick // ticks] * ticks + tick % ticks for tick in range(frames * ticks)
    ]
    for tick in range(frames * ticks):
        assert received_ticks[tick] == max(
            (sent for sent in range(tick + 1) if arrivals[sent] <= tick), default=-1
        )


@pytest.mark.parametrize(("delay", "jitter"), [(6, 4), (3, 3)])
def test_jitter_is_uniform_and_packets_that_are_overtaken_are_dropped(
    delay: int, jitter: int
) -> None:
    """A command is older than m frames if no packet of the last m arrived."""
    robots, frames = 1000, delay + jitter + 1
    received_ticks = receive_packets(
        [[]] * robots, frames + 20, delay, seeds=range(robots), jitter_frames=jitter
    )
    assert (np.diff(received_ticks, axis=0) >= 0).all()
    age = frames - 1 - received_ticks[frames - 1]
    # A packet sent a frames ago has arrived if it is late by a - k_d or less, one of 2 j + 1 equal
    # chances each.
    ages = np.arange(delay - jitter, delay + jitter + 1)
    arrival_probability = (ages - (delay - jitter) + 1) / (2 * jitter + 1)
    expected = (
        np.concatenate([[1.0], np.cumprod(1 - arrival_probability)[:-1]]) * arrival_probability
    )
    fraction = np.array([(age == a).mean() for a in ages])
    assert expected.sum() == pytest.approx(1)
    assert (
        np.abs(fraction - expected) <= SIGMAS * np.sqrt(expected * (1 - expected) / robots)
    ).all()


def test_losses_have_their_probability_and_robots_hold_the_last_packet() -> None:
    """Several causes multiply the probabilities that a packet passes."""
    weak_loss, strong_loss = (
        make_fault("radio-loss", 100, 4000, probability=0.3),
        make_fault("radio-loss", probability=0.5),
    )
    received_ticks = receive_packets(
        [[], [weak_loss], [weak_loss, strong_loss], [make_fault("radio-loss", 10, 7)]],
        4200,
        loss_probability=0.2,
    )
    is_new = np.diff(received_ticks, axis=0) > 0
    for row, passes in enumerate((0.8, 0.56, 0.28)):
        fraction = is_new[101:4101, row].mean()
        assert fraction == pytest.approx(passes, abs=SIGMAS * np.sqrt(passes * (1 - passes) / 4000))
    assert not is_new[11:18, 3].any()
    np.testing.assert_array_equal(received_ticks[4110:, 1], received_ticks[4110:, 0])


@pytest.mark.parametrize(("length", "fraction"), [(4.0, 0.2), (12.0, 0.4)])
def test_bursts_follow_the_gilbert_elliott_model(length: float, fraction: float) -> None:
    """Lengths of bursts are geometric with their mean; gaps have the mean that follows."""
    lost = (
        np.diff(
            receive_packets(
                [
                    [
                        make_fault(
                            "radio-burst-loss", mean_burst_frames=length, burst_fraction=fraction
                        )
                    ]
                ],
                8000,
                delay=0,
            )[:, 0]
        )
        == 0
    )
    edges = np.flatnonzero(np.diff(lost.astype(int)))
    runs = np.diff(edges)
    bursts, gaps = (runs[::2], runs[1::2]) if lost[edges[0] + 1] else (runs[1::2], runs[::2])
    for values, mean in ((bursts, length), (gaps, length * (1 - fraction) / fraction)):
        # The deviation of a geometric number of mean m is sqrt(m (m - 1)).
        assert values.mean() == pytest.approx(
            mean, abs=SIGMAS * np.sqrt(mean * (mean - 1) / len(values))
        )


@given(st.integers(0, 9), st.integers(1, 9), st.integers(0, 30), st.integers(1, 30))
def test_late_and_duplicate_packets_arrive_last_in_their_frame(
    delay: int, k: int, start: int, duration: int
) -> None:
    """A robot applies the packet that arrives last; here it affects all packets of an interval."""
    kinds = {"radio-reorder": False, "radio-duplicates": True}
    received_ticks = receive_packets(
        [[make_fault(kind, start, duration, probability=1.0, delay_frames=k)] for kind in kinds],
        90,
        delay,
    )
    for row, original in enumerate(kinds.values()):
        expected_tick = -1
        for tick in range(90):
            sent, late_tick = tick - delay, tick - delay - k
            if sent >= 0 and (original or not start <= sent < start + duration):
                expected_tick = sent
            if late_tick >= 0 and start <= late_tick < start + duration:
                expected_tick = late_tick
            assert received_ticks[tick, row] == expected_tick


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
    """Bit for bit, with further losses and jitter."""
    radio_fault = make_fault(kind, 20, 30, **values)
    settings = {"jitter_frames": 2, "loss_probability": 0.1}
    healthy, faulty = receive_packets([[], [radio_fault]], 100, 4, **settings).T
    np.testing.assert_array_equal(healthy, receive_packets([[]], 100, 4, **settings)[:, 0])
    np.testing.assert_array_equal(
        faulty, receive_packets([[radio_fault]], 100, 4, **settings)[:, 0]
    )
    np.testing.assert_array_equal(faulty[:22], healthy[:22])
    np.testing.assert_array_equal(faulty[64:], healthy[64:])
    assert (faulty != healthy).any()


def test_packets_to_some_robots_do_not_change_the_others() -> None:
    """Two packets in a tick: each robot holds the last one, however long nothing arrives."""
    link = make_radio([{"delay_frames": 0}] * 3, ticks_per_frame=16, initial_packet=(0.0, -1.0))
    link.send(np.full((3, 2), 1.0), np.array([0, 1]))
    link.send(np.full((3, 2), 2.0), np.array([1]))
    packets, new, _ = link.deliver()
    np.testing.assert_array_equal(packets, [[1, 1], [2, 2], [0, -1]])
    assert new.tolist() == [True, True, False]
    for _ in range(200):
        link.deliver()
    later_packets, new, age = link.deliver()
    np.testing.assert_array_equal(later_packets, packets)
    assert not new.any()
    assert age[0] == 201


def test_a_radio_delay_equals_a_radio_whose_dead_time_is_unknown() -> None:
    """Bit for bit."""
    scenario = om.load_scenario(
        "rect", plant="planar", reference={"waypoints": [[0, 0, 0], [0.2, 0, 1.0]], "settle_s": 0.2}
    )
    wrong_model = scenario.settings.replace(
        radio={"delay_frames": 9}, control={"delay_error_frames": -3}
    )
    faulty = scenario.settings.replace(
        fault=[{"kind": "radio-delay", "start_s": 0, "delay_frames": 9}]
    )
    expected, result = (
        om.run(scenario.replace(settings=settings_i), ["comp-flc"]).frames()
        for settings_i in (wrong_model, faulty)
    )
    for name in ("x_m", "heading_rad", "command_vx_m_s", "wheel_speed_1_rad_s"):
        np.testing.assert_array_equal(expected[name], result[name])
