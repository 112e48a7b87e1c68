"""Builder of the world of the robots: the field, n robots with name prefixes, and their contacts.

Contacts are set here. Rollers touch the field's geom `carpet` by explicit pairs (see
`rollers`). Hulls (the robot's geoms of the class `hull`) are disabled in the robot's
model. If a world has several robots, or on request, they are enabled (see `hulls`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, Kinematics
from omni_mj.config.robot_files import find_models_folder
from omni_mj.config.robot_settings import Mechanics
from omni_mj.config.settings import Settings
from omni_mj.mjcf import rollers
from omni_mj.mjcf.attachable_robot import (
    attach_with_contact_pairs,
    find_load_addresses,
    prepare_robot,
    stiffen_slip_hinges,
)
from omni_mj.mjcf.custom_robot import RobotSpec
from omni_mj.mjcf.field import place_walls
from omni_mj.mjcf.robot_builder import build_robot_spec
from omni_mj.mjcf.robot_geometry import compute_support_distance
from omni_mj.mjcf.robot_parts import Ids, RobotIndices, compute_initial_kinematics, find_robots

SETTLING_S = 0.25  # time in which a robot comes to rest on the carpet
HULL_DIRECTIONS = 73  # every 5 degrees, both ends included


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
        settings: Settings of the robots. Only their `mechanics`, the number of substeps and the
            size of the field matter.
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
        settings.world.carpet_size_m,
    )


@lru_cache(maxsize=16)
def _build_world(
    robot_spec: RobotSpec,
    mechanics: Mechanics,
    n_robots: int,
    substeps: int,
    with_hulls: bool,
    carpet_size_m: tuple[float, float],
) -> World:
    """Return a world; see `build_world`. Equal arguments return the same object."""
    field = mujoco.MjSpec.from_file(str(find_models_folder() / "field.xml"))
    place_walls(field, carpet_size_m)
    robot = prepare_robot(robot_spec, mechanics, with_hulls)
    other_spheres = list[str]()
    for slot in range(n_robots):
        other_spheres += attach_with_contact_pairs(
            field, robot, f"robot_{slot + 1}/", other_spheres
        )
    if n_robots == 1:  # with one robot there is one island; listing it costs 7 % of a step
        field.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    field.option.impratio = rollers.FRICTION_STIFFNESS_RATIO
    field.option.timestep /= substeps
    try:
        model = field.compile()
    except ValueError as error:
        raise OmniError(f"{robot_spec.file}: {' '.join(str(error).split())}") from error
    robots = find_robots(model)
    for indices in robots:
        stiffen_slip_hinges(model, indices)
    if n_robots == 1:
        rest_qpos = _settle(model)
    else:
        single_world = _build_world(robot_spec, mechanics, 1, substeps, False, carpet_size_m)
        rest_qpos = np.tile(single_world.rest_qpos, n_robots)
    return World(
        model,
        robots,
        rest_qpos,
        mechanics.wheels.kinematics,
        np.array([find_load_addresses(model, indices) for indices in robots]),
        _compute_hull_radius(robot.model, robot_spec.hull_geoms),
    )


def _compute_hull_radius(model: mujoco.MjModel, hull_geoms: Sequence[str]) -> float:
    """Return the radius of the circle about a robot's center that contains its hull, m."""
    data, angles = compute_initial_kinematics(model), np.linspace(0, 2 * np.pi, HULL_DIRECTIONS)
    directions = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    distances = (
        float(compute_support_distance(data, model.geom(name).id, directions).max())
        for name in hull_geoms
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
