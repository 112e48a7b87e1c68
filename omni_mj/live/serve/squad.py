"""Robots of one kind in the served world, placed and removed while it goes on."""

from collections.abc import Sequence

import numpy as np
from mujoco.batch import Batch

from omni_control.kinematics import Array, world_to_body, wrapped
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.scenarios.rows import Row
from omni_mj.worlds.build import World

AWAY_M = 10.0  # height at which removed robots wait, each a metre above the one before
HEADING_MEMORY_FRAMES = 120  # for which a robot remembers its headings; older images tell it nothing


class Squad(MujocoPlant):
    """Robots of one shape. Removed ones are neither driven nor in the way of others.

    Args:
        rows: Of the robots; their places are those in the world.
        start: Initial poses, shape (n, 3).
        batch: Of the world, which `ServedPlant` steps.
        world: Where these robots are in it.

    Attributes:
        present: Which robots are on the field, shape (n,).
        places: Theirs in the world, shape (n,).
        is_unstable: Whether physics has failed since the last `recover`.
    """

    remembered_frames = HEADING_MEMORY_FRAMES

    def __init__(self, rows: Sequence[Row], start: Array, batch: Batch, world: World) -> None:
        super().__init__(rows, start, within=(batch, world))
        self.present, self.places = np.ones(len(rows), bool), np.array([row.place for row in rows])
        self._last_pose, self.is_unstable = self.pose(), False

    def pose(self) -> Array:
        """Return poses, also between frames, shape (n, 3)."""
        poses = super().pose()
        if self._cycle:
            poses[:, 2] += wrapped(self.quaternion_heading() - self._heading)
        return poses

    @property
    def driven(self) -> np.ndarray:
        """Which robots are present and have not toppled, shape (n,)."""
        return self.present & ~self._failed

    def place(self, robot: int, pose: Array, twist: Array) -> None:
        """Put a robot down upright, its wheels rolling with it.

        Args:
            robot: Its index.
            pose: Shape (3,).
            twist: World frame, shape (3,).
        """
        self.present[robot], self._failed[robot] = True, False
        height = float(self._world.standing[self._world.robots[robot].qpos[2]])
        self._put(robot, pose, height, twist)
        self._heading[robot], self._sensed[0][robot] = pose[2], twist[2]
        self.know_heading(robot, float(pose[2]))

    def remove(self, robot: int) -> None:
        """Switch a robot off and take it away."""
        self.present[robot], self._failed[robot] = False, True
        self._put(robot, np.zeros(3), AWAY_M + self.places[robot], np.zeros(3))

    def stand(self) -> None:
        """Put all robots where they start."""
        self._stand(np.zeros(1, int))

    def recover(self) -> None:
        """Go on at rest from the last poses after physics has failed."""
        self.is_unstable = False
        self.stand()
        for robot, present in enumerate(self.present):
            if present:
                self.place(robot, self._last_pose[robot], np.zeros(3))
            else:
                self.remove(robot)

    def _begin(self) -> None:
        for robot in np.flatnonzero(~self.present):  # else they would fall
            self.remove(int(robot))
        np.copyto(self._last_pose, super().pose(), where=self.driven[:, None])
        super()._begin()

    def _put(self, robot: int, pose: Array, height: float, twist: Array) -> None:
        at, velocity = self._at, np.zeros(6)
        velocity[[0, 1, 5]] = twist
        wheel_speeds = self._world.kinematics.wheel_speeds(world_to_body(twist, pose[2]))
        quaternion = np.cos(pose[2] / 2), 0.0, 0.0, np.sin(pose[2] / 2)
        for array, value in (
            (at.qvel, 0.0),
            (at.position, (*pose[:2], height)),
            (at.quaternion, quaternion),
            (at.velocity, velocity),
            (at.wheel_speed, wheel_speeds),
        ):
            values = array.get().copy()
            values[robot] = value
            array.set(values)

    def _stop(self, rows: list[int], unstable: list[int]) -> None:
        """Switch robots off. `ServedPlant` restores a world that became unstable."""
        self._failed[rows] = True
        self.is_unstable |= bool(unstable)
