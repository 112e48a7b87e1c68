"""The served world: robots of one or two kinds that collide with each other and with walls, placed and removed."""

from collections.abc import Callable, Sequence

import numpy as np
from mujoco.batch import Batch

from omni_control.kinematics import Array, world_to_body, wrap_angle
from omni_mj.link.radio import Received
from omni_mj.live.serve.cameras import CYCLES_PER_FRAME
from omni_mj.plants import Telemetry, batches
from omni_mj.plants.faults import check_carpet
from omni_mj.plants.mujoco import MujocoPlant, run_cycles
from omni_mj.scenarios.rows import Row
from omni_mj.worlds import build
from omni_mj.worlds.build import World
from omni_mj.worlds.shape import Shape

AWAY_M = 10.0  # height at which removed robots wait, each a metre above the one before
HEADING_MEMORY_FRAMES = 120  # for which a robot remembers its headings; older images tell it nothing
WALLS = {"wall_front": (1, 0), "wall_left": (0, 1), "wall_back": (-1, 0), "wall_right": (0, -1)}


class Squad(MujocoPlant):
    """Robots of one shape. Removed ones are neither driven nor in the way of others.

    Args:
        rows: Of the robots; their places are those in the world.
        start: Initial poses, shape (n, 3).
        batch: Of the world, which `ServedWorld` steps.
        world: Where these robots are in it.

    Attributes:
        present: Which robots are on the field, shape (n,).
        places: Theirs in the world, shape (n,).
        is_unstable: Whether physics has failed.
    """

    remembered_frames = HEADING_MEMORY_FRAMES

    def __init__(self, rows: Sequence[Row], start: Array, batch: Batch, world: World) -> None:
        super().__init__(rows, start, within=(batch, world))
        self.present, self.places = np.ones(len(rows), bool), np.array([row.place for row in rows])
        self.is_unstable = False

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
        self._put(robot, pose, float(self._world.standing[self._world.robots[robot].qpos[2]]), twist)
        self._heading[robot], self._sensed[0][robot] = pose[2], twist[2]
        self.know_heading(robot, float(pose[2]))

    def remove(self, robot: int) -> None:
        """Switch a robot off and take it away."""
        self.present[robot], self._failed[robot] = False, True
        self._put(robot, np.zeros(3), AWAY_M + self.places[robot], np.zeros(3))

    def stand(self) -> None:
        """Put all robots where they start."""
        self._stand(np.zeros(1, int))

    def _begin(self) -> None:
        for robot in np.flatnonzero(~self.present):  # else they would fall
            self.remove(int(robot))
        super()._begin()

    def _put(self, robot: int, pose: Array, height: float, twist: Array) -> None:
        at, velocity = self._at, np.zeros(6)
        velocity[[0, 1, 5]] = twist
        for array, value in (
            (at.qvel, 0.0),
            (at.pose, (*pose[:2], height, np.cos(pose[2] / 2), 0.0, 0.0, np.sin(pose[2] / 2))),
            (at.velocity, velocity),
            (at.wheel_speed, self._world.kinematics.wheel_speeds(world_to_body(twist, pose[2]))),
        ):
            values = array.get()
            values[:, robot] = value
            array.set(values)

    def _stop(self, rows: list[int], unstable: list[int]) -> None:
        """Switch robots off. Whoever steps an unstable world replaces it."""
        self._failed[rows] = True
        self.is_unstable |= bool(unstable)


class ServedWorld:
    """A world of n robots. Those of one shape form a squad.

    Args:
        rows: Of the robots by their places in the world. The physics must be the same for all.
        start: Initial poses, shape (n, 3).
        surface: Length and width between the walls, shape (2,), m.

    Attributes:
        squads: Of the robots.
        squad_of: Squad and index in it of each robot.
        wheels: Number of wheels of each robot.

    Raises:
        OmniError: See `build.mixed`, `check_carpet` and `MujocoPlant`.
    """

    def __init__(self, rows: Sequence[Row], start: Array, surface: Array) -> None:
        check_carpet(rows)
        shapes = [Shape.of(row.settings) for row in rows]
        worlds = build.mixed([row.settings for row in rows], hulls=True)
        self._batch, self._cycle = batches.made(worlds[0], 1), 0
        self.squads = list[Squad]()
        for shape, world in zip(dict.fromkeys(shapes), worlds, strict=True):
            places = [place for place, other in enumerate(shapes) if other == shape]
            self.squads.append(Squad([rows[place] for place in places], start[places], self._batch, world))
        for squad in self.squads:  # sensors of the first squad were read before the others stood
            squad.stand()
        squad_of = {place: (squad, i) for squad in self.squads for i, place in enumerate(squad.places)}
        self.squad_of = [squad_of[place] for place in range(len(rows))]
        self.wheels = [len(row.settings.wheels.azimuths_deg) for row in rows]
        self._walls = [worlds[0].model.geom(name).id for name in WALLS]
        self.move_walls(surface)

    @property
    def present(self) -> np.ndarray:
        """Which robots are on the field, shape (n,)."""
        return self.gather(lambda squad: squad.present)

    @property
    def is_unstable(self) -> bool:
        """Whether physics has failed."""
        return any(squad.is_unstable for squad in self.squads)

    def pose(self) -> Array:
        """Return poses, also between frames, shape (n, 3)."""
        return self.gather(Squad.pose)

    def telemetry(self) -> Telemetry:
        """Return telemetry; NaN for wheels that a robot does not have."""
        named = {squad: squad.telemetry().named() for squad in self.squads}
        names = named[self.squads[0]]
        return Telemetry.of(**{name: self.gather(lambda squad, name=name: named[squad][name]) for name in names})  # type: ignore[misc]

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
        return {int(squad.places[i]): cause for squad in self.squads for i, cause in squad.end(count).items()}

    def move_walls(self, surface: Array) -> None:
        """Set length and width between the walls, shape (2,), m."""
        self._batch.expand("geom_pos")[0, self._walls, :2] = np.array(list(WALLS.values())) * surface / 2

    def gather(self, values_of: Callable[[Squad], np.ndarray]) -> np.ndarray:
        """Return values of all robots, shape (n,) or (n, m), padded with NaN where a squad has fewer columns."""
        parts = [values_of(squad) for squad in self.squads]
        if len(parts) == 1:
            return parts[0]
        widest = max(parts, key=lambda part: part.shape[1:])
        values = np.full((len(self.wheels), *widest.shape[1:]), np.nan).astype(widest.dtype)
        for squad, part in zip(self.squads, parts, strict=True):
            columns = (slice(part.shape[1]),) if part.ndim > 1 else ()
            values[(squad.places, *columns)] = part
        return values
