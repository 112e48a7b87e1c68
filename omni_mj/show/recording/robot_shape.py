"""A robot's shape for the rerun viewer, from the geoms of the compiled model."""

from collections.abc import Callable
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
Colour = tuple[int, int, int]
# Kind of geom -> its rerun shape, from sizes (n, 3), centres (n, 3) and axes z (n, 3), and further arguments.
SHAPES: dict[str, Callable[..., Any]] = {
    "CYLINDER": lambda size, centre, z, **look: rr.Cylinders3D(
        radii=size[:, 0], lengths=2 * size[:, 1], centers=centre, **look
    ),
    "BOX": lambda size, centre, z, **look: rr.Boxes3D(half_sizes=size, centers=centre, **look),
    "ELLIPSOID": lambda size, centre, z, **look: rr.Ellipsoids3D(half_sizes=size, centers=centre, **look),
    "SPHERE": lambda size, centre, z, **look: rr.Ellipsoids3D(
        half_sizes=np.repeat(size[:, :1], 3, axis=1), centers=centre, **look
    ),
    "CAPSULE": lambda size, centre, z, **look: rr.Capsules3D(  # which begins at the centre of one of its ends
        radii=size[:, 0], lengths=2 * size[:, 1], translations=centre - size[:, 1:2] * z, **look
    ),
}


@lru_cache(maxsize=4)
def _posed(world: build.World) -> tuple[mujoco.MjModel, mujoco.MjData, Robot]:
    """Return a model with the chassis over the origin, so that world coordinates are the robot's own."""
    model, parts = world.model, world.robots[0]
    data = mujoco.MjData(model)
    data.qpos[parts.qpos[:2]] = 0.0
    data.qpos[parts.qpos[3:7]] = [1.0, 0.0, 0.0, 0.0]
    mujoco.mj_kinematics(model, data)
    return model, data, parts


def _at_rest(settings: Settings) -> tuple[mujoco.MjModel, mujoco.MjData, Robot]:
    """Return the model of whole wheels."""
    return _posed(build.world(settings.replace(wheels={"model": "rollers"})))


def wheel_mounts(settings: Settings) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return per wheel the axle's position (3,) in m and its axis (3,), in the robot's frame."""
    _, data, parts = _at_rest(settings)
    return [(data.xanchor[joint].copy(), data.xaxis[joint].copy()) for joint in parts.joints]


def log(stream: rr.RecordingStream, entity: str, colour: Colour, settings: Settings) -> None:
    """Log chassis and wheels once, static, under `entity`; the cover in `colour` to tell robots apart."""
    model, _, parts = _at_rest(settings)
    turning = np.concatenate([parts.wheels, parts.rims, parts.rollers.ravel()])
    bodies = np.setdiff1d(np.flatnonzero(model.body_rootid == parts.chassis), turning)
    _log_geoms(stream, f"{entity}/chassis", settings, bodies, np.zeros(3), colour)
    for i, (position, _) in enumerate(wheel_mounts(settings)):
        wheel = np.append(parts.rollers[i], parts.wheels[i])
        _log_geoms(stream, f"{entity}/wheel_{i + 1}", settings, wheel, position, colour)


def _log_geoms(
    stream: rr.RecordingStream, entity: str, settings: Settings, bodies: np.ndarray, origin: np.ndarray, cover: Colour
) -> None:
    """Log the geoms of `bodies` relative to `origin`: one entity per kind of geom, and one per mesh."""
    model, data, parts = _at_rest(settings)
    shown = np.isin(model.geom_bodyid, bodies) & (model.geom_group < SHOWN_GROUPS)
    colours = np.array([_colour(model, parts, geom, cover) for geom in range(model.ngeom)])
    rotations = data.geom_xmat.reshape(-1, 3, 3)
    for kind, shape in SHAPES.items():
        ids = np.flatnonzero((model.geom_type == getattr(mujoco.mjtGeom, f"mjGEOM_{kind}")) & shown)
        if ids.size:
            quaternions = data.geom_xquat[ids][:, [1, 2, 3, 0]]  # MuJoCo's wxyz to rerun's xyzw
            look = {"quaternions": quaternions, "colors": colours[ids], "fill_mode": "solid"}
            geoms = shape(model.geom_size[ids], data.geom_xpos[ids] - origin, rotations[ids][:, :, 2], **look)
            stream.log(f"{entity}/{kind.lower()}s", geoms, static=True)
    for geom in np.flatnonzero((model.geom_type == mujoco.mjtGeom.mjGEOM_MESH) & shown):
        mesh = model.mesh(model.geom_dataid[geom])
        vertices = model.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]]
        shape_3d = rr.Mesh3D(
            vertex_positions=vertices @ rotations[geom].T + data.geom_xpos[geom] - origin,
            triangle_indices=model.mesh_face[mesh.faceadr[0] :][: mesh.facenum[0]],
            albedo_factor=[*colours[geom], 255],
        )
        stream.log(f"{entity}/mesh_{geom}", shape_3d, static=True)


def _colour(model: mujoco.MjModel, robot: Robot, geom: int, cover: Colour) -> np.ndarray:
    """Return the colour (3,) of a geom, 0 to 255: its material's or its own, or that of this robot's `cover`."""
    material = model.geom_matid[geom]
    if material >= 0 and model.mat(material).name.endswith(f"/{COVER}"):
        return np.array(cover)
    colour = (255 * (model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom])[:3]).astype(int)
    if model.geom_bodyid[geom] in robot.rollers[:, ::2]:  # every other roller lighter, or nobody sees wheels turn
        colour = np.minimum(colour + LIGHTER, 255)
    return colour
