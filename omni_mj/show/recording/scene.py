"""What the spatial views of a recording show: the field, the reference, robots, and where they are believed to be."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import rerun as rr

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import Settings
from omni_mj.show.recording import colours, robot_shape
from omni_mj.show.recording.robots import Robot, Track
from omni_mj.show.recording.timelines import Frames, indexes
from omni_mj.worlds import field

ABOVE = "world/above"  # the camera of the plan view
PIXELS_PER_M, CAMERA_HEIGHT_M = 500.0, 100.0  # from so high up there is hardly any perspective
RADIUS_M, HEIGHT_M = 0.09, 0.15  # of a robot: the envelope that the rules allow
MARGIN_M = 0.3  # shown around the reference
CROWD, ROW_M = 4, 0.15  # more names than that stand in two rows, so far from each other
TIE_M = 5e-4  # from a robot up to the next: where they stand in each other, one must hide the other
_UP = np.array([0.0, 0.0, 1.0])


def pixel(x: float, y: float) -> tuple[float, float]:
    """Where the point (x, y) of the carpet, in m, lies in the plan view."""
    length, width = field.SURFACE_M
    return PIXELS_PER_M * (length / 2 + x), PIXELS_PER_M * (width / 2 - y)


def extent(paths: Iterable[Array]) -> tuple[Array, Array]:
    """Corners (2,) each of what a view should show, in m: references (frames, 3) with a margin."""
    points = np.concatenate([path[:, :2] for path in paths])
    return points.min(0) - MARGIN_M, points.max(0) + MARGIN_M


def log_static(stream: rr.RecordingStream, robots: Sequence[Robot], settings: Settings, paths: Sequence[Array]) -> None:
    """Log once what stays.

    Args:
        stream: of the recording.
        robots: whose shapes, colours and names are logged.
        settings: of one of them; they are of one kind.
        paths: the references that they follow, each (frames, 3), which lie on the carpet.
    """
    stream.log("world", rr.ViewCoordinates.FLU, static=True)
    log_field(stream)
    white, thin = [colours.REFERENCE], _points(0.7)
    strips = [_at(path, 0.002) for path in paths]
    stream.log("world/reference/path", rr.LineStrips3D(strips, colors=white, radii=thin), static=True)
    stream.log("world/reference/target", rr.Points3D.from_fields(colors=white, radii=_points(3.5)), static=True)
    (left, front), (right, _) = extent(paths)
    for robot in robots:
        entity, count = f"world/{robot.name}", len(robots)
        robot_shape.log(stream, f"{entity}/robot", robot.colour, settings)
        # Their names as a legend on the carpet: above robots so close to each other they would hide them.
        row = robot.order % 2 if count > CROWD else 0
        place = [[left + (right - left) * (robot.order + 0.5) / count, front - row * ROW_M, 0.01]]
        legend = rr.Points3D(
            place, labels=[robot.name], colors=[colours.pale(robot.colour, 0.3)], radii=_points(4), show_labels=True
        )
        stream.log(f"{entity}/name", legend, static=True)
        # The first ones' paths are wider, to show beneath those that are drawn over them.
        width = _points(1.0 + 0.4 * (count - 1 - robot.order))
        stream.log(f"{entity}/path", rr.LineStrips3D.from_fields(colors=[robot.colour], radii=width), static=True)


def send_targets(stream: rr.RecordingStream, paths: Sequence[Array], frames: Frames) -> None:
    """Send where the references (frames, 3) are in `frames`; one that has come to its end stays there."""
    now = np.stack([path[np.minimum(frames, len(path) - 1)] for path in paths], axis=1)
    points = _at(now.reshape(-1, 3), 0.005)
    columns = rr.Points3D.columns(positions=points).partition(np.full(len(frames), len(paths)))
    stream.send_columns("world/reference/target", indexes(frames), columns)


def send(stream: rr.RecordingStream, robot: Robot, settings: Settings, track: Track, frames: Frames) -> None:
    """Send where a robot, under these settings, was in `frames`, and where it was believed to be."""
    entity, time, pose = f"world/{robot.name}", indexes(frames), track["pose"][frames]
    lift = robot.order * TIE_M
    stream.send_columns(f"{entity}/robot", time, _transform(_at(pose, lift), pose[:, 2], _UP))
    angles = np.nan_to_num(track["wheel_angle"][frames])  # the kinematic plant's wheels do not turn
    for i, (position, axis) in enumerate(robot_shape.wheel_mounts(settings)):
        mount = np.broadcast_to(position, (len(frames), 3))
        stream.send_columns(f"{entity}/robot/wheel_{i + 1}", time, _transform(mount, angles[:, i], axis))
    # A segment per frame, from the frame before: the viewer shows those up to its time cursor.
    before = track["pose"][np.maximum(frames - 1, 0)]
    height = 0.004 + lift
    segments = np.stack([_at(before, height), _at(pose, height)], axis=1, dtype=np.float32)
    stream.send_columns(f"{entity}/path", time, rr.LineStrips3D.columns(strips=segments))
    _send_belief(stream, f"{entity}/vision", track["vision"][frames], frames)
    _send_belief(stream, f"{entity}/predicted", track["predicted"][frames], frames)


def shapes(robot: Robot) -> Iterator[tuple[str, str, rr.ComponentColumnList]]:
    """What shows where a robot is believed to be, which appears once that is known.

    Yields:
        The channel of what is believed, the entity of its shape, and the shape.
    """
    for channel, shape in (("vision", _ring), ("predicted", _ghost)):
        yield channel, f"world/{robot.name}/{channel}/shape", shape(robot.colour)


def log_field(stream: rr.RecordingStream) -> None:
    """Log carpet, lines, goals and the camera of the plan view."""
    length, width = field.SURFACE_M
    carpet = rr.Boxes3D(
        half_sizes=[[length / 2, width / 2, 0.01]],
        centers=[[0, 0, -0.011]],
        colors=[colours.CARPET],
        fill_mode="solid",
    )
    stream.log("world/field/carpet", carpet, static=True)
    strips = [_at(line, 0.0) for line in field.lines()]
    lines = rr.LineStrips3D(strips, colors=[colours.LINES], radii=field.LINE_M / 2)
    stream.log("world/field/lines", lines, static=True)
    centres, half_sizes = field.goal_walls()
    goals = rr.Boxes3D(half_sizes=half_sizes, centers=centres, colors=[colours.GOALS], fill_mode="solid")
    stream.log("world/field/goals", goals, static=True)
    # Looks straight down, the image's x along the field's and its y, which points down, against the field's.
    camera = rr.Transform3D(translation=[0, 0, CAMERA_HEIGHT_M], mat3x3=np.diag([1.0, -1.0, -1.0]))
    focal_length, size = CAMERA_HEIGHT_M * PIXELS_PER_M, PIXELS_PER_M * np.array(field.SURFACE_M)
    stream.log(ABOVE, camera, rr.Pinhole(focal_length=focal_length, resolution=size), static=True)


def _send_belief(stream: rr.RecordingStream, entity: str, pose: Array, frames: Frames) -> None:
    """Send the poses (frames, 3) that are known."""
    known = ~np.isnan(pose[:, 0])
    if known.any():
        stream.send_columns(entity, indexes(frames[known]), transform(pose[known]))


def _ring(colour: colours.Rgb) -> rr.ComponentColumnList:
    """Where vision sees a robot: a ring on top of it, with a line to its front."""
    angle = np.linspace(0, 2 * np.pi, 37)
    rim = RADIUS_M * np.column_stack([np.cos(angle), np.sin(angle)])
    strip = _at(np.concatenate([[[0, 0]], rim]), HEIGHT_M)
    return rr.LineStrips3D.columns(strips=[strip], colors=[colours.pale(colour)], radii=[_points(1.2)])


def _ghost(colour: colours.Rgb) -> rr.ComponentColumnList:
    """Where a robot is predicted to be: its envelope, transparent."""
    return rr.Cylinders3D.columns(
        lengths=[HEIGHT_M],
        radii=[RADIUS_M],
        centers=[[0, 0, HEIGHT_M / 2]],
        colors=[(*colours.pale(colour), 70)],
        line_radii=[_points(0.8)],
        fill_mode=["TransparentFillMajorWireframe"],
    )


def _points(size: float) -> float:
    """Radius in points of the screen, whatever the distance: what rerun takes a negative radius for."""
    return -size


def transform(pose: Array, height: float = 0.0) -> rr.ComponentColumnList:
    """Columns of transforms of upright robots at poses (n, 3), at a height above the carpet, m."""
    return _transform(_at(pose, height), pose[:, 2], _UP)


def turned(position: Array, angle: Array, axis: Array) -> rr.ComponentColumnList:
    """Columns of transforms at one `position` (3,), turned by `angle` (n,) about `axis` (3,)."""
    return _transform(np.broadcast_to(position, (len(angle), 3)), angle, axis)


def _at(pose: Array, z: float) -> Array:
    """Points (n, 3) above the poses (n, 2 or 3)."""
    return np.column_stack([pose[:, :2], np.full(len(pose), z)])


def _transform(position: Array, angle: Array, axis: Array) -> rr.ComponentColumnList:
    """Columns of transforms at `position` (n, 3), turned by `angle` (n,) about `axis` (3,)."""
    half = angle[:, None] / 2
    quaternion = np.concatenate([np.sin(half) * axis, np.cos(half)], axis=1)
    return rr.Transform3D.columns(translation=position, quaternion=quaternion)
