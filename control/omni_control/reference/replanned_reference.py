"""References that are planned anew in every frame, and the rule by which they approach a pose.

`IteratedReference` is the mode "iteratively updated" of the paper's section 3-A. The robot moves
towards its way-point as fast as the limits of speed and acceleration allow and stops there exactly,
in whole frames. The rule depends only on the present pose and velocity. It therefore also recovers
from disturbances, and the pose may move: see `target_reference`.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_control.arguments import check_types, explain_types
from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.reference.motion_limits import MotionLimits
from omni_control.reference.sampled_reference import as_poses, check_period

# Position and heading error within which a way-point is reached.
ARRIVAL_RADIUS_M, ARRIVAL_ANGLE_RAD = 0.02, 0.1


@dataclass(frozen=True)
class Plan:
    """Desired poses and twists of n robots in the latest frame.

    Args:
        frame: Latest frame, one for all robots or (n,); NaN before the first.
        pose, twist: Desired poses and twists in this frame, (n, 3).
        next_pose: Desired poses in the next frame, (n, 3).
    """

    frame: float | Array
    pose: Array
    twist: Array
    next_pose: Array


AnyPlan = TypeVar("AnyPlan", bound=Plan)


@explain_types
class ReplannedReference(ABC, Generic[AnyPlan]):
    """Reference whose plan advances by one step with a call of `at` for a new frame.

    A repeated call for the same frame returns the same result.

    The directions in which a robot must accelerate are not known in advance. The limits are
    therefore reduced until the wheels can keep all of them at once, in any direction.

    Args:
        plan: Plan before the first frame.
        limits: Limits of velocity and acceleration. `reference.limits` may be replaced between
            frames.
        period: Length of a frame, s.

    Raises:
        OmniError: Jerk is limited, or the period is not a positive number.
    """

    def __init__(self, plan: AnyPlan, limits: MotionLimits, period: float) -> None:
        self._plan, self.limits, self.period = plan, limits, check_period(period)

    @property
    def limits(self) -> MotionLimits:
        """Limits of the reference, reduced for the wheels."""
        return self._limits

    @limits.setter
    def limits(self, limits: MotionLimits) -> None:
        if limits.jerk or limits.turn_jerk:
            raise OmniError(
                "a reference that is planned anew in every frame cannot limit jerk, "
                "because it responds to disturbances and new targets immediately"
            )
        self._limits = limits.reduce_for_wheels()

    def at(self, frame: float | Array, pose: Array) -> tuple[Array, Array]:
        """Return the poses of the plan at a frame, and the twists to the next; see `Reference`."""
        self._plan = self._advance(self._plan, frame, pose)
        return self._plan.pose.copy(), self._plan.twist.copy()

    def preview(self, frame: float | Array, pose: Array, count: int) -> tuple[Array, Array]:
        """Return poses and twists of robots that follow the plan from `pose`; see `Reference`."""
        plan, (poses, twists) = self._plan, np.empty((2, count, *pose.shape))
        for i in range(count):
            plan = self._advance(plan, frame + i, pose)
            poses[i], twists[i] = plan.pose, plan.twist
            pose = pose + plan.twist * self.period
        return poses, twists

    def _advance(self, plan: AnyPlan, frame: float | Array, pose: Array) -> AnyPlan:
        """Return the plan of `frame` from that of the previous frame."""
        if np.array_equal(frame, plan.frame):
            return plan
        return self._plan_step(plan, np.array(frame, float), pose)

    @abstractmethod
    def _plan_step(self, plan: AnyPlan, frame: Array, pose: Array) -> AnyPlan:
        """Return the plan of a new frame, for robots at `pose`."""


@dataclass(frozen=True)
class _WaypointPlan(Plan):
    """Plan with the progress through way-points.

    Args:
        waypoint_index: Index of the way-point that each robot approaches, (n,).
        rest_frames: Remaining frames of rest at the first way-point.
    """

    waypoint_index: NDArray[np.intp]
    rest_frames: int


@explain_types
class IteratedReference(ReplannedReference[_WaypointPlan]):
    """Reference through way-points, planned anew in every frame from the pose of the robot.

    A robot approaches the next way-point as soon as it has come near to the last one, while it is
    still slowing down. Jerk is not limited, because the reference responds to disturbances
    immediately.

    Args:
        waypoints: Poses [x, y, heading], (points, 3).
        limits: Limits of velocity and acceleration.
        period: Length of a frame, s.
        n: Number of robots; each progresses independently.
        rest_frames: Frames of rest at the first way-point.

    Raises:
        OmniError: There are no way-points, one is not three finite numbers, jerk is limited, or
            the period is not a positive number.
    """

    @check_types
    def __init__(
        self,
        waypoints: ArrayLike,
        limits: MotionLimits,
        period: float,
        n: int,
        rest_frames: int = 0,
    ) -> None:
        self.waypoints = as_poses(waypoints)
        start = np.repeat(self.waypoints[:1], n, axis=0)
        waypoint_index = np.full(n, min(1, len(self.waypoints) - 1))
        plan = _WaypointPlan(np.nan, start, np.zeros((n, 3)), start, waypoint_index, rest_frames)
        super().__init__(plan, limits, period)

    def _plan_step(self, plan: _WaypointPlan, frame: Array, pose: Array) -> _WaypointPlan:
        target = self.waypoints[plan.waypoint_index]
        twist = approach_pose(pose, plan.twist, target, self.limits, self.period)
        offset = target - pose
        is_near = np.hypot(offset[:, 0], offset[:, 1]) < ARRIVAL_RADIUS_M
        has_arrived = is_near & (np.abs(offset[:, 2]) < ARRIVAL_ANGLE_RAD)
        waypoint_index = np.minimum(plan.waypoint_index + has_arrived, len(self.waypoints) - 1)
        if plan.rest_frames:
            return replace(plan, frame=frame, pose=plan.next_pose, rest_frames=plan.rest_frames - 1)
        next_pose = pose + twist * self.period
        return _WaypointPlan(frame, plan.next_pose, twist, next_pose, waypoint_index, 0)


class TargetMotion(NamedTuple):
    """Motion of the targets of n robots, and how fast the robots respond to it.

    Args:
        twist: Twists of the targets, (n, 3), world frame.
        response: Fraction b of a desired change of velocity that is made in a frame, (n, 1). The
            speed towards the target is at most (1 - r)^2 / (b period) per distance, with
            r = sqrt(1 - b). Small errors then decay with a double pole at r: by the factor r per
            frame, without overshoot. Braking is planned with the fraction b of the limit of
            acceleration, which leaves some for changes of the twist. With b = 1, targets are
            reached in whole frames.
    """

    twist: Array
    response: Array

    def select(self, axes: slice) -> "TargetMotion":
        """Return the motion along some axes."""
        return TargetMotion(self.twist[:, axes], self.response)


def approach_pose(
    pose: Array,
    twist: Array,
    target: Array,
    limits: MotionLimits,
    period: float,
    motion: TargetMotion | None = None,
) -> Array:
    """Return the twists (n, 3) of the next frame for robots that approach and stop at target poses.

    Position and heading are approached independently, each within its own limits. Braking is
    planned with the lowest limit of acceleration at any heading between the present one and the
    target's. That limit can only rise as the robot turns, so the plan always stays feasible. It is
    exact for a robot that does not turn, and conservative for one that does. The change of velocity
    in a frame is limited at the heading in that frame. If it exceeds the limit, all its components
    are scaled down alike: towards the target and across.

    A moving target is approached in the frame that moves with it, where it rests. Limits of
    acceleration hold there unchanged. A velocity in the world that exceeds the limit of speed is
    scaled down.

    Args:
        pose: Poses (n, 3); headings are unwrapped (continuous, not limited to (-pi, pi]).
        twist: Twists of the last frame (n, 3), world frame.
        target: Target poses (n, 3).
        limits: Limits of speed and acceleration.
        period: Length of a frame, s.
        motion: Motion of the targets. Default: they rest.
    """
    offset, heading, target_heading = target - pose, pose[:, 2], target[:, 2]
    translation = rotation = None
    if motion is not None:
        translation, rotation = motion.select(slice(0, 2)), motion.select(slice(2, 3))
        # A turning target may have any heading.
        target_heading = np.where(motion.twist[:, 2] == 0, target_heading, heading + np.pi)
    offset_xy, step = offset[:, :2], limits.acceleration * period
    braking = limits.compute_min_acceleration(offset_xy, heading, target_heading)
    max_gain = limits.compute_max_component(offset_xy, heading) * period
    change = _compute_velocity_change(
        offset_xy, twist[:, :2], limits.speed, braking, max_gain, period, translation
    )
    norm = _norm(limits.to_isotropic(change, heading))
    turn_step = limits.turn_acceleration * period
    turn_change = _compute_velocity_change(
        offset[:, 2:],
        twist[:, 2:],
        limits.turn_rate,
        limits.turn_acceleration,
        turn_step,
        period,
        rotation,
    )
    scaled_change = [
        change * (step / np.maximum(norm, step)),
        turn_change * (turn_step / np.maximum(_norm(turn_change), turn_step)),
    ]
    return twist + np.concatenate(scaled_change, axis=1)


def _compute_velocity_change(
    offset: Array,
    velocity: Array,
    max_speed: float,
    braking: float | Array,
    max_gain: float | Array,
    period: float,
    motion: TargetMotion | None = None,
) -> Array:
    """Return the desired change of velocity (n, d) in a frame, before it is limited.

    Args:
        offset: Target minus position, (n, d) m or rad, d = 1 or 2.
        velocity: Velocity of the last frame, (n, d) m/s or rad/s.
        max_speed: Highest speed.
        braking: Planned deceleration, one or (n, 1).
        max_gain: Highest gain of the speed towards the target in a frame, one or (n, 1). It must be
            at least the largest change that the limits allow. Otherwise a robot at the target, with
            an offset in a random direction by rounding, might not stop in this frame.
        period: Length of a frame, s.
        motion: Motion of the targets along these axes. Default: they rest.
    """
    if motion is not None:
        braking = braking * motion.response
    distance = _norm(offset)
    speed = np.minimum(max_speed, _compute_stopping_speed(distance, braking, period))
    direction = np.divide(offset, distance, out=np.zeros_like(offset), where=distance > 0)
    if motion is not None:
        max_slope = (1 - np.sqrt(1 - motion.response)) ** 2 / (motion.response * period)
        speed = np.minimum(speed, max_slope * distance)
        velocity = velocity - motion.twist
        max_gain = max_gain / motion.response
    closing_speed = _sum_columns(velocity * direction)
    lateral_velocity = velocity - closing_speed * direction
    change = np.minimum(speed - closing_speed, max_gain) * direction - lateral_velocity
    if motion is None:
        return change
    new_velocity = velocity + motion.twist + motion.response * change
    return new_velocity * (max_speed / np.maximum(_norm(new_velocity), max_speed)) - (
        velocity + motion.twist
    )


def _compute_stopping_speed(distance: Array, acceleration: float | Array, period: float) -> Array:
    """Return the highest speed from which a point can stop after exactly a given distance.

    A point decelerates by a in frames of length T. If it moves m, m - 1, ..., 1 units of a T^2 in
    successive frames, it covers m (m + 1) / 2 units in m frames. Between these distances the speed
    is interpolated linearly. It then falls by exactly one unit in each frame but the last.

    Args:
        distance: Distances (n, 1), at least 0, m.
        acceleration: Highest deceleration, one or (n, 1), m/s^2.
        period: Length of a frame, s.

    Returns:
        Speeds (n, 1), m/s.
    """
    unit = acceleration * period**2
    units = distance / unit
    frames = np.floor(np.sqrt(0.25 + 2 * units) - 0.5)
    remainder = units - frames * (frames + 1) / 2
    return (frames + remainder / (frames + 1)) * unit / period


def _norm(vector: Array) -> Array:
    return np.sqrt(_sum_columns(vector * vector))


def _sum_columns(vector: Array) -> Array:
    """Return the sum of one or two columns, (n, 1); `np.sum` would take most of the time here."""
    return vector[:, :1] + vector[:, 1:] if vector.shape[1] == 2 else vector
