"""Spatial part of a recording: field, reference, robots, and where robots are believed to be."""

from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from omni_control.kinematics import Array
from omni_mj.mjcf import roles
from omni_mj.scenarios.settings import PERIOD_S, Settings
from omni_mj.show.shown import Robot
from omni_mj.show.style import Rgb, pale
from omni_mj.worlds import build, field

Frames = NDArray[np.int_]  # numbers of frames, (n,)
FRAME, TIME = "frame", "time"  # timelines
CARPET, LINES, GOALS, REFERENCE = (33, 66, 45), (150, 175, 158), (190, 190, 190), (240, 240, 240)
RADIUS_M, HEIGHT_M = 0.09, 0.15  # of a robot: the envelope that the rules allow
MARGIN_M = 0.3  # shown around the reference
TIE_M = 5e-4  # from a robot up to the next: of robots at one place, one must hide the other
COVER = "cover"  # material of the geoms that tell robots apart by their colour
LIGHTER = 110  # of 255
SHOWN_GROUPS = 3  # as in MuJoCo's viewer: geoms of group 3 and above (hulls) are hidden
_UP = np.array([0.0, 0.0, 1.0])
# Kind of geom -> its rerun shape, from sizes (n, 3), centres (n, 3) and further arguments.
_SHAPES: dict[str, Callable[..., Any]] = {
    "CYLINDER": lambda size, at, **look: rr.Cylinders3D(radii=size[:, 0], lengths=2 * size[:, 1], centers=at, **look),
    "BOX": lambda size, at, **look: rr.Boxes3D(half_sizes=size, centers=at, **look),
    "ELLIPSOID": lambda size, at, **look: rr.Ellipsoids3D(half_sizes=size, centers=at, **look),
}
_SHAPES["CAPSULE"] = _SHAPES["CYLINDER"]
_SHAPES["SPHERE"] = lambda size, at, **look: _SHAPES["ELLIPSOID"](size[:, :1].repeat(3, axis=1), at, **look)


def indexes(frames: Frames) -> list[rr.TimeColumn]:
    """Return index columns that place rows in `frames`."""
    return [rr.TimeColumn(FRAME, sequence=frames), rr.TimeColumn(TIME, duration=frames * PERIOD_S)]


def extent(paths: Iterable[Array]) -> tuple[Array, Array]:
    """Return the corners (2,) of what a view should show, in m: references (frames, 3) with a margin."""
    points = np.concatenate([path[:, :2] for path in paths])
    return points.min(0) - MARGIN_M, points.max(0) + MARGIN_M


def log_static(stream: rr.RecordingStream, robots: Sequence[Robot], paths: Sequence[Array]) -> None:
    """Log what does not change: the field, the references (frames, 3) on it, and how robots look."""
    stream.log("world", rr.ViewCoordinates.FLU, static=True)
    log_field(stream)
    strips = [_at(path, 0.002) for path in paths]
    stream.log("world/reference/path", rr.LineStrips3D(strips, colors=[REFERENCE], radii=_points(0.7)), static=True)
    target = rr.Points3D.from_fields(colors=[REFERENCE], radii=_points(3.5))
    stream.log("world/reference/target", target, static=True)
    (left, front), (right, _) = extent(paths)
    count = len(robots)
    for robot in robots:
        entity = f"world/{robot.name}"
        log_robot(stream, f"{entity}/robot", robot.colour, robot.settings)
        # Names are a legend on the carpet: above robots so close to each other they would hide them.
        place = [[left + (right - left) * (robot.order + 0.5) / count, front, 0.01]]
        look: dict[str, Any] = {"colors": [pale(robot.colour, 0.3)], "radii": _points(4), "show_labels": True}
        stream.log(f"{entity}/name", rr.Points3D(place, labels=[robot.name], **look), static=True)
        # Paths of the first robots are wider, to show beneath those that are drawn over them.
        width = _points(1.0 + 0.4 * (count - 1 - robot.order))
        stream.log(f"{entity}/path", rr.LineStrips3D.from_fields(colors=[robot.colour], radii=width), static=True)


