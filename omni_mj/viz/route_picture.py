"""Pictures of a robot on its route, seen from above, without a window or OpenGL."""

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from omni_control.kinematics import Array
from omni_mj.mjcf.field import ROBOT_RADIUS_M
from omni_mj.viz import style

SIZE = (480, 360)  # width and height, pixels
MARGIN_M = 0.35  # around the route
ROBOT_COLOR = style.COLORS[0]


def draw_robot(pose: Array, reference_poses: Array, frame: int) -> NDArray[np.uint8]:
    """Return a picture of a route, the reference as a ring on it, and the robot as a disk.

    Args:
        pose: Pose of the robot, shape (3,), m, m, rad.
        reference_poses: Poses of the reference in all frames, shape (frames, 3), m, m, rad.
        frame: Number of the frame.

    Returns:
        Colors, shape (height, width, 3).
    """
    route = reference_poses[:, :2]
    low, high = route.min(0) - MARGIN_M, route.max(0) + MARGIN_M
    scale = (np.array(SIZE) / (high - low)).min()  # pixels per m

    def to_pixels(points: Array) -> list[tuple[float, float]]:
        pixels = np.array(SIZE) / 2 + scale * (points - (low + high) / 2) * [1, -1]
        return [(x, y) for x, y in np.clip(pixels, -1e4, 1e4).tolist()]

    image = Image.new("RGB", SIZE, "white")
    pen = ImageDraw.Draw(image)
    pen.line(to_pixels(route), style.BACKGROUND, 2)
    reference = reference_poses[min(frame, len(reference_poses) - 1)]
    for (x, y, heading), line, fill in (
        (np.nan_to_num(pose), "black", ROBOT_COLOR),
        (reference, style.REFERENCE, None),
    ):
        center = np.array([x, y])
        front = center + ROBOT_RADIUS_M * np.array([np.cos(heading), np.sin(heading)])
        ((center_x, center_y),) = to_pixels(center[None])
        pen.circle((center_x, center_y), ROBOT_RADIUS_M * scale, fill, line, 2)
        pen.line([(center_x, center_y), *to_pixels(front[None])], line, 2)
    return np.array(image)
