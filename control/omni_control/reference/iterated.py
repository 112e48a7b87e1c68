"""Reference that is planned anew in every frame from where the robot is.

This is the mode "iteratively updated" of section 3-A.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.reference.approach import approach_pose
from omni_control.reference.motion_limits import MotionLimits
from omni_control.reference.timed import validate_waypoints

ARRIVAL_RADIUS_M, ARRIVAL_ANGLE_RAD = 0.02, 0.1


@dataclass(frozen=True)
class _Plan:
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
        waypoints: Poses [x, y, heading], at least one.
        limits: Limits of velocity and acceleration.
        period: Length of a frame, s.
        n: Number of robots; each makes its own progress.
        arrival_radius: Distance within which a way-point is reached, m.
        arrival_angle: Heading error within which a way-point is reached, rad.
        rest_frames: Frames spent at the first way-point.

    Raises:
        OmniError: There are no way-points, one is not three finite numbers, or jerk is limited.
    """

    def __init__(
        self,
        waypoints: Sequence[Sequence[float]],
        limits: MotionLimits,
        period: float,
        n: int,
        arrival_radius: float = ARRIVAL_RADIUS_M,
        arrival_angle: float = ARRIVAL_ANGLE_RAD,
        rest_frames: int = 0,
    ) -> None:
        if limits.jerk or limits.turn_jerk:
            raise OmniError(
                "a reference that is planned anew in every frame cannot limit jerk, "
                "because it answers disturbances immediately"
            )
        self.waypoints = validate_waypoints(waypoints)
        self.waypoints.flags.writeable = False
        self.limits, self.period = limits.reduce_for_wheels(), period
        self.arrival_radius, self.arrival_angle = arrival_radius, arrival_angle
        start = np.repeat(self.waypoints[:1], n, axis=0)
        waypoint = np.minimum(np.ones(n, int), len(waypoints) - 1)
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
        is_near = np.hypot(offset[:, 0], offset[:, 1]) < self.arrival_radius
        has_arrived = is_near & (np.abs(offset[:, 2]) < self.arrival_angle)
        waypoint = np.minimum(plan.waypoint + has_arrived, len(self.waypoints) - 1)
        if plan.rest_frames:
            return replace(plan, frame=frame, pose=plan.next_pose, rest_frames=plan.rest_frames - 1)
        return _Plan(frame, plan.next_pose, twist, pose + twist * self.period, waypoint, 0)
