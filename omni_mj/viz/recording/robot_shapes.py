"""Shapes of a robot in a recording: chassis and wheels of its MuJoCo model, and their poses."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np
import rerun as rr

from omni_control.kinematics import Array
from omni_mj.config.settings import Settings
from omni_mj.mjcf import world_builder
from omni_mj.viz import style
from omni_mj.viz.recording.rerun_stream import Frames, FrameStream

# MuJoCo's viewer shows geoms of groups 0 to 2. The collision hulls have higher groups.
VISIBLE_GROUPS = 3
ROLLER_CONTRAST = 110  # added to the RGB bytes of every other roller
UP = np.array([0.0, 0.0, 1.0])
# Name of a MuJoCo geom type -> rerun shape with sizes (n, 3) and further arguments.
SHAPES: dict[str, Callable[..., Any]] = {
    "CYLINDER": lambda size, **attributes: rr.Cylinders3D(
        radii=size[:, 0], lengths=2 * size[:, 1], **attributes
    ),
    "BOX": lambda size, **attributes: rr.Boxes3D(half_sizes=size, **attributes),
    "ELLIPSOID": lambda size, **attributes: rr.Ellipsoids3D(half_sizes=size, **attributes),
    "SPHERE": lambda size, **attributes: rr.Ellipsoids3D(radii=size[:, 0], **attributes),
}
SHAPES["CAPSULE"] = SHAPES["CYLINDER"]


def log_robot(stream: FrameStream, entity: str, cover_color: style.Rgb, settings: Settings) -> None:
    """Log chassis and wheels of a robot once, as static shapes.

    Args:
        stream: Stream of the recording.
        entity: Path of the robot; its chassis and wheels are below it.
        cover_color: Color of the cover, which distinguishes robots.
        settings: Settings of the robot.
    """
    world, data = stand_at_origin(settings)
    robot, colors = world.robots[0], geom_colors(world, cover_color)
    wheel_bodies = np.concatenate([robot.wheels, robot.rims, robot.rollers.ravel()])
    robot_bodies = np.flatnonzero(world.model.body_rootid == robot.chassis)
    chassis = np.setdiff1d(robot_bodies, wheel_bodies)
    _log_bodies(stream, f"{entity}/chassis", data, chassis, np.zeros(3), colors)
    for i, joint in enumerate(robot.joints):
        wheel = np.append(robot.rollers[i], robot.wheels[i])
        _log_bodies(stream, f"{entity}/wheel_{i + 1}", data, wheel, data.xanchor[joint], colors)


def send_poses(
    stream: FrameStream,
    entity: str,
    frames: Frames,
    pose: Array,
    wheel_angles: Array,
    settings: Settings,
    height: float = 0.0,
) -> None:
    """Send transforms of a robot and of its wheels, whose shapes `log_robot` has logged.

    Args:
        stream: Stream of the recording.
        entity: Path of the robot.
        frames: Numbers of the frames, (n,).
        pose: Poses, (n, 3) m, m, rad.
        wheel_angles: Angles of the wheels, (n, wheels) rad; NaN if the plant has no wheels.
        settings: Settings of the robot.
        height: Height above the carpet, m.
    """
    stream.send_frames(entity, frames, pose_columns(pose, height))
    world, data = stand_at_origin(settings)
    for i, joint in enumerate(world.robots[0].joints):
        hub = np.broadcast_to(data.xanchor[joint], (len(wheel_angles), 3))
        turns = _transform_columns(hub, np.nan_to_num(wheel_angles[:, i]), data.xaxis[joint])
        stream.send_frames(f"{entity}/wheel_{i + 1}", frames, turns)


def pose_columns(pose: Array, height: float = 0.0) -> rr.ComponentColumnList:
    """Return transforms of upright robots at poses (n, 3), at a height above the carpet in m."""
    return _transform_columns(points_above(pose, height), pose[:, 2], UP)


def points_above(pose: Array, height: float) -> Array:
    """Return points (n, 3) at a height in m above poses or positions (n, 2 or 3)."""
    return np.column_stack([pose[:, :2], np.full(len(pose), height)])


def are_visible(model: mujoco.MjModel, bodies: np.ndarray) -> np.ndarray:
    """Return whether each geom belongs to one of some bodies and is drawn, (n,) bool."""
    return np.isin(model.geom_bodyid, bodies) & (model.geom_group < VISIBLE_GROUPS)


def mesh_triangles(model: mujoco.MjModel, geom: int) -> Array:
    """Return the corners of a mesh geom's triangles, (triangles, 3, 3) m, in its own frame."""
    mesh = model.mesh(model.geom_dataid[geom])
    faces = model.mesh_face[mesh.faceadr[0] :][: mesh.facenum[0]]
    return np.asarray(model.mesh_vert[mesh.vertadr[0] + faces])


