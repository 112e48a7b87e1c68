"""Contacts of hulls: robots that hit each other, walls, or the carpet when they have fallen.

**Shape.** Two upright cylinders touch along a line, and the pressure is centered where it does not
tilt the robots. MuJoCo returns one point of that line, an end that changes from step to step, and
the robots hop. Therefore hulls that are upright cylinders hit robots and walls with a sphere of
the same radius at the height of the robot's center of mass. On the field, the cylinders touch only
the carpet; in other scenes, everything but robots (`scene_contacts`). Hulls of other shapes touch
where MuJoCo finds contacts.

**Force.** The impedance d of a contact of spheres grows with the depth r. The deceleration is

    a = d (b r' + d k r),    d = 0.05 + 0.9 r / 13 mm,    k = omega^2,    b = 2 zeta omega

If d were proportional to r, s = r^2 / 2 in place of r would give a linear spring and damper of the
damping ratio zeta / sqrt(2): the restitution is 0.3 at any speed. As the force starts near zero,
the restitution hardly depends on the depth at which a time step finds the contact.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from typing import Any

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_mj.mjcf.custom_robot import RobotSpec
from omni_mj.mjcf.robot_geometry import compute_composite_inertia, compute_support_distance
from omni_mj.mjcf.robot_parts import RobotIndices, compute_initial_kinematics

FREQUENCY_RAD_S = 590.0  # omega
DAMPING_RATIO = 0.67  # zeta
FRICTION_RATE_PER_S = 400.0  # of the decay of the sliding speed, within Coulomb's limit
MIN_IMPEDANCE, MAX_IMPEDANCE = 0.05, 0.95
SOFT_DEPTH_M = 0.013  # at which the impedance is largest
UPRIGHT_COSINE = 1 - 1e-6
TILT_RAD = 2e-4  # of upright cylinders, which lowers their rim by 18 um
CARPET = "carpet"  # name of the floor in models/field.xml
SPHERE_SUFFIX = "_sphere"  # appended to a cylinder's name, for the sphere in its place


def enable_hulls(
    robot_spec: RobotSpec, spec: mujoco.MjSpec, model: mujoco.MjModel, robot: RobotIndices
) -> list[str]:
    """Let the hull of a robot collide, or add the spheres that collide in its place.

    Args:
        robot_spec: The robot.
        spec: Copy of its specification; changed in place.
        model: Model compiled from it.
        robot: Indices of the robot in the model.

    Returns:
        Names of the spheres, which collide by `connect_hull`; none for a hull of another shape
        than upright cylinders.

    Raises:
        OmniError: The robot has no hull, or it reaches below the carpet.
    """
    if not robot_spec.hull_geoms:
        raise OmniError(
            f"{robot_spec.file}: no hull; robots in one world collide with geoms of the class "
            "'hull'"
        )
    data = compute_initial_kinematics(model)
    geoms = {name: model.geom(name).id for name in robot_spec.hull_geoms}
    for name, geom in geoms.items():
        depth = compute_support_distance(data, geom, np.array([0.0, 0.0, -1.0]))
        if depth > 0:
            raise OmniError(
                f"{robot_spec.file}: the hull {name!r} must end above the carpet, where the robot "
                f"would stand on it; its lowest point is {1e3 * depth:.2g} mm below"
            )
    ids = list(geoms.values())
    is_cylinder = model.geom_type[ids] == mujoco.mjtGeom.mjGEOM_CYLINDER
    if not (is_cylinder & (abs(data.geom_xmat[ids, 8]) > UPRIGHT_COSINE)).all():
        for name in geoms:
            spec.geom(name).contype = spec.geom(name).conaffinity = 1
        return []
    bodies = np.flatnonzero(model.body_rootid == robot.chassis)
    _, center, _ = compute_composite_inertia(model, bodies)
    chassis = spec.body(model.body(robot.chassis).name)
    for name, geom in geoms.items():
        x, y, _ = data.geom_xpos[geom]
        tilt_cylinder(spec.geom(name), model)
        chassis.add_geom(
            name=name + SPHERE_SUFFIX,
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[model.geom_size[geom, 0], 0, 0],
            pos=[x, y, center[2]],
            friction=model.geom_friction[geom],
            contype=0,
            conaffinity=0,
            mass=0,
            group=model.geom_group[geom],
        )
    return [name + SPHERE_SUFFIX for name in geoms]


def connect_hull(
    field: mujoco.MjSpec, spheres: Sequence[str], other_spheres: Iterable[str]
) -> None:
    """Let spheres collide with those of other robots and with walls, and cylinders with the carpet.

    Args:
        field: World with a robot; changed in place.
        spheres: Names of the robot's spheres, from `enable_hulls`, with its prefix.
        other_spheres: Names of the spheres of other robots.
    """
    walls = [geom.name for geom in field.geoms if geom.classname.name == "solid"]
    walls.remove(CARPET)
    k, b = FREQUENCY_RAD_S**2, 2 * DAMPING_RATIO * FREQUENCY_RAD_S
    d = MAX_IMPEDANCE
    sphere_law = {
        "solref": [-k * d * d, -b * d],  # MuJoCo divides by d^2 and d
        "solreffriction": [-1.0, -FRICTION_RATE_PER_S * d],
        "solimp": [MIN_IMPEDANCE, d, SOFT_DEPTH_M, 0.5, 1.0],
    }
    for name, other_name in product(spheres, [*other_spheres, *walls]):
        _add_pair(field, name, other_name, sphere_law)
    for name in spheres:
        cylinder = field.geom(name.removesuffix(SPHERE_SUFFIX))
        own_law = {"solref": cylinder.solref, "solreffriction": [0, 0], "solimp": cylinder.solimp}
        _add_pair(field, cylinder.name, CARPET, own_law)


def _add_pair(field: mujoco.MjSpec, geom: str, partner: str, law: Mapping[str, Any]) -> None:
    """Let two geoms collide by a law of force, with the friction of the first one."""
    sliding, spinning, rolling = field.geom(geom).friction
    friction = [sliding, sliding, spinning, rolling, rolling]
    field.add_pair(geomname1=geom, geomname2=partner, condim=3, friction=friction, **law)


def tilt_cylinder(cylinder: mujoco.MjsGeom, model: mujoco.MjModel) -> None:
    """Tilt a cylinder by `TILT_RAD` about the x axis of its body.

    At tilts of 1e-15 rad, MuJoCo 4.0 returns false contacts of planes and cylinders, 2 cm deep.

    Args:
        cylinder: The cylinder; changed in place.
        model: Model with the cylinder, before the change.
    """
    geom, body = model.geom(cylinder.name), cylinder.parent
    cylinder.set_frame(body.add_frame())
    cylinder.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    cylinder.pos = geom.pos
    mujoco.mju_mulQuat(
        cylinder.quat, np.array([np.cos(TILT_RAD / 2), np.sin(TILT_RAD / 2), 0.0, 0.0]), geom.quat
    )
