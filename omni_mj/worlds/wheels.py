"""How fast the contact points of wheels without creep slide."""

from dataclasses import dataclass

import mujoco
import numpy as np

from omni_control.kinematics import Array, Kinematics, world_to_body
from omni_mj.mjcf.roles import Ids, Robot


@dataclass(frozen=True, eq=False)
class WheelGeometry:
    """Where a robot's rollers are: addresses among its own positions and speeds, and the circle of their centres.

    Roller k of a wheel is at the bottom at the wheel angle k times `pitch` (rad).

    Args:
        roller_dofs: (wheels, rollers).
        wheel_qpos: (wheels,).
        wheel_dofs: (wheels,).
        circle: radius of the circle on which the rollers' centres lie, m.
        pitch: angle between rollers, rad.
        height: of the chassis' frame over the carpet, as modelled, m.
    """

    roller_dofs: Ids
    wheel_qpos: Ids
    wheel_dofs: Ids
    circle: float
    pitch: float
    height: float

    @classmethod
    def of(cls, model: mujoco.MjModel, robot: Robot, pitch: float) -> "WheelGeometry":
        """Read it from a compiled model, whose whole wheels have rollers `pitch` (rad) apart."""
        return cls(
            robot.roller_dofs - robot.dofs.start,
            robot.wheel_qpos - robot.qpos.start,
            robot.wheel_dofs - robot.dofs.start,
            float(np.linalg.norm(model.body_pos[robot.rollers[0, 0]])),
            pitch,
            float(model.qpos0[robot.qpos.start + 2]),
        )


def contact_slip(wheels: WheelGeometry, kinematics: Kinematics, qpos: Array, qvel: Array) -> Array:
    """Speed at which each wheel's contact point slides over the carpet, (n, wheels) m/s.

    The contact point is taken under the axle, on the roller nearest the bottom. Along the rim it moves with the hub's
    speed less what the wheel rolls; along the axle with the hub's speed plus the roller's spin at its distance from
    the roller's axis, h cos(phi) - rho for a roller at angle phi from the bottom, an axle height h and a circle of
    roller centres of radius rho.

    Args:
        wheels: where the robots' rollers are.
        kinematics: of the robots.
        qpos: MuJoCo's positions (n, k) of n robots, the free joint first.
        qvel: MuJoCo's velocities (n, k - 1).
    """
    w, z = qpos[:, 3], qpos[:, 6]
    body = world_to_body(qvel[:, [0, 1, 5]], 2 * np.arctan2(z, w))
    vx, vy, turn = body[:, :1], body[:, 1:2], body[:, 2:]
    height = kinematics.radius + (qpos[:, 2:3] - wheels.height)
    angle = qpos[:, wheels.wheel_qpos]
    nearest = np.rint(angle / wheels.pitch)
    phi = nearest * wheels.pitch - angle
    count = wheels.roller_dofs.shape[1]
    dofs = wheels.roller_dofs[np.arange(len(wheels.wheel_qpos)), nearest.astype(int) % count]
    spin = qvel[np.arange(len(qvel))[:, None], dofs]
    c, s = np.cos(kinematics.azimuths), np.sin(kinematics.azimuths)
    along_rim = c * vy - s * vx + kinematics.arm * turn - height * qvel[:, wheels.wheel_dofs]
    along_axle = c * vx + s * vy + spin * (height * np.cos(phi) - wheels.circle)
    return np.hypot(along_rim, along_axle)
