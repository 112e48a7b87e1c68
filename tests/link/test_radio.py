"""The radio: what is sent arrives, unchanged, k_d frames later, more or less by its jitter."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from omni_mj.link.steady_radio import SteadyRadio

from omni_mj.link import steady_radio
from omni_mj.link.noise import Stream
from omni_mj.link.radio import Radio, Received
from omni_mj.scenarios.faults import Delay, RadioLoss
from omni_mj.scenarios.settings import RadioSettings

SIGMAS = 5  # of a statistic's own spread


@dataclass
class Link:
    """What was sent in each frame of a run, and what the robots held then."""

    commands: NDArray  # (frames, n, 3)
    headings: NDArray  # (frames, n)
    received: Received  # (frames, n, 3), (frames, n), (frames, n)


def radio_of(delay: int, jitter: int = 0, seeds: Sequence[int] = (0,)) -> Radio:
    return Radio([RadioSettings(delay_frames=delay, jitter_frames=jitter)] * len(seeds), [(seed,) for seed in seeds])


def link(delay: int, jitter: int, seeds: list[int], frames: int) -> Link:
    """Send random commands and headings through a radio."""
    rng = np.random.default_rng(0)
    n = len(seeds)
    commands, headings = rng.normal(size=(frames, n, 3)), rng.normal(size=(frames, n))
    radio = radio_of(delay, jitter, seeds)
    received = [radio.exchange(commands[frame], headings[frame]) for frame in range(frames)]
    columns = ([getattr(r, name) for r in received] for name in ("command", "heading", "age"))
    return Link(commands, headings, Received(*map(np.array, columns)))


@settings(deadline=None, max_examples=60, derandomize=True)
@given(delay=st.integers(0, 20), robots=st.integers(1, 4), frames=st.integers(1, 60), seed=st.integers(0, 2**32))
def test_delivered_is_what_was_sent_k_d_frames_ago(delay: int, robots: int, frames: int, seed: int) -> None:
    """Without jitter, whatever the seed: every command and heading, k_d frames later."""
    run = link(delay, 0, [seed + i for i in range(robots)], frames)
    # Before the first packet arrives the robot is told to stand, and no heading; copies, so equal to the last bit.
    expected = np.concatenate([np.zeros((delay, robots, 3)), run.commands])[:frames]
    np.testing.assert_array_equal(run.received.command, expected)
    expected = np.concatenate([np.full((delay, robots), np.nan), run.headings])[:frames]
    np.testing.assert_array_equal(run.received.heading, expected)
    assert (run.received.age[delay:] == delay).all()


@settings(deadline=None, max_examples=20, derandomize=True)
@given(st.integers(0, 5))
def test_a_packet_in_flight_cannot_be_changed(delay: int) -> None:
    radio = radio_of(delay)
    command, heading = np.ones((1, 3)), np.ones(1)
    delivered = [radio.exchange(command, heading)]
    command[:], heading[:] = 7.0, 7.0  # the sender's arrays, reused
    for _ in range(delay):
        for received in filter(lambda values: values is not None, vars(delivered[-1]).values()):
            received[:] = 9  # the receiver's arrays, reused
        delivered.append(radio.exchange(np.zeros((1, 3)), np.zeros(1)))
    np.testing.assert_array_equal(delivered[-1].command, 1.0)
    np.testing.assert_array_equal(delivered[-1].heading, 1.0)
    np.testing.assert_array_equal(delivered[-1].age, delay)


def test_no_delay_is_no_queue() -> None:
    radio = radio_of(0)
    for value in (2.0, 3.0):
        received = radio.exchange(np.full((1, 3), value), np.full(1, -value))
        np.testing.assert_array_equal(received.command, value)
        np.testing.assert_array_equal(received.heading, -value)
        np.testing.assert_array_equal(received.age, 0)


def test_at_once_is_what_a_radio_without_delay_delivers() -> None:
    rng = np.random.default_rng(0)
    command, heading = rng.normal(size=(3, 3)), rng.normal(size=3)
    delivered = radio_of(0, seeds=[0, 1, 2]).exchange(command, heading)
    for name, value in vars(Received.at_once(command, heading)).items():
        np.testing.assert_array_equal(value, getattr(delivered, name))
    assert np.isnan(Received.at_once(command).heading).all()


# --- jitter ---

delays_and_jitters = st.integers(0, 12).flatmap(lambda delay: st.tuples(st.just(delay), st.integers(0, delay)))


@settings(deadline=None, max_examples=60, derandomize=True)
@given(delays_and_jitters, st.integers(1, 80), st.integers(0, 2**32))
def test_no_packet_comes_before_it_is_sent_nor_later_than_it_may(
    chosen: tuple[int, int], frames: int, seed: int
) -> None:
    """A robot holds a packet of k_d - j to k_d + j frames ago, and never goes back to an older one."""
    delay, jitter = chosen
    run = link(delay, jitter, [seed], frames)
    sent = np.arange(frames) - run.received.age[:, 0]
    assert (np.diff(sent) >= 0).all()
    age = run.received.age[sent >= 0, 0]
    assert ((delay - jitter <= age) & (age <= delay + jitter)).all()
    assert (sent[delay + jitter :] >= 0).all()


@settings(deadline=None, max_examples=60, derandomize=True)
@given(delays_and_jitters, st.integers(1, 80), st.lists(st.integers(0, 2**32), min_size=1, max_size=3))
def test_a_robot_holds_the_newest_of_the_packets_that_have_arrived(
    chosen: tuple[int, int], frames: int, seeds: list[int]
) -> None:
    """Against a list of events: every packet's arrival, drawn as the radio draws them, gone through frame by frame."""
    delay, jitter = chosen
    run = link(delay, jitter, seeds, frames)
    bounds = -jitter - 0.5, jitter + 0.5
    late = [np.random.default_rng([int(Stream.RADIO_JITTER), seed]).uniform(*bounds, frames) for seed in seeds]
    for robot in range(len(seeds)):
        arrivals = [(sent + delay + round(late[robot][sent]), sent) for sent in range(frames)]
        held_before = None
        for frame in range(frames):
            held = max((sent for arrival, sent in arrivals if arrival <= frame), default=None)
            command = np.zeros(3) if held is None else run.commands[held, robot]
            np.testing.assert_array_equal(run.received.command[frame, robot], command)
            heading = np.nan if held is None or held == held_before else run.headings[held, robot]
            np.testing.assert_array_equal(run.received.heading[frame, robot], heading)
            assert held is None or run.received.age[frame, robot] == frame - held
            held_before = held


