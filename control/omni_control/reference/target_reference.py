"""Reference towards targets that move, with a new target in any frame.

The reference is one continuous motion per robot, with the pose r and the twist v. In each frame,
v changes by at most the limit of acceleration times the period. A new target changes where the
motion leads from the next frame on, but never r or v themselves, so that commands do not jump.

- **Pose targets.** In the frame that moves with the target, `approach_pose` drives the robot as
  fast as it can still brake, and stops it at the target in whole frames without overshoot. It then
  has the target's twist. From rest to rest this is the time-optimal trapezoid.
- **Noise.** This law would answer noise of a millimeter with full acceleration. While targets keep
  differing from the extrapolation of the previous ones, half of a desired change of velocity is
  made per frame, and small errors halve in two frames.
- **Velocity targets.** v approaches v_t at the limit of acceleration.
- **Dead time.** A controller asks for the frame in which its command will act. The target is
  extrapolated to that frame with its twist.
- **Disturbances.** The motion does not depend on the measured pose, and thus adds no noise to
  commands. But it waits for a robot that cannot follow: r stays within `MAX_LEAD_M` and
  `MAX_LEAD_RAD` of the robot.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_control.arguments import check_types, explain_types
from omni_control.errors import OmniError
from omni_control.kinematics import Array, compute_pose_error
from omni_control.reference.motion_limits import MotionLimits
from omni_control.reference.replanned_reference import (
    Plan,
    ReplannedReference,
    TargetMotion,
    approach_pose,
)

# Largest distance and angle between a robot and its reference.
MAX_LEAD_M, MAX_LEAD_RAD = 0.3, 1.0
MAX_GAP_FRAMES = 10  # after a longer pause, the reference starts again at the robot, at rest
RESPONSE_TO_CHANGES = 0.5  # while targets change
# Changes that are less than this apart continue each other. Counted up to the frame planned.
SETTLING_FRAMES = 15
MAX_NUMBER = 1e9  # of targets and frames; larger ones would overflow
_UNCHANGED_M = 1e-9  # also rad, m/s and rad/s


@explain_types
class TargetReference(ReplannedReference[Plan]):
    """Reference of n robots towards targets that may change in every frame.

    It starts at rest at the pose of the robot and stays there until the first target. A target
    applies until the next one. Headings turn the shorter way.

    `Team.set_target` and `Team.set_velocity` insert the number of the frame.

    Args:
        limits: Limits of velocity and acceleration. Targets beyond them are followed as closely as
            the limits allow. Replace `reference.limits` to change them while driving.
        period: Length of a frame, s.
        n: Number of robots.

    Raises:
        OmniError: Jerk is limited, or the period is not a positive number.
    """

    @check_types
    def __init__(self, limits: MotionLimits, period: float, n: int) -> None:
        zero = np.zeros((n, 3))
        super().__init__(Plan(np.nan, zero, zero, zero), limits, period)
        self._target_pose, self._target_twist = zero.copy(), zero.copy()
        self._target_frame = np.zeros(n)
        # Frames of the latest two targets that differ from the extrapolation of the previous one.
        self._change_frames = np.repeat([[-2e9], [-1e9]], n, axis=1)
        self._has_pose = np.zeros((n, 3), bool)  # False: only the velocity matters

    def set_target(
        self, frame: float, robots: ArrayLike, pose: ArrayLike, twist: ArrayLike = (0, 0, 0)
    ) -> None:
        """Set the poses and twists of the targets of some robots.

        Args:
            frame: Frame number in which the targets have these poses.
            robots: Index of a robot, or indices (m,).
            pose: Target poses [x, y, heading], (3,) or (m, 3), m and rad.
            twist: Twists of the targets, (3,) or (m, 3), world frame, m/s and rad/s. Default: they
                rest.

        Raises:
            OmniError: A robot does not exist, or a target is not three finite numbers.
        """
        rows = as_robot_indices(robots, len(self._target_frame))
        pose = as_finite(pose, (len(rows), 3), "target poses")
        self._store(rows, frame, pose, twist, np.ones(3, bool))

    def set_velocity(
        self,
        frame: float,
        robots: ArrayLike,
        twist: ArrayLike,
        heading: ArrayLike | None = None,
    ) -> None:
        """Set the twists at which some robots shall drive.

        Args:
            frame: Frame number in which the headings are valid.
            robots: Index of a robot, or indices (m,).
            twist: Desired twists [vx, vy, turn rate], (3,) or (m, 3), world frame.
            heading: Target headings, one or (m,) rad, which change at the turn rate. Default: only
                the turn rate matters.

        Raises:
            OmniError: A robot does not exist, or a number is not finite.
        """
        rows = as_robot_indices(robots, len(self._target_frame))
        pose = np.zeros((len(rows), 3))
        if heading is not None:
            pose[:, 2] = as_finite(heading, (len(rows),), "target headings")
        self._store(rows, frame, pose, twist, np.array([False, False, heading is not None]))

    def _store(
        self,
        rows: NDArray[np.intp],
        frame: float,
        pose: Array,
        twist: ArrayLike,
        has_pose: NDArray[np.bool_],
    ) -> None:
        """Store targets: the frame, the poses (m, 3) where `has_pose` (3,), and the twists."""
        frame = float(as_finite(frame, (), "the frame of a target"))
        twist = as_finite(twist, pose.shape, "target twists")
        change = np.abs(twist - self._target_twist[rows])
        change += has_pose * np.abs(pose - self._extrapolate(frame)[rows])
        is_changed = (change > _UNCHANGED_M) | (has_pose != self._has_pose[rows])
        changed = rows[is_changed.any(1)]
        self._change_frames[0, changed] = self._change_frames[1, changed]
        self._change_frames[1, changed] = frame
        self._target_frame[rows], self._has_pose[rows] = frame, has_pose
        self._target_pose[rows], self._target_twist[rows] = pose, twist

    def _plan_step(self, plan: Plan, frame: Array, pose: Array) -> Plan:
        if pose.shape != plan.pose.shape:
            raise OmniError(f"the reference is that of {len(plan.pose)} robots, got {len(pose)}")
        is_new = ~(np.abs(frame - plan.frame) <= MAX_GAP_FRAMES)
        is_new = np.broadcast_to(is_new, len(pose))[:, None]
        last_twist = np.where(is_new, 0.0, plan.twist)
        start = np.where(is_new, pose, _limit_lead(plan.next_pose, pose))
        target = self._extrapolate_targets(frame, start, last_twist)
        intervals = self._change_frames[1] - self._change_frames[0], frame - self._change_frames[1]
        is_changing = np.maximum(*intervals) < SETTLING_FRAMES
        response = np.where(is_changing, RESPONSE_TO_CHANGES, 1.0)[:, None]
        motion = TargetMotion(self._target_twist, response)
        twist = approach_pose(start, last_twist, target, self.limits, self.period, motion)
        return Plan(frame, start, twist, start + twist * self.period)

    def _extrapolate(self, frame: float | Array) -> Array:
        elapsed = (frame - self._target_frame) * self.period
        return self._target_pose + elapsed[:, None] * self._target_twist

    def _extrapolate_targets(self, frame: Array, pose: Array, twist: Array) -> Array:
        """Return the poses (n, 3) of the targets in a frame; `pose` where only velocity matters.

        Of all full turns of a target's heading, the one nearest to the heading at which the robot
        could have the target's turn rate counts. A robot that turns does not turn back.
        """
        target = self._extrapolate(frame)
        turn_rate = twist[:, 2] - self._target_twist[:, 2]
        braking_turn = turn_rate * np.abs(turn_rate) / (2 * self.limits.turn_acceleration)
        full_turns = np.round((pose[:, 2] + braking_turn - target[:, 2]) / (2 * np.pi))
        target[:, 2] += 2 * np.pi * full_turns
        return np.where(self._has_pose, target, pose)


def as_robot_indices(robots: ArrayLike, n: int) -> NDArray[np.intp]:
    """Return the indices (m,) of some of n robots.

    Raises:
        OmniError: A robot does not exist.
    """
    indices = np.atleast_1d(np.asarray(robots))
    is_integer = indices.dtype.kind in "iu" and indices.ndim == 1
    if not is_integer or not ((indices >= 0) & (indices < n)).all():
        raise OmniError(f"robots must be indices from 0 to {n - 1}, got {robots!r}")
    return indices


def _limit_lead(reference: Array, pose: Array) -> Array:
    """Return the poses (n, 3) nearest to those of the reference, not too far from the robots'."""
    error = compute_pose_error(reference, pose)
    distance = np.hypot(error[:, 0], error[:, 1])
    excess = np.zeros_like(error)
    excess[:, :2] = error[:, :2] * (1 - MAX_LEAD_M / np.maximum(distance, MAX_LEAD_M))[:, None]
    excess[:, 2] = error[:, 2] - np.clip(error[:, 2], -MAX_LEAD_RAD, MAX_LEAD_RAD)
    return reference - excess


def as_finite(values: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    """Return numbers of at most `MAX_NUMBER`, repeated to a shape.

    Raises:
        OmniError: A value is not a finite number or too large, or the shape is wrong.
    """
    try:
        array = np.broadcast_to(np.asarray(values, float), shape)
    except (TypeError, ValueError):
        array = np.array(np.nan)
    if not (np.abs(array) <= MAX_NUMBER).all():
        limit = f"finite numbers of shape {shape}, at most {MAX_NUMBER:g}"
        raise OmniError(f"{name} must be {limit}, got {values!r}")
    return array
