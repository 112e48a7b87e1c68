"""Put a robot on the floor of a scene, which may be uneven or inclined."""

from collections.abc import Iterator

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.mjcf.field import ROBOT_HEIGHT_M
from omni_mj.mjcf.robot_parts import RobotIndices
from omni_mj.mjcf.world_builder import World
from omni_mj.plants.mjdata_views import RobotViews

SEARCH_RANGE_M = 0.3  # above and below the approximate height of the floor


def put_on_floor(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    world: World,
    views: RobotViews,
    pose: Array,
    height: float,
) -> None:
    """Put a robot at rest on the plane that fits the floor below its wheels.

    Args:
        model: Model of the scene; the contact margins of the robot are changed.
        data: Its data; the positions of the robot are changed.
        world: The scene with its one robot.
        views: View of the robot.
        pose: Pose of the robot seen from above, (3,) m, m, rad.
        height: Approximate height of the floor, m.

    Raises:
        OmniError: There is no floor at about this height.
    """
    (robot,) = world.robots
    views.place_robots(np.zeros(1, int), pose[None])
    mujoco.mj_kinematics(model, data)
    wheels = data.xpos[robot.wheels][:, :2]
    floors = [_find_floor(model, data, robot.chassis, wheel, height) for wheel in wheels]
    known_floors = [floor for floor in floors if floor is not None]
    if not known_floors:
        raise OmniError(
            f"there is no floor below the wheels of {model.body(robot.chassis).name!r} at "
            f"({pose[0]:g}, {pose[1]:g}) m within {SEARCH_RANGE_M:g} m of the height {height:g} m; "
            "give add_robot another pose or height"
        )
    # Wheels beyond the edge of the floor hang in the air.
    heights = np.array([(floor or known_floors[0])[0] for floor in floors])
    # Margins of both geoms add up. A margin would increase the radius of the wheels.
    set_margin(model, robot, -max(margin for _, margin in known_floors))
    position = views.pose.get()
    if np.ptp(heights) == 0:
        position[2] += heights[0]
    else:
        offsets = np.column_stack([wheels - pose[:2], np.ones(len(wheels))])
        (slope_x, slope_y, center), *_ = np.linalg.lstsq(offsets, heights, rcond=None)
        normal = np.array([-slope_x, -slope_y, 1.0]) / np.hypot(1.0, np.hypot(slope_x, slope_y))
        # The shortest rotation from z to the normal
        tilt = np.array([1 + normal[2], -normal[1], normal[0], 0.0])
        quaternion = np.zeros(4)
        mujoco.mju_mulQuat(quaternion, tilt / np.linalg.norm(tilt), position[3:, 0])
        position[:3, 0] = [*pose[:2], center] + position[2, 0] * normal
        position[3:, 0] = quaternion
    views.pose.set(position)


def set_margin(model: mujoco.MjModel, robot: RobotIndices, margin: float) -> None:
    """Set the contact margin of a robot, m."""
    is_own = np.isin(model.geom_bodyid, robot.bodies)
    model.geom_margin[is_own & (model.geom_conaffinity > 0)] = margin


def _find_floor(
    model: mujoco.MjModel, data: mujoco.MjData, chassis: int, point: Array, height: float
) -> tuple[float, float] | None:
    """Return height and contact margin of the floor at a point (2,), m, or None.

    Of the surfaces with enough room for a robot it is the one that is nearest to `height`.
    """
    floors, room_top = list[tuple[float, float]](), np.inf
    for surface, geom in _list_surfaces(model, data, np.array([*point, height + SEARCH_RANGE_M])):
        if surface < height - SEARCH_RANGE_M:
            break
        is_own = model.body_rootid[model.geom_bodyid[geom]] == chassis
        if is_own or not (model.geom_contype[geom] or model.geom_conaffinity[geom]):
            continue
        if room_top - surface > ROBOT_HEIGHT_M:
            floors.append((surface, float(model.geom_margin[geom])))
        room_top = surface
    return min(floors, key=lambda floor: abs(floor[0] - height), default=None)


def _list_surfaces(
    model: mujoco.MjModel, data: mujoco.MjData, start: Array
) -> Iterator[tuple[float, int]]:
    """Yield height, m, and geom of all surfaces below a point (3,), from above."""
    geom = np.zeros(1, np.int32)
    down = np.array([0.0, 0.0, -1.0])
    while (distance := mujoco.mj_ray(model, data, start, down, None, 1, -1, geom)) >= 0:
        start = start + distance * down
        yield float(start[2]), int(geom[0])
        start = start + 1e-6 * down