@pytest.mark.parametrize(("delay", "jitter"), [(6, 4), (3, 3)])
def test_ages_are_those_of_packets_that_are_late_by_a_uniform_number_of_frames(delay: int, jitter: int) -> None:
    """What is held is older than m frames if none of the packets of the last m has arrived: a product of chances."""
    robots, frames = 4000, delay + jitter + 1
    age = link(delay, jitter, list(range(robots)), frames).received.age[-1]
    # A packet sent a frames ago has arrived if it is late by a - k_d or less, one of 2 j + 1 equal chances each.
    ages = np.arange(delay - jitter, delay + jitter + 1)
    arrived = (ages - (delay - jitter) + 1) / (2 * jitter + 1)
    still_out = np.concatenate([[1.0], np.cumprod(1 - arrived)[:-1]])
    expected = still_out * arrived
    share = np.array([(age == a).mean() for a in ages])
    assert expected.sum() == pytest.approx(1)
    # The share of n robots spreads by sqrt(p (1 - p) / n).
    spread = np.sqrt(expected * (1 - expected) / robots)
    assert (np.abs(share - expected) <= SIGMAS * spread).all()


def test_jitter_is_independent_from_packet_to_packet() -> None:
    """Jitter of one frame: two packets arrive together, or swap, as often as independent lateness says."""
    robots = 3000
    radio = radio_of(1, 1, range(robots))
    first, second = (radio.exchange(np.full((robots, 3), k + 1.0), np.zeros(robots)).command[:, 0] for k in (0, 1))
    # In frame 0 only a packet early by one is there. In frame 1 the second is if it is early, else the first if it is
    # early or in time: of three chances each.
    assert set(zip(first, second, strict=True)) == {(0, 0), (0, 1), (0, 2), (1, 1), (1, 2)}
    for pair, chance in {(0, 0): 2 / 9, (0, 1): 2 / 9, (0, 2): 2 / 9, (1, 1): 2 / 9, (1, 2): 1 / 9}.items():
        share = ((first == pair[0]) & (second == pair[1])).mean()
        assert share == pytest.approx(chance, abs=SIGMAS * np.sqrt(chance * (1 - chance) / robots))


