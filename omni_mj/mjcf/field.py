"""The field that the league plays on: division B of the Small Size League.

Dimensions: RoboCup-SSL/ssl-rules, chapter "Playing Environment", field setup. World frame: the field's centre is the
origin, x leads towards the goal.
"""

import numpy as np

from omni_control.kinematics import Array

LENGTH_M, WIDTH_M = 9.0, 6.0  # of the playing area, its lines included
SURFACE_M = 10.4, 7.4  # the carpet goes on for 0.7 m on all sides
LINE_M = 0.01  # width of all lines
CIRCLE_RADIUS_M = 0.5
DEFENCE_DEPTH_M, DEFENCE_WIDTH_M = 1.0, 2.0
GOAL_WIDTH_M, GOAL_DEPTH_M, GOAL_HEIGHT_M, GOAL_WALL_M = 1.0, 0.18, 0.16, 0.02


def get_field_lines() -> dict[str, tuple[float, float, float, float]]:
    """Return the straight lines by SSL-Vision's names: x and y of both ends, m."""
    x, y, half = LENGTH_M / 2, WIDTH_M / 2, DEFENCE_WIDTH_M / 2
    result = {
        "TOP_TOUCH_LINE": (-x, y, x, y),
        "BOTTOM_TOUCH_LINE": (-x, -y, x, -y),
        "HALFWAY_LINE": (0.0, -y, 0.0, y),
        "CENTER_LINE": (-x, 0.0, x, 0.0),
    }
    for side, sign in (("LEFT", -1), ("RIGHT", 1)):
        goal, front, left = sign * x, sign * (x - DEFENCE_DEPTH_M), sign * half
        result[f"{side}_GOAL_LINE"] = goal, -y, goal, y
        result[f"{side}_PENALTY_STRETCH"] = front, -half, front, half
        result[f"{side}_FIELD_LEFT_PENALTY_STRETCH"] = goal, left, front, left
        result[f"{side}_FIELD_RIGHT_PENALTY_STRETCH"] = goal, -left, front, -left
    return result


def get_goal_walls() -> tuple[Array, Array]:
    """Centres (6, 3) and half sizes (6, 3) of the walls of both goals, in m."""
    depth, thick = GOAL_DEPTH_M / 2, GOAL_WALL_M / 2
    back, middle, side = (
        LENGTH_M / 2 + GOAL_DEPTH_M + thick,
        LENGTH_M / 2 + depth,
        GOAL_WIDTH_M / 2 + thick,
    )
    centres = np.array([[back, 0], [middle, side], [middle, -side]])
    sizes = np.array([[thick, side + thick], [depth, thick], [depth, thick]])
    height = np.full((6, 1), GOAL_HEIGHT_M / 2)
    return np.hstack([np.concatenate([centres, -centres]), height]), np.hstack(
        [np.tile(sizes, (2, 1)), height]
    )
