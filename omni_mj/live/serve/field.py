"""The field as SSL-Vision describes it, and the cameras above it: areas and calibrations."""

from dataclasses import dataclass

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.live.wire import MM_PER_M
from omni_mj.live.wire.vision_pb2 import Calibration, FieldArc, FieldLine, FieldSize, Point, Shape
from omni_mj.worlds import field

CAMERA_HEIGHT_M = 4.0
IMAGE_SIZE = np.array([1920, 1200])  # pixels
BALL_RADIUS_M, ROBOT_RADIUS_M = 0.0215, 0.09
MIN_SIZE_M, MAX_SIZE_M, MAX_MARGIN_M = 1.0, 30.0, 5.0  # of fields that are accepted
CAMERA_GRIDS = {1: (1, 1), 2: (2, 1), 3: (3, 1), 4: (2, 2)}  # number of cameras -> along x and y


def standard_field() -> FieldSize:
    """Return the field of division B with its markings."""
    length, width, depth = field.LENGTH_M, field.WIDTH_M, field.DEFENCE_DEPTH_M
    lengths_m = {
        "field_length": length,
        "field_width": width,
        "goal_width": field.GOAL_WIDTH_M,
        "goal_depth": field.GOAL_DEPTH_M,
        "goal_height": field.GOAL_HEIGHT_M,
        "boundary_width": (field.SURFACE_M[0] - length) / 2,
        "penalty_area_depth": depth,
        "penalty_area_width": field.DEFENCE_WIDTH_M,
        "center_circle_radius": field.CIRCLE_RADIUS_M,
        "line_thickness": field.LINE_M,
    }
    x, y, inner, half = length / 2, width / 2, length / 2 - depth, field.DEFENCE_WIDTH_M / 2
    lines_m = {
        "TOP_TOUCH_LINE": (-x, y, x, y),
        "BOTTOM_TOUCH_LINE": (-x, -y, x, -y),
        "HALFWAY_LINE": (0.0, -y, 0.0, y),
        "CENTER_LINE": (-x, 0.0, x, 0.0),
    }
    for side, sign in (("LEFT", -1), ("RIGHT", 1)):
        goal, front, left = sign * x, sign * inner, sign * half
        lines_m[f"{side}_GOAL_LINE"] = goal, -y, goal, y
        lines_m[f"{side}_PENALTY_STRETCH"] = front, -half, front, half
        lines_m[f"{side}_FIELD_LEFT_PENALTY_STRETCH"] = goal, left, front, left
        lines_m[f"{side}_FIELD_RIGHT_PENALTY_STRETCH"] = goal, -left, front, -left
    thickness = MM_PER_M * field.LINE_M
    circle = FieldArc(
        name="CenterCircle",
        center=Point(x=0, y=0),
        radius=MM_PER_M * field.CIRCLE_RADIUS_M,
        a1=0.0,
        a2=2 * np.pi,
        thickness=thickness,
        type=Shape.CENTER_CIRCLE,
    )
    lines = []
    for shape, ends in lines_m.items():
        x1, y1, x2, y2 = (MM_PER_M * end for end in ends)
        name = shape.title().replace("_", "")
        p1, p2 = Point(x=x1, y=y1), Point(x=x2, y=y2)
        lines.append(FieldLine(name=name, p1=p1, p2=p2, thickness=thickness, type=shape))
    return FieldSize(
        **{name: round(MM_PER_M * value) for name, value in lengths_m.items()},
        field_lines=lines,
        field_arcs=[circle],
        ball_radius=MM_PER_M * BALL_RADIUS_M,
        max_robot_radius=MM_PER_M * ROBOT_RADIUS_M,
    )


def surface(size: FieldSize) -> Array:
    """Return length and width between the walls, shape (2,), m.

    Raises:
        OmniError: The lengths are out of range.
    """
    length, width, margin = (value / MM_PER_M for value in (size.field_length, size.field_width, size.boundary_width))
    plausible = all(MIN_SIZE_M <= value <= MAX_SIZE_M for value in (length, width))
    if not plausible or not 0 <= margin <= MAX_MARGIN_M:
        raise OmniError(
            f"a field must be {MIN_SIZE_M:g} to {MAX_SIZE_M:g} m long and wide with a margin of up to "
            f"{MAX_MARGIN_M:g} m, not {length:g} x {width:g} m with {margin:g} m"
        )
    return np.array([length, width]) + 2 * margin


@dataclass(frozen=True, eq=False)
class Area:
    """Part of the carpet that a camera sees.

    Attributes:
        middle: Its centre, shape (2,), m.
        half: Half of its extent, shape (2,), m.
    """

    middle: Array
    half: Array

    def sees(self, points: Array) -> np.ndarray:
        """Return which points, shape (n, 2), are in the area."""
        return np.asarray((np.abs(points - self.middle) <= self.half).all(1))

    def calibration(self, camera: int) -> Calibration:
        """Return the calibration of a camera that looks straight down: half a turn about x, without distortion."""
        x, y = MM_PER_M * self.middle
        z = MM_PER_M * CAMERA_HEIGHT_M
        width, height = IMAGE_SIZE
        return Calibration(
            camera_id=camera,
            focal_length=CAMERA_HEIGHT_M * np.min(IMAGE_SIZE / (2 * self.half)),
            principal_point_x=width / 2,
            principal_point_y=height / 2,
            distortion=0.0,
            q0=1.0,
            q1=0.0,
            q2=0.0,
            q3=0.0,
            tx=-x,
            ty=y,
            tz=z,
            derived_camera_world_tx=x,
            derived_camera_world_ty=y,
            derived_camera_world_tz=z,
            pixel_image_width=width,
            pixel_image_height=height,
        )


def areas(n_cameras: int, extent: Array, overlap: float) -> list[Area]:
    """Divide the carpet among 1 to 4 cameras.

    Args:
        n_cameras: Number of cameras. They are numbered along x, then along y, from the lowest coordinates.
        extent: Length and width between the walls, shape (2,), m.
        overlap: Width of the strip that two neighbours both see, m.
    """
    columns, rows = CAMERA_GRIDS[n_cameras]
    cell = extent / (columns, rows)
    corners = [np.array([i, j]) for j in range(rows) for i in range(columns)]
    return [Area(cell * (corner + 0.5) - extent / 2, (cell + overlap) / 2) for corner in corners]
