"""The reference planned anew in every frame from where the robot is (section 3-A, "iteratively updated")."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.reference.motion_limits import MotionLimits, approach_pose, validate_waypoints

ARRIVAL_RADIUS_M, ARRIVAL_ANGLE_RAD = 0.02, 0.1  # of a way-point, within which it is reached


@dataclass(frozen=True)
class _Plan:
    """What was last answered to n robots, and what the next answer starts from.

    frame: for which it was asked. here, twist: the answer, (n, 3). following: the pose to which it
    leads, which is the next answer's, (n, 3). goal: index of the way-point (n,). rest: frames still
    to be spent at the first.
    """

    frame: float | Array
    here: Array
    twist: Array
    following: Array
    goal: NDArray[np.intp]
    rest: int


class IteratedReference:
    """The reference planned anew in every frame from where the robot is; `n` robots with their own progress.

    A way-point counts as reached within `arrival_radius` (m) and `arrival_angle` (rad); the robot
    then turns to the next, still slowing down. The first `rest_frames` frames are spent at the
    first way-point.

    It goes on by a step whenever it is asked for another frame than the last time; robots that ask
    for the same frame again are given the same answer.

    Where a robot must go next, and how much it must turn meanwhile, depends on what disturbs it: so
    limits are eased beforehand until the wheels can do all that is left at once, whatever the
    directions. Jerk is not limited, since the disturbances that are answered come at once.

    Raises:
        OmniError: no way-points, or one that is not three finite numbers; a limit of jerk.
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
                "a reference that is planned anew in every frame cannot limit jerk: disturbances decide it"
            )
        self.waypoints = validate_waypoints(waypoints)
        self.waypoints.flags.writeable = False
        self.limits, self.period = limits.at_once(), period
        self.arrival_radius, self.arrival_angle = arrival_radius, arrival_angle
        start = np.repeat(self.waypoints[:1], n, axis=0)
        first = np.minimum(np.ones(n, int), len(waypoints) - 1)
        self._plan = _Plan(np.nan, start, np.zeros((n, 3)), start, first, rest_frames)

    def at(self, frame: float | Array, pose: Array) -> tuple[Array, Array]:
        """See `Reference`: the pose expected one frame after the last that was asked for, and the twist from here."""
        self._plan = self._planned(self._plan, frame, pose)
        return self._plan.here.copy(), self._plan.twist.copy()

    def preview(self, frame: float | Array, pose: Array, count: int) -> tuple[Array, Array]:
        """See `Reference`: the plan rolled out, the robots taken to follow it from `pose` on."""
        plan, (poses, twists) = self._plan, np.empty((2, count, *pose.shape))
        for later in range(count):
            plan = self._planned(plan, frame + later, pose)
            poses[later], twists[later] = plan.here, plan.twist
            pose = pose + plan.twist * self.period
        return poses, twists

    def _planned(self, last: _Plan, frame: float | Array, pose: Array) -> _Plan:
        """Return the plan for `frame`: the last one, if that was for the same frame."""
        if np.array_equal(frame, last.frame):
            return last
        frame = np.array(frame, float)
        twist = approach_pose(pose, last.twist, self.waypoints[last.goal], self.limits, self.period)
        offset = self.waypoints[last.goal] - pose
        near = np.hypot(offset[:, 0], offset[:, 1]) < self.arrival_radius
        arrived = near & (np.abs(offset[:, 2]) < self.arrival_angle)
        goal = np.minimum(last.goal + arrived, len(self.waypoints) - 1)
        if last.rest:
            return replace(last, frame=frame, here=last.following, rest=last.rest - 1)
        return _Plan(frame, last.following, twist, pose + twist * self.period, goal, 0)
