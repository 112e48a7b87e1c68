"""Drag, creep and Coulomb's limit of the carpet, written to robots in MuJoCo's worlds.

The laws are those of `omni_mj.robot.wheel_carpet_forces`.
"""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.mjcf.world_builder import World
from omni_mj.plants.mjdata_views import RobotViews
from omni_mj.robot.array_ops import rotate
from omni_mj.robot.electronics import FrameInputs
from omni_mj.robot.wheel_carpet_forces import (
    CarpetParameters,
    ChassisMotion,
    Drag,
    compute_drag,
    compute_torque_limit,
)


def scale_creep_for_mujoco(carpet: CarpetParameters, world: World) -> CarpetParameters:
    """Return parameters whose `creep_compliance` is that of slip hinges, Q / A."""
    inverse_inertia = world.model.dof_invweight0[world.robots[0].slip_dofs][:, None]
    compliance = carpet.creep_compliance / (world.model.opt.timestep * inverse_inertia)
    return carpet._replace(creep_compliance=compliance)


class CarpetForces:
    """Forces of the carpet on the robots of a batch.

    Args:
        views: Views of the robots.
    """

    def __init__(self, views: RobotViews) -> None:
        self._views = views
        self._drag: Drag

    def update_drag(
        self, p: CarpetParameters, inputs: FrameInputs, load: Array, wheel_angle: Array
    ) -> None:
        """Compute the drag anew, and write it with the push forces to the chassis.

        Args:
            p: Parameters; see `scale_creep_for_mujoco`.
            inputs: Inputs of the frame, with the push forces.
            load: Normal forces, (W, n) N.
            wheel_angle: (W, n) rad.
        """
        motion = self._compute_motion()
        self._drag = compute_drag(p, motion, load, wheel_angle)
        self._views.wrench.set(self._compute_wrench(motion, inputs))

    def set_slip_limits(self, load: Array) -> None:
        """Write Coulomb's limits and the impedances of creep to the slip hinges.

        Args:
            load: Normal forces, (W, n) N.
        """
        limit, positive_load = compute_torque_limit(self._drag.torque_per_load, load)
        self._views.slip_limit.set(limit)
        # d = A / (A + Q)
        impedance = positive_load / (positive_load + self._drag.slip_compliance)
        self._views.slip_impedance.set(impedance)

    def _compute_motion(self) -> ChassisMotion:
        """Return the motion of the centers of the wheels, for robots that stand upright."""
        x, y, _, w, _, _, z = self._views.pose.get()
        velocity_x, velocity_y, _, _, _, turn_rate = self._views.velocity.get()
        cosine = w * w - z * z
        sine = 2 * w * z
        forward_velocity, sideways_velocity = rotate(velocity_x, velocity_y, cosine, -sine)
        return ChassisMotion(x, y, cosine, sine, forward_velocity, sideways_velocity, turn_rate)

    def _compute_wrench(self, motion: ChassisMotion, inputs: FrameInputs) -> Array:
        """Return the wrench of drag and pushes on the chassis, world frame, (6, n) N and N m."""
        drag = self._drag
        x, y = rotate(drag.forward_force, drag.sideways_force, motion.cosine, motion.sine)
        center_x, center_y, height = self._views.center_of_mass
        moment = drag.moment - center_x * drag.sideways_force + center_y * drag.forward_force
        force_x = x + inputs.push_force_x
        force_y = y + inputs.push_force_y
        return np.stack([force_x, force_y, 0 * moment, height * y, -height * x, moment])
