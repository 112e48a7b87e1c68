"""Previews: what a reference will answer robots that follow it, without side effects."""

import numpy as np
from benches.control import Array
from closed_loop import T
from hypothesis import given, settings
from hypothesis import strategies as st

from omni_control import (
    CURVES,
    CurveReference,
    IteratedReference,
    MotionLimits,
    Reference,
    TimedReference,
)

LIMITS = MotionLimits()
PATH = [[0.0, 0.0, 0.0], [0.3, 0.1, 0.5], [0.1, 0.3, -0.5]]
KNOWN_REFERENCES = (
    TimedReference(PATH, LIMITS, T),
    CurveReference(CURVES["figure-eight"](1.0, 0.6), LIMITS, T, faces_along_path=True),
)
seeds = st.integers(0, 2**32 - 1)


def follow(
    reference: Reference, frame: float | Array, pose: Array, count: int
) -> tuple[Array, Array]:
    """Return the answers of `at` in successive frames to robots that follow, (count, n, 3) each."""
    poses, twists = [], []
    for i in range(count):
        desired, twist = reference.at(frame + i, pose)
        poses.append(desired)
        twists.append(twist)
        pose = pose + twist * T
    return np.array(poses), np.array(twists)


@given(seeds)
def test_a_preview_of_a_known_reference_equals_its_answers(seed: int) -> None:
    """To the bit, for one frame for all robots or one each, whole or not, and beyond the ends."""
    rng = np.random.default_rng(seed)
    for reference in KNOWN_REFERENCES:
        start = int(rng.integers(-5, reference.frames + 5))
        for frame in (start, start + 0.3, start + rng.uniform(0, 9, 4)):
            preview = reference.preview(frame, np.zeros((4, 3)), 30)
            np.testing.assert_array_equal(preview, follow(reference, frame, np.zeros((4, 3)), 30))


def follow_disturbed(seed: int, frames: int, rest_frames: int) -> tuple[IteratedReference, Array]:
    """Return an iterated reference, and the poses of three disturbed robots that followed it."""
    rng = np.random.default_rng(seed)
    reference = IteratedReference(PATH, LIMITS, T, 3, rest_frames=rest_frames)
    pose = np.zeros((3, 3))
    for frame in range(frames):
        _, twist = reference.at(frame, pose)
        pose = pose + twist * T + rng.normal(0, 0.003, pose.shape)
    return reference, pose


@settings(max_examples=12)
@given(seeds, st.integers(0, 60), st.integers(0, 30))
def test_a_preview_of_an_iterated_reference_equals_its_answers(
    seed: int, frames: int, rest_frames: int
) -> None:
    """To undisturbed robots, at rest, between and past way-points, before and after `at`.

    The preview changes nothing: it can be repeated, and a reference without previews gives the same
    answers.
    """
    reference, pose = follow_disturbed(seed, frames, rest_frames)
    untouched, _ = follow_disturbed(seed, frames, rest_frames)
    preview = reference.preview(frames, pose, 90)
    np.testing.assert_array_equal(preview, reference.preview(frames, pose, 90))
    reference.at(frames, pose)
    np.testing.assert_array_equal(preview, reference.preview(frames, pose, 90))
    np.testing.assert_array_equal(preview, follow(untouched, frames, pose, 90))
    np.testing.assert_array_equal(preview, follow(reference, frames, pose, 90))


def test_an_iterated_reference_advances_by_one_step_for_any_new_frame() -> None:
    first_frames = (0, 7, -1.5, np.array([2.5]))
    path = [[0, 0, 0], [1, 0, 0]]
    references = [IteratedReference(path, LIMITS, T, n=1) for _ in first_frames]
    for step in range(3):
        answers = [
            reference.at(frame + 2 * step, np.zeros((1, 3)))
            for reference, frame in zip(references, first_frames, strict=True)
        ]
        for poses_and_twists in answers:
            np.testing.assert_array_equal(poses_and_twists, answers[0])
