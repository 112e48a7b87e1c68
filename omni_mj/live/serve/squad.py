"""Robots of one kind in the world that `serve` drives: put down and taken away while it goes on."""

from collections.abc import Sequence

import numpy as np
from mujoco.batch import Batch

from omni_control.kinematics import Array, world_to_body, wrapped
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.scenarios.rows import Row
from omni_mj.worlds.build import World

AWAY_M = 10.0  # height at which robots that are taken away wait, each a metre above the one before
REMEMBERED_FRAMES = 120  # for which robots know what they held for their headings; older images tell them nothing


class Squad(MujocoPlant):
    """Robots of one shape; those that are away are neither driven nor in anybody's way.

    Args:
        rows: of the robots; their places are those in the world.
        start: poses at the start, (n, 3).
        batch: of the world, which `ServedPlant` steps.
        world: where these robots are in it.

    Attributes:
        present: which robots are on the field, (n,).
        places: theirs in the world, (n,).
        wheels: of each robot.
        reach: radius of the hull about a robot's middle, m.
        unstable: whether physics has failed since the last `recover`.
    """

    remembered_frames = REMEMBERED_FRAMES

    def __init__(self, rows: Sequence[Row], start: Array, batch: Batch, world: World) -> None:
        super().__init__(rows, start, within=(batch, world))
        self.present, self.places = np.ones(len(rows), bool), np.array([row.place for row in rows])
        self.wheels, self.reach = len(world.kinematics.azimuths), world.reach
        self._good, self.unstable = self.pose(), False

    def pose(self) -> Array:
        """See `Plant`; also between frames."""
        poses = super().pose()
        if self._cycle:
            poses[:, 2] += wrapped(self.quaternion_heading() - self._heading)
        return poses

    @property
    def driven(self) -> np.ndarray:
        """Which robots are present and have not toppled, (n,)."""
        return self.present & ~self._failed

    def place(self, robot: int, pose: Array, twist: Array) -> None:
        """Put a robot down, upright, its wheels rolling with it.

        Args:
            robot: its number.
            pose: where, (3,).
            twist: with which velocity, world frame, (3,).
        """
        self.present[robot], self._failed[robot] = True, False
        self._put(robot, pose, float(self._world.standing[self._world.robots[robot].qpos[2]]))
        velocity, speeds = self._at.velocity.get().copy(), self._at.wheel_speed.get().copy()
        velocity[robot, [0, 1, 5]] = twist
        speeds[robot] = self._world.kinematics.wheel_speeds(world_to_body(twist, pose[2]))
        self._at.velocity.set(velocity)
        self._at.wheel_speed.set(speeds)
        self._heading[robot], self._sensed[0][robot] = pose[2], twist[2]
        self.know_heading(robot, float(pose[2]))

    def remove(self, robot: int) -> None:
        """Take a robot away: it is switched off, and waits where nothing is."""
        self.present[robot], self._failed[robot] = False, True
        self._put(robot, np.zeros(3), AWAY_M + self.places[robot])

    def stand(self) -> None:
        """Put all robots where they start."""
        self._stand(np.zeros(1, int))

    def recover(self) -> None:
        """Go on from where the robots last were, at rest, after physics has failed."""
        self.unstable = False
        self.stand()
        for robot, present in enumerate(self.present):
            if present:
                self.place(robot, self._good[robot], np.zeros(3))
            else:
                self.remove(robot)

    def _begin(self) -> None:
        if not self.present.all():
            for robot in np.flatnonzero(~self.present):  # nothing holds them there
                self._put(int(robot), np.zeros(3), AWAY_M + self.places[robot])
        np.copyto(self._good, super().pose(), where=self.driven[:, None])
        super()._begin()

    def _put(self, robot: int, pose: Array, height: float) -> None:
        """Set a robot upright and at rest, its wheels turned as they are."""
        position, quaternion = self._at.position.get().copy(), self._at.quaternion.get().copy()
        speeds = self._at.qvel.get().copy()
        position[robot] = *pose[:2], height
        quaternion[robot] = np.cos(pose[2] / 2), 0.0, 0.0, np.sin(pose[2] / 2)
        speeds[robot] = 0.0
        self._at.position.set(position)
        self._at.quaternion.set(quaternion)
        self._at.qvel.set(speeds)

    def _stop(self, rows: list[int], unstable: list[int]) -> None:
        """Switch robots off; a world that became unstable is put right by whoever steps it."""
        self._failed[rows] = True
        self.unstable |= bool(unstable)
