"""Laws of the identification of latency, alpha and drag, on robots that answer as its model says."""

import copy

import numpy as np
import pytest
from closed_loop import BodyFrame, T, believe_nothing
from hypothesis import given
from hypothesis import strategies as st
from laws import FEW, LAW

from omni_control.delay import CommandsInFlight
from omni_control.estimation.identify import ALPHA_BOUNDS, PlantIdentifier
from omni_control.kinematics import Array

SHARP = (1e-5, 1e-5, 1e-4)  # the least noise that the identifier believes of vision
GUESS, SECOND = 6.0, 60
DRAG_HIGHEST = 0.08  # twice what is told by default

seeds = st.integers(0, 2**32 - 1)
halves = st.integers(0, 26)


def learn(plant: BodyFrame, commands: Array, guess: float = GUESS, drag_sigma: float = 0.04) -> PlantIdentifier:
    """Drive robots with commands (frames, n, 3) and let the identifier see every frame of it, without noise."""
    n = commands.shape[1]
    identifier = PlantIdentifier(n, T, guess, SHARP)
    identifier._drag_sigma = drag_sigma  # what is believed of drag apart from the noise that it makes
    queue, sent = CommandsInFlight(n, identifier.longest), np.zeros((n, 3))
    for command in commands:
        queue.push(sent)
        identifier.update(wrapped(plant.pose), plant.middle, queue)
        plant.advance(command)
        sent = command
    return identifier


def wrapped(pose: Array) -> Array:
    """Poses (n, 3) as vision reports them, with headings in (-pi, pi]."""
    return np.column_stack([pose[:, :2], np.angle(np.exp(1j * pose[:, 2]))])


def white(rng: np.random.Generator, frames: int, n: int) -> Array:
    """Commands (frames, n, 3) that show everything: new in every frame, up to 2 m/s and 4 rad/s."""
    return rng.uniform(-1, 1, (frames, n, 3)) * np.array([2.0, 2.0, 4.0])


def smooth(rng: np.random.Generator, frames: int, n: int) -> Array:
    """Commands (frames, n, 3) as robots get them: up to 1 m/s and 3 rad/s, there and back in one to three seconds."""
    phase, rate = rng.uniform([[[0.0]], [[2.0]]], [[[2 * np.pi]], [[6.0]]], (2, n, 3))
    return np.array([1.0, 1.0, 3.0]) * np.sin(phase + rate * T * np.arange(frames)[:, None, None])


@pytest.fixture
def without_prior(monkeypatch: pytest.MonkeyPatch) -> None:
    believe_nothing(monkeypatch)


@pytest.mark.usefixtures("without_prior")
def test_a_robot_of_the_model_is_found_exactly() -> None:
    """Latency to the half frame, alpha and drag to the rounding, where nothing is believed beforehand of the latter.

    With dry friction all axes answer at once: drag depends on the whole twist, which else is not that of one time.
    """
    for dry in [True, False]:
        n, rng = 40, np.random.default_rng(0)
        latency = rng.integers(2, 25, (n, 1)) / 2 + (0 if dry else rng.integers(-2, 3, (n, 3)) / 2) + np.zeros((n, 3))
        alpha, drag = rng.uniform(0.45, 1.15, (n, 3)), rng.uniform(0, 0.07, (n, 3)) * dry
        found = learn(
            BodyFrame(rng.uniform(-3, 3, (n, 3)), latency, alpha, drag), white(rng, 2 * SECOND, n), drag_sigma=1e6
        )
        # 120 sums of numbers of size 1, divided by what drag explains beyond alpha: a hundredth.
        np.testing.assert_allclose(found.latency, latency, rtol=0, atol=1e-9)
        np.testing.assert_allclose(found.alpha, alpha, rtol=0, atol=1e-9)
        np.testing.assert_allclose(found.drag, drag, rtol=0, atol=1e-9)
        assert found.latency_sigma.max() < 1e-9


def test_two_seconds_of_ordinary_driving_show_latency_and_response() -> None:
    """Latency within a half frame, and the answer to any command within 2 %.

    Speeds that change slowly tell latencies badly apart, and drag from alpha: what is believed beforehand (alpha = 1
    to 0.15, no drag to 0.04 m/s) moves both together, by 0.03, and hardly their sum. The errors are 0.9 % in
    translation and 1.9 % turning, whose drag counts at 80 mm from the centre.
    """
    n, rng = 60, np.random.default_rng(1)
    latency = np.repeat(rng.integers(0, 25, (n, 1)) / 2, 3, axis=1)
    alpha, drag = rng.uniform(0.5, 1.1, (n, 3)), rng.uniform(0, 0.06, (n, 3))
    plant = BodyFrame(np.zeros((n, 3)), latency, alpha, drag)
    found = learn(plant, smooth(rng, 2 * SECOND, n))
    assert np.abs(found.latency - latency).max() < 0.5
    assert np.abs(found.alpha - alpha).max() < 0.06
    commands = smooth(rng, 500, n)
    size = np.sqrt((commands[..., :2] ** 2).sum(-1) + (0.08 * commands[..., 2]) ** 2)
    answer = alpha * commands - drag * commands / np.maximum(size, 0.05)[..., None]
    error = found.respond(commands, np.zeros(n)) - answer
    relative = np.sqrt((error**2).mean((0, 1)) / (answer**2).mean((0, 1)))
    assert (relative < [0.015, 0.015, 0.03]).all()


