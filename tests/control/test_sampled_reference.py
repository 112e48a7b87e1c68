"""Laws of asking a reference known in advance for frames that are not whole, or differ from robot to robot."""

import numpy as np
import pytest
from benches.control import Array, PerRobotReference
from hypothesis import given
from hypothesis import strategies as st

from omni_control import OmniError, SampledReference

T = 1 / 60
LAST = 40
frames = st.floats(-10, LAST + 10)
# Any poses make a reference; these are no straight lines, so that a wrong pair of frames shows.
POSES = np.random.default_rng(0).normal(size=(LAST + 1, 3)).cumsum(axis=0)
REFERENCE = SampledReference(POSES, T)
ANYWHERE = np.zeros((1, 3))


def between_frames(frame: float) -> Array:
    """The pose by numpy's own interpolation, which stands still beyond both ends."""
    return np.array([np.interp(frame, np.arange(LAST + 1), column) for column in POSES.T])


@given(frames)
def test_between_frames_a_reference_is_on_the_line_between_them(frame: float) -> None:
    """The pose is linear in the frame, and at rest before the first and after the last."""
    pose, _ = REFERENCE.at(frame, ANYWHERE)
    # Poses of size 10 round at 2e-15, a few times.
    np.testing.assert_allclose(pose[0], between_frames(frame), rtol=0, atol=2e-14)


@given(st.lists(frames, min_size=1, max_size=6))
def test_each_robot_gets_the_answer_to_its_own_frame(asked: list[float]) -> None:
    """A frame per robot gives, bit for bit, what each robot alone is given for its frame."""
    poses, twists = REFERENCE.at(np.array(asked), np.zeros((len(asked), 3)))
    assert poses.shape == twists.shape == (len(asked), 3)
    for i, frame in enumerate(asked):
        alone = REFERENCE.at(frame, ANYWHERE)
        assert alone[0].tobytes() == poses[i].tobytes()
        assert alone[1].tobytes() == twists[i].tobytes()


def test_robots_with_references_of_their_own_are_told_what_each_would_be() -> None:
    """To the bit, whatever is asked: one frame, one each, a preview; shorter ones rest."""
    each = [REFERENCE, SampledReference(POSES[::-1][:3], T), SampledReference(POSES + 1.0, T)]
    together, n = PerRobotReference(each), len(each)
    pose, rng = np.zeros((n, 3)), np.random.default_rng(0)
    for frame in (0, 2.4, -3.0, 1e3, rng.uniform(-2, 12, n)):
        own = [frame if np.ndim(frame) == 0 else frame[i : i + 1] for i in range(n)]
        for found, expected in (
            (
                together.at(frame, pose),
                [one.at(at, pose[:1]) for one, at in zip(each, own, strict=True)],
            ),
            (
                together.preview(frame, pose, 4),
                [one.preview(at, pose[:1], 4) for one, at in zip(each, own, strict=True)],
            ),
        ):
            for part in (0, 1):
                np.testing.assert_array_equal(
                    found[part], np.concatenate([e[part] for e in expected], axis=-2)
                )
    with pytest.raises(OmniError, match="same length"):
        PerRobotReference([REFERENCE, SampledReference(POSES, 2 * T)])
