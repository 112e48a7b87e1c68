"""Geometry and inertia of a compiled robot: wheels, reach of geoms, composite inertia."""

from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.mjcf.robot_parts import Ids, RobotIndices, compute_initial_kinematics

LENGTH_TOLERANCE_M = 5e-4  # of the geometry of equal wheels
N_WHEEL_ANGLES = 64  # from one roller to the next, at which the height of an axle is computed
ANGLE_TOLERANCE_RAD = 0.01  # of axles that point at the robot's center, horizontally
DIGITS = 10  # decimal places; further ones are rounding errors of the compiler
_GEOM = mujoco.mjtGeom


@dataclass(frozen=True)
class WheelGeometry:
    """Geometry of a robot's wheels, with the robot's frame at the world's origin.

    Attributes:
        azimuths_deg: Directions to the contact points, (wheels,), 0 to 360 deg.
        is_outward: Whether the axis of each hinge points away from the robot, (wheels,).
        arm: Distance from the center to the contact points, m.
        radius: Radius of the wheels over the rollers, m.
        roller_radius: Radius of the rollers, m.
        axle_height: Height of the axles above the origin of the chassis, m.
        ripple: Height by which the axles rise and fall while the wheels roll, m.
        rolling_radius: Distance per angle by which the wheels roll, m.
    """

    azimuths_deg: tuple[float, ...]
    is_outward: tuple[bool, ...]
    arm: float
    radius: float
    roller_radius: float
    axle_height: float
    ripple: float
    rolling_radius: float


def measure_wheels(model: mujoco.MjModel, robot: RobotIndices, contact_geoms: Ids) -> WheelGeometry:
    """Return the geometry of a robot's wheels.

    Args:
        model: Compiled model.
        robot: Indices of the robot.
        contact_geoms: Geoms of rollers that touch the carpet.

    Raises:
        OmniError: The wheels are not equal, upright, or on one circle about the robot's center, or
            the carpet would touch a hub.
    """
    data = compute_initial_kinematics(model)
    azimuths, is_outward, lengths = list[float](), list[bool](), list[list[float]]()
    for joint, rim, rollers in zip(robot.joints, robot.rims, robot.rollers, strict=True):
        anchor, axis = data.xanchor[joint], data.xaxis[joint]
        radial = np.array([*anchor[:2], 0.0])
        is_outward.append(bool(axis @ radial > 0))
        axle = axis if is_outward[-1] else -axis
        distance = np.linalg.norm(radial)
        misalignment = np.linalg.norm(np.cross(axle, radial))
        if distance < LENGTH_TOLERANCE_M or misalignment > ANGLE_TOLERANCE_RAD * distance:
            raise OmniError(
                f"the axle of the wheel {model.joint(joint).name!r} at ({anchor[0]:.4g}, "
                f"{anchor[1]:.4g}) m must point horizontally at the center of the robot, the "
                f"origin of the body {model.body(robot.chassis).name!r}"
            )
        azimuth = np.degrees(np.arctan2(axle[1], axle[0])) % 360
        azimuths.append(float(np.round(azimuth, DIGITS)) % 360)
        roller_lengths = np.mean(
            [_measure_roller(data, roller, contact_geoms, anchor, axle) for roller in rollers],
            axis=0,
        )
        heights = _compute_axle_heights(data, joint, rim, rollers, contact_geoms)
        lengths.append([*roller_lengths, anchor[2], float(np.ptp(heights)), float(heights.mean())])
    _check_equal_wheels(lengths)
    rounded = (float(np.round(value, DIGITS)) for value in np.mean(lengths, axis=0))
    return WheelGeometry(tuple(azimuths), tuple(is_outward), *rounded)


def _check_equal_wheels(lengths: list[list[float]]) -> None:
    """Raise an OmniError if a length differs from wheel to wheel; lengths (wheels, 6), m."""
    names = "arms", "radii", "radii of rollers", "heights", "ripples", "rolling radii"
    for values, name in zip(np.transpose(lengths), names, strict=True):
        if np.ptp(values) > LENGTH_TOLERANCE_M:
            values_mm = ", ".join(f"{1e3 * value:.2f}" for value in values)
            raise OmniError(f"wheels must be equal, but their {name} are {values_mm} mm")


def _measure_roller(
    data: mujoco.MjData,
    roller: int,
    contact_geoms: Ids,
    anchor: Array,
    axle: Array,
) -> tuple[float, float, float]:
    """Return arm and radius of the wheel at a roller, and the radius of the roller, m.

    Args:
        data: Kinematic state of the robot.
        roller: Body of the roller.
        contact_geoms: Geoms of rollers that touch the carpet.
        anchor: Center of the wheel, (3,) m.
        axle: Outward unit vector along the axle, (3,).
    """
    model = data.model
    hinge = data.xanchor[model.body_jntadr[roller]] - anchor
    spoke = hinge - (hinge @ axle) * axle
    length = float(np.linalg.norm(spoke))
    geoms = contact_geoms[model.geom_bodyid[contact_geoms] == roller]
    radius = (
        max(compute_support_distance(data, geom, spoke / length) for geom in geoms)
        - anchor @ spoke / length
    )
    arm = (anchor + (hinge @ axle) * axle)[:2] @ axle[:2]
    return float(arm), float(radius), float(radius) - length


