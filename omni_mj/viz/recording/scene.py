"""Spatial part of a recording: field, reference, robots, and where robots are believed to be."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from omni_control.kinematics import Array
from omni_mj.config.settings import PERIOD_S, Settings
from omni_mj.mjcf import field, world_builder
from omni_mj.viz import style
from omni_mj.viz.recorded_robots import RecordedRobot

Frames = NDArray[np.int_]  # numbers of frames, (n,)
FRAME, TIME = "frame", "time"  # timelines
CARPET, LINES, GOALS, REFERENCE = (33, 66, 45), (150, 175, 158), (190, 190, 190), (240, 240, 240)
RADIUS_M, HEIGHT_M = 0.09, 0.15  # of a robot: the envelope that the rules allow
TIE_M = 5e-4  # from a robot up to the next: of robots at one place, one must hide the other
LIGHTER = 110  # of 255
SHOWN_GROUPS = 3  # as in MuJoCo's viewer: geoms of group 3 and above (hulls) are hidden
_UP = np.array([0.0, 0.0, 1.0])
# Kind of geom -> its rerun shape, from sizes (n, 3) and further arguments.
_SHAPES: dict[str, Callable[..., Any]] = {
    "CYLINDER": lambda size, **look: rr.Cylinders3D(
        radii=size[:, 0], lengths=2 * size[:, 1], **look
    ),
    "BOX": lambda size, **look: rr.Boxes3D(half_sizes=size, **look),
    "ELLIPSOID": lambda size, **look: rr.Ellipsoids3D(half_sizes=size, **look),
    "SPHERE": lambda size, **look: rr.Ellipsoids3D(radii=size[:, 0], **look),
}
_SHAPES["CAPSULE"] = _SHAPES["CYLINDER"]


def indexes(frames: Frames) -> list[rr.TimeColumn]:
    """Return index columns that place rows in `frames`."""
    return [rr.TimeColumn(FRAME, sequence=frames), rr.TimeColumn(TIME, duration=frames * PERIOD_S)]


def scalars(values: Array) -> rr.ComponentColumnList:
    """Return columns of n rows of the values (n, lines) of a plot."""
    return rr.Scalars.columns(scalars=values.ravel()).partition(
        np.full(len(values), values.shape[1])
    )


def log_static(
    stream: rr.RecordingStream, robots: Sequence[RecordedRobot], paths: Sequence[Array]
) -> None:
    """Log what does not change: the field, the references (frames, 3) on it, and how robots look."""
    stream.log("world", rr.ViewCoordinates.FLU, static=True)
    log_field(stream)
    strips = [_at(path, 0.002) for path in paths]
    stream.log(
        "world/reference",
        rr.LineStrips3D(strips, colors=[REFERENCE], radii=_points(0.7)),
        static=True,
    )
    for robot in robots:
        entity = f"world/{robot.name}"
        log_robot(stream, f"{entity}/robot", robot.colour, robot.settings)
        path = rr.LineStrips3D.from_fields(colors=[robot.colour], radii=_points(1.4))
        stream.log(f"{entity}/path", path, static=True)
        target = rr.Points3D.from_fields(colors=[REFERENCE], radii=_points(3.5))
        stream.log(f"{entity}/target", target, static=True)


def log_field(stream: rr.RecordingStream) -> None:
    """Log carpet, lines and goals."""
    carpet = [[*np.array(field.SURFACE_M) / 2, 0.01]]
    centres, half_sizes = field.get_goal_walls()
    for name, sizes, at, colour in (
        ("carpet", carpet, [[0, 0, -0.011]], CARPET),
        ("goals", half_sizes, centres, GOALS),
    ):
        shape = rr.Boxes3D(half_sizes=sizes, centers=at, colors=[colour], fill_mode="solid")
        stream.log(f"world/field/{name}", shape, static=True)
    angle = np.linspace(0, 2 * np.pi, 73)
    circle = field.CIRCLE_RADIUS_M * np.column_stack([np.cos(angle), np.sin(angle)])
    lines = [circle, *np.reshape([*field.get_field_lines().values()], (-1, 2, 2))]
    strips = [_at(line, 0.0) for line in lines]
    stream.log(
        "world/field/lines",
        rr.LineStrips3D(strips, colors=[LINES], radii=field.LINE_M / 2),
        static=True,
    )


def send(stream: rr.RecordingStream, robot: RecordedRobot, frames: Frames) -> None:
    """Send where a robot was in successive `frames`, and where it was believed to be."""
    entity, pose, lift = f"world/{robot.name}", robot["pose"], robot.order * TIE_M
    time = indexes(frames)
    send_pose(
        stream,
        f"{entity}/robot",
        time,
        pose[frames],
        robot["wheel_angle"][frames],
        robot.settings,
        lift,
    )
    # A segment per frame, from the frame before: the viewer shows those up to its time cursor.
    ends = [_at(pose[at], 0.004 + lift) for at in (np.maximum(frames - 1, 0), frames)]
    segments = np.stack(ends, axis=1, dtype=np.float32)
    stream.send_columns(f"{entity}/path", time, rr.LineStrips3D.columns(strips=segments))
    targets = rr.Points3D.columns(positions=_at(robot["ref"][frames], 0.005))
    stream.send_columns(f"{entity}/target", time, targets)
    for belief, low in (("vision", HEIGHT_M), ("predicted", 0.0)):
        values = robot[belief][frames]
        known = ~np.isnan(values[:, 0])
        if known.any():
            stream.send_columns(
                f"{entity}/{belief}", indexes(frames[known]), transform(values[known])
            )
            envelope = rr.Cylinders3D.columns(
                lengths=[HEIGHT_M - low],
                radii=[RADIUS_M],
                centers=[[0, 0, (HEIGHT_M + low) / 2]],
                colors=[style.mix_with_white(robot.colour)],
                line_radii=[_points(1.2)],
                fill_mode=["majorwireframe"],
            )
            stream.send_columns(f"{entity}/{belief}/shape", indexes(frames[known][:1]), envelope)


def send_pose(
    stream: rr.RecordingStream,
    entity: str,
    time: list[rr.TimeColumn],
    pose: Array,
    angles: Array,
    settings: Settings,
    height: float = 0.0,
) -> None:
    """Send transforms of a robot and of its wheels, whose shapes `log_robot` has put there.

    Args:
        stream: Stream of the recording.
        entity: Path of the robot.
        time: Index columns of n frames.
        pose: Poses, (n, 3) m, m, rad.
        angles: Angles of the wheels, (n, wheels) rad; NaN where wheels do not turn.
        settings: Settings of the robot.
        height: Height above the carpet, m.
    """
    stream.send_columns(entity, time, transform(pose, height))
    world, data = _at_rest(settings)
    for i, joint in enumerate(world.robots[0].joints):
        at = np.broadcast_to(data.xanchor[joint], (len(angles), 3))
        turned = _transform(at, np.nan_to_num(angles[:, i]), data.xaxis[joint])
        stream.send_columns(f"{entity}/wheel_{i + 1}", time, turned)


def transform(pose: Array, height: float = 0.0) -> rr.ComponentColumnList:
    """Return columns of transforms of upright robots at poses (n, 3), at a height above the carpet, m."""
    return _transform(_at(pose, height), pose[:, 2], _UP)


def log_robot(
    stream: rr.RecordingStream, entity: str, cover: style.Rgb, settings: Settings
) -> None:
    """Log chassis and wheels once, static, under `entity`; in the colour `cover` what tells robots apart."""
    world, data = _at_rest(settings)
    model, robot = world.model, world.robots[0]
    turning = np.concatenate([robot.wheels, robot.rims, robot.rollers.ravel()])
    chassis = np.setdiff1d(np.flatnonzero(model.body_rootid == robot.chassis), turning)
    parts = {"chassis": (chassis, np.zeros(3))}
    for i, joint in enumerate(robot.joints):
        parts[f"wheel_{i + 1}"] = (
            np.append(robot.rollers[i], robot.wheels[i]),
            data.xanchor[joint],
        )
    colours = _colours(world, cover)
    for part, (bodies, origin) in parts.items():
        shown = np.isin(model.geom_bodyid, bodies) & (model.geom_group < SHOWN_GROUPS)
        places = data.geom_xpos - origin
        for kind, shape in _SHAPES.items():
            ids = np.flatnonzero(
                (model.geom_type == getattr(mujoco.mjtGeom, f"mjGEOM_{kind}")) & shown
            )
            if ids.size:
                quaternions = data.geom_xquat[ids][:, [1, 2, 3, 0]]  # MuJoCo's wxyz to rerun's xyzw
                look = {"centers": places[ids], "quaternions": quaternions, "colors": colours[ids]}
                geoms = shape(model.geom_size[ids], fill_mode="solid", **look)
                stream.log(f"{entity}/{part}/{kind.lower()}s", geoms, static=True)
        for geom in np.flatnonzero((model.geom_type == mujoco.mjtGeom.mjGEOM_MESH) & shown):
            mesh = model.mesh(model.geom_dataid[geom])
            vertices = model.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]]
            mesh_3d = rr.Mesh3D(
                vertex_positions=vertices @ data.geom_xmat[geom].reshape(3, 3).T + places[geom],
                triangle_indices=model.mesh_face[mesh.faceadr[0] :][: mesh.facenum[0]],
                albedo_factor=colours[geom],
            )
            stream.log(f"{entity}/{part}/mesh_{geom}", mesh_3d, static=True)


@lru_cache(maxsize=4)
def _at_rest(settings: Settings) -> tuple[world_builder.World, mujoco.MjData]:
    """Return the model of whole wheels, its first robot over the origin: world coordinates are the robot's own."""
    world = world_builder.build_world(settings.replace(wheels={"model": "rollers"}))
    data, qpos = mujoco.MjData(world.model), world.robots[0].qpos
    data.qpos[qpos[:7]] = [0, 0, data.qpos[qpos[2]], 1, 0, 0, 0]
    mujoco.mj_kinematics(world.model, data)
    return world, data


