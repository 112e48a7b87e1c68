"""Spatial views of a recording: field, reference, robots, and where robots are believed to be."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import rerun as rr

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import Settings
from omni_mj.show.recording import robot_shape
from omni_mj.show.recording.plots import Robot
from omni_mj.show.recording.sink import Frames, Rgb, indexes, pale
from omni_mj.worlds import field

CARPET, LINES, GOALS, REFERENCE = (33, 66, 45), (150, 175, 158), (190, 190, 190), (240, 240, 240)
ABOVE = "world/above"  # camera of the plan view
PIXELS_PER_M, CAMERA_HEIGHT_M = 500.0, 100.0  # from so high up there is hardly any perspective
RADIUS_M, HEIGHT_M = 0.09, 0.15  # of a robot: the envelope that the rules allow
MARGIN_M = 0.3  # shown around the reference
CROWD, ROW_M = 4, 0.15  # more names than that stand in two rows, so far from each other
TIE_M = 5e-4  # from a robot up to the next: of robots at one place, one must hide the other
_UP = np.array([0.0, 0.0, 1.0])


def pixel(x: float, y: float) -> tuple[float, float]:
    """Return where the point (x, y) of the carpet, in m, lies in the plan view."""
    length, width = field.SURFACE_M
    return PIXELS_PER_M * (length / 2 + x), PIXELS_PER_M * (width / 2 - y)


def extent(paths: Iterable[Array]) -> tuple[Array, Array]:
    """Return the corners (2,) of what a view should show, in m: references (frames, 3) with a margin."""
    points = np.concatenate([path[:, :2] for path in paths])
    return points.min(0) - MARGIN_M, points.max(0) + MARGIN_M


def log_static(stream: rr.RecordingStream, robots: Sequence[Robot], settings: Settings, paths: Sequence[Array]) -> None:
    """Log what does not change.

    Args:
        stream: Stream of the recording.
        robots: Robots whose shapes, colours and names are logged.
        settings: Settings of one of them; they are of one kind.
        paths: References that they follow, (frames, 3) each, which lie on the carpet.
    """
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
        robot_shape.log(stream, f"{entity}/robot", robot.colour, settings)
        # Names are a legend on the carpet: above robots so close to each other they would hide them.
        row = robot.order % 2 if count > CROWD else 0
        place = [[left + (right - left) * (robot.order + 0.5) / count, front - row * ROW_M, 0.01]]
        look: dict[str, Any] = {"colors": [pale(robot.colour, 0.3)], "radii": _points(4), "show_labels": True}
        stream.log(f"{entity}/name", rr.Points3D(place, labels=[robot.name], **look), static=True)
        # Paths of the first robots are wider, to show beneath those that are drawn over them.
        width = _points(1.0 + 0.4 * (count - 1 - robot.order))
        stream.log(f"{entity}/path", rr.LineStrips3D.from_fields(colors=[robot.colour], radii=width), static=True)


def log_field(stream: rr.RecordingStream) -> None:
    """Log carpet, lines, goals and the camera of the plan view."""
    size = np.array(field.SURFACE_M)
    boxes: dict[str, tuple[Any, Any, Rgb]] = {
        "carpet": ([[*size / 2, 0.01]], [[0, 0, -0.011]], CARPET),
        "goals": (*field.goal_walls()[::-1], GOALS),
    }
    for name, (half_sizes, centres, colour) in boxes.items():
        shape = rr.Boxes3D(half_sizes=half_sizes, centers=centres, colors=[colour], fill_mode="solid")
        stream.log(f"world/field/{name}", shape, static=True)
    strips = [_at(line, 0.0) for line in field.lines()]
    lines = rr.LineStrips3D(strips, colors=[LINES], radii=field.LINE_M / 2)
    stream.log("world/field/lines", lines, static=True)
    # Looks straight down, the image's x along the field's and its y, which points down, against the field's.
    camera = rr.Transform3D(translation=[0, 0, CAMERA_HEIGHT_M], mat3x3=np.diag([1.0, -1.0, -1.0]))
    pinhole = rr.Pinhole(focal_length=CAMERA_HEIGHT_M * PIXELS_PER_M, resolution=PIXELS_PER_M * size)
    stream.log(ABOVE, camera, pinhole, static=True)


def send_targets(stream: rr.RecordingStream, paths: Sequence[Array], frames: Frames) -> None:
    """Send where the references (frames, 3) are in `frames`; one that has come to its end stays there."""
    now = np.stack([path[np.minimum(frames, len(path) - 1)] for path in paths], axis=1)
    points = rr.Points3D.columns(positions=_at(now.reshape(-1, 3), 0.005))
    stream.send_columns("world/reference/target", indexes(frames), points.partition(np.full(len(frames), len(paths))))


def send(stream: rr.RecordingStream, robot: Robot, frames: Frames, known: set[str]) -> None:
    """Send where a robot was in `frames` and where it was believed to be.

    Args:
        stream: Stream of the recording.
        robot: The robot.
        frames: Successive frames that it has.
        known: Entities of beliefs whose shapes are there already; others appear with the first belief and are added.
    """
    entity, time, pose, lift = f"world/{robot.name}", indexes(frames), robot["pose"], robot.order * TIE_M
    send_pose(
        stream, f"{entity}/robot", time, pose[frames], robot["wheel_angle"][frames], robot.table_row.settings, lift
    )
    # A segment per frame, from the frame before: the viewer shows those up to its time cursor.
    ends = [_at(pose[at], 0.004 + lift) for at in (np.maximum(frames - 1, 0), frames)]
    segments = np.stack(ends, axis=1, dtype=np.float32)
    stream.send_columns(f"{entity}/path", time, rr.LineStrips3D.columns(strips=segments))
    for belief, shape in (("vision", _ring), ("predicted", _ghost)):
        values = robot[belief][frames]
        seen = ~np.isnan(values[:, 0])
        if seen.any():
            stream.send_columns(f"{entity}/{belief}", indexes(frames[seen]), transform(values[seen]))
            place = f"{entity}/{belief}/shape"
            if place not in known:
                known.add(place)
                stream.send_columns(place, indexes(frames[seen][:1]), shape(robot.colour))


def send_pose(
    stream: rr.RecordingStream,
    entity: str,
    time: list[rr.TimeColumn],
    pose: Array,
    angles: Array,
    settings: Settings,
    height: float = 0.0,
) -> None:
    """Send transforms of a robot and of its wheels, whose shapes `robot_shape.log` has put there.

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
    for i, (mount, axis) in enumerate(robot_shape.wheel_mounts(settings)):
        places = np.broadcast_to(mount, (len(angles), 3))
        stream.send_columns(f"{entity}/wheel_{i + 1}", time, _transform(places, np.nan_to_num(angles[:, i]), axis))


def transform(pose: Array, height: float = 0.0) -> rr.ComponentColumnList:
    """Return columns of transforms of upright robots at poses (n, 3), at a height above the carpet, m."""
    return _transform(_at(pose, height), pose[:, 2], _UP)


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
