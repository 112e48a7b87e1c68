"""Builds the world that robots drive in: the field, n robots attached to it by prefix, and the contacts between them.

What touches what is made here. Rollers touch the geom `carpet` of the field by explicit pairs (see `contact`). Hulls
(the robot's geoms of the class `hull`) are off as modelled; with more than one robot in a world, or where it is asked
for, they are switched on, and meet each other and every geom of the field that collides: walls, and the carpet under a
robot that has fallen.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, Kinematics
from omni_mj.mjcf import roles
from omni_mj.mjcf.geometry import support
from omni_mj.mjcf.own import Part
from omni_mj.mjcf.roles import Ids, Robot
from omni_mj.scenarios.robots import models
from omni_mj.scenarios.settings import Settings
from omni_mj.worlds import contact, two_rollers
from omni_mj.worlds.shape import Shape, part_of

SETTLING_S = 0.25

# What the field says, and nobody else.
_SCENES = ("option", "visual", "stat", "memory", "nstack", "nconmax", "njmax")


@dataclass(frozen=True, eq=False)
class World:
    """A compiled world and where its robots are in it, to be read only: it is shared by all who ask for the same.

    Args:
        model: robots named `robot_1/...` and so on by their places, all at the origin.
        robots: n of one shape, in the order of their places: all that are in it, unless it is `mixed`.
        standing: positions (nq,) with every robot at rest at the origin, its weight on its rollers.
        kinematics: of each robot's wheels.
        loads: addresses in sensordata of the forces on each robot's wheels in the direction of z, (n, wheels).
        reach: radius of the circle about a robot's middle that its hull stays in, m; 0 without a hull.
    """

    model: mujoco.MjModel
    robots: tuple[Robot, ...]
    standing: Array
    kinematics: Kinematics
    loads: Ids
    reach: float


def prefix(place: int) -> str:
    """Before the names of all that belongs to the robot at a place."""
    return f"robot_{place + 1}/"


def world(settings: Settings | None = None, places: int = 1, hulls: bool | None = None) -> World:
    """A field with robots of one shape on it, built once.

    Args:
        settings: of the robots; what their `Shape` says counts. [the default robot's]
        places: number of robots.
        hulls: whether robots meet each other and walls. [if they are several]

    Raises:
        OmniError: numbers of which no robot can be made, or a robot's file that lacks a part.
    """
    return mixed([settings or Settings()] * places, hulls)[0]


def mixed(settings: Sequence[Settings], hulls: bool | None = None) -> tuple[World, ...]:
    """A field with robots of any shapes on it, built once: for each shape the same world, with the robots that have it.

    Args:
        settings: of the robot at each place; what their `Shape` says counts.
        hulls: whether robots meet each other and walls. [if they are several]

    Returns:
        In the order in which the shapes come.

    Raises:
        OmniError: see `world`; or some robots' wheels creep and others' do not, which takes two solvers.
    """
    wheels = [each.wheels for each in settings]
    for each in wheels:
        if each.creep == "off" and each.model != "rollers":
            raise OmniError(f"wheels.creep = off needs wheels.model = rollers, not {each.model}")
    if len({each.creep for each in wheels}) > 1:
        raise OmniError("wheels.creep must be the same for all robots of a world, on or off")
    shapes = [Shape.of(each) for each in settings]
    robots = tuple((part_of(shape), shape) for shape in shapes)
    return _worlds(robots, settings[0].physics.substeps, len(settings) > 1 if hulls is None else hulls)


@lru_cache(maxsize=16)
def _worlds(robots: tuple[tuple[Part, Shape], ...], substeps: int, hulls: bool) -> tuple[World, ...]:
    field = mujoco.MjSpec.from_file(str(models() / "field.xml"))
    kinds = {robot: _Kind.of(*robot, field, hulls) for robot in dict.fromkeys(robots)}
    for place, robot in enumerate(robots):
        kinds[robot].attach(field, prefix(place))
    if len(robots) == 1:  # what touches is one island, of which to make a list costs 7 % of a step
        field.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    creeps = robots[0][1].wheels.creep == "on"
    field.option.impratio = contact.FRICTION_STIFFER if creeps else contact.RIGID_FRICTION_STIFFER
    field.option.timestep = field.option.timestep / substeps
    try:
        model = field.compile()
    except ValueError as error:
        files = ", ".join(part.file for part, _ in kinds)
        raise OmniError(f"{files}: {' '.join(str(error).split())}") from error
    found = roles.find(model)
    for one in found:  # backward Euler: a slip speed decays within a step
        model.dof_solref[one.slip_dofs] = -1.0, -contact.STIFFEST / model.opt.timestep
        model.dof_solimp[one.slip_dofs, :2] = contact.STIFFEST
    if len(robots) == 1:
        standing = _standing(model)
    else:
        standing = model.qpos0.copy()
        for robot, one in zip(robots, found, strict=True):
            (alone,) = _worlds((robot,), substeps, False)
            standing[one.qpos] = alone.standing[alone.robots[0].qpos]
    worlds = []
    for robot, kind in kinds.items():
        same = tuple(one for one, other in zip(found, robots, strict=True) if other == robot)
        worlds.append(World(model, same, standing, robot[1].wheels.kinematics, _loads(model, same), kind.reach))
    return tuple(worlds)


@dataclass(frozen=True, eq=False)
class _Kind:
    """Robots of one shape, to be attached to a field.

    Args:
        spec: to be copied.
        rollers: names of the geoms that touch the carpet.
        rims: names of the bodies whose loads are sensed.
        contact: parameters of the pairs of rollers and carpet.
        reach: see `World`.
    """

    spec: mujoco.MjSpec
    rollers: tuple[str, ...]
    rims: tuple[str, ...]
    contact: dict[str, object]
    reach: float

    @classmethod
    def of(cls, robot: Part, shape: Shape, field: mujoco.MjSpec, hulls: bool) -> Self:
        """Make them ready for a field."""
        spec = robot.spec.copy()
        alone = spec.compile()
        (found,) = roles.find(alone)
        pair = contact.RIGID
        if found.slip_dofs.size:
            pair = contact.creeping(alone, found.rollers.ravel(), shape.body.mass_kg / len(found.wheels))
        rollers = robot.touching
        if shape.wheels.model == "two-rollers":
            two_rollers.reduce(spec, alone, found)
            left = {geom.name for geom in spec.geoms}
            rollers = tuple(name for name in rollers if name in left)
        for name in _SCENES:
            setattr(spec, name, getattr(field, name))
        if hulls and not robot.hull:
            raise OmniError(
                f"{robot.file}: no hull; robots that share a world meet with their geoms of the class 'hull', or those "
                "that 'hull' names"
            )
        for name in robot.hull if hulls else ():
            spec.geom(name).contype = spec.geom(name).conaffinity = 1
        return cls(spec, rollers, tuple(alone.body(rim).name for rim in found.rims), pair, _reach(alone, robot.hull))

    def attach(self, field: mujoco.MjSpec, name: str) -> None:
        """Put one on a field, at the origin, with a name before those of its parts."""
        field.attach(self.spec.copy(), frame=field.worldbody.add_frame(), prefix=name)
        for roller in self.rollers:
            field.add_pair(geomname1="carpet", geomname2=name + roller, condim=3, **self.contact)
        for rim in self.rims:
            _add_load_sensor(field, name + rim)


def _reach(model: mujoco.MjModel, hull: Sequence[str]) -> float:
    """Radius of the circle about a robot's middle that its hull stays in while it stands upright, m."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    around = [np.array([np.cos(angle), np.sin(angle), 0.0]) for angle in np.linspace(0, 2 * np.pi, 73)]
    return max((support(model, data, model.geom(name).id, way) for name in hull for way in around), default=0.0)


def _add_load_sensor(field: mujoco.MjSpec, rim: str) -> None:
    """Have the force between carpet and whatever is on a rim sensed, in the world's axes."""
    sensor = field.add_sensor(name=f"load/{rim}")
    sensor.type = mujoco.mjtSensor.mjSENS_CONTACT
    sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_GEOM, "carpet"
    sensor.reftype, sensor.refname = mujoco.mjtObj.mjOBJ_XBODY, rim
    # Data: force alone; of all contacts their sum; one of it.
    sensor.intprm[:3] = 1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), 3, 1


def _loads(model: mujoco.MjModel, robots: tuple[Robot, ...]) -> Ids:
    """Addresses of the loads of each robot's wheels, (robots, wheels)."""
    return np.array(
        [[model.sensor(f"load/{model.body(rim).name}").adr[0] + 2 for rim in robot.rims] for robot in robots]
    )


def _standing(model: mujoco.MjModel) -> Array:
    """Positions (nq,) of one robot at rest at the origin.

    As modelled, the rollers touch the carpet at distance zero, where rounding decides which of them carry load first.
    """
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=round(SETTLING_S / model.opt.timestep))
    return data.qpos.copy()