def _compute_axle_heights(
    data: mujoco.MjData, joint: int, rim: int, rollers: Ids, contact_geoms: Ids
) -> Array:
    """Return the height of an axle above the rollers' lowest point while the wheel turns, m.

    Args:
        data: Kinematic state of the robot.
        joint: Hinge of the wheel.
        rim: Body that carries the rollers.
        rollers: Bodies of the rollers.
        contact_geoms: Geoms of these and other rollers that touch the carpet.

    Returns:
        Heights at equal steps from one roller at the bottom to the next, (N_WHEEL_ANGLES,).

    Raises:
        OmniError: A geom of the hub or rim that can collide reaches below the rollers.
    """
    model, anchor, axle = data.model, data.xanchor[joint], data.xaxis[joint]
    spoke = data.xpos[rollers[0]] - anchor
    spoke -= (spoke @ axle) * axle
    spoke /= np.linalg.norm(spoke)
    angles = np.linspace(0, 2 * np.pi / len(rollers), N_WHEEL_ANGLES, endpoint=False)[:, None]
    directions = np.cos(angles) * spoke + np.sin(angles) * np.cross(axle, spoke)
    geoms = contact_geoms[np.isin(model.geom_bodyid[contact_geoms], rollers)]
    distances = [compute_support_distance(data, geom, directions) for geom in geoms]
    heights = np.max(distances, axis=0) - directions @ anchor
    can_collide = (model.geom_contype | model.geom_conaffinity) != 0
    is_on_hub = np.isin(model.geom_bodyid, [model.jnt_bodyid[joint], rim])
    for geom in np.flatnonzero(can_collide & is_on_hub).tolist():
        reach = compute_support_distance(data, geom, directions) - directions @ anchor
        if (depth := np.max(reach - heights)) > 0:
            raise OmniError(
                f"the wheel {model.joint(joint).name!r} cannot roll: between two rollers, the geom "
                f"{model.geom(geom).name!r} of its hub is {1e3 * depth:.2g} mm lower; make it "
                "smaller, or switch its contacts off with contype and conaffinity"
            )
    return heights


def compute_support_distance(data: mujoco.MjData, geom: int, directions: Array) -> Array:
    """Return the largest extent of a geom along unit vectors (..., 3) from the origin, (...) m.

    Raises:
        OmniError: The type of the geom is not supported.
    """
    model = data.model
    local_directions = directions @ data.geom_xmat[geom].reshape(3, 3)
    x, y, z = np.moveaxis(local_directions, -1, 0)
    a, b, c = model.geom_size[geom]
    kind = _GEOM(model.geom_type[geom])
    if kind == _GEOM.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        start = model.mesh_vertadr[mesh]
        vertices = model.mesh_vert[start : start + model.mesh_vertnum[mesh]]
        extent = (local_directions @ vertices.T).max(-1)
    elif kind == _GEOM.mjGEOM_ELLIPSOID:
        extent = np.linalg.norm(local_directions * [a, b, c], axis=-1)
    elif kind == _GEOM.mjGEOM_CYLINDER:
        extent = a * np.hypot(x, y) + b * np.abs(z)
    elif kind in (_GEOM.mjGEOM_CAPSULE, _GEOM.mjGEOM_SPHERE):
        extent = a + b * np.abs(z)  # b is 0 for a sphere
    elif kind == _GEOM.mjGEOM_BOX:
        extent = np.abs(local_directions) @ [a, b, c]
    else:
        # Without the prefix mjGEOM_.
        raise OmniError(f"rollers, hubs and hulls cannot be geoms of type {kind.name[7:].lower()}")
    return np.asarray(directions @ data.geom_xpos[geom] + extent)


def set_inertial(body: mujoco.MjsBody, mass: float, center: Array, inertia: Array) -> None:
    """Set a body's mass, center of mass (3,) and inertia (3, 3) about it, in its own frame."""
    body.explicitinertial = True
    body.mass, body.ipos, body.iquat = mass, center, [1.0, 0.0, 0.0, 0.0]
    body.inertia = np.zeros(3)  # the compiler accepts either this or the full matrix
    body.fullinertia = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def compute_composite_inertia(
    model: mujoco.MjModel, bodies: Iterable[int]
) -> tuple[float, Array, Array]:
    """Return mass, center of mass (3,) and inertia (3, 3) about it of bodies, world frame.

    The bodies are in the model's initial configuration.
    """
    data, indices = compute_initial_kinematics(model), list(bodies)
    mass, positions = model.body_mass[indices], data.xipos[indices]
    center = mass @ positions / mass.sum()
    inertia = np.zeros((3, 3))
    for body, m, r in zip(indices, mass, positions - center, strict=True):
        axes = data.ximat[body].reshape(3, 3)
        principal = np.diag(model.body_inertia[body])
        inertia += axes @ principal @ axes.T + m * compute_point_mass_inertia(r)
    return float(mass.sum()), center, inertia


def make_printable_moments(moments: Array) -> Array:
    """Return the moments of inertia (3,) of a flat ring, slightly thicker if necessary.

    MuJoCo prints six digits. It rejects moments that violate the triangle inequality.
    """
    axial, *transverse = (float(f"{moment:.6g}") for moment in moments)
    return moments * [1.0, 1.00001, 1.00001] if axial > sum(transverse) else moments


def compute_point_mass_inertia(r: Array) -> Array:
    """Return the inertia (3, 3) about the origin of a unit mass at r (3,), m^2."""
    return r @ r * np.eye(3) - np.outer(r, r)
