"""Observations and actions of a policy, scaled to about 1.

The environments and an `om.Controller` use the same functions. A policy that was trained in one
therefore runs in the other.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_control.arguments import check_array, check_types, explain_types
from omni_control.controllers.base import Observation
from omni_control.kinematics import Array, body_to_world, world_to_body
from omni_control.reference import MotionLimits, Reference

# Times after the end of the dead time at which the reference is observed, frames.
PREVIEW_FRAMES = (0, 3, 6, 9, 12)
MAX_OBSERVATION = 100.0  # m, m/s, rad or rad/s; observations are clipped to it


@check_types
def get_observation_size(history_length: int) -> int:
    """Return the number of values in an observation with `history_length` commands."""
    return 3 * (2 + 2 * len(PREVIEW_FRAMES) + history_length)


@explain_types
def encode_observation(
    frame: int, observation: Observation, reference: Reference, history_length: int
) -> NDArray[np.float32]:
    """Return the observations of n robots for a policy, (n, get_observation_size(history_length)).

    All vectors are [forward, left, counter-clockwise] in the robot's frame (estimated heading):

    - the error of the filtered pose,
    - the errors of the pose predicted for alpha = 1 to the reference at each of `PREVIEW_FRAMES`
      after the dead time, m and rad,
    - the twists of the reference there, and the filtered twist, m/s and rad/s,
    - the latest `history_length` commands, oldest first.

    Args:
        frame: Frame number.
        observation: State of the robots as far as the team knows it.
        reference: Desired poses.
        history_length: Number of observed commands, at most those in `observation.sent_commands`.
    """
    heading, predicted_pose = observation.pose[:, 2], observation.predicted_pose
    target, _ = reference.at(frame, observation.pose)
    poses, twists = reference.preview(
        frame + observation.delay_frames, predicted_pose, PREVIEW_FRAMES[-1] + 1
    )
    preview = list(PREVIEW_FRAMES)
    vectors = np.concatenate(
        [
            (target - observation.pose)[None],
            poses[preview] - predicted_pose,
            twists[preview],
            observation.twist[None],
            observation.sent_commands.get_latest(history_length),
        ]
    )
    body_vectors = np.moveaxis(world_to_body(vectors, heading), 0, 1).reshape(len(heading), -1)
    return np.clip(body_vectors, -MAX_OBSERVATION, MAX_OBSERVATION).astype(np.float32)


@explain_types
def decode_action(
    action: ArrayLike, observation: Observation, limits: MotionLimits | Array
) -> Array:
    """Return the commands [vx, vy, w] (n, 3) of actions, world frame, m/s and rad/s.

    The team's limits are not applied yet.

    Args:
        action: [forward, left, counter-clockwise] of each robot, (n, 3), as fractions of the
            limits; clipped to -1 to 1.
        observation: State of the robots, of which the headings are used.
        limits: Limits of commands for all robots; or [speed, speed, turn rate] of each, (n, 3).

    Raises:
        OmniError: The actions are not finite numbers (n, 3).
    """
    fractions = np.clip(check_array("actions", action, observation.pose.shape), -1.0, 1.0)
    max_command = (
        np.array([limits.speed, limits.speed, limits.turn_rate])
        if isinstance(limits, MotionLimits)
        else limits
    )
    return body_to_world(fractions * max_command, observation.pose[:, 2])
