"""The plant that `serve` drives: one world with walls, whose robots are put down and taken away while it goes on."""

from collections.abc import Sequence

import mujoco
import numpy as np

from omni_control.kinematics import Array, world_to_body, wrapped
from omni_mj.onboard import laws
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.scenarios.rows import Row

AWAY_M = 10.0  # height at which robots that are taken away wait, each a metre above the one before
WALLS = {"wall_front": (1, 0), "wall_left": (0, 1), "wall_back": (-1, 0), "wall_right": (0, -1)}
REMEMBERED_FRAMES = 120  # for which robots know what they held for their headings; older images tell them nothing
CLEARANCE_M = 0.001  # that robots put down side by side need; a touch is no overlap


class ServedPlant(MujocoPlant):
    """A plant of one world; robots that are away are neither driven nor in anybody's way.

    Args:
        rows: of the robots.
        start: poses at the start, (n, 3).

    Attributes:
        present: which robots are on the field, (n,).
        surface: length and width between the walls, (2,) m.

    Raises:
        OmniError: see `MujocoPlant`.
    """

    def __init__(self, rows: Sequence[Row], start: Array) -> None:
        super().__init__(rows, start, threads=1, hulls=True)
        model, n = self._world.model, len(rows)
        self.present = np.ones(n, bool)
        self._walls = {name: model.geom(name).id for name in WALLS}
        self._positions = self._batch.expand("geom_pos")
        walls = self._positions[0, list(self._walls.values()), :2]
        self.surface = walls.max(0) - walls.min(0)
        hulls = (model.geom_contype > 0) & (model.geom_type == mujoco.mjtGeom.mjGEOM_CYLINDER)
        self.radius = float(np.max(model.geom_size[hulls, 0] + np.hypot(*model.geom_pos[hulls, :2].T)))
        self._strength = self._chance.force.copy()
        self._firmware.estimate.remember(REMEMBERED_FRAMES)
        self._good, self.unstable = self.pose(), False

    def pose(self) -> Array:
        """See `Plant`; also between frames."""
        poses = super().pose()
        if self._cycle:
            poses[:, 2] += wrapped(laws.heading(*self._at.quaternion.get().T) - self._heading)
        return poses

    @property
    def frame_in(self) -> int:
        """Cycles from now to the next beginning of a frame, in which headings are compared; none at one."""
        return -self._cycle % self.cycles

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
        self.present[robot], self._failed[robot], self._living = True, False, None
        self._chance.force[robot] = self._strength[robot]
        self._put(robot, pose, float(self._world.standing[self._world.robots[robot].qpos[2]]))
        velocity, speeds = self._at.velocity.get().copy(), self._at.wheel_speed.get().copy()
        velocity[robot, [0, 1, 5]] = twist
        speeds[robot] = self._world.kinematics.wheel_speeds(world_to_body(twist, pose[2]))
        self._at.velocity.set(velocity)
        self._at.wheel_speed.set(speeds)
        self._heading[robot], self._turn_rates[robot] = pose[2], twist[2]
        self._firmware.estimate.place(robot, float(pose[2]))

    def remove(self, robot: int) -> None:
        """Take a robot away: it is switched off, and waits where nothing is."""
        self.present[robot], self._failed[robot] = False, True
        self._chance.force[robot] = 0.0
        self._put(robot, np.zeros(3), AWAY_M + robot)

    def move_walls(self, length: float, width: float) -> None:
        """Set the walls so far from each other, in m, about the field's centre."""
        self.surface = np.array([length, width])
        for name, (x, y) in WALLS.items():
            self._positions[0, self._walls[name], :2] = x * length / 2, y * width / 2

    def overlap(self, robot: int, places: Array) -> str:
        """What a robot would stand in at `places[robot]`, the others being at theirs, (n, 2) m; nothing if it is free.

        A robot that is away has a place that is not a number.
        """
        room = self.surface / 2 - self.radius + CLEARANCE_M
        if (np.abs(places[robot]) > room).any():
            return f"a wall: the field ends at |x| = {self.surface[0] / 2:g} m and |y| = {self.surface[1] / 2:g} m"
        apart = np.hypot(*(places - places[robot]).T)
        apart[robot] = np.inf
        near = np.flatnonzero(apart < 2 * self.radius - CLEARANCE_M)
        return f"a robot that is {apart[near[0]]:.3f} m away" if near.size else ""

    def _begin(self) -> None:
        if not self.present.all():
            for robot in np.flatnonzero(~self.present):  # nothing holds them there
                self._put(int(robot), np.zeros(3), AWAY_M + robot)
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
        """See `MujocoPlant`; robots of a world that became unstable go on from where they last were, at rest."""
        super()._stop(rows, unstable)
        self._living = None
        if unstable:
            self.unstable, self._batch.warning[:] = True, 0
            for robot in range(len(self.present)):
                if self.present[robot]:
                    self.place(robot, self._good[robot], np.zeros(3))
                else:
                    self.remove(robot)
