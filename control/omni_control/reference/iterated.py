"""Reference that is planned anew in every frame from where the robot is.

This is the mode "iteratively updated" of section 3-A. The robot moves towards its way-point as fast
as the limits of speed and acceleration allow and stops there exactly, in whole frames. The rule
needs the present velocity only, so that it also recovers from disturbances.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.reference.motion_limits import MotionLimits
from omni_control.reference.sampled import as_poses

# Position and heading error within which a way-point is reached.
ARRIVAL_RADIUS_M, ARRIVAL_ANGLE_RAD = 0.02, 0.1


class _Plan(NamedTuple):
    """Last answer to n robots, and the start of the next one.

    Args:
        frame: Frame of the answer.
        pose, twist: The answer, (n, 3).
        next_pose: Poses to which the answer leads, (n, 3).
        waypoint: Index of the way-point that each robot approaches, (n,).
        rest_frames: Frames still to be spent at the first way-point.
    """

    frame: float | Array
    pose: Array
    twist: Array
    next_pose: Array
    waypoint: NDArray[np.intp]
    rest_frames: int


class IteratedReference:
    """Reference planned anew in every frame from where the robot is.

    A robot that has reached a way-point turns to the next one, still slowing down. The plan
    advances by one step when it is asked for another frame than the last time. The same frame gets
    the same answer again.

    The directions in which a robot must drive and turn next depend on its disturbances. The limits
    are therefore reduced in advance until the wheels can meet all of them at once, in any
    direction. Jerk is not limited, since the reference answers disturbances immediately.

    Args:
        waypoints: Poses [x, y, heading], (points, 3).
        limits: Limits of velocity and acceleration.
        period: Length of a frame, s.
        n: Number of robots; each makes its own progress.
        rest_frames: Frames spent at the first way-point.

    Raises:
        OmniError: There are no way-points, one is not three finite numbers, or jerk is limited.
    """

    def __init__(
        self,
        waypoints: ArrayLike,
        limits: MotionLimits,
        period: float,
        n: int,
        rest_frames: int = 0,
    ) -> None:
        if limits.jerk or limits.turn_jerk:
            raise OmniError(
                "a reference that is planned anew in every frame cannot limit jerk, "
                "because it answers disturbances immediately"
            )
        self.waypoints = as_poses(waypoints)
        self.limits, self.period = limits.reduce_for_wheels(), period
        start = np.repeat(self.waypoints[:1], n, axis=0)
        waypoint = np.full(n, min(1, len(self.waypoints) - 1))
        self._plan = _Plan(np.nan, start, np.zeros((n, 3)), start, waypoint, rest_frames)

    def at(self, frame: float | Array, pose: Array) -> tuple[Array, Array]:
        """Return the poses expected a frame after the last answer, and the twists from `pose` on.

        See `Reference`.
        """
        self._plan = self._advance(self._plan, frame, pose)
        return self._plan.pose.copy(), self._plan.twist.copy()

    def preview(self, frame: float | Array, pose: Array, count: int) -> tuple[Array, Array]:
        """Return the plan for robots that follow it from `pose` on; see `Reference`."""
        plan, (poses, twists) = self._plan, np.empty((2, count, *pose.shape))
        for i in range(count):
            plan = self._advance(plan, frame + i, pose)
            poses[i], twists[i] = plan.pose, plan.twist
            pose = pose + plan.twist * self.period
        return poses, twists

    def _advance(self, plan: _Plan, frame: float | Array, pose: Array) -> _Plan:
        """Return the plan for `frame`, which follows another one."""
        if np.array_equal(frame, plan.frame):
            return plan
        frame, target = np.array(frame, float), self.waypoints[plan.waypoint]
        twist = approach_pose(pose, plan.twist, target, self.limits, self.period)
        offset = target - pose
        is_near = np.hypot(offset[:, 0], offset[:, 1]) < ARRIVAL_RADIUS_M
        has_arrived = is_near & (np.abs(offset[:, 2]) < ARRIVAL_ANGLE_RAD)
        waypoint = np.minimum(plan.waypoint + has_arrived, len(self.waypoints) - 1)
        if plan.rest_frames:
            return plan._replace(frame=frame, pose=plan.next_pose, rest_frames=plan.rest_frames - 1)
        return _Plan(frame, plan.next_pose, twist, pose + twist * self.period, waypoint, 0)


def approach_pose(
    pose: Array, twist: Array, target: Array, limits: MotionLimits, period: float
) -> Array:
    """Return the twists (n, 3) of the next frame for poses that shall stop at target poses.

    Position and heading are approached independently, each within its own limits. Braking is
    planned with the lowest limit of acceleration among the headings still to come. That limit rises
    as these become fewer, so that the plan can always be kept. It is exact for a robot that does
    not turn, and careful for one that does. The change of velocity in a frame is limited at the
    robot's heading in that frame. It is shared between braking the part that leads past the target
    and gaining speed towards it.

    Args:
        pose: Poses (n, 3); headings count full turns.
        twist: Twists of the last frame (n, 3), world frame.
        target: Target poses (n, 3).
        limits: Limits of speed and acceleration.
        period: Length of a frame, s.
    """
    offset, heading = target - pose, pose[:, 2]
    offset_xy, step = offset[:, :2], limits.acceleration * period
    braking = limits.compute_min_acceleration(offset_xy, heading, target[:, 2])
    max_gain = limits.compute_max_component(offset_xy, heading) * period
    change = _compute_velocity_change(
        offset_xy, twist[:, :2], limits.speed, braking, max_gain, period
    )
    norm = _norm(limits.to_isotropic(change, heading))
    turn_step = limits.turn_acceleration * period
    turn_change = _compute_velocity_change(
        offset[:, 2:], twist[:, 2:], limits.turn_rate, limits.turn_acceleration, turn_step, period
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
) -> Array:
    """Return the desired change of velocity (n, d) in a frame, before it is limited.

    Args:
        offset: Set-point minus position, (n, d) m, d = 1 or 2.
        velocity: Velocity of the last frame, (n, d) m/s.
        max_speed: Highest speed, m/s.
        braking: Deceleration that is planned, one or (n, 1), m/s^2.
        max_gain: Highest gain of the speed towards the set-point, one or (n, 1), m/s. It must be at
            least the largest change that the limits allow. Otherwise a robot that could stop in
            this frame would not, if its offset, and with it the direction, is a rounding error.
        period: Length of a frame, s.
    """
    distance = _norm(offset)
    speed = np.minimum(max_speed, _compute_stopping_speed(distance, braking, period))
    direction = np.divide(offset, distance, out=np.zeros_like(offset), where=distance > 0)
    closing_speed = _sum_columns(velocity * direction)
    lateral_velocity = velocity - closing_speed * direction
    return np.minimum(speed - closing_speed, max_gain) * direction - lateral_velocity


def _compute_stopping_speed(distance: Array, acceleration: float | Array, period: float) -> Array:
    """Return the highest speed from which a point can stop after exactly a given distance.

    A point that moves s, s - 1, s - 2, ... units of a T^2 in successive frames of length T covers
    m (m + 1) / 2 units in m frames. Between these distances the speed is linear, so that it falls
    by exactly one unit in each frame but the last.

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
    """Return the sum of one or two columns, (n, 1); `np.sum` takes longer than all else here."""
    return vector[:, :1] + vector[:, 1:] if vector.shape[1] == 2 else vector
