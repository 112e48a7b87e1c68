"""Plant of `serve`: robots of one world that can be placed and removed during the simulation."""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array, world_to_body, wrap_angle
from omni_mj.config.rows import Row
from omni_mj.plants.mujoco_plant import MujocoPlant

AWAY_M = 10.0  # height of the first removed robot; each further one is a meter higher
# Number of frames for which a robot stores its headings. It ignores older measurements.
HEADING_MEMORY_FRAMES = 120


class ServedPlant(MujocoPlant):
    """Robots that collide with each other and with walls, and can be removed.

    Args:
        rows: Rows of the robots, in the order of their slots.
        start: Initial poses, shape (n, 3), m and rad.

    Attributes:
        present: Which robots are on the field, shape (n,).
        is_unstable: Whether physics has failed.
    """

    min_heading_memory = HEADING_MEMORY_FRAMES

    def __init__(self, rows: Sequence[Row], start: Array) -> None:
        super().__init__(rows, start, with_hulls=True)
        self.present, self.is_unstable = np.ones(len(rows), bool), False

    def pose(self) -> Array:
        """Return poses, also between frames, shape (n, 3)."""
        poses = super().pose()
        if self._cycle:
            poses[:, 2] += wrap_angle(self.compute_heading() - self._heading)
        return poses

    def place_robot(self, robot: int, pose: Array, twist: Array) -> None:
        """Place a robot upright, with wheels that roll without slip.

        Args:
            robot: Index of the robot.
            pose: Pose, shape (3,), m and rad.
            twist: Twist in the world frame, shape (3,), m/s and rad/s.
        """
        self.present[robot], self._failed[robot] = True, False
        self._move(
            robot, pose, float(self._world.rest_qpos[self._world.robots[robot].qpos[2]]), twist
        )
        self._heading[robot], self._sensor_values[0][robot] = pose[2], twist[2]
        self.set_heading_estimate(robot, float(pose[2]))

    def remove(self, robot: int) -> None:
        """Switch a robot off and take it away."""
        self.present[robot], self._failed[robot] = False, True
        self._move(robot, np.zeros(3), AWAY_M + robot, np.zeros(3))

    def _begin_frame(self) -> None:
        for robot in np.flatnonzero(~self.present):  # otherwise they would fall
            self.remove(int(robot))
        super()._begin_frame()

    def _move(self, robot: int, pose: Array, height: float, twist: Array) -> None:
        views, (x, y, heading) = self._views, pose
        wheel_speeds = self._world.kinematics.wheel_speeds(world_to_body(twist, heading))
        for array, value in (
            (views.qvel, 0.0),
            (views.pose, (x, y, height, np.cos(heading / 2), 0.0, 0.0, np.sin(heading / 2))),
            (views.velocity, (*twist[:2], 0.0, 0.0, 0.0, twist[2])),
            (views.wheel_speed, wheel_speeds),
        ):
            values = array.get()
            values[:, robot] = value
            array.set(values)

    def _stop_rows(self, rows: np.ndarray, unstable_rows: np.ndarray) -> None:
        """Switch robots off. The caller replaces an unstable world."""
        self._failed[rows] = True
        self.is_unstable |= bool(len(unstable_rows))
