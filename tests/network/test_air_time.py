"""Kinds of radio: published percentiles of real links, and closed forms of their laws."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from omni_mj.config.network_settings import RadioSettings
from omni_mj.network.air_time import AirTime

SEND_S, N_PACKETS = 0.015, 667  # as in the measurement: 10 s
RUNS = 300
BEACON_S = 0.1024


def send(
    n_packets: int, interval_s: float = SEND_S, seeds: list[tuple[int, ...]] | None = None, **radio
) -> tuple[NDArray, NDArray]:
    """Return arrival times (packets, n), s, infinite for lost packets, and times on air."""
    seeds = seeds or [(seed,) for seed in range(RUNS)]
    link = AirTime([RadioSettings(**radio)] * len(seeds), seeds)
    air_times, arrivals = [], []
    for packet in range(n_packets):
        air_s, is_lost = link.send(packet * interval_s, np.ones(len(seeds), bool))
        air_times.append(air_s)
        arrivals.append(np.where(is_lost, np.inf, packet * interval_s + air_s))
    return np.array(arrivals), np.array(air_times)


def is_typical(published: float, simulated: list[float]) -> bool:
    """Return whether a published figure is within the central 98 % of simulated runs."""
    low, high = np.quantile(simulated, [0.01, 0.99])
    return bool(low <= published <= high)


def test_broadcasts_have_the_published_intervals_and_losses() -> None:
    """Intervals p50 1.136, p99 96.808, max 198.247 ms; 13 of 667 lost, 20 of 654 overwritten."""
    arrivals, air = send(N_PACKETS, kind="wifi-broadcast")
    figures: dict[str, list[float]] = {"p50": [], "p99": [], "max": [], "lost": [], "same": []}
    for run in arrivals.T:
        times = np.sort(run[np.isfinite(run)])
        intervals = 1e3 * np.diff(times)
        figures["p50"].append(float(np.median(intervals)))
        figures["p99"].append(float(np.quantile(intervals, 0.99)))
        figures["max"].append(float(intervals.max()))
        figures["lost"].append(N_PACKETS - len(times))
        figures["same"].append(int((np.diff(np.rint(960 * times)) == 0).sum()))
    published = {"p50": 1.136, "p99": 96.808, "max": 198.247, "lost": 13, "same": 20}
    assert {name for name in published if not is_typical(published[name], figures[name])} == set()
    assert np.median(figures["p50"]) == pytest.approx(1.136, abs=0.02)
    assert np.median(figures["p99"]) == pytest.approx(96.8, abs=0.6)
    # Packets of a burst arrive in order. All of a burst are lost, or none.
    assert (np.diff(air + SEND_S * np.arange(N_PACKETS)[:, None], axis=0) > 0).all()
    # A run of lost packets is a whole burst or several: 6 or 7 packets each
    is_lost = np.isinf(arrivals[:, 0:40]).T
    edges = np.diff(np.pad(is_lost, ((0, 0), (1, 1))).astype(int), axis=1)
    starts, ends = np.argwhere(edges == 1), np.argwhere(edges == -1)
    inner = (starts[:, 1] > 0) & (ends[:, 1] < N_PACKETS)
    lengths = (ends - starts)[inner, 1]
    assert lengths.min() >= 6
    assert set(lengths[lengths < 12]) <= {6, 7}


def test_a_broadcast_waits_for_the_beacon_uniformly() -> None:
    """The first packet of a burst waits longest; without a queue waits are uniform."""
    rare = 1.7 * BEACON_S  # at most one packet in a burst
    _, air = send(20, rare, kind="wifi-broadcast")
    waits = air[1:].ravel() / BEACON_S
    assert stats.kstest(air[0] / BEACON_S, "uniform").pvalue > 1e-4
    assert waits.min() >= 0
    assert waits.max() < 1
    # Robots of a world share the access point; worlds do not.
    _, shared = send(50, seeds=[(3,), (3, 1), (4,)], kind="wifi-broadcast")
    np.testing.assert_array_equal(shared[:, 0], shared[:, 1])
    assert (shared[:, 0] != shared[:, 2]).all()


def test_unicasts_have_the_published_intervals() -> None:
    """Intervals p50 15.000, p99 16.244, max 16.528 ms, none lost; the wait is triangular."""
    arrivals, air = send(N_PACKETS, kind="wifi-unicast")
    assert np.isfinite(arrivals).all()
    intervals = 1e3 * np.diff(arrivals, axis=0)
    assert np.median(intervals) == pytest.approx(15, abs=0.01)
    assert is_typical(16.244, list(np.quantile(intervals, 0.99, axis=0)))
    assert is_typical(16.528, list(intervals.max(0)))
    access = RadioSettings().access_delay_s
    triangle = stats.triang(0.5, 0, 2 * access)
    assert stats.kstest(air[::7].ravel()[:20000], triangle.cdf).pvalue > 1e-4


def test_no_packet_is_on_air_for_longer_than_the_longest_time() -> None:
    """Of 2,000 packets per second, a queue would be longer at the end of a burst."""
    longest_s = RadioSettings(kind="wifi-broadcast").max_air_frames / 60
    _, air = send(1000, 0.0005, [(0,), (1,)], kind="wifi-broadcast")
    np.testing.assert_allclose(air.max(0), longest_s)


def test_a_robot_receives_in_its_slot() -> None:
    """Arrivals of robot i are i slots after those of robot 0, modulo the cycle."""
    slots, slot_s = 8, 0.002
    seeds = [(5, robot) if robot else (5,) for robot in range(slots)]
    arrivals, air = send(400, seeds=seeds, kind="time-slots", slots=slots, slot_s=slot_s)
    cycle = slots * slot_s
    assert (air >= 0).all()
    assert (air <= cycle + 1e-12).all()
    position = (arrivals - arrivals[0, 0]) / slot_s
    offset = position - np.arange(slots) + slots / 2
    np.testing.assert_allclose(offset % slots, slots / 2, atol=1e-6)
    # Sending is not synchronized with the slots: over many bases, waits are uniform.
    _, first = send(1, kind="time-slots")
    assert stats.kstest(first[0] / 0.016, "uniform").pvalue > 1e-4


@pytest.mark.parametrize("kind", ["wifi-broadcast", "wifi-unicast", "time-slots"])
def test_the_team_knows_the_mean_age_of_commands(kind: str) -> None:
    """Mean over time of the newest command's age, less half a frame for which it is held."""
    period = 1 / 60
    settings = RadioSettings(kind=kind, delay_frames=0, burst_loss_probability=0)
    arrivals, air = send(1500, period, kind=kind, burst_loss_probability=0)
    assert air.max() <= settings.max_air_frames * period
    ages = []
    for run in arrivals[:, :40].T:
        # Newest packet that has arrived at any of dense times
        times = np.arange(2.0, 24.0, 0.00037)
        ages.append(times - period * (np.searchsorted(np.sort(run), times, "right") - 1))
    assert np.mean(ages) / period - 0.5 == pytest.approx(
        settings.mean_delay_frames, abs=0.15 if kind == "wifi-broadcast" else 0.03
    )
