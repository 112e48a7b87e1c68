"""What a world is built from for each robot: our shape with the numbers of its settings, or a user's own model."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import mujoco

from omni_control.errors import OmniError
from omni_mj.mjcf import roles
from omni_mj.mjcf.own import Own
from omni_mj.mjcf.roles import Names, Robot
from omni_mj.scenarios import resolve, robots
from omni_mj.scenarios.checking import in_one
from omni_mj.worlds import shape
from omni_mj.worlds.shape import Shape


@dataclass(frozen=True, eq=False)
class Part:
    """One robot, alone.

    Attributes:
        file: it was made of, named in messages.
        spec: to be copied, not changed.
        names: of parts that are not found by what they do.
        touching: names of the rollers' geoms that touch the carpet.
        hull: names of the geoms with which robots meet.
    """

    file: str
    spec: mujoco.MjSpec
    names: Names
    touching: tuple[str, ...]
    hull: tuple[str, ...]

    def find(self, model: mujoco.MjModel, places: Iterable[int] | None = None) -> tuple[Robot, ...]:
        """Where the parts of robots are in a world, attached at these places; of one alone, without any."""
        prefixes = None if places is None else {place: prefix(place) for place in places}
        return roles.find(model, self.file, self.names, prefixes)


def prefix(place: int) -> str:
    """Before the names of all that belongs to the robot at a place."""
    return f"robot_{place + 1}/"


def of(kind: Shape) -> Part:
    """The part for robots of a shape.

    Raises:
        OmniError: the file lacks something, or numbers contradict it or each other; a line for each.
    """
    if kind.model.file:
        return _own(kind, resolve.read_model(kind.model))
    path = robots.robot_model().resolve()
    return _ours(kind, path, path.stat().st_mtime_ns)


@lru_cache(maxsize=16)
def _ours(kind: Shape, path: Path, changed: int) -> Part:
    spec = shape.robot(kind, path)
    for key in list(spec.keys):  # of another size than the world's
        spec.delete(key)
    rollers = tuple(geom.name for geom in spec.geoms if geom.parent.name.startswith("roller_"))
    hull = tuple(geom.name for geom in spec.geoms if geom.classname.name == "hull")
    return Part(path.name, spec, {}, rollers, hull)


@lru_cache(maxsize=16)
def _own(kind: Shape, found: Own) -> Part:
    motor = {"gear": kind.gear, "rotor_inertia_kg_m2": kind.rotor_inertia}
    in_one(resolve.contradictions({"body": kind.body, "wheels": kind.wheels, "motor": motor}, found))
    if kind.wheels.creep == "off":
        raise OmniError(f"wheels.creep = off needs the robot that comes along, not {found.file.name}; take on")
    if kind.wheels.model == "two-rollers":
        in_one(f"{found.file.name}: {line}" for line in found.unlike())
    return Part(found.file.name, found.spec, found.names, found.touching, found.names["hull"])