def _colours(world: world_builder.World, cover: style.Rgb) -> np.ndarray:
    """Return the colours of all geoms, (n, 3) bytes: their materials' or their own, or `cover`."""
    model, material = world.model, world.model.geom_matid
    colours = (
        255 * np.where(material[:, None] >= 0, model.mat_rgba[material], model.geom_rgba)[:, :3]
    )
    colours[np.isin(material, covers(model))] = cover
    # Every other roller is lighter, or nobody sees wheels turn.
    colours[np.isin(model.geom_bodyid, world.robots[0].rollers[:, ::2])] += LIGHTER
    return np.minimum(colours, 255).astype(np.uint8)


def covers(model: mujoco.MjModel) -> list[int]:
    """Return the materials of the geoms that tell robots apart by their colour."""
    return [i for i in range(model.nmat) if model.mat(i).name.endswith("/cover")]


def _transform(position: Array, angle: Array, axis: Array) -> rr.ComponentColumnList:
    half = angle[:, None] / 2
    quaternion = np.concatenate([np.sin(half) * axis, np.cos(half)], axis=1)
    return rr.Transform3D.columns(translation=position, quaternion=quaternion)


def _points(size: float) -> float:
    """Return a radius in points of the screen, whatever the distance, for which rerun takes a negative radius."""
    return -size


def _at(pose: Array, z: float) -> Array:
    """Return points (n, 3) above the poses (n, 2 or 3)."""
    return np.column_stack([pose[:, :2], np.full(len(pose), z)])
