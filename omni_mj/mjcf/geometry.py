"""Numbers of a compiled robot: what it weighs, where its wheels are, how far its rollers reach."""

from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.mjcf.roles import Ids, Robot

ALIKE_M = 5e-4  # by which wheels may differ that count as alike
STRAIGHT = 0.01  # rad by which axles may miss the robot's middle, or the horizontal
DIGITS = 10  # that are kept: others are rounding of the compiler's


@dataclass(frozen=True)
class Wheels:
    """Of one robot's wheels, upright with its frame in the world's.

    Args:
        azimuths: (wheels,) deg, to where each touches, 0 to 360.
        outward: whether a hinge's axis points away from the robot, (wheels,).
        arm: to where they touch, m.
        radius: over the rollers, m.
        roller_radius: m.
        rollers: of a wheel.
        height: of the axles in the chassis' frame, m.
    """

    azimuths: tuple[float, ...]
    outward: tuple[bool, ...]
    arm: float
    radius: float
    roller_radius: float
    rollers: int
    height: float

    @classmethod
    def of(cls, model: mujoco.MjModel, robot: Robot, touching: Ids, file: str) -> "Wheels":
        """Measure them.

        Args:
            model: compiled.
            robot: its parts.
            touching: geoms of rollers that touch the carpet.
            file: named in messages.

        Raises:
            OmniError: wheels that are not alike, upright, or on one circle about the robot's middle; a line for each.
        """
        data, errors = mujoco.MjData(model), list[str]()
        mujoco.mj_kinematics(model, data)
        names = [model.joint(joint).name for joint in robot.joints]
        reaches = np.zeros((len(names), 4))  # arm, radius, roller's radius, height
        azimuths, outward = [], []
        for i, joint in enumerate(robot.joints):
            anchor, axis = data.xanchor[joint], data.xaxis[joint]
            out = np.array([*anchor[:2], 0.0])
            outward.append(bool(axis @ out > 0))
            axle = axis if outward[-1] else -axis
            if np.linalg.norm(out) < ALIKE_M or np.linalg.norm(np.cross(axle, out)) > STRAIGHT * np.linalg.norm(out):
                errors.append(
                    f"{file}: the axle of the wheel {names[i]!r} at ({anchor[0]:.4g}, {anchor[1]:.4g}) m does not "
                    f"lead level to the middle of the robot, the origin of the body {_name(model, robot)!r}"
                )
                continue
            azimuths.append(float(np.round(np.degrees(np.arctan2(axle[1], axle[0])) % 360, DIGITS)) % 360)
            geoms = touching[np.isin(model.geom_bodyid[touching], robot.rollers[i])]
            if not geoms.size:
                errors.append(f"{file}: the rollers of the wheel {names[i]!r} have no geom that could touch the carpet")
                continue
            reaches[i] = *_reach(model, data, robot.rollers[i], geoms, anchor, axle), anchor[2]
        if not errors:
            what = ("arms", "radii", "radii of rollers", "heights of axles")
            for values, kind in zip(reaches.T, what, strict=True):
                if np.ptp(values) > ALIKE_M:
                    told = ", ".join(f"{1e3 * value:.2f}" for value in values)
                    errors.append(f"{file}: wheels must be alike, but their {kind} are {told} mm")
        if errors:
            raise OmniError("\n".join(errors))
        arm, radius, roller, height = (float(np.round(value, DIGITS)) for value in reaches.mean(0))
        return cls(tuple(azimuths), tuple(outward), arm, radius, roller, robot.rollers.shape[1], height)


@dataclass(frozen=True)
class Body:
    """Mass, kg; centre of mass, (3,) m; inertia about it, (3, 3) kg m^2, in the robot's frame."""

    mass: float
    centre: Array
    inertia: Array

    @classmethod
    def of(cls, model: mujoco.MjModel, robot: Robot) -> "Body":
        """The whole robot as modelled."""
        return cls(*composite(model, np.flatnonzero(model.body_rootid == robot.chassis)))


def _name(model: mujoco.MjModel, robot: Robot) -> str:
    return str(model.body(robot.chassis).name)


def _reach(
    model: mujoco.MjModel, data: mujoco.MjData, rollers: Ids, geoms: Ids, anchor: Array, axle: Array
) -> tuple[float, float, float]:
    """Means over rollers: how far out they touch, the wheel's radius in their middle, and their own."""
    arms, radii, own = [], [], []
    for roller in rollers:
        hinge = data.xanchor[model.body_jntadr[roller]] - anchor
        spoke = hinge - (hinge @ axle) * axle
        length = float(np.linalg.norm(spoke))
        mine = geoms[model.geom_bodyid[geoms] == roller]
        reach = max(support(model, data, int(geom), spoke / length) for geom in mine) - anchor @ spoke / length
        arms.append(float((anchor + (hinge @ axle) * axle)[:2] @ axle[:2]))
        radii.append(reach)
        own.append(reach - length)
    return float(np.mean(arms)), float(np.mean(radii)), float(np.mean(own))


def support(model: mujoco.MjModel, data: mujoco.MjData, geom: int, direction: Array) -> float:
    """How far a geom reaches along a unit vector (3,), from the world's origin, m."""
    along = direction @ data.geom_xmat[geom].reshape(3, 3)
    a, b, c = model.geom_size[geom]
    kind = mujoco.mjtGeom(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first = model.mesh_vertadr[mesh]
        vertices = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
        return float(direction @ data.geom_xpos[geom] + (vertices @ along).max())
    reach = {
        mujoco.mjtGeom.mjGEOM_SPHERE: a,
        mujoco.mjtGeom.mjGEOM_ELLIPSOID: np.linalg.norm(along * [a, b, c]),
        mujoco.mjtGeom.mjGEOM_CAPSULE: a + b * abs(along[2]),
        mujoco.mjtGeom.mjGEOM_CYLINDER: a * np.hypot(along[0], along[1]) + b * abs(along[2]),
        mujoco.mjtGeom.mjGEOM_BOX: np.abs(along) @ [a, b, c],
    }.get(kind)
    if reach is None:
        raise OmniError(f"a roller cannot be a geom of type {kind.name[7:].lower()}")
    return float(direction @ data.geom_xpos[geom] + reach)


def weigh(body: mujoco.MjsBody, mass: float, centre: Array, inertia: Array) -> None:
    """Give a body its mass, centre of mass (3,) and inertia (3, 3) about it, in its own frame."""
    body.explicitinertial = True
    body.mass, body.ipos, body.iquat = mass, centre, [1.0, 0.0, 0.0, 0.0]
    body.inertia = np.zeros(3)  # the compiler takes either this or the full matrix
    body.fullinertia = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def composite(model: mujoco.MjModel, bodies: Iterable[int]) -> tuple[float, Array, Array]:
    """Mass, centre of mass (3,) and inertia (3, 3) about it of some bodies as modelled, in the world's frame."""
    data, chosen = mujoco.MjData(model), list(bodies)
    mujoco.mj_kinematics(model, data)
    mass, at = model.body_mass[chosen], data.xipos[chosen]
    centre = mass @ at / mass.sum()
    inertia = np.zeros((3, 3))
    for number, m, r in zip(chosen, mass, at - centre, strict=True):
        axes = data.ximat[number].reshape(3, 3)
        inertia += axes @ np.diag(model.body_inertia[number]) @ axes.T + m * spread(r)
    return float(mass.sum()), centre, inertia


def spread(r: Array) -> Array:
    """Inertia of a unit mass at r about the origin, m^2."""
    return np.asarray(r @ r * np.eye(3) - np.outer(r, r))
