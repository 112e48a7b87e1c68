"""Builder of the world of the robots: the field, n robots with name prefixes, and their contacts.

Contacts are set here. Rollers touch the field's geom `carpet` by explicit pairs (see
`rollers`). Hulls (the robot's geoms of the class `hull`) are disabled in the robot's
model. If a world has several robots, or on request, they are enabled (see `hulls`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, Kinematics
from omni_mj.config.robot_files import find_models_folder
from omni_mj.config.robot_settings import Mechanics
from omni_mj.config.settings import Settings
from omni_mj.mjcf import hulls, rollers
from omni_mj.mjcf.custom_robot import RobotSpec
from omni_mj.mjcf.robot_builder import build_robot_spec
from omni_mj.mjcf.robot_geometry import compute_support_distance
from omni_mj.mjcf.robot_parts import Ids, RobotIndices, compute_initial_kinematics, find_robots

SETTLING_S = 0.25  # time in which a robot comes to rest on the carpet
HULL_DIRECTIONS = 73  # every 5 degrees, both ends included
MAX_IMPEDANCE = 0.9999  # MuJoCo's limit of d

# Attributes that the field sets for the whole world.
_WORLD_ATTRIBUTES = ("option", "visual", "stat", "memory", "nstack", "nconmax", "njmax")


@dataclass(frozen=True, eq=False)
class World:
    """A compiled world and the indices of its robots; read-only, because it is shared.

    Attributes:
        model: Compiled model. Robots are named `robot_1/...` and so on by slot, all at the origin.
        robots: Indices of n equal robots, by slot.
        rest_qpos: Positions (nq,) with every robot at rest at the origin, on its rollers.
        kinematics: Kinematics of each robot.
        load_addresses: Addresses in sensordata of the vertical forces on the wheels, (n, wheels).
        hull_radius: Radius of the circle about a robot's center that contains its hull, m; 0
            without a hull.
    """

    model: mujoco.MjModel
    robots: tuple[RobotIndices, ...]
    rest_qpos: Array
    kinematics: Kinematics
    load_addresses: Ids
    hull_radius: float


def build_world(
    settings: Settings, robots_per_world: int = 1, with_hulls: bool | None = None
) -> World:
    """Return a field with equal robots on it; repeated calls return the same object.

    Args:
        settings: Settings of the robots. Only their `mechanics` and the number of substeps
            matter.
        robots_per_world: Number of robots.
        with_hulls: Whether robots collide with each other and with walls. Default: if there are
            several.

    Raises:
        OmniError: The numbers of the robot are impossible, or a robot's file lacks a part.
    """
    mechanics = settings.mechanics
    return _build_world(
        build_robot_spec(mechanics),
        mechanics,
        robots_per_world,
        settings.physics.substeps,
        robots_per_world > 1 if with_hulls is None else with_hulls,
    )


@lru_cache(maxsize=16)
def _build_world(
    robot_spec: RobotSpec, mechanics: Mechanics, n_robots: int, substeps: int, with_hulls: bool
) -> World:
    """Return a world; see `build_world`. Equal arguments return the same object."""
    field = mujoco.MjSpec.from_file(str(find_models_folder() / "field.xml"))
    spec, contact_geoms = robot_spec.spec.copy(), robot_spec.contact_geoms
    robot_model = spec.compile()
    (single_robot,) = find_robots(robot_model)
    contact = rollers.make_roller_contact(
        robot_model, single_robot, mechanics.body.mass_kg / len(single_robot.wheels)
    )
    if mechanics.wheels.model == "two-rollers":
        rollers.reduce_rollers(spec, robot_model, single_robot)
        remaining = {geom.name for geom in spec.geoms}
        contact_geoms = tuple(name for name in contact_geoms if name in remaining)
    for name in _WORLD_ATTRIBUTES:
        setattr(spec, name, getattr(field, name))
    spheres = list[str]()
    if with_hulls:
        spheres = hulls.enable_hulls(robot_spec, spec, robot_model, single_robot)
    rims = [robot_model.body(rim).name for rim in single_robot.rims]
    for slot in range(n_robots):
        _attach_robot(field, spec, f"robot_{slot + 1}/", contact_geoms, rims, contact)
    hulls.add_hull_pairs(field, n_robots, spheres)
    if n_robots == 1:  # with one robot there is one island; listing it costs 7 % of a step
        field.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    field.option.impratio = rollers.FRICTION_STIFFNESS_RATIO
    field.option.timestep /= substeps
    try:
        model = field.compile()
    except ValueError as error:
        raise OmniError(f"{robot_spec.file}: {' '.join(str(error).split())}") from error
    robots = find_robots(model)
    for robot in robots:  # backward Euler: a slip speed decays within a step
        model.dof_solref[robot.slip_dofs] = -1.0, -MAX_IMPEDANCE / model.opt.timestep
        model.dof_solimp[robot.slip_dofs, :2] = MAX_IMPEDANCE
    if n_robots == 1:
        rest_qpos = _settle(model)
    else:
        single_world = _build_world(robot_spec, mechanics, 1, substeps, False)
        rest_qpos = np.tile(single_world.rest_qpos, n_robots)
    # A sensor's three values are the force along x, y and z.
    load_addresses = [
        [model.sensor(f"load/{model.body(rim).name}").adr[0] + 2 for rim in robot.rims]
        for robot in robots
    ]
    return World(
        model,
        robots,
        rest_qpos,
        mechanics.wheels.kinematics,
        np.array(load_addresses),
        _compute_hull_radius(robot_model, robot_spec.hull_geoms),
    )


def _attach_robot(
    field: mujoco.MjSpec,
    spec: mujoco.MjSpec,
    prefix: str,
    contact_geoms: Sequence[str],
    rims: Sequence[str],
    contact: dict[str, Any],
) -> None:
    """Add a robot to the field, with its contacts and load sensors.

    Args:
        field: Specification of the world; changed in place.
        spec: Specification of the robot.
        prefix: Prefix of the robot's names.
        contact_geoms: Names of the rollers' geoms that touch the carpet.
        rims: Names of the rims' bodies.
        contact: Parameters of the contact pairs.
    """
    field.attach(spec.copy(), frame=field.worldbody.add_frame(), prefix=prefix)
    for geom in contact_geoms:
        field.add_pair(geomname1="carpet", geomname2=prefix + geom, condim=3, **contact)
    for rim in rims:  # force between the carpet and the parts on the rim, world axes
        field.add_sensor(
            name=f"load/{prefix}{rim}",
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            objtype=mujoco.mjtObj.mjOBJ_GEOM,
            objname="carpet",
            reftype=mujoco.mjtObj.mjOBJ_XBODY,
            refname=prefix + rim,
            # Output: force only; reduction: sum over all contacts; one result.
            intprm=[1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), 3, 1],
        )


def _compute_hull_radius(model: mujoco.MjModel, hull_geoms: Sequence[str]) -> float:
    """Return the radius of the circle about a robot's center that contains its hull, m."""
    data = compute_initial_kinematics(model)
    directions = [
        np.array([np.cos(angle), np.sin(angle), 0.0])
        for angle in np.linspace(0, 2 * np.pi, HULL_DIRECTIONS)
    ]
    distances = (
        compute_support_distance(data, model.geom(name).id, direction)
        for name in hull_geoms
        for direction in directions
    )
    return max(distances, default=0.0)


def _settle(model: mujoco.MjModel) -> Array:
    """Return the positions (nq,) of one robot at rest at the origin.

    As modelled, the rollers touch the carpet at distance zero, where rounding determines which of
    them carry load first.
    """
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=round(SETTLING_S / model.opt.timestep))
    return data.qpos.copy()
