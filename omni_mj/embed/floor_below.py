"""Put a robot on the floor of a scene, which may be uneven or inclined."""

import mujoco
import numpy as np

from omni_control.kinematics import Array
from omni_mj.mjcf.robot_parts import find_roller_geoms
from omni_mj.mjcf.world_builder import World
from omni_mj.plants.mjdata_views import RobotViews

SEARCH_HEIGHT_M = 0.3  # above the approximate height of the floor, from which it is sought


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
        model: Model of the scene; the contact margins of the robot's rollers are changed.
        data: Its data; the positions of the robot are changed.
        world: The scene with its one robot.
        views: View of the robot.
        pose: Pose of the robot seen from above, (3,) m, m, rad.
        height: Approximate height of the floor, m.
    """
    views.place_robots(np.zeros(1, int), pose[None])
    mujoco.mj_kinematics(model, data)
    (robot,) = world.robots
    wheels = data.xpos[robot.wheels, :2]
    heights, margins = np.array(
        [_find_floor(model, data, robot.chassis, np.array([*wheel, height])) for wheel in wheels]
    ).T
    # Margins of both geoms add up. A margin would increase the radius of the wheels.
    model.geom_margin[find_roller_geoms(model, robot)] = -margins.max()
    position = views.pose.get()
    if np.ptp(heights) == 0:
        position[2] += heights[0]
    else:
        offsets = np.column_stack([wheels - pose[:2], np.ones(len(wheels))])
        (slope_x, slope_y, center), *_ = np.linalg.lstsq(offsets, heights, rcond=None)
        normal = np.array([-slope_x, -slope_y, 1.0])
        normal /= np.linalg.norm(normal)
        # The shortest rotation from z to the normal
        tilt = np.array([1 + normal[2], -normal[1], normal[0], 0.0])
        quaternion = np.zeros(4)
        mujoco.mju_mulQuat(quaternion, tilt / np.linalg.norm(tilt), position[3:, 0])
        position[:3, 0] = [*pose[:2], center] + position[2, 0] * normal
        position[3:, 0] = quaternion
    views.pose.set(position)


def _find_floor(
    model: mujoco.MjModel, data: mujoco.MjData, chassis: int, start: Array
) -> tuple[float, float]:
    """Return height and contact margin of the highest geom near a point (3,), m.

    Without a geom there, except those of the robot itself, the height is that of the point.
    """
    hit, down = np.zeros(1, np.int32), np.array([0.0, 0.0, -1.0])
    point = start - SEARCH_HEIGHT_M * down
    while True:
        distance = mujoco.mj_ray(model, data, point, down, None, 1, -1, hit)
        if distance < 0:
            return float(start[2]), 0.0
        point = point + distance * down
        geom = hit[0]
        is_own = model.body_rootid[model.geom_bodyid[geom]] == chassis
        if not is_own and (model.geom_contype[geom] or model.geom_conaffinity[geom]):
            return float(point[2]), float(model.geom_margin[geom])
        point = point + 1e-6 * down
