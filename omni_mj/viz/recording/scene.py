"""Spatial part of a recording: field, references, robots, enlarged position errors, estimates."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from omni_control.kinematics import Array
from omni_mj.config.world_settings import WorldSettings
from omni_mj.mjcf import field
from omni_mj.mjcf.field import ROBOT_HEIGHT_M, ROBOT_RADIUS_M
from omni_mj.viz import style
from omni_mj.viz.displayed_robots import RecordedRobot
from omni_mj.viz.recording.rerun_stream import Frames, FrameStream
from omni_mj.viz.recording.robot_shapes import log_robot, points_above, pose_columns, send_poses

CARPET_COLOR, LINE_COLOR, GOAL_COLOR = (33, 66, 45), (150, 175, 158), (190, 190, 190)
REFERENCE_COLOR = (240, 240, 240)
ERROR_SCALE = 10  # enlargement of position errors
# Errors are drawn as flags. Heights differ so that the labels of controllers do not overlap.
FLAG_STEP = 0.07  # height per controller, as a fraction of the scene's size
MAX_FLAG_HEIGHT = 0.35  # of all controllers, as a fraction of the scene's size
MARGIN_M = 0.8  # around the references, both sides together
# Lines on the carpet have different heights, so that none flickers through another.
REFERENCE_HEIGHT_M, PATH_HEIGHT_M, TARGET_HEIGHT_M = 0.002, 0.004, 0.005
# Robots of different controllers often stand at one position. The height makes the last one hide
# the others, so that the picture does not flicker.
LAYER_M = 5e-4
# Channel of the log -> label, and height of the lower end of its cylinder, m.
ESTIMATES = {"vision": ("measured", ROBOT_HEIGHT_M), "predicted": ("predicted", 0.0)}


def log_static(stream: FrameStream, robots: Sequence[RecordedRobot]) -> None:
    """Log everything that does not change except references: field, shapes, colors, widths."""
    stream.log("world", rr.ViewCoordinates.FLU, static=True)
    log_field(stream, robots[0].settings.world)
    for robot in robots:
        entity = f"world/{robot.name}"
        log_robot(stream, f"{entity}/robot", robot.color, robot.settings)
        for name, archetype, color, radius in (
            ("path", rr.LineStrips3D, robot.color, 1.4),
            ("target", rr.Points3D, REFERENCE_COLOR, 3.5),
            ("error", rr.LineStrips3D, robot.color, 1.6),
            ("error/label", rr.Points3D, style.mix_with_white(robot.color), 4.0),
        ):
            # A negative radius is in points of the screen.
            appearance = archetype.from_fields(colors=[color], radii=-radius)
            stream.log(f"{entity}/{name}", appearance, static=True)


def log_references(stream: FrameStream, references: Sequence[Array]) -> None:
    """Log reference paths, (frames, 3) each, on the carpet."""
    strips = [points_above(reference, REFERENCE_HEIGHT_M) for reference in references]
    # A negative radius is in points of the screen.
    lines = rr.LineStrips3D(strips, colors=[REFERENCE_COLOR], radii=-0.7)
    stream.log("world/reference", lines, static=True)


def log_field(stream: FrameStream, world: WorldSettings) -> None:
    """Log carpet, lines and goals."""
    length, width = world.carpet_size_m
    carpet = rr.Boxes3D(
        half_sizes=[length / 2, width / 2, 0.01],
        centers=[0, 0, -0.011],
        colors=[CARPET_COLOR],
        fill_mode="solid",
    )
    stream.log("world/field/carpet", carpet, static=True)
    centers, half_sizes = field.get_goal_walls(world)
    goals = rr.Boxes3D(
        half_sizes=half_sizes, centers=centers, colors=[GOAL_COLOR], fill_mode="solid"
    )
    stream.log("world/field/goals", goals, static=True)
    strips = [points_above(line, 0.0) for line in field_line_strips(world)]
    shape = rr.LineStrips3D(strips, colors=[LINE_COLOR], radii=field.LINE_WIDTH_M / 2)
    stream.log("world/field/lines", shape, static=True)


def field_line_strips(world: WorldSettings) -> list[Array]:
    """Return the lines of the field as points (n, 2) each, m."""
    angle = np.linspace(0, 2 * np.pi, 73)
    circle = field.CENTER_CIRCLE_RADIUS_M * np.column_stack([np.cos(angle), np.sin(angle)])
    return [circle, *np.reshape([*field.get_field_lines(world).values()], (-1, 2, 2))]


def measure_scene(references: Sequence[Array]) -> tuple[Array, float]:
    """Return the center (2,) and the diagonal of the area around references (frames, 3), m."""
    points = np.concatenate(references)[:, :2]
    low, high = points.min(0), points.max(0)
    return (low + high) / 2, MARGIN_M + float(np.hypot(*(high - low)))


def choose_flag_heights(
    robots: Sequence[RecordedRobot], references: Sequence[Array]
) -> list[float]:
    """Return the height at which each controller's position error is drawn, m."""
    n_controllers = 1 + robots[-1].layer
    _, size_m = measure_scene(references)
    step = min(FLAG_STEP, MAX_FLAG_HEIGHT / n_controllers) * size_m
    return [ROBOT_HEIGHT_M + (k + 0.5) * step for k in range(n_controllers)]


