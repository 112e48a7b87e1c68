"""Laws of looking ahead: a preview is what will be answered to robots that follow, and costs nothing."""

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
KNOWN = (
    TimedReference(PATH, LIMITS, T),
    CurveReference(CURVES["figure-eight"](1.0, 0.6), LIMITS, T, tangent=True),
)
seeds = st.integers(0, 2**32 - 1)


def answers(
    reference: Reference, frame: float | Array, pose: Array, count: int
) -> tuple[Array, Array]:
    """What `at` answers in successive frames to robots that follow, (count, n, 3) each."""
    poses, twists = [], []
    for later in range(count):
        here, twist = reference.at(frame + later, pose)
        poses.append(here)
        twists.append(twist)
        pose = pose + twist * T
    return np.array(poses), np.array(twists)


@given(seeds)
def test_a_preview_of_what_is_known_in_advance_is_what_is_answered(seed: int) -> None:
    """Bit for bit, for one frame for all robots and one each, whole or not, beyond the ends."""
    rng = np.random.default_rng(seed)
    for reference in KNOWN:
        first = int(rng.integers(-5, reference.frames + 5))
        for frame in (first, first + 0.3, first + rng.uniform(0, 9, 4)):
            got = reference.preview(frame, np.zeros((4, 3)), 30)
            np.testing.assert_array_equal(got, answers(reference, frame, np.zeros((4, 3)), 30))


def disturbed(
    rng: np.random.Generator, n: int, frames: int, rest: int
) -> tuple[IteratedReference, Array]:
    """A reference that is planned anew, asked for so many frames by robots that are pushed about, and their poses."""
    reference = IteratedReference(PATH, LIMITS, T, n, rest_frames=rest)
    pose = np.zeros((n, 3))
    for frame in range(frames):
        _, twist = reference.at(frame, pose)
        pose = pose + twist * T + rng.normal(0, 0.003, pose.shape)
    return reference, pose


@settings(max_examples=12)
@given(seeds, st.integers(0, 60), st.integers(0, 30))
def test_a_preview_of_what_is_planned_anew_is_the_plan_of_now(
    seed: int, frames: int, rest: int
) -> None:
    """What is answered afterwards, if nothing disturbs: at rest, on the way and past way-points; asked before or not.

    The preview changes nothing: it can be repeated, and who never looked ahead is answered the
    same.
    """
    (looked, pose), (other, _) = (
        disturbed(np.random.default_rng(seed), 3, frames, rest) for _ in range(2)
    )
    previewed = looked.preview(frames, pose, 90)
    np.testing.assert_array_equal(previewed, looked.preview(frames, pose, 90))
    looked.at(frames, pose)
    np.testing.assert_array_equal(previewed, looked.preview(frames, pose, 90))
    np.testing.assert_array_equal(previewed, answers(other, frames, pose, 90))
    np.testing.assert_array_equal(previewed, answers(looked, frames, pose, 90))


def test_what_is_planned_anew_does_not_look_ahead() -> None:
    """It goes on by a frame from its last answer, whatever new frame, whole or not, it is asked for."""
    asked = (0, 7, -1.5, np.array([2.5]))
    references = [IteratedReference([[0, 0, 0], [1, 0, 0]], LIMITS, T, n=1) for _ in asked]
    for step in range(3):
        poses = [
            reference.at(frame + 2 * step, np.zeros((1, 3)))
            for reference, frame in zip(references, asked, strict=True)
        ]
        for answer in poses:
            np.testing.assert_array_equal(answer, poses[0])
