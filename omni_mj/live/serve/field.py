"""The field as SSL-Vision describes it, and the cameras above it: their areas, and how they are calibrated."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.live.wire.vision import Calibration, FieldArc, FieldLine, FieldSize, Point, Shape
from omni_mj.worlds import field

HEIGHT_M = 4.0  # of the cameras
IMAGE = 1920, 1200  # pixels
BALL_RADIUS_M, ROBOT_RADIUS_M = 0.0215, 0.09
SHORTEST_M, LONGEST_M, WIDEST_MARGIN_M = 1.0, 30.0, 5.0  # fields and margins that are believed
GRIDS = {1: (1, 1), 2: (2, 1), 3: (3, 1), 4: (2, 2)}  # cameras along x and y


def standard() -> FieldSize:
    """The field of division B, with its lines."""
    length, width, line = field.LENGTH_M, field.WIDTH_M, field.LINE_M
    bare = FieldSize(
        field_length=length,
        field_width=width,
        goal_width=field.GOAL_WIDTH_M,
        goal_depth=field.GOAL_DEPTH_M,
        boundary_width=(field.SURFACE_M[0] - length) / 2,
        penalty_area_depth=field.DEFENCE_DEPTH_M,
        penalty_area_width=field.DEFENCE_WIDTH_M,
        center_circle_radius=field.CIRCLE_RADIUS_M,
        line_thickness=line,
        goal_height=field.GOAL_HEIGHT_M,
        ball_radius=BALL_RADIUS_M,
        max_robot_radius=ROBOT_RADIUS_M,
    )
    x, y, inner, half = length / 2, width / 2, length / 2 - field.DEFENCE_DEPTH_M, field.DEFENCE_WIDTH_M / 2
    lines = (
        ("TopTouchLine", (-x, y), (x, y), Shape.TOP_TOUCH_LINE),
        ("BottomTouchLine", (-x, -y), (x, -y), Shape.BOTTOM_TOUCH_LINE),
        ("LeftGoalLine", (-x, -y), (-x, y), Shape.LEFT_GOAL_LINE),
        ("RightGoalLine", (x, -y), (x, y), Shape.RIGHT_GOAL_LINE),
        ("HalfwayLine", (0.0, -y), (0.0, y), Shape.HALFWAY_LINE),
        ("CenterLine", (-x, 0.0), (x, 0.0), Shape.CENTRE_LINE),
        ("LeftPenaltyStretch", (-inner, -half), (-inner, half), Shape.LEFT_PENALTY_STRETCH),
        ("RightPenaltyStretch", (inner, -half), (inner, half), Shape.RIGHT_PENALTY_STRETCH),
        ("LeftFieldLeftPenaltyStretch", (-x, -half), (-inner, -half), Shape.LEFT_FIELD_LEFT_PENALTY_STRETCH),
        ("LeftFieldRightPenaltyStretch", (-x, half), (-inner, half), Shape.LEFT_FIELD_RIGHT_PENALTY_STRETCH),
        ("RightFieldLeftPenaltyStretch", (x, half), (inner, half), Shape.RIGHT_FIELD_LEFT_PENALTY_STRETCH),
        ("RightFieldRightPenaltyStretch", (x, -half), (inner, -half), Shape.RIGHT_FIELD_RIGHT_PENALTY_STRETCH),
    )
    circle = FieldArc("CenterCircle", Point(0, 0), field.CIRCLE_RADIUS_M, 0.0, 2 * np.pi, line, Shape.CENTRE_CIRCLE)
    drawn = tuple(FieldLine(name, Point(*one), Point(*other), line, kind) for name, one, other, kind in lines)
    return bare._replace(field_lines=drawn, field_arcs=(circle,))


def surface(size: FieldSize) -> Array:
    """Length and width between the walls, (2,) m.

    Raises:
        OmniError: of a field that cannot be.
    """
    lengths = np.array([size.field_length, size.field_width])
    if (lengths < SHORTEST_M).any() or (lengths > LONGEST_M).any() or not 0 <= size.boundary_width <= WIDEST_MARGIN_M:
        raise OmniError(
            f"a field is {SHORTEST_M:g} to {LONGEST_M:g} m long and wide with a margin of up to {WIDEST_MARGIN_M:g} m, "
            f"not {lengths[0]:g} x {lengths[1]:g} m with {size.boundary_width:g} m"
        )
    return lengths + 2 * size.boundary_width


@dataclass(frozen=True, eq=False)
class Area:
    """What a camera sees of the carpet: its middle and half its extent, (2,) m each."""

    middle: Array
    half: Array

    def sees(self, points: Array) -> np.ndarray:
        """Which of the points (n, 2) are in it, (n,)."""
        return np.asarray((np.abs(points - self.middle) <= self.half).all(1))

    def covers(self, x: float, y: float) -> bool:
        """Whether a point is in it."""
        (middle_x, middle_y), (half_x, half_y) = self._bounds
        return abs(x - middle_x) <= half_x and abs(y - middle_y) <= half_y

    def pixel(self, x: float, y: float) -> tuple[float, float]:
        """Where a point on the carpet is in the image, which looks straight down."""
        scale, middle_x, middle_y = self._scale
        return IMAGE[0] / 2 + scale * (x - middle_x), IMAGE[1] / 2 - scale * (y - middle_y)

    def calibration(self, number: int) -> Calibration:
        """What SSL-Vision says of this camera: turned by half a turn about x, without distortion."""
        x, y = map(float, self.middle)
        return Calibration(
            camera_id=number,
            focal_length=self._focal_length,
            principal_point_x=IMAGE[0] / 2,
            principal_point_y=IMAGE[1] / 2,
            distortion=0.0,
            q0=1.0,
            q1=0.0,
            q2=0.0,
            q3=0.0,
            tx=-x,
            ty=y,
            tz=HEIGHT_M,
            derived_camera_world_tx=x,
            derived_camera_world_ty=y,
            derived_camera_world_tz=HEIGHT_M,
            pixel_image_width=IMAGE[0],
            pixel_image_height=IMAGE[1],
        )

    @cached_property
    def _focal_length(self) -> float:
        return float(HEIGHT_M * np.min(np.array(IMAGE) / (2 * self.half)))

    @cached_property
    def _bounds(self) -> tuple[list[float], list[float]]:
        return self.middle.tolist(), self.half.tolist()

    @cached_property
    def _scale(self) -> tuple[float, float, float]:
        """Pixels per m, and the middle."""
        return self._focal_length / HEIGHT_M, float(self.middle[0]), float(self.middle[1])


def areas(cameras: int, between_walls: Array, overlap: float) -> list[Area]:
    """The areas of 1 to 4 cameras, which together see all; two neighbours share a strip of width `overlap` in m.

    They are numbered along x, then along y, from the lowest coordinates.
    """
    along_x, along_y = GRIDS[cameras]
    cell = between_walls / (along_x, along_y)
    made = []
    for j in range(along_y):
        for i in range(along_x):
            low, high = cell * (i, j) - between_walls / 2, cell * (i + 1, j + 1) - between_walls / 2
            inner = np.array([[i > 0, j > 0], [i < along_x - 1, j < along_y - 1]]) * overlap / 2
            low, high = low - inner[0], high + inner[1]
            made.append(Area((low + high) / 2, (high - low) / 2))
    return made
