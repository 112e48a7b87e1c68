"""References known in advance at fractional frames, and with a frame or a path per robot."""

import numpy as np
import pytest
from benches.control import PerRobotReference
from hypothesis import given
from hypothesis import strategies as st

from omni_control import OmniError, SampledReference

T = 1 / 60
N_STEPS = 40
frames = st.floats(-10, N_STEPS + 10)
# Poses on no straight line, so that a wrong pair of frames shows.
POSES = np.random.default_rng(0).normal(size=(N_STEPS + 1, 3)).cumsum(axis=0)
REFERENCE = SampledReference(POSES, T)
ANYWHERE = np.zeros((1, 3))


@given(frames)
def test_poses_are_linear_between_frames_and_constant_beyond(frame: float) -> None:
    expected = [np.interp(frame, np.arange(N_STEPS + 1), column) for column in POSES.T]
    pose, _ = REFERENCE.at(frame, ANYWHERE)
    # Poses of size 10 round at 2e-15, a few times.
    np.testing.assert_allclose(pose[0], expected, rtol=0, atol=2e-14)


@given(st.lists(frames, min_size=1, max_size=6))
def test_each_robot_gets_the_answer_for_its_own_frame(robot_frames: list[float]) -> None:
    """To the bit, as if it were alone."""
    n = len(robot_frames)
    poses, twists = REFERENCE.at(np.array(robot_frames), np.zeros((n, 3)))
    assert poses.shape == twists.shape == (n, 3)
    for i, frame in enumerate(robot_frames):
        pose, twist = REFERENCE.at(frame, ANYWHERE)
        assert pose.tobytes() == poses[i].tobytes()
        assert twist.tobytes() == twists[i].tobytes()


def test_robots_with_different_references_get_the_answers_of_their_own() -> None:
    """To the bit, at one frame or one per robot, and in a preview; shorter references rest."""
    references = [REFERENCE, SampledReference(POSES[::-1][:3], T), SampledReference(POSES + 1.0, T)]
    combined, n = PerRobotReference(references), len(references)
    pose, rng = np.zeros((n, 3)), np.random.default_rng(0)
    for frame in (0, np.int64(5), 2.4, -3.0, 1e3, rng.uniform(-2, 12, n)):
        robot_frames = [frame if np.ndim(frame) == 0 else frame[i : i + 1] for i in range(n)]
        pairs = list(zip(references, robot_frames, strict=True))
        answers = [reference.at(k, ANYWHERE) for reference, k in pairs]
        previews = [reference.preview(k, ANYWHERE, 4) for reference, k in pairs]
        for i in (0, 1):
            expected = np.concatenate([answer[i] for answer in answers], axis=-2)
            np.testing.assert_array_equal(combined.at(frame, pose)[i], expected)
            expected = np.concatenate([preview[i] for preview in previews], axis=-2)
            np.testing.assert_array_equal(combined.preview(frame, pose, 4)[i], expected)
    rested = combined.with_rest(2, 1).poses[:, 0]
    np.testing.assert_array_equal(rested, REFERENCE.with_rest(2, 1).poses)
    with pytest.raises(OmniError, match="same length"):
        PerRobotReference([REFERENCE, SampledReference(POSES, 2 * T)])