def test_a_seeds_jitter_is_the_same_in_any_batch() -> None:
    seeds, frames = [3, 8, 3, 5], 200
    together = link(6, 4, seeds, frames).received.age
    for robot, seed in enumerate(seeds):
        np.testing.assert_array_equal(together[:, robot], link(6, 4, [seed], frames).received.age[:, 0])
    assert (together[:, 0] != together[:, 1]).any()


def test_each_robot_has_a_dead_time_and_a_jitter_of_its_own() -> None:
    cases, frames = [(0, 0), (3, 1), (12, 12)], 60
    rng = np.random.default_rng(1)
    commands, headings = rng.normal(size=(frames, 3, 3)), rng.normal(size=(frames, 3))
    settings = [RadioSettings(delay_frames=delay, jitter_frames=jitter) for delay, jitter in cases]
    together = Radio(settings, [(5,)] * 3)
    alone = [Radio([own], [(5,)]) for own in settings]
    for command, heading in zip(commands, headings, strict=True):
        received = together.exchange(command, heading)
        for i, radio in enumerate(alone):
            single = radio.exchange(command[[i]], heading[[i]])
            for name, values in vars(received).items():
                if values is None:
                    continue
                np.testing.assert_array_equal(values[[i]], getattr(single, name))


@settings(deadline=None, max_examples=30, derandomize=True)
@given(delay=st.integers(0, 12), robots=st.integers(1, 4), seed=st.integers(0, 2**32 - 1))
def test_a_radio_that_nothing_disturbs_is_a_queue(delay: int, robots: int, seed: int) -> None:
    """All that robots hold, to the bit, of the two radios; and a packet in flight is its own."""
    chosen, seeds = [RadioSettings(delay_frames=delay)] * robots, [(i,) for i in range(robots)]
    general, steady, rng = (
        Radio(chosen, seeds),
        steady_radio.radio(chosen, seeds, [()] * robots),
        np.random.default_rng(seed),
    )
    assert isinstance(steady, SteadyRadio)
    for _ in range(3 * delay + 3):
        command, heading = rng.normal(size=(robots, 3)), rng.normal(size=robots)
        one, other = (each.exchange(command, heading) for each in (general, steady))
        command[:] = heading[:] = 0.0
        for name in ("command", "heading", "age"):
            np.testing.assert_array_equal(getattr(other, name), getattr(one, name))
        np.testing.assert_array_equal(True if other.new is None else other.new, one.new)


def test_what_disturbs_a_radio_is_not_left_out() -> None:
    """Jitter, losses, dead times that differ, faults: none of them is a queue."""
    usual, seeds = RadioSettings(delay_frames=2), [(0,), (1,)]
    more = {"jitter_frames": 1}, {"loss_probability": 0.1}, {"delay_frames": 3}
    for changed in more:
        assert isinstance(
            steady_radio.radio([usual, RadioSettings(**{"delay_frames": 2, **changed})], seeds, [(), ()]), Radio
        )
    for fault in (Delay(at=1.0, to=4), RadioLoss(at=1.0, probability=0.1)):
        assert isinstance(steady_radio.radio([usual] * 2, seeds, [(), (fault,)]), Radio)
