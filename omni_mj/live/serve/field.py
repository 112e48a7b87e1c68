"""The field as SSL-Vision describes it."""

import math

from omni_mj.live.wire import MM_PER_M
from omni_mj.live.wire.league_pb2 import FieldArc, FieldLine, FieldSize, Point, Shape
from omni_mj.worlds import field

BALL_RADIUS_M, ROBOT_RADIUS_M = 0.0215, 0.09


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
        a2=2 * math.pi,
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
