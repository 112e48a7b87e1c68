"""Builds the world that robots drive in: the field, n robots attached to it by prefix, and the contacts between them.

What touches what is made here. Rollers touch the geom `carpet` of the field by explicit pairs (see `contact`). Hulls
(the robot's geoms of the class `hull`) are off as modelled; with more than one robot in a world, or where it is asked
for, they are switched on, and meet each other and every geom of the field that collides: walls, and the carpet under a
robot that has fallen.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, Kinematics
from omni_mj.config.robot_files import find_models_folder
from omni_mj.config.settings import Settings
from omni_mj.mjcf import contact_parameters, robot_indices, two_roller_wheels
from omni_mj.mjcf.custom_robot import RobotSpec
from omni_mj.mjcf.robot_geometry import compute_support_distance
from omni_mj.mjcf.robot_indices import Ids, RobotIndices
from omni_mj.mjcf.robot_spec import RobotShape, build_robot_spec

SETTLING_S = 0.25

# What the field says, and nobody else.
_SCENES = ("option", "visual", "stat", "memory", "nstack", "nconmax", "njmax")


@dataclass(frozen=True, eq=False)
class World:
    """A compiled world and where its robots are in it, to be read only: it is shared by all who ask for the same.

    Args:
        model: robots named `robot_1/...` and so on by their places, all at the origin.
        robots: n of one shape, in the order of their places.
        rest_qpos: positions (nq,) with every robot at rest at the origin, its weight on its rollers.
        kinematics: of each robot's wheels.
        load_addresses: addresses in sensordata of the forces on each robot's wheels in the direction of z,
            (n, wheels).
        hull_radius: radius of the circle about a robot's middle that its hull stays in, m; 0 without a
            hull.
    """

    model: mujoco.MjModel
    robots: tuple[RobotIndices, ...]
    rest_qpos: Array
    kinematics: Kinematics
    load_addresses: Ids
    hull_radius: float


def get_name_prefix(place: int) -> str:
    """Before the names of all that belongs to the robot at a place."""
    return f"robot_{place + 1}/"


def build_world(
    settings: Settings | None = None, robots_per_world: int = 1, with_hulls: bool | None = None
) -> World:
    """A field with robots of one shape on it, built once.

    Args:
        settings: of the robots; what their `RobotShape` says counts. [the default robot's]
        robots_per_world: number of robots.
        with_hulls: whether robots meet each other and walls. [if they are several]

    Raises:
        OmniError: numbers of which no robot can be made, or a robot's file that lacks a part.
    """
    settings = settings or Settings()
    shape = RobotShape.from_settings(settings)
    return _world(
        build_robot_spec(shape),
        shape,
        robots_per_world,
        settings.physics.substeps,
        robots_per_world > 1 if with_hulls is None else with_hulls,
    )


@lru_cache(maxsize=16)
def _world(part: RobotSpec, shape: RobotShape, places: int, substeps: int, hulls: bool) -> World:
    field = mujoco.MjSpec.from_file(str(find_models_folder() / "field.xml"))
    spec, rollers = part.spec.copy(), part.contact_geoms
    alone = spec.compile()
    (robot,) = robot_indices.find_robots(alone)
    pair = contact_parameters.make_roller_contact(
        alone, robot.rollers.ravel(), shape.body.mass_kg / len(robot.wheels)
    )
    if shape.wheels.model == "two-rollers":
        two_roller_wheels.reduce(spec, alone, robot)
        left = {geom.name for geom in spec.geoms}
        rollers = tuple(name for name in rollers if name in left)
    for name in _SCENES:
        setattr(spec, name, getattr(field, name))
    if hulls and not part.hull_geoms:
        raise OmniError(
            f"{part.file}: no hull; robots that share a world meet with their geoms of the class 'hull'"
        )
    for name in part.hull_geoms if hulls else ():
        spec.geom(name).contype = spec.geom(name).conaffinity = 1
    for place in range(places):
        field.attach(spec.copy(), frame=field.worldbody.add_frame(), prefix=get_name_prefix(place))
        for roller in rollers:
            field.add_pair(
                geomname1="carpet", geomname2=get_name_prefix(place) + roller, condim=3, **pair
            )
        for rim in robot.rims:
            _add_load_sensor(field, get_name_prefix(place) + alone.body(rim).name)
    if places == 1:  # what touches is one island, of which to make a list costs 7 % of a step
        field.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    field.option.impratio = contact_parameters.FRICTION_STIFFER
    field.option.timestep = field.option.timestep / substeps
    try:
        model = field.compile()
    except ValueError as error:
        raise OmniError(f"{part.file}: {' '.join(str(error).split())}") from error
    robots = tuple(robot_indices.find_robots(model))
    for each in robots:  # backward Euler: a slip speed decays within a step
        model.dof_solref[each.slip_dofs] = -1.0, -contact_parameters.STIFFEST / model.opt.timestep
        model.dof_solimp[each.slip_dofs, :2] = contact_parameters.STIFFEST
    if places == 1:
        standing = _standing(model)
    else:
        one = _world(part, shape, 1, substeps, False)
        standing = model.qpos0.copy()
        for each in robots:
            standing[each.qpos] = one.rest_qpos[one.robots[0].qpos]
    kinematics = shape.wheels.kinematics
    return World(
        model, robots, standing, kinematics, _loads(model, robots), _reach(alone, part.hull_geoms)
    )


def _reach(model: mujoco.MjModel, hull: Sequence[str]) -> float:
    """Radius of the circle about a robot's middle that its hull stays in while it stands upright, m."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    around = [
        np.array([np.cos(angle), np.sin(angle), 0.0]) for angle in np.linspace(0, 2 * np.pi, 73)
    ]
    return max(
        (
            compute_support_distance(model, data, model.geom(name).id, way)
            for name in hull
            for way in around
        ),
        default=0.0,
    )


def _add_load_sensor(field: mujoco.MjSpec, rim: str) -> None:
    """Have the force between carpet and whatever is on a rim sensed, in the world's axes."""
    sensor = field.add_sensor(name=f"load/{rim}")
    sensor.type = mujoco.mjtSensor.mjSENS_CONTACT
    sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_GEOM, "carpet"
    sensor.reftype, sensor.refname = mujoco.mjtObj.mjOBJ_XBODY, rim
    # Data: force alone; of all contacts their sum; one of it.
    sensor.intprm[:3] = 1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), 3, 1


def _loads(model: mujoco.MjModel, robots: tuple[RobotIndices, ...]) -> Ids:
    """Addresses of the loads of each robot's wheels, (robots, wheels)."""
    return np.array(
        [
            [model.sensor(f"load/{model.body(rim).name}").adr[0] + 2 for rim in robot.rims]
            for robot in robots
        ]
    )


def _standing(model: mujoco.MjModel) -> Array:
    """Positions (nq,) of one robot at rest at the origin.

    As modelled, the rollers touch the carpet at distance zero, where rounding decides which of them
    carry load first.
    """
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=round(SETTLING_S / model.opt.timestep))
    return data.qpos.copy()
