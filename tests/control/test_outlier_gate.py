"""Laws of the gate: what a robot can do passes as it is, what it cannot does not, and no doubt lasts."""

import numpy as np
from benches.control import (
    MAX_REJECTIONS,
    MAX_REPEATS,
    Array,
    OutlierGate,
    make_controller,
    wrap_angle,
)
from closed_loop import NOISE, LaggedPlant, T, make_vision_noise, run_team, to_measured_pose
from hypothesis import given, settings
from hypothesis import strategies as st
from team_setup import TIMED, make_reference, make_start_poses

from omni_control import MotionLimits, Team, TeamModel

LIMITS = MotionLimits(3.7, 4.7, 26.0, 50.8)
seeds = st.integers(0, 2**32 - 1)


def gate_of(n: int, noise: Array = NOISE) -> OutlierGate:
    return OutlierGate(np.tile(noise, (n, 1)), [LIMITS] * n, T)


def driven(rng: np.random.Generator, frames: int, n: int, missed: float) -> tuple[Array, Array]:
    """Images (frames, n, 3) and ages (frames, n) of robots that go from standing to full speed from frame to frame."""
    velocity = rng.uniform(-1, 1, (frames, n, 3)) * [3.7 / np.sqrt(2), 3.7 / np.sqrt(2), 20.0]
    pose = rng.uniform(-3, 3, (n, 3)) + np.cumsum(velocity * T, axis=0)
    share = rng.uniform(0, 1, (frames, n))
    images = pose - share[..., None] * T * velocity + NOISE * rng.standard_normal(pose.shape)
    images[..., 2] = wrap_angle(images[..., 2])
    images[rng.random((frames, n)) < missed] = np.nan
    return images, share * T


@given(seeds, st.floats(0, 0.5))
def test_all_that_a_robot_can_do_is_believed_to_the_bit(seed: int, missed: float) -> None:
    """Whatever blows it gets, however images are late or missed: the gate changes nothing."""
    images, ages = driven(np.random.default_rng(seed), 60, 5, missed)
    gate = gate_of(5)
    for image, age in zip(images, ages, strict=True):
        np.testing.assert_array_equal(gate.reject_outliers(image, age), image)


@given(seeds, st.floats(0.18, 10.0), st.floats(-np.pi, np.pi))
def test_another_robot_is_not_taken_for_this_one(seed: int, away: float, direction: float) -> None:
    """One that stands anywhere beside a robot at rest is seen in some images, not in two in a row: none is believed."""
    rng = np.random.default_rng(seed)
    other = np.array([[away * np.cos(direction), away * np.sin(direction), 1.0]])
    gate, mistaken = gate_of(1), True
    for _ in range(100):
        mistaken = not mistaken and rng.random() < 0.5
        pose = NOISE * rng.standard_normal((1, 3))
        np.testing.assert_array_equal(
            gate.reject_outliers(pose + mistaken * other), np.nan if mistaken else pose
        )


@given(seeds, st.floats(-np.pi, np.pi), st.floats(-20, 20))
def test_headings_seen_backwards_are_turned_back(seed: int, heading: float, rate: float) -> None:
    """In any images but the first, up to nine in a row, of robots that turn: to rounding."""
    rng, gate, in_a_row = np.random.default_rng(seed), gate_of(1), 0
    for k in range(100):
        true = np.array([[0, 0, wrap_angle(heading + rate * T * k)]]) + NOISE * rng.standard_normal(
            (1, 3)
        )
        backwards = k > 0 and in_a_row < MAX_REJECTIONS - 1 and rng.random() < 0.5
        in_a_row = in_a_row + 1 if backwards else 0
        image = true.copy()
        image[:, 2] = wrap_angle(true[:, 2] + np.pi * backwards)
        found = gate.reject_outliers(image)
        np.testing.assert_array_equal(found[:, :2], true[:, :2])
        assert abs(wrap_angle(found[0, 2] - true[0, 2])) < 1e-14