def send_robot(
    stream: FrameStream, robot: RecordedRobot, frames: Frames, flag_height_m: float
) -> None:
    """Send everything that a robot shows in the scene.

    Args:
        stream: Stream of the recording.
        robot: Robot whose first frame is at the latest that before the frames.
        frames: Numbers of successive frames, (n,).
        flag_height_m: Height at which the enlarged position error is drawn, m.
    """
    entity, pose, height = f"world/{robot.name}", robot["pose"], robot.layer * LAYER_M
    new = frames - robot.first_frame
    angles = robot["wheel_angle"][new]
    send_poses(stream, f"{entity}/robot", frames, pose[new], angles, robot.settings, height)
    # Each frame has a segment from the frame before. The viewer shows those up to its time cursor.
    starts = points_above(pose[np.maximum(new - 1, 0)], PATH_HEIGHT_M + height)
    ends = points_above(pose[new], PATH_HEIGHT_M + height)
    segments = np.stack([starts, ends], axis=1, dtype=np.float32)
    stream.send_frames(f"{entity}/path", frames, rr.LineStrips3D.columns(strips=segments))
    target = rr.Points3D.columns(positions=points_above(robot["ref"][new], TARGET_HEIGHT_M))
    stream.send_frames(f"{entity}/target", frames, target)
    _send_error(stream, robot, frames, flag_height_m)
    _send_estimates(stream, robot, frames)


def _send_error(stream: FrameStream, robot: RecordedRobot, frames: Frames, height: float) -> None:
    """Send the enlarged position error as a flag: a pole at the reference, the error at its top."""
    new = frames - robot.first_frame
    reference, pose = robot["ref"][new, :2], robot["pose"][new, :2]
    error = pose - reference
    tip = points_above(reference + ERROR_SCALE * error, height)
    corners = [points_above(reference, 0.0), points_above(reference, height), tip]
    entity = f"world/{robot.name}/error"
    strips = np.stack(corners, axis=1, dtype=np.float32)
    stream.send_frames(entity, frames, rr.LineStrips3D.columns(strips=strips))
    errors_cm = 100 * np.linalg.norm(error, axis=1)
    labels = [f"{robot.name}  {error_cm:.1f} cm" for error_cm in errors_cm]
    label = rr.Points3D.columns(positions=tip, labels=labels)
    stream.send_frames(f"{entity}/label", frames, label)


def _send_estimates(stream: FrameStream, robot: RecordedRobot, frames: Frames) -> None:
    """Send the measured pose as a ring and the predicted pose as a wireframe cylinder."""
    for channel, (label, bottom) in ESTIMATES.items():
        poses = robot[channel][frames - robot.first_frame]
        is_known = ~np.isnan(poses[:, 0])
        known = frames[is_known]
        if not known.size:
            continue
        entity = f"world/{robot.name}/{channel}"
        stream.send_frames(entity, known, pose_columns(poses[is_known]))
        envelope = rr.Cylinders3D.columns(
            lengths=[ROBOT_HEIGHT_M - bottom],
            radii=[ROBOT_RADIUS_M],
            centers=[[0, 0, (ROBOT_HEIGHT_M + bottom) / 2]],
            colors=[style.mix_with_white(robot.color)],
            line_radii=[-1.2],  # points of the screen
            fill_mode=["majorwireframe"],
            labels=[label],
        )
        stream.send_frames(f"{entity}/shape", known[:1], envelope)
