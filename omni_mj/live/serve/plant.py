"""The served world: walls, and robots of one or two kinds that collide with each other."""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array
from omni_mj.link.radio import Received
from omni_mj.live.serve.cameras import CYCLES_PER_FRAME
from omni_mj.live.serve.squad import Squad
from omni_mj.plants import Telemetry, batches
from omni_mj.plants.faults import check_carpet
from omni_mj.plants.mujoco import run_cycles
from omni_mj.scenarios.rows import Row
from omni_mj.worlds import build
from omni_mj.worlds.shape import Shape

WALLS = {"wall_front": (1, 0), "wall_left": (0, 1), "wall_back": (-1, 0), "wall_right": (0, -1)}
CLEARANCE_M = 0.001  # by which hulls may touch


class ServedPlant:
    """A world of n robots. Those of one shape form a squad.

    Args:
        rows: Of the robots by their places in the world. The physics must be the same for all.
        start: Initial poses, shape (n, 3).

    Attributes:
        squads: Of the robots.
        wheels: Number of wheels of each robot.
        surface: Length and width between the walls, shape (2,), m.

    Raises:
        OmniError: See `build.mixed`, `check_carpet` and `MujocoPlant`.
    """

    def __init__(self, rows: Sequence[Row], start: Array) -> None:
        check_carpet(rows)
        shapes = [Shape.of(row.settings) for row in rows]
        worlds = build.mixed([row.settings for row in rows], hulls=True)
        self._batch = batches.made(worlds[0], 1)
        self.squads = list[Squad]()
        for shape, world in zip(dict.fromkeys(shapes), worlds, strict=True):
            places = [place for place, other in enumerate(shapes) if other == shape]
            self.squads.append(Squad([rows[place] for place in places], start[places], self._batch, world))
        for squad in self.squads:  # sensors of the first squad were read before the others stood
            squad.stand()
        self._squad_of = {int(place): (squad, i) for squad in self.squads for i, place in enumerate(squad.places)}
        self._cycle = 0
        self.wheels = [len(row.settings.wheels.azimuths_deg) for row in rows]
        self._walls = [worlds[0].model.geom(name).id for name in WALLS]
        self._positions = self._batch.expand("geom_pos")
        walls = self._positions[0, self._walls, :2]
        self.surface = walls.max(0) - walls.min(0)

    @property
    def present(self) -> np.ndarray:
        """Which robots are on the field, shape (n,)."""
        return self._gather([squad.present for squad in self.squads])

    @property
    def driven(self) -> np.ndarray:
        """Which robots are present and have not toppled, shape (n,)."""
        return self._gather([squad.driven for squad in self.squads])

    def pose(self) -> Array:
        """Return poses, also between frames, shape (n, 3)."""
        return self._gather([squad.pose() for squad in self.squads])

    def twist(self) -> Array:
        """Return velocities, shape (n, 3)."""
        return self._gather([squad.twist() for squad in self.squads])

    def telemetry(self) -> Telemetry:
        """Return telemetry; NaN for wheels that a robot does not have."""
        named = [squad.telemetry().named() for squad in self.squads]
        return Telemetry.of(**{name: self._gather([parts[name] for parts in named]) for name in named[0]})

    @property
    def cycles_left(self) -> int:
        """Cycles from now to the end of the frame; all of them at its beginning."""
        return CYCLES_PER_FRAME - self._cycle % CYCLES_PER_FRAME

    def advance(self, count: int, received: Received | None = None) -> dict[int, str]:
        """Advance by `count` cycles of the wheel loops, at most `cycles_left`; see `MujocoPlant.go`."""
        for squad in self.squads:
            squad.begin(None if received is None else received.of(squad.places, self.wheels[squad.places[0]]))
        run_cycles(self.squads, self._batch, count)
        self._cycle += count
        causes = dict[int, str]()
        for squad in self.squads:
            causes |= {int(squad.places[robot]): cause for robot, cause in squad.end(count).items()}
        if any(squad.is_unstable for squad in self.squads):
            self._batch.warning[:] = 0
            for squad in self.squads:
                squad.recover()
        return causes

    def place(self, robot: int, pose: Array, twist: Array) -> None:
        """Put a robot down; see `Squad.place`."""
        squad, index = self._squad_of[robot]
        squad.place(index, pose, twist)

    def remove(self, robot: int) -> None:
        """Take a robot away; see `Squad.remove`."""
        squad, index = self._squad_of[robot]
        squad.remove(index)

    def move_walls(self, surface: Array) -> None:
        """Set length and width between the walls, shape (2,), m."""
        self.surface = surface
        self._positions[0, self._walls, :2] = np.array(list(WALLS.values())) * surface / 2

    def find_obstacle(self, robot: int, positions: Array, reach: Array) -> str:
        """Return what a robot would stand in, or nothing.

        Args:
            robot: Its index.
            positions: Of all robots, shape (n, 2), m; NaN for those that are away.
            reach: Radii of their hulls, shape (n,), m.
        """
        if (np.abs(positions[robot]) > self.surface / 2 - reach[robot] + CLEARANCE_M).any():
            return f"a wall: the field ends at |x| = {self.surface[0] / 2:g} m and |y| = {self.surface[1] / 2:g} m"
        distance = np.hypot(*(positions - positions[robot]).T)
        distance[robot] = np.nan
        near = np.flatnonzero(distance < reach[robot] + reach - CLEARANCE_M)
        return f"a robot that is {distance[near[0]]:.3f} m away" if near.size else ""

    def _gather(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """Return the squads' values as those of all robots, padded with NaN where a squad has fewer columns."""
        if len(parts) == 1:
            return parts[0]
        widest = max(parts, key=lambda part: part.shape[1:])
        values = np.full((len(self.wheels), *widest.shape[1:]), np.nan).astype(widest.dtype)
        for squad, part in zip(self.squads, parts, strict=True):
            if part.ndim == 1:
                values[squad.places] = part
            else:
                values[squad.places, : part.shape[1]] = part
        return values