def log_field(stream: rr.RecordingStream) -> None:
    """Log carpet, lines and goals."""
    carpet = [[*np.array(field.SURFACE_M) / 2, 0.01]]
    centres, half_sizes = field.goal_walls()
    for name, sizes, at, colour in (
        ("carpet", carpet, [[0, 0, -0.011]], CARPET),
        ("goals", half_sizes, centres, GOALS),
    ):
        shape = rr.Boxes3D(half_sizes=sizes, centers=at, colors=[colour], fill_mode="solid")
        stream.log(f"world/field/{name}", shape, static=True)
    strips = [_at(line, 0.0) for line in field.lines()]
    stream.log("world/field/lines", rr.LineStrips3D(strips, colors=[LINES], radii=field.LINE_M / 2), static=True)


def send_targets(stream: rr.RecordingStream, paths: Sequence[Array], frames: Frames) -> None:
    """Send where the references (frames, 3) are in `frames`; one that has come to its end stays there."""
    now = np.stack([path[np.minimum(frames, len(path) - 1)] for path in paths], axis=1)
    points = rr.Points3D.columns(positions=_at(now.reshape(-1, 3), 0.005))
    stream.send_columns("world/reference/target", indexes(frames), points.partition(np.full(len(frames), len(paths))))


def send(stream: rr.RecordingStream, robot: Robot, frames: Frames) -> None:
    """Send where a robot was in successive `frames`, and where it was believed to be."""
    entity, pose, lift = f"world/{robot.name}", robot["pose"], robot.order * TIE_M
    time = indexes(frames)
    send_pose(stream, f"{entity}/robot", time, pose[frames], robot["wheel_angle"][frames], robot.settings, lift)
    # A segment per frame, from the frame before: the viewer shows those up to its time cursor.
    ends = [_at(pose[at], 0.004 + lift) for at in (np.maximum(frames - 1, 0), frames)]
    segments = np.stack(ends, axis=1, dtype=np.float32)
    stream.send_columns(f"{entity}/path", time, rr.LineStrips3D.columns(strips=segments))
    for belief, shape in (("vision", _ring), ("predicted", _ghost)):
        values = robot[belief][frames]
        known = ~np.isnan(values[:, 0])
        if known.any():
            stream.send_columns(f"{entity}/{belief}", indexes(frames[known]), transform(values[known]))
            stream.send_columns(f"{entity}/{belief}/shape", indexes(frames[known][:1]), shape(robot.colour))


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
    shape = _shape(settings)
    for i, joint in enumerate(shape.robot.joints):
        at = np.broadcast_to(shape.data.xanchor[joint], (len(angles), 3))
        turned = _transform(at, np.nan_to_num(angles[:, i]), shape.data.xaxis[joint])
        stream.send_columns(f"{entity}/wheel_{i + 1}", time, turned)


def transform(pose: Array, height: float = 0.0) -> rr.ComponentColumnList:
    """Return columns of transforms of upright robots at poses (n, 3), at a height above the carpet, m."""
    return _transform(_at(pose, height), pose[:, 2], _UP)


def log_robot(stream: rr.RecordingStream, entity: str, colour: Rgb, settings: Settings) -> None:
    """Log chassis and wheels once, static, under `entity`; the cover in `colour` to tell robots apart."""
    shape = _shape(settings)
    model, robot = shape.model, shape.robot
    turning = np.concatenate([robot.wheels, robot.rims, robot.rollers.ravel()])
    chassis = np.setdiff1d(np.flatnonzero(model.body_rootid == robot.chassis), turning)
    _log_geoms(stream, f"{entity}/chassis", shape, chassis, np.zeros(3), colour)
    for i, joint in enumerate(robot.joints):
        wheel = np.append(robot.rollers[i], robot.wheels[i])
        _log_geoms(stream, f"{entity}/wheel_{i + 1}", shape, wheel, shape.data.xanchor[joint], colour)


class _Shape(NamedTuple):
    """A model and its first robot, whose chassis is over the origin: world coordinates are the robot's own."""

    model: mujoco.MjModel
    data: mujoco.MjData
    robot: roles.Robot


def _shape(settings: Settings) -> _Shape:
    """Return the model of whole wheels."""
    return _posed(build.world(settings.replace(wheels={"model": "rollers"})))


