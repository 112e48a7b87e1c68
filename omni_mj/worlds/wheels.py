"""How fast the wheels' contact points slide over the carpet."""

from dataclasses import dataclass

import mujoco
import numpy as np

from omni_control.kinematics import Array, Kinematics, world_to_body
from omni_mj.worlds import robot


@dataclass(frozen=True)
class WheelGeometry:
    """Where a model's rollers are: joint addresses (4, rollers), and the circle on which their centres lie.

    Roller k of a wheel is at the bottom at the wheel angle k times `pitch` (rad).
    """

    roller_dofs: np.ndarray
    wheel_qpos: np.ndarray
    wheel_dofs: np.ndarray
    circle: float
    pitch: float

    @classmethod
    def of(cls, model: mujoco.MjModel) -> "WheelGeometry":
        """Read it from a compiled model."""
        wheels = [model.body(f"wheel_{i + 1}") for i in range(robot.WHEELS)]
        rollers = [np.flatnonzero(model.body_parentid == wheel.id) for wheel in wheels]
        joints = robot.wheel_joints(model)
        return cls(
            np.array([model.body_dofadr[r] for r in rollers]),
            np.array([joint.qposadr[0] for joint in joints]),
            np.array([joint.dofadr[0] for joint in joints]),
            float(np.linalg.norm(model.body_pos[rollers[0][0]])),
            2 * np.pi / len(rollers[0]),
        )


def contact_slip(wheels: WheelGeometry, kinematics: Kinematics, qpos: Array, qvel: Array) -> Array:
    """Speed at which each wheel's contact point slides over the carpet, (n, 4) m/s.

    The contact point is taken under the axle, on the roller nearest the bottom. Along the rim it moves with the hub's
    speed less what the wheel rolls; along the axle with the hub's speed plus the roller's spin at its distance from
    the roller's axis, h cos(phi) - rho for a roller at angle phi from the bottom, an axle height h and a circle of
    roller centres of radius rho.

    Args:
        wheels: where the model's rollers are.
        kinematics: of the model.
        qpos: MuJoCo's positions (n, nq), the robot's free joint first.
        qvel: MuJoCo's velocities (n, nv).
    """
    w, z = qpos[:, 3], qpos[:, 6]
    body = world_to_body(np.column_stack([qvel[:, :2], qvel[:, 5]]), 2 * np.arctan2(z, w))
    vx, vy, turn = body[:, :1], body[:, 1:2], body[:, 2:]
    height = kinematics.radius + qpos[:, 2:3]
    angle = qpos[:, wheels.wheel_qpos]
    nearest = np.rint(angle / wheels.pitch)
    phi = nearest * wheels.pitch - angle
    count = wheels.roller_dofs.shape[1]
    dofs = wheels.roller_dofs[np.arange(robot.WHEELS), nearest.astype(int) % count]
    spin = np.take_along_axis(qvel, dofs, axis=1)
    c, s = np.cos(kinematics.azimuths), np.sin(kinematics.azimuths)
    along_rim = c * vy - s * vx + kinematics.arm * turn - height * qvel[:, wheels.wheel_dofs]
    along_axle = c * vx + s * vy + spin * (height * np.cos(phi) - wheels.circle)
    return np.hypot(along_rim, along_axle)
