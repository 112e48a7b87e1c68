"""Numbers of a compiled robot: what it weighs, where its wheels are, how far its rollers reach."""

from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.mjcf.robot_indices import Ids, RobotIndices

ALIKE_M = 5e-4  # by which wheels may differ that count as alike
STRAIGHT = 0.01  # rad by which axles may miss the robot's middle, or the horizontal
DIGITS = 10  # that are kept: others are rounding of the compiler's
_GEOM = mujoco.mjtGeom


@dataclass(frozen=True)
class WheelGeometry:
    """Of one robot's wheels, upright with its frame in the world's.

    Args:
        azimuths: (wheels,) deg, to where each touches, 0 to 360.
        outward: whether a hinge's axis points away from the robot, (wheels,).
        arm: to where they touch, m.
        radius: over the rollers, m.
        roller_radius: m.
        height: of the axles in the chassis' frame, m.
    """

    azimuths: tuple[float, ...]
    outward: tuple[bool, ...]
    arm: float
    radius: float
    roller_radius: float
    height: float


def measure_wheels(model: mujoco.MjModel, robot: RobotIndices, touching: Ids) -> WheelGeometry:
    """Measure a robot's wheels.

    Args:
        model: compiled.
        robot: its parts.
        touching: geoms of rollers that touch the carpet.

    Raises:
        OmniError: wheels that are not alike, upright, or on one circle about the robot's middle.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    azimuths, outward, reaches = list[float](), list[bool](), list[tuple[float, ...]]()
    for joint, rollers in zip(robot.joints, robot.rollers, strict=True):
        anchor, axis = data.xanchor[joint], data.xaxis[joint]
        out = np.array([*anchor[:2], 0.0])
        outward.append(bool(axis @ out > 0))
        axle = axis if outward[-1] else -axis
        if np.linalg.norm(out) < ALIKE_M or np.linalg.norm(
            np.cross(axle, out)
        ) > STRAIGHT * np.linalg.norm(out):
            raise OmniError(
                f"the axle of the wheel {model.joint(joint).name!r} at ({anchor[0]:.4g}, {anchor[1]:.4g}) m does not "
                f"lead level to the middle of the robot, the origin of the body {model.body(robot.chassis).name!r}"
            )
        azimuths.append(
            float(np.round(np.degrees(np.arctan2(axle[1], axle[0])) % 360, DIGITS)) % 360
        )
        means = np.mean(
            [_reach(model, data, int(roller), touching, anchor, axle) for roller in rollers], axis=0
        )
        reaches.append((*means, anchor[2]))
    for values, kind in zip(
        np.transpose(reaches), ("arms", "radii", "radii of rollers", "heights"), strict=True
    ):
        if np.ptp(values) > ALIKE_M:
            listed = ", ".join(f"{1e3 * value:.2f}" for value in values)
            raise OmniError(f"wheels must be alike, but their {kind} are {listed} mm")
    arm, radius, roller, height = (
        float(np.round(value, DIGITS)) for value in np.mean(reaches, axis=0)
    )
    return WheelGeometry(tuple(azimuths), tuple(outward), arm, radius, roller, height)


def _reach(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    roller: int,
    touching: Ids,
    anchor: Array,
    axle: Array,
) -> tuple[float, float, float]:
    """How far out a roller touches, the wheel's radius there, and its own, m."""
    hinge = data.xanchor[model.body_jntadr[roller]] - anchor
    spoke = hinge - (hinge @ axle) * axle
    length = float(np.linalg.norm(spoke))
    geoms = touching[model.geom_bodyid[touching] == roller]
    radius = (
        max(compute_support_distance(model, data, int(geom), spoke / length) for geom in geoms)
        - anchor @ spoke / length
    )
    return float((anchor + (hinge @ axle) * axle)[:2] @ axle[:2]), radius, radius - length


def compute_support_distance(
    model: mujoco.MjModel, data: mujoco.MjData, geom: int, direction: Array
) -> float:
    """How far a geom reaches along a unit vector (3,), from the world's origin, m."""
    along = direction @ data.geom_xmat[geom].reshape(3, 3)
    a, b, c = model.geom_size[geom]
    kind = _GEOM(model.geom_type[geom])
    if kind == _GEOM.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first = model.mesh_vertadr[mesh]
        reach = (model.mesh_vert[first : first + model.mesh_vertnum[mesh]] @ along).max()
    elif kind == _GEOM.mjGEOM_ELLIPSOID:
        reach = np.linalg.norm(along * [a, b, c])
    elif kind == _GEOM.mjGEOM_CYLINDER:
        reach = a * np.hypot(along[0], along[1]) + b * abs(along[2])
    elif kind in (_GEOM.mjGEOM_CAPSULE, _GEOM.mjGEOM_SPHERE):
        reach = a + b * abs(along[2])  # b is 0 of a sphere
    elif kind == _GEOM.mjGEOM_BOX:
        reach = np.abs(along) @ [a, b, c]
    else:
        raise OmniError(f"rollers and hulls cannot be geoms of type {kind.name[7:].lower()}")
    return float(direction @ data.geom_xpos[geom] + reach)


def set_inertial(body: mujoco.MjsBody, mass: float, centre: Array, inertia: Array) -> None:
    """Give a body its mass, centre of mass (3,) and inertia (3, 3) about it, in its own frame."""
    body.explicitinertial = True
    body.mass, body.ipos, body.iquat = mass, centre, [1.0, 0.0, 0.0, 0.0]
    body.inertia = np.zeros(3)  # the compiler takes either this or the full matrix
    body.fullinertia = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def compute_composite_inertia(
    model: mujoco.MjModel, bodies: Iterable[int]
) -> tuple[float, Array, Array]:
    """Mass, centre of mass (3,) and inertia (3, 3) about it of some bodies as modelled, in the world's frame."""
    data, chosen = mujoco.MjData(model), list(bodies)
    mujoco.mj_kinematics(model, data)
    mass, at = model.body_mass[chosen], data.xipos[chosen]
    centre = mass @ at / mass.sum()
    inertia = np.zeros((3, 3))
    for number, m, r in zip(chosen, mass, at - centre, strict=True):
        axes = data.ximat[number].reshape(3, 3)
        inertia += axes @ np.diag(model.body_inertia[number]) @ axes.T + m * point_mass_inertia(r)
    return float(mass.sum()), centre, inertia


def point_mass_inertia(r: Array) -> Array:
    """Inertia of a unit mass at r about the origin, m^2."""
    return np.asarray(r @ r * np.eye(3) - np.outer(r, r))