@lru_cache(maxsize=4)
def _posed(world: build.World) -> _Shape:
    robot, data = world.robots[0], mujoco.MjData(world.model)
    data.qpos[robot.qpos[:7]] = [0, 0, data.qpos[robot.qpos[2]], 1, 0, 0, 0]
    mujoco.mj_kinematics(world.model, data)
    return _Shape(world.model, data, robot)


def _log_geoms(
    stream: rr.RecordingStream, entity: str, shape: _Shape, bodies: np.ndarray, origin: np.ndarray, cover: Rgb
) -> None:
    """Log the geoms of `bodies` relative to `origin`: one entity per kind of geom, and one per mesh."""
    model, data, robot = shape
    shown = np.isin(model.geom_bodyid, bodies) & (model.geom_group < SHOWN_GROUPS)
    colours = np.array([_colour(model, robot, geom, cover) for geom in range(model.ngeom)])
    for kind, primitive in _SHAPES.items():
        ids = np.flatnonzero((model.geom_type == getattr(mujoco.mjtGeom, f"mjGEOM_{kind}")) & shown)
        if ids.size:
            quaternions = data.geom_xquat[ids][:, [1, 2, 3, 0]]  # MuJoCo's wxyz to rerun's xyzw
            look = {"quaternions": quaternions, "colors": colours[ids], "fill_mode": "solid"}
            geoms = primitive(model.geom_size[ids], data.geom_xpos[ids] - origin, **look)
            stream.log(f"{entity}/{kind.lower()}s", geoms, static=True)
    for geom in np.flatnonzero((model.geom_type == mujoco.mjtGeom.mjGEOM_MESH) & shown):
        mesh = model.mesh(model.geom_dataid[geom])
        vertices = model.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]]
        shape_3d = rr.Mesh3D(
            vertex_positions=vertices @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom] - origin,
            triangle_indices=model.mesh_face[mesh.faceadr[0] :][: mesh.facenum[0]],
            albedo_factor=[*colours[geom], 255],
        )
        stream.log(f"{entity}/mesh_{geom}", shape_3d, static=True)


def _colour(model: mujoco.MjModel, robot: roles.Robot, geom: int, cover: Rgb) -> np.ndarray:
    """Return the colour (3,) of a geom, 0 to 255: its material's or its own, or that of this robot's `cover`."""
    material = model.geom_matid[geom]
    if material >= 0 and model.mat(material).name.endswith(f"/{COVER}"):
        return np.array(cover)
    colour = (255 * (model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom])[:3]).astype(int)
    if model.geom_bodyid[geom] in robot.rollers[:, ::2]:  # every other roller lighter, or nobody sees wheels turn
        colour = np.minimum(colour + LIGHTER, 255)
    return colour


def _transform(position: Array, angle: Array, axis: Array) -> rr.ComponentColumnList:
    half = angle[:, None] / 2
    quaternion = np.concatenate([np.sin(half) * axis, np.cos(half)], axis=1)
    return rr.Transform3D.columns(translation=position, quaternion=quaternion)


def _ring(colour: Rgb) -> rr.ComponentColumnList:
    """Return what shows where vision sees a robot: a ring on top of it, with a line to its front."""
    angle = np.linspace(0, 2 * np.pi, 37)
    rim = RADIUS_M * np.column_stack([np.cos(angle), np.sin(angle)])
    strip = _at(np.concatenate([[[0, 0]], rim]), HEIGHT_M)
    return rr.LineStrips3D.columns(strips=[strip], colors=[pale(colour)], radii=[_points(1.2)])


def _ghost(colour: Rgb) -> rr.ComponentColumnList:
    """Return what shows where a robot is predicted to be: its envelope, transparent."""
    return rr.Cylinders3D.columns(
        lengths=[HEIGHT_M],
        radii=[RADIUS_M],
        centers=[[0, 0, HEIGHT_M / 2]],
        colors=[(*pale(colour), 70)],
        line_radii=[_points(0.8)],
        fill_mode=["TransparentFillMajorWireframe"],
    )


def _points(size: float) -> float:
    """Return a radius in points of the screen, whatever the distance, for which rerun takes a negative radius."""
    return -size


def _at(pose: Array, z: float) -> Array:
    """Return points (n, 3) above the poses (n, 2 or 3)."""
    return np.column_stack([pose[:, :2], np.full(len(pose), z)])
