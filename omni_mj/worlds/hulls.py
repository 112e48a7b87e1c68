"""What robots meet each other and walls with: their geoms of the class `hull`, or those that a model's file names."""

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.worlds.parts import Part

_GEOM = mujoco.mjtGeom
_ROUND = [int(kind) for kind in (_GEOM.mjGEOM_CYLINDER, _GEOM.mjGEOM_CAPSULE, _GEOM.mjGEOM_SPHERE)]
_CORNERS = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1)


def switch_on(spec: mujoco.MjSpec, robot: Part) -> None:
    """Have a robot's hull collide, which as modelled does not.

    Raises:
        OmniError: it has none.
    """
    if not robot.hull:
        raise OmniError(
            f"{robot.file}: no hull; robots that share a world meet with their geoms of the class 'hull', or those "
            "that 'hull' names"
        )
    for name in robot.hull:
        hull = spec.geom(name)
        hull.contype = hull.conaffinity = 1


def reach(model: mujoco.MjModel, robot: Part) -> float:
    """Radius of the circle about a robot's middle that its hull stays in while it stands upright, m; 0 without a hull.

    Args:
        model: of the robot alone.
        robot: what it is.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    middle = data.xpos[1, :2]
    return max((_farthest(model, data, model.geom(name).id, middle) for name in robot.hull), default=0.0)


def _farthest(model: mujoco.MjModel, data: mujoco.MjData, geom: int, middle: Array) -> float:
    """How far a geom reaches from a point of the plane; of one that does not stand upright and round, its box."""
    axes, place = data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom, :2] - middle
    if int(model.geom_type[geom]) in _ROUND and abs(axes[2, 2]) > 1 - 1e-9:
        return float(model.geom_size[geom, 0] + np.hypot(*place))
    centre, half = np.split(model.geom_aabb[geom], 2)
    corners = axes @ (centre[:, None] + half[:, None] * _CORNERS)
    return float(np.hypot(*(place[:, None] + corners[:2])).max())
