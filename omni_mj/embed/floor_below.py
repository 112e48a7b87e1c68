"""Put a robot on the floor of a scene, which may be uneven or inclined."""

import mujoco
import numpy as np

from omni_control.kinematics import Array
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
        model: Model of the scene.
        data: Its data; the positions of the robot are changed.
        world: The scene with its one robot.
        views: View of the robot.
        pose: Pose of the robot seen from above, (3,) m, m, rad.
        height: Approximate height of the floor, m.
    """
    views.place_robots(np.zeros(1, int), pose[None])
    mujoco.mj_kinematics(model, data)
    wheels = data.xpos[world.robots[0].wheels][:, :2]
    top = height + SEARCH_HEIGHT_M
    heights = np.array([_find_floor(model, data, np.array([*wheel, top])) for wheel in wheels])
    heights = np.where(np.isnan(heights), height, heights)
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


def _find_floor(model: mujoco.MjModel, data: mujoco.MjData, start: Array) -> float:
    """Return the height of the highest fixed geom below a point (3,), m; NaN if there is none."""
    geom = np.zeros(1, np.int32)
    down = np.array([0.0, 0.0, -1.0])
    point = start.copy()
    while True:
        distance = mujoco.mj_ray(model, data, point, down, None, 1, -1, geom)
        if distance < 0:
            return np.nan
        point = point + distance * down
        is_fixed = model.body_weldid[model.geom_bodyid[geom[0]]] == 0
        collides = model.geom_contype[geom[0]] or model.geom_conaffinity[geom[0]]
        if is_fixed and collides:
            return float(point[2])
        point = point + 1e-6 * down
