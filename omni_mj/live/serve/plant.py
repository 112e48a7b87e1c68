"""What moves in `serve`: one world with walls, in which robots of any shapes meet."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from omni_control.kinematics import Array
from omni_mj.link.radio import Received
from omni_mj.live.serve.squad import Squad
from omni_mj.plants import Telemetry, batches
from omni_mj.plants.faults import check_carpet
from omni_mj.plants.mujoco import run_cycles
from omni_mj.scenarios.rows import Row
from omni_mj.worlds import build
from omni_mj.worlds.shape import Shape

WALLS = {"wall_front": (1, 0), "wall_left": (0, 1), "wall_back": (-1, 0), "wall_right": (0, -1)}
CLEARANCE_M = 0.001  # that robots put down side by side need; a touch is no overlap


class ServedPlant:
    """A world of n robots; of the shapes that they have, each is a squad.

    Args:
        rows: of the robots, by their places in the world; the physics must be the same for all.
        start: poses at the start, (n, 3).

    Attributes:
        squads: of the robots.
        cycles: of the wheel loops in a frame.
        wheels: of each robot, n.
        reach: radius of each robot's hull about its middle, (n,) m.
        surface: length and width between the walls, (2,) m.
        unstable: whether physics has failed, after which all stand where they last were.

    Raises:
        OmniError: see `build.mixed`, `check_carpet` and `MujocoPlant`.
    """

    def __init__(self, rows: Sequence[Row], start: Array) -> None:
        check_carpet(rows)
        shapes = [Shape.of(row.settings) for row in rows]
        worlds = build.mixed([row.settings for row in rows], hulls=True)
        self._batch = batches.made(worlds[0], 1)
        self.squads = list[Squad]()
        for shape, world in zip(dict.fromkeys(shapes), worlds, strict=True):
            places = [place for place, each in enumerate(shapes) if each == shape]
            self.squads.append(Squad([rows[place] for place in places], start[places], self._batch, world))
        if len(self.squads) > 1:  # what the first ones sensed was before the others stood where they start
            for squad in self.squads:
                squad.stand()
        self._of = {int(place): (squad, robot) for squad in self.squads for robot, place in enumerate(squad.places)}
        self._cycle, self.cycles = 0, self.squads[0].cycles
        self.wheels = [len(row.settings.wheels.azimuths_deg) for row in rows]
        self.reach = self._all(lambda squad: np.full(len(squad.places), squad.reach))
        model = worlds[0].model
        self._walls = {name: model.geom(name).id for name in WALLS}
        self._positions = self._batch.expand("geom_pos")
        walls = self._positions[0, list(self._walls.values()), :2]
        self.surface = walls.max(0) - walls.min(0)
        self.unstable = False

    @property
    def present(self) -> np.ndarray:
        """Which robots are on the field, (n,)."""
        return self._all(lambda squad: squad.present)

    @property
    def driven(self) -> np.ndarray:
        """Which robots are present and have not toppled, (n,)."""
        return self._all(lambda squad: squad.driven)

    def pose(self) -> Array:
        """Where robots are, (n, 3), also between frames; see `Plant`."""
        return self._all(Squad.pose)

    def twist(self) -> Array:
        """How they move, (n, 3); see `Plant`."""
        return self._all(Squad.twist)

    def telemetry(self) -> Telemetry:
        """See `Plant`; of wheels that a robot does not have, not a number."""
        told = [squad.telemetry().named() for squad in self.squads]
        return Telemetry.of(**{name: self._gathered([parts[name] for parts in told]) for name in told[0]})

    @property
    def frame_in(self) -> int:
        """Cycles from now to the next beginning of a frame, in which headings are compared; none at one."""
        return -self._cycle % self.cycles

    @property
    def left(self) -> int:
        """Cycles that are left of the frame; all at its beginning."""
        return self.cycles - self._cycle % self.cycles

    def go(self, count: int, received: Received | None = None) -> dict[int, str]:
        """Move on by some cycles of the wheel loops, no more than are left of the frame; see `MujocoPlant.go`."""
        squads = self.squads
        for squad in squads:
            squad.begin(None if received is None else self._part(received, squad))
        run_cycles(squads, self._batch, count)
        self._cycle += count
        causes = dict[int, str]()
        for squad in squads:
            if failed := squad.end(count):
                causes |= {int(squad.places[robot]): cause for robot, cause in failed.items()}
        if causes and any(squad.unstable for squad in squads):
            self.unstable, self._batch.warning[:] = True, 0
            for squad in squads:
                squad.recover()
        return causes

    def place(self, robot: int, pose: Array, twist: Array) -> None:
        """Put a robot down; see `Squad.place`."""
        squad, number = self._of[robot]
        squad.place(number, pose, twist)

    def remove(self, robot: int) -> None:
        """Take a robot away; see `Squad.remove`."""
        squad, number = self._of[robot]
        squad.remove(number)

    def move_walls(self, length: float, width: float) -> None:
        """Set the walls so far from each other, in m, about the field's centre."""
        self.surface = np.array([length, width])
        for name, (x, y) in WALLS.items():
            self._positions[0, self._walls[name], :2] = x * length / 2, y * width / 2

    def overlap(self, robot: int, places: Array, reach: Array) -> str:
        """What a robot would stand in at `places[robot]`, the others being at theirs, (n, 2) m; nothing if it is free.

        A robot that is away has a place that is not a number; `reach` (n,) m is how far each is about its middle.
        """
        room = self.surface / 2 - reach[robot] + CLEARANCE_M
        if (np.abs(places[robot]) > room).any():
            return f"a wall: the field ends at |x| = {self.surface[0] / 2:g} m and |y| = {self.surface[1] / 2:g} m"
        apart = np.hypot(*(places - places[robot]).T)
        apart[robot] = np.inf
        near = np.flatnonzero(apart < reach[robot] + reach - CLEARANCE_M)
        return f"a robot that is {apart[near[0]]:.3f} m away" if near.size else ""

    def _part(self, received: Received, squad: Squad) -> Received:
        """What a squad holds."""
        return received if len(self.squads) == 1 else received.of(squad.places, squad.wheels)

    def _all(self, of: Callable[[Squad], np.ndarray]) -> np.ndarray:
        """What each robot has of something."""
        return self._gathered([of(squad) for squad in self.squads])

    def _gathered(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """Values of the squads' robots, (k,) or (k, m) each, as those of all; not a number where some have fewer."""
        if len(parts) == 1:
            return parts[0]
        most = max(parts, key=lambda part: part.shape[1:])
        values = np.full((len(self._of), *most.shape[1:]), np.nan).astype(most.dtype)
        for squad, part in zip(self.squads, parts, strict=True):
            values.reshape(len(values), -1)[squad.places, : math.prod(part.shape[1:])] = part.reshape(len(part), -1)
        return values
