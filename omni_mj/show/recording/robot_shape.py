"""A robot's shape for the rerun viewer, taken from the compiled model's own geoms."""

from functools import lru_cache
from typing import Any

import mujoco
import numpy as np
import rerun as rr

from omni_mj.mjcf.roles import Robot
from omni_mj.scenarios.settings import Settings
from omni_mj.worlds import build

LIGHTER = 110  # of 255
SHOWN_GROUPS = 3  # as in MuJoCo's viewer: geoms of group 3 and above (hulls) are hidden
COVER = "cover"  # material of the geoms that tell robots apart by their colour
_CYLINDER, _BOX, _ELLIPSOID = mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_ELLIPSOID
_SPHERE, _CAPSULE, _MESH = mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_MESH


def _at_rest(settings: Settings) -> tuple[mujoco.MjModel, mujoco.MjData, Robot]:
    """The model of whole wheels with the chassis over the origin, so that world coordinates are the robot's own."""
    return _posed(build.world(settings.replace(wheels={"model": "rollers"})))


@lru_cache(maxsize=4)
def _posed(world: build.World) -> tuple[mujoco.MjModel, mujoco.MjData, Robot]:
    model, parts = world.model, world.robots[0]
    data = mujoco.MjData(model)
    data.qpos[parts.qpos[:2]] = 0.0
    data.qpos[parts.qpos[3:7]] = [1.0, 0.0, 0.0, 0.0]
    mujoco.mj_kinematics(model, data)
    return model, data, parts


def wheel_mounts(robot: Settings) -> list[tuple[np.ndarray, np.ndarray]]:
    """Per wheel, the axle's position (3,) in m and its axis (3,), in the robot's frame."""
    _, data, parts = _at_rest(robot)
    return [(data.xanchor[joint].copy(), data.xaxis[joint].copy()) for joint in parts.joints]


def log(stream: rr.RecordingStream, entity: str, colour: tuple[int, int, int], robot: Settings) -> None:
    """Log chassis and wheels once, static, under `entity`; the cover in `colour` to tell robots apart."""
    model, _, parts = _at_rest(robot)
    own = np.flatnonzero(model.body_rootid == parts.chassis)
    turning = np.concatenate([parts.wheels, parts.rims, parts.rollers.ravel()])
    _log_geoms(stream, f"{entity}/chassis", robot, np.setdiff1d(own, turning), np.zeros(3), colour)
    for i, (position, _) in enumerate(wheel_mounts(robot)):
        bodies = np.append(parts.rollers[i], parts.wheels[i])
        _log_geoms(stream, f"{entity}/wheel_{i + 1}", robot, bodies, position, colour)


def _log_geoms(
    stream: rr.RecordingStream,
    entity: str,
    robot: Settings,
    bodies: np.ndarray,
    origin: np.ndarray,
    colour: tuple[int, int, int],
) -> None:
    """Log the geoms of `bodies` relative to `origin`, one entity per kind of geom."""
    model, data, parts = _at_rest(robot)
    mine = np.isin(model.geom_bodyid, bodies) & (model.geom_group < SHOWN_GROUPS)
    for kind in (_CYLINDER, _BOX, _ELLIPSOID, _SPHERE, _CAPSULE):
        ids = np.flatnonzero((model.geom_type == kind) & mine)
        if not ids.size:
            continue
        size = model.geom_size[ids]
        common: dict[str, Any] = {
            "quaternions": data.geom_xquat[ids][:, [1, 2, 3, 0]],  # MuJoCo's wxyz to rerun's xyzw
            "colors": np.array([_colour(model, parts, i, colour) for i in ids]),
            "fill_mode": "solid",
        }
        centres = data.geom_xpos[ids] - origin
        if kind == _CYLINDER:
            shape: Any = rr.Cylinders3D(radii=size[:, 0], lengths=2 * size[:, 1], centers=centres, **common)
        elif kind == _BOX:
            shape = rr.Boxes3D(half_sizes=size, centers=centres, **common)
        elif kind == _CAPSULE:  # rerun's begin at the centre of one of their ends
            ends = centres - size[:, 1:2] * data.geom_xmat[ids].reshape(-1, 3, 3)[:, :, 2]
            shape = rr.Capsules3D(radii=size[:, 0], lengths=2 * size[:, 1], translations=ends, **common)
        else:
            half_sizes = size if kind == _ELLIPSOID else np.repeat(size[:, :1], 3, axis=1)
            shape = rr.Ellipsoids3D(half_sizes=half_sizes, centers=centres, **common)
        stream.log(f"{entity}/{mujoco.mjtGeom(kind).name[7:].lower()}s", shape, static=True)
    for geom in np.flatnonzero((model.geom_type == _MESH) & mine):
        _log_mesh(stream, f"{entity}/mesh_{geom}", robot, int(geom), origin, colour)


def _log_mesh(
    stream: rr.RecordingStream,
    entity: str,
    robot: Settings,
    geom: int,
    origin: np.ndarray,
    colour: tuple[int, int, int],
) -> None:
    model, data, parts = _at_rest(robot)
    mesh = model.mesh(model.geom_dataid[geom])
    vertices = model.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]]
    faces = model.mesh_face[mesh.faceadr[0] :][: mesh.facenum[0]]
    placed = vertices @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom] - origin
    albedo = [*_colour(model, parts, np.intp(geom), colour), 255]
    shape = rr.Mesh3D(vertex_positions=placed, triangle_indices=faces, albedo_factor=albedo)
    stream.log(entity, shape, static=True)


def _colour(model: mujoco.MjModel, robot: Robot, geom: np.intp, cover: tuple[int, int, int]) -> np.ndarray:
    """Colour (3,) of a geom, 0 to 255: its material's or its own, or that of this robot's `cover`."""
    material = model.geom_matid[geom]
    if material >= 0 and model.mat(material).name.endswith(f"/{COVER}"):
        return np.array(cover)
    colour = (255 * (model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom])[:3]).astype(int)
    if model.geom_bodyid[geom] in robot.rollers[:, ::2]:  # every other roller lighter, or nobody sees wheels turn
        colour = np.minimum(colour + LIGHTER, 255)
    return colour