def test_what_driving_forward_shows_of_the_latency_holds_sideways_as_well() -> None:
    """A robot that never drove sideways is believed to answer there as late as forward, to 0.7 frames or so.

    Turning is another matter: of it nothing is learned, and the guess remains.
    """
    commands = white(np.random.default_rng(0), SECOND, 1) * [1, 0, 0]
    found = learn(BodyFrame(np.zeros((1, 3)), 3.0, 0.8, 0.0), commands)
    np.testing.assert_allclose(found.latency[0, :2], 3.0, rtol=0, atol=0.2)  # believed besides: 6, to 3 frames
    assert found.latency[0, 2] == pytest.approx(GUESS, abs=0.2)
    assert found.latency_sigma[0, 0] < 1e-6
    assert 0.6 < found.latency_sigma[0, 1] < 0.8
    assert found.latency_sigma[0, 2] > 2.5
    np.testing.assert_allclose(found.alpha[0, 1:], 1.0, rtol=0, atol=1e-12)


def test_no_more_drag_is_found_than_is_thought_possible() -> None:
    """Twice what is believed of it: a robot that loses 0.2 m/s is said to lose 0.08, and the rest is put on alpha."""
    commands = smooth(np.random.default_rng(0), 2 * SECOND, 3) * [1, 0, 0]
    found = learn(BodyFrame(np.zeros((3, 3)), 6.0, 1.0, 0.2), commands)
    np.testing.assert_allclose(found.drag[:, 0], 0.08, rtol=1e-9)
    assert (found.alpha[:, 0] < 0.95).all()


def test_latencies_compared_are_those_around_the_guess_that_exist() -> None:
    """Half frames from seven below the guess, but not below nought, to seven above it; commands are kept for all."""
    for guess in [0.0, 1.2, 6.0, 7.2, 40.0]:
        identifier = PlantIdentifier(1, T, guess, SHARP)
        candidates = identifier.candidates
        assert np.diff(candidates).tolist() == [0.5] * (len(candidates) - 1)
        assert candidates[0] == max(0, np.floor(guess - 7))
        assert guess + 7 - 0.5 < candidates[-1] <= guess + 7 + 0.5
        assert candidates[-1] + 1 <= identifier.longest < candidates[-1] + 2.5
        assert (identifier.latency == guess).all()


def test_robots_that_answer_at_once_or_very_late_are_found() -> None:
    for guess, true in [(0.0, 0.0), (0.0, 3.5), (30.0, 30.0), (30.0, 25.5)]:
        rng = np.random.default_rng(0)
        found = learn(BodyFrame(np.zeros((3, 3)), true, 0.8, 0.0), white(rng, SECOND, 3), guess)
        # White commands tell the latencies apart without doubt.
        np.testing.assert_allclose(found.latency, true, rtol=0, atol=1e-9)


@FEW
@given(seeds, st.floats(0.1, 100))
def test_at_standstill_nothing_is_learned(seed: int, times: float) -> None:
    """Whatever vision reports of robots that were told to stand, be it 13 cm off, moves no estimate.

    In two seconds of it 0.3 of the evidence is left, so that what was believed beforehand counts threefold.
    """
    rng, n = np.random.default_rng(seed), 3
    plant = BodyFrame(np.zeros((n, 3)), 4.5, 0.7, 0.02)
    # The last 40 frames are at rest: the latency, and the memory of displacements, which halves in a frame.
    quiet = learn(plant, np.concatenate([smooth(rng, 2 * SECOND, n), np.zeros((40, n, 3))]))
    before, noisy = copy.deepcopy(quiet), copy.deepcopy(quiet)
    queue = CommandsInFlight(n, quiet.longest)
    for _ in range(2 * SECOND):
        seen = plant.pose + times * np.array([0.0013, 0.0013, 0.01]) * rng.standard_normal((n, 3))
        noisy.update(wrapped(seen), plant.middle, queue)
        quiet.update(wrapped(plant.pose), plant.middle, queue)
    for name, forgotten in (("alpha", 0.03), ("drag", 0.02), ("latency", 0.5)):
        np.testing.assert_allclose(getattr(noisy, name), getattr(quiet, name), rtol=0, atol=1e-6)
        np.testing.assert_allclose(getattr(quiet, name), getattr(before, name), rtol=0, atol=forgotten)


