"""Lines, goals and walls of the field, and the largest robot of the Small Size League.

Source: RoboCup-SSL/ssl-rules, chapter "Playing Environment", field setup. The origin of the world
frame is the center of the field; x points to a goal, y left, z up. The size of the field is a
setting, see `WorldSettings`. Other dimensions are those of the rules for a field of this length.
"""

from typing import NamedTuple

import mujoco
import numpy as np

from omni_control.kinematics import Array
from omni_mj.config.world_settings import WorldSettings

LINE_WIDTH_M = 0.01
CENTER_CIRCLE_RADIUS_M = 0.5
GOAL_DEPTH_M, GOAL_HEIGHT_M, GOAL_WALL_THICKNESS_M = 0.18, 0.16, 0.02
ROBOT_RADIUS_M, ROBOT_HEIGHT_M = 0.09, 0.15  # largest robot that the rules allow


class Division(NamedTuple):
    """Dimensions that differ between the divisions, m.

    Attributes:
        goal_width: Width of a goal.
        penalty_area_depth, penalty_area_width: Size of the "defense area" of the rules.
    """

    goal_width: float
    penalty_area_depth: float
    penalty_area_width: float


DIVISION_A, DIVISION_B = Division(1.8, 1.8, 3.6), Division(1.0, 1.0, 2.0)
DIVISION_A_LENGTH_M = 12.0


def get_division(world: WorldSettings) -> Division:
    """Return the dimensions for a field: those of division A from its length on."""
    return DIVISION_A if world.field_length_m >= DIVISION_A_LENGTH_M else DIVISION_B


def place_walls(spec: mujoco.MjSpec, carpet_size_m: tuple[float, float]) -> None:
    """Change carpet and walls of models/field.xml to another size, (2,) m along x and y."""
    half_length, half_width = carpet_size_m[0] / 2, carpet_size_m[1] / 2
    spec.geom("carpet").size[:2] = half_length, half_width
    walls_xy = {
        "front": (half_length, 0),
        "back": (-half_length, 0),
        "left": (0, half_width),
        "right": (0, -half_width),
    }
    for side, (x, y) in walls_xy.items():
        wall = spec.geom(f"wall_{side}")
        wall.pos[:2] = x, y
        wall.size[0] = half_width if x else half_length


def get_field_lines(world: WorldSettings) -> dict[str, tuple[float, float, float, float]]:
    """Return a mapping from SSL-Vision's names of straight lines to their ends, x1, y1, x2, y2, m.

    A penalty stretch is an edge of a penalty area: that in front, or one at a side.
    """
    x, y, division = world.field_length_m / 2, world.field_width_m / 2, get_division(world)
    half_width = division.penalty_area_width / 2
    lines = {
        "TOP_TOUCH_LINE": (-x, y, x, y),
        "BOTTOM_TOUCH_LINE": (-x, -y, x, -y),
        "HALFWAY_LINE": (0.0, -y, 0.0, y),
        "CENTER_LINE": (-x, 0.0, x, 0.0),
    }
    for side, sign in (("LEFT", -1), ("RIGHT", 1)):
        goal_x, front_x = sign * x, sign * (x - division.penalty_area_depth)
        left_y = sign * half_width  # the side on the left of a robot that faces the goal
        lines[f"{side}_GOAL_LINE"] = goal_x, -y, goal_x, y
        lines[f"{side}_PENALTY_STRETCH"] = front_x, -half_width, front_x, half_width
        lines[f"{side}_FIELD_LEFT_PENALTY_STRETCH"] = goal_x, left_y, front_x, left_y
        lines[f"{side}_FIELD_RIGHT_PENALTY_STRETCH"] = goal_x, -left_y, front_x, -left_y
    return lines


def get_goal_walls(world: WorldSettings) -> tuple[Array, Array]:
    """Return centers (6, 3) and half sizes (6, 3) of the walls of both goals, m.

    A goal has a wall at the back and one at each side.
    """
    half_depth, half_thickness = GOAL_DEPTH_M / 2, GOAL_WALL_THICKNESS_M / 2
    goal_x = world.field_length_m / 2
    back_x = goal_x + GOAL_DEPTH_M + half_thickness
    side_x = goal_x + half_depth
    side_y = get_division(world).goal_width / 2 + half_thickness
    z = GOAL_HEIGHT_M / 2
    centers = np.array([[back_x, 0, z], [side_x, side_y, z], [side_x, -side_y, z]])
    side_size = [half_depth, half_thickness, z]
    sizes = np.array([[half_thickness, side_y + half_thickness, z], side_size, side_size])
    return np.concatenate([centers, centers * [-1, -1, 1]]), np.tile(sizes, (2, 1))