def cover_materials(model: mujoco.MjModel) -> list[int]:
    """Return the materials of covers, whose colors distinguish robots."""
    return [i for i in range(model.nmat) if model.mat(i).name.endswith("/cover")]


def _log_bodies(
    stream: FrameStream,
    entity: str,
    data: mujoco.MjData,
    bodies: Array,
    origin: Array,
    colors: np.ndarray,
) -> None:
    """Log the visible geoms of bodies, relative to an origin (3,) in m."""
    model = data.model
    visible = are_visible(model, bodies)
    centers = data.geom_xpos - origin
    for name, shape in SHAPES.items():
        geom_type = getattr(mujoco.mjtGeom, f"mjGEOM_{name}")
        geoms = (model.geom_type == geom_type) & visible
        if geoms.any():
            shapes = shape(
                model.geom_size[geoms],
                centers=centers[geoms],
                quaternions=data.geom_xquat[geoms][:, [1, 2, 3, 0]],  # MuJoCo: wxyz, rerun: xyzw
                colors=colors[geoms],
                fill_mode="solid",
            )
            stream.log(f"{entity}/{name.lower()}s", shapes, static=True)
    is_mesh = model.geom_type == mujoco.mjtGeom.mjGEOM_MESH
    for geom in np.flatnonzero(is_mesh & visible).tolist():
        corners = mesh_triangles(model, geom) @ data.geom_xmat[geom].reshape(3, 3).T
        # Flat shading: each triangle (3 corners, 3 axes) has its own corners and normal.
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        mesh_3d = rr.Mesh3D(
            vertex_positions=corners.reshape(-1, 3) + centers[geom],
            vertex_normals=np.repeat(normals, 3, axis=0),
            albedo_factor=colors[geom],
        )
        stream.log(f"{entity}/mesh_{geom}", mesh_3d, static=True)


@lru_cache(maxsize=4)
def stand_at_origin(settings: Settings) -> tuple[world_builder.World, mujoco.MjData]:
    """Return a model whose first robot, with complete wheels, stands at the world's origin."""
    world = world_builder.build_world(settings.replace(wheels={"model": "rollers"}))
    data, qpos = mujoco.MjData(world.model), world.robots[0].qpos
    data.qpos[qpos[:7]] = [0, 0, data.qpos[qpos[2]], 1, 0, 0, 0]
    mujoco.mj_kinematics(world.model, data)
    return world, data


def geom_colors(world: world_builder.World, cover_color: style.Rgb) -> np.ndarray:
    """Return the colors of all geoms, (n, 3) bytes: from the material, the geom or the cover."""
    model, material = world.model, world.model.geom_matid
    rgba = np.where(material[:, None] >= 0, model.mat_rgba[material], model.geom_rgba)
    colors = 255 * rgba[:, :3]
    colors[np.isin(material, cover_materials(model))] = cover_color
    # Every other roller is lighter; otherwise the rotation of wheels would be invisible.
    rollers = np.isin(model.geom_bodyid, world.robots[0].rollers[:, ::2])
    colors[rollers] += ROLLER_CONTRAST
    return np.minimum(colors, 255).astype(np.uint8)


def _transform_columns(position: Array, angle: Array, axis: Array) -> rr.ComponentColumnList:
    """Return transforms to positions (n, 3) with rotations by angles (n,) about an axis (3,)."""
    half = angle[:, None] / 2
    quaternion = np.concatenate([np.sin(half) * axis, np.cos(half)], axis=1)
    return rr.Transform3D.columns(translation=position, quaternion=quaternion)
