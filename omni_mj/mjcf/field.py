"""Dimensions of the field, and the largest robot: division B of the Small Size League.

Source: RoboCup-SSL/ssl-rules, chapter "Playing Environment", field setup. The origin of the world
frame is the center of the field; x points to a goal, y left, z up. The carpet and the walls around
it in the simulation are those of models/field.xml.
"""

import numpy as np

from omni_control.kinematics import Array

LENGTH_M, WIDTH_M = 9.0, 6.0  # of the playing area, including its lines
MARGIN_M = 0.7  # from the playing area to the edge of the carpet, on all sides
CARPET_SIZE_M = np.array([LENGTH_M, WIDTH_M]) + 2 * MARGIN_M
LINE_WIDTH_M = 0.01
CENTER_CIRCLE_RADIUS_M = 0.5
PENALTY_AREA_DEPTH_M, PENALTY_AREA_WIDTH_M = 1.0, 2.0  # "defense area" in the rules
GOAL_WIDTH_M, GOAL_DEPTH_M, GOAL_HEIGHT_M, GOAL_WALL_THICKNESS_M = 1.0, 0.18, 0.16, 0.02
ROBOT_RADIUS_M, ROBOT_HEIGHT_M = 0.09, 0.15  # largest robot that the rules allow


def get_field_lines() -> dict[str, tuple[float, float, float, float]]:
    """Return a mapping from SSL-Vision's names of straight lines to their ends, x1, y1, x2, y2, m.

    A penalty stretch is an edge of a penalty area: that in front, or one at a side.
    """
    x, y, half_width = LENGTH_M / 2, WIDTH_M / 2, PENALTY_AREA_WIDTH_M / 2
    lines = {
        "TOP_TOUCH_LINE": (-x, y, x, y),
        "BOTTOM_TOUCH_LINE": (-x, -y, x, -y),
        "HALFWAY_LINE": (0.0, -y, 0.0, y),
        "CENTER_LINE": (-x, 0.0, x, 0.0),
    }
    for side, sign in (("LEFT", -1), ("RIGHT", 1)):
        goal_x, front_x = sign * x, sign * (x - PENALTY_AREA_DEPTH_M)
        left_y = sign * half_width  # the side on the left of a robot that faces the goal
        lines[f"{side}_GOAL_LINE"] = goal_x, -y, goal_x, y
        lines[f"{side}_PENALTY_STRETCH"] = front_x, -half_width, front_x, half_width
        lines[f"{side}_FIELD_LEFT_PENALTY_STRETCH"] = goal_x, left_y, front_x, left_y
        lines[f"{side}_FIELD_RIGHT_PENALTY_STRETCH"] = goal_x, -left_y, front_x, -left_y
    return lines


def get_goal_walls() -> tuple[Array, Array]:
    """Return centers (6, 3) and half sizes (6, 3) of the walls of both goals, m.

    A goal has a wall at the back and one at each side.
    """
    half_depth, half_thickness = GOAL_DEPTH_M / 2, GOAL_WALL_THICKNESS_M / 2
    back_x = LENGTH_M / 2 + GOAL_DEPTH_M + half_thickness
    side_x = LENGTH_M / 2 + half_depth
    side_y = GOAL_WIDTH_M / 2 + half_thickness
    z = GOAL_HEIGHT_M / 2
    centers = np.array([[back_x, 0, z], [side_x, side_y, z], [side_x, -side_y, z]])
    side_size = [half_depth, half_thickness, z]
    sizes = np.array([[half_thickness, side_y + half_thickness, z], side_size, side_size])
    return np.concatenate([centers, centers * [-1, -1, 1]]), np.tile(sizes, (2, 1))