@LAW
@given(seeds, st.floats(1e-3, 1e4), st.floats(1e-3, 1e3), st.floats(0, 0.95))
def test_estimates_are_bounded_whatever_is_seen(seed: int, size: float, speed: float, unseen: float) -> None:
    """Commands and poses that have nothing to do with each other, and gaps: they are those of a robot that can be."""
    rng, n = np.random.default_rng(seed), 3
    identifier = PlantIdentifier(n, T, GUESS, (0.0013, 0.0013, 0.01))
    queue = CommandsInFlight(n, identifier.longest)
    for frame in range(90):
        queue.push(rng.uniform(-speed, speed, (n, 3)) * (frame > 0))
        measured = wrapped(rng.normal(0, size, (n, 3)))
        measured[rng.random(n) < unseen * (frame > 0)] = np.nan
        identifier.update(measured, rng.uniform(-4, 4, n), queue)
        lowest, highest = identifier.candidates[[0, -1]]
        for value, low, high in (
            (identifier.alpha, *ALPHA_BOUNDS),
            (identifier.drag, 0.0, 2 * 0.04),
            (identifier.latency, lowest, highest),
            (identifier.latency_sigma, 0.0, (highest - lowest) / 2),
        ):
            # Means over probabilities, whose sum is rounded.
            assert value.min() >= low - 1e-12
            assert value.max() <= high + 1e-12


def test_a_gap_in_vision_costs_nothing_but_evidence() -> None:
    """Displacements are counted from where a robot was seen last: single misses and gaps of ten leave it exact."""
    rng, n = np.random.default_rng(0), 4
    plant = BodyFrame(np.zeros((n, 3)), 5.5, 0.8, 0.0)
    identifier = PlantIdentifier(n, T, GUESS, SHARP)
    queue, commands = CommandsInFlight(n, identifier.longest), white(rng, 3 * SECOND, n)
    sent = np.zeros((n, 3))
    for frame, command in enumerate(commands):
        queue.push(sent)
        measured = wrapped(plant.pose)
        if frame % 30 > 20 or frame % 7 == 3:
            measured[::2] = np.nan
        identifier.update(measured, plant.middle, queue)
        plant.advance(command)
        sent = command
    np.testing.assert_allclose(identifier.latency, 5.5, rtol=0, atol=1e-6)
    # What is believed beforehand weighs twice as much where a half of the frames was not seen.
    np.testing.assert_allclose(identifier.alpha, 0.8, rtol=0, atol=0.05)


def test_a_row_of_a_batch_is_what_it_is_alone() -> None:
    """Estimates do not depend, in their last bit, on the other robots."""
    n, rng = 9, np.random.default_rng(0)
    latency, alpha = rng.integers(0, 20, (n, 3)) / 2, rng.uniform(0.5, 1.1, (n, 3))
    start, commands = rng.uniform(-2, 2, (n, 3)), smooth(rng, 40, n)

    def run(rows: slice) -> list[Array]:
        found = learn(BodyFrame(start[rows], latency[rows], alpha[rows], 0.02), commands[:, rows])
        return [found.latency, found.latency_sigma, found.alpha, found.drag]

    batch = run(slice(None))
    for i in range(n):
        for alone, all_rows in zip(run(slice(i, i + 1)), batch, strict=True):
            np.testing.assert_array_equal(alone[0], all_rows[i])


@pytest.mark.usefixtures("without_prior")
def test_a_robot_first_seen_later_and_already_moving_is_found_exactly() -> None:
    """Displacements count from where a robot was first seen: what was commanded before explains none of them."""
    rng, n = np.random.default_rng(0), 4
    plant = BodyFrame(np.zeros((n, 3)), 5.5, 0.8, 0.0)
    identifier = PlantIdentifier(n, T, GUESS, SHARP)
    queue, sent = CommandsInFlight(n, identifier.longest), np.zeros((n, 3))
    for frame, command in enumerate(white(rng, 2 * SECOND, n)):
        queue.push(sent)
        if frame >= 20:
            unseen = (frame < 30) & (np.arange(n) < 2)
            identifier.update(np.where(unseen[:, None], np.nan, wrapped(plant.pose)), plant.middle, queue)
        plant.advance(command)
        sent = command
    np.testing.assert_allclose(identifier.latency, 5.5, rtol=0, atol=1e-9)
    np.testing.assert_allclose(identifier.alpha, 0.8, rtol=0, atol=1e-9)