@given(
    seeds,
    st.floats(0, 1),
    st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-np.pi, np.pi)),
)
def test_whatever_was_seen_a_robot_is_believed_within_ten_images(
    seed: int, missed: float, place: tuple[float, float, float]
) -> None:
    """After any images: from the tenth of where a robot really is, each is believed, as it is. No gate is stuck."""
    rng, gate = np.random.default_rng(seed), gate_of(3)
    for _ in range(rng.integers(0, 60)):
        image = rng.uniform(-4, 4, (3, 3))
        image[rng.random(3) < missed] = np.nan
        gate.reject_outliers(image, rng.uniform(0, 0.2, 3))
    for k in range(3 * MAX_REJECTIONS):
        image = to_measured_pose(np.array(place) + NOISE * rng.standard_normal((3, 3)))
        found = gate.reject_outliers(image)
        if k >= MAX_REJECTIONS - 1:
            np.testing.assert_array_equal(found[:, :2], image[:, :2])
        if k >= 2 * MAX_REJECTIONS - 2:  # a heading is first looked at when the place is believed
            np.testing.assert_array_equal(found, image)


def test_a_robot_may_come_out_of_a_frozen_image_as_far_as_it_has_driven() -> None:
    """The image is believed while it lasts; afterwards it is as old as it is."""
    gate, image = gate_of(1), np.array([[0.1, 0.2, 0.3]])
    for _ in range(20):
        np.testing.assert_array_equal(gate.reject_outliers(image), image)
    moved = image + np.array([1.5, 0.0, 0.0])  # 4.5 m/s
    np.testing.assert_array_equal(gate.reject_outliers(moved), moved)


@given(st.floats(0.0, 3.5), st.floats(-np.pi, np.pi))
def test_what_was_too_fast_to_stand_is_not_seen_to_stand_for_a_second(
    speed: float, direction: float
) -> None:
    """Images that differed by 1 cm/s show a robot that moves, or noise. One that may stand is believed at once.

    Where the image goes on, after however many repeats, it is believed.
    """
    step = speed * T * np.array([[np.cos(direction), np.sin(direction), 0.0]])
    for repeats in (4, MAX_REPEATS + 4):
        gate = gate_of(1)
        for k in range(3):
            gate.reject_outliers(k * step + 0.1)
        found = np.array([gate.reject_outliers(2 * step + 0.1)[0, 0] for _ in range(repeats)])
        doubted = MAX_REPEATS - 1 if speed > 0.01 else 0
        if abs(speed - 0.01) > 1e-6:
            np.testing.assert_array_equal(np.isnan(found), np.arange(repeats) < doubted)
        went_on = (3 + repeats) * step + 0.1
        np.testing.assert_array_equal(gate.reject_outliers(went_on), went_on)


@settings(max_examples=12)
@given(seeds, st.floats(0.05, 0.3))
def test_a_team_drives_on_as_if_nothing_had_been_mistaken(seed: int, share: float) -> None:
    """Another robot 1.5 m away, up to three images of ten: all that is said is as if those images had not been.

    So it is whatever a controller makes of what it sees.
    """
    rng, n, frames = np.random.default_rng(seed), 2, 100
    errors = make_vision_noise(rng, frames, n)
    wrong = (rng.random((frames, n)) < share) & (np.arange(frames) > 0)[:, None]
    lied, missed = errors.copy(), errors.copy()
    lied[wrong] += [1.5, 0.3, np.pi]
    missed[wrong] = np.nan
    model, start = TeamModel(T, 4), make_start_poses(n)
    driven = [
        run_team(
            Team(make_controller("comp-flc", model, make_reference(TIMED, n), n), start),
            LaggedPlant(start, 4, alpha=0.9),
            each,
        )
        for each in (lied, missed)
    ]
    for name, values in driven[0].items():
        np.testing.assert_array_equal(values, driven[1][name], err_msg=name)
