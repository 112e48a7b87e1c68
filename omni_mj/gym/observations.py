"""A frame as a policy has it: what it sees of robots and what its answer means, in numbers around 1.

The same for robots of an environment and for those of an `om.Controller`, so that what was learned in one drives in the
other.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_control.controllers.base import Observation
from omni_control.errors import OmniError
from omni_control.kinematics import Array, body_to_world, world_to_body
from omni_control.reference import MotionLimits, Reference

# Times after the end of the dead time at which the reference is observed, frames.
PREVIEW_FRAMES = (0, 3, 6, 9, 12)
HIGHEST = 100.0  # m, m/s, rad or rad/s: an observation beyond is cut off


def get_observation_size(history_length: int) -> int:
    """How many numbers an observation has."""
    return 3 * (2 + 2 * len(PREVIEW_FRAMES) + history_length)


def encode_observation(
    frame: int, observation: Observation, reference: Reference, history_length: int
) -> NDArray[np.float32]:
    """What a policy sees of n robots, (n, get_observation_size(history_length)).

    All is along the axes of each robot [forward, left, counter-clockwise], as far as vision knows
    its heading, three numbers each: the way from the robot to its reference now; the way from where
    commands in flight lead (alpha = 1) to the reference at each frame of `AHEAD` after the dead
    time, in m and rad; the reference's twists there, and the robot's, in m/s and rad/s; the last
    `history_length` commands that were sent, the oldest first.

    Args:
        frame: its number.
        observation: what the team sees, n robots.
        reference: where they should be.
        history_length: commands to be shown; `observation.sent_commands` must hold as many.
    """
    heading = observation.pose[:, 2]
    here, _ = reference.at(frame, observation.pose)
    poses, twists = reference.preview(
        frame + observation.delay_frames, observation.predicted_pose, PREVIEW_FRAMES[-1] + 1
    )
    chosen = list(PREVIEW_FRAMES)
    vectors = np.concatenate(
        [
            (here - observation.pose)[None],
            poses[chosen] - observation.predicted_pose,
            twists[chosen],
            observation.twist[None],
            observation.sent_commands.get_latest(history_length),
        ]
    )
    own = np.moveaxis(world_to_body(vectors, heading), 0, 1).reshape(len(heading), -1)
    return np.clip(own, -HIGHEST, HIGHEST).astype(np.float32)


def decode_action(
    action: ArrayLike, observation: Observation, limits: MotionLimits | Array
) -> Array:
    """The commands [vx, vy, w] (n, 3) that actions mean, world frame, m/s and rad/s, before the team's limits.

    Args:
        action: [forward, left, counter-clockwise] of each robot, (n, 3), 1 being the highest that
            may be commanded.
        observation: what the team sees; robots are turned as vision says.
        limits: of commands, of all robots; or of each the highest speed, again the speed, and turn
            rate, (n, 3).

    Raises:
        OmniError: the actions are not (n, 3) finite numbers.
    """
    given, shape = np.asarray(action, float), observation.pose.shape
    if given.shape != shape or not np.isfinite(given).all():
        raise OmniError(
            f"actions must be finite numbers {shape}, not {given.dtype} of shape {given.shape}"
        )
    highest = (
        np.array([limits.speed, limits.speed, limits.turn_rate])
        if isinstance(limits, MotionLimits)
        else limits
    )
    return body_to_world(given * highest, observation.pose[:, 2])
