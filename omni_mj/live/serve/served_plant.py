"""The plant that `serve` simulates: robots of one world that are placed and removed while it goes on."""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array, world_to_body, wrap_angle
from omni_mj.config.rows import Row
from omni_mj.plants.mujoco import MujocoPlant

AWAY_M = 10.0  # height at which removed robots wait, each a metre above the one before
# For which a robot remembers its headings; older images tell it nothing
HEADING_MEMORY_FRAMES = 120


class ServedPlant(MujocoPlant):
    """Robots that collide with each other and with walls. Removed ones are neither driven nor in anybody's way.

    Args:
        rows: Of the robots by their places in the world.
        start: Initial poses, shape (n, 3).

    Attributes:
        present: Which robots are on the field, shape (n,).
        is_unstable: Whether physics has failed.
    """

    remembered_frames = HEADING_MEMORY_FRAMES

    def __init__(self, rows: Sequence[Row], start: Array) -> None:
        super().__init__(rows, start, hulls=True)
        self.present, self.is_unstable = np.ones(len(rows), bool), False

    @property
    def cycles_left(self) -> int:
        """Cycles from now to the end of the frame; none at its beginning."""
        return -self._cycle % self.cycles

    def pose(self) -> Array:
        """Return poses, also between frames, shape (n, 3)."""
        poses = super().pose()
        if self._cycle:
            poses[:, 2] += wrap_angle(self.quaternion_heading() - self._heading)
        return poses

    def place(self, robot: int, pose: Array, twist: Array) -> None:
        """Put a robot down upright, its wheels rolling with it.

        Args:
            robot: Its index.
            pose: Shape (3,).
            twist: World frame, shape (3,).
        """
        self.present[robot], self._failed[robot] = True, False
        self._move(
            robot, pose, float(self._world.rest_qpos[self._world.robots[robot].qpos[2]]), twist
        )
        self._heading[robot], self._sensed[0][robot] = pose[2], twist[2]
        self.know_heading(robot, float(pose[2]))

    def remove(self, robot: int) -> None:
        """Switch a robot off and take it away."""
        self.present[robot], self._failed[robot] = False, True
        self._move(robot, np.zeros(3), AWAY_M + robot, np.zeros(3))

    def _begin(self) -> None:
        for robot in np.flatnonzero(~self.present):  # else they would fall
            self.remove(int(robot))
        super()._begin()

    def _move(self, robot: int, pose: Array, height: float, twist: Array) -> None:
        at, (x, y, heading) = self._at, pose
        wheel_speeds = self._world.kinematics.wheel_speeds(world_to_body(twist, heading))
        for array, value in (
            (at.qvel, 0.0),
            (at.pose, (x, y, height, np.cos(heading / 2), 0.0, 0.0, np.sin(heading / 2))),
            (at.velocity, (*twist[:2], 0.0, 0.0, 0.0, twist[2])),
            (at.wheel_speed, wheel_speeds),
        ):
            values = array.get()
            values[:, robot] = value
            array.set(values)

    def _stop(self, rows: list[int], unstable: list[int]) -> None:
        """Switch robots off. Whoever steps an unstable world replaces it."""
        self._failed[rows] = True
        self.is_unstable |= bool(unstable)
