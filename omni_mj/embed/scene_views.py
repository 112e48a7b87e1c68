"""View of a robot in a scene, where it may stand on a slope."""

import mujoco
import numpy as np

from omni_control.kinematics import Array
from omni_mj.mjcf.world_builder import World
from omni_mj.plants.mjdata_views import EntryView, RobotViews
from omni_mj.robot.wheel_carpet_forces import ChassisMotion, Drag

MIN_TILT_RAD = 0.01  # below, a robot counts as upright, as on the plant


class SceneArrays:
    """Arrays of a scene, with the interface of a batch of one world."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._model, self._data = model, data

    def bind(self, name: str) -> Array:
        """Return an array of the data, (1, ...)."""
        array: Array = getattr(self._data, name)
        return array[None]

    def expand(self, name: str) -> Array:
        """Return an array of the model, (1, ...)."""
        array: Array = getattr(self._model, name)
        return array[None]


class SceneViews(RobotViews):
    """View of a robot in a scene. Its carpet has the inclination of the robot.

    Args:
        state: Arrays of the scene.
        world: The scene with its one robot.
    """

    def __init__(self, state: SceneArrays, world: World) -> None:
        super().__init__(state, world)
        self.load = _NormalForces(self, state, world)

    def find_axes(self) -> Array | None:
        """Return the robot's axes in columns, (3, 3), or None if it is upright."""
        quaternion = self.pose.get()[3:, 0]
        if np.hypot(quaternion[1], quaternion[2]) < MIN_TILT_RAD / 2:
            return None
        axes = np.zeros(9)
        mujoco.mju_quat2Mat(axes, quaternion)
        return axes.reshape(3, 3)

    def read_motion(self) -> ChassisMotion:
        """See `RobotViews`."""
        axes = self.find_axes()
        if axes is None:
            return super().read_motion()
        x, y = self.pose.get()[:2]
        cosine, sine = axes[:2, :1] / np.hypot(*axes[:2, 0])
        velocity = self.velocity.get()
        return ChassisMotion(x, y, cosine, sine, tuple(axes.T[:2] @ velocity[:3]), velocity[5])

    def write_drag(self, drag: Drag, motion: ChassisMotion, push_force: Array) -> None:
        """See `RobotViews`."""
        axes = self.find_axes()
        if axes is None:
            super().write_drag(drag, motion, push_force)
            return
        force = np.stack([*drag.force, np.zeros(1)])  # in the body frame
        torque = np.cross(-self.center_of_mass, force, axis=0)
        torque[2] += drag.moment
        world_push = np.vstack([push_force, np.zeros((1, 1))])
        self.wrench.set(np.vstack([axes @ force + world_push, axes @ torque]))


class _NormalForces(EntryView):
    """View of the normal forces of a robot's wheels, (W, 1) N, normal to its base."""

    def __init__(self, robot: SceneViews, state: SceneArrays, world: World) -> None:
        addresses = world.load_addresses[0][:, None] + np.arange(-2, 1)
        super().__init__(state, "sensordata", addresses.reshape(1, -1))
        self._robot, self._sources = robot, (state, world)

    def __reduce__(self) -> tuple[type, tuple[object, ...]]:
        return type(self), (self._robot, *self._sources)

    def get(self) -> Array:
        """Return the forces along the robot's z axis."""
        axes = self._robot.find_axes()
        return super().get().reshape(-1, 3) @ (np.eye(3) if axes is None else axes)[:, 2:]
