"""What is measured on a compiled robot: geometry of its wheels, its motor; and how fast the contact points slide."""

from dataclasses import dataclass

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, Kinematics, world_to_body
from omni_mj.worlds.roles import Ids, Robot


@dataclass(frozen=True)
class Motor:
    """The model's motor and gear: torque constant (N m/A = V s/rad), resistance (ohm), gear ratio."""

    constant: float
    resistance: float
    gear: float


def motor(model: mujoco.MjModel, robot: Robot, file: str) -> Motor:
    """Read the motor from the wheels' dcmotors, which must be alike; `file` is named in messages."""
    resistance, constant = model.actuator_gainprm[robot.motors, :2].T
    gear = model.actuator_gear[robot.motors, 0]
    if any(np.ptp(values) > 0 for values in (resistance, constant, gear)):
        raise OmniError(f"{file}: the <dcmotor>s of the wheels must be alike")
    return Motor(float(constant[0]), float(resistance[0]), float(gear[0]))


def kinematics(model: mujoco.MjModel, robot: Robot, file: str) -> Kinematics:
    """Measure azimuths, arm and radius of the wheels on the robot as modelled, standing on a carpet at z = 0.

    Raises:
        OmniError: wheels for which equation 3 does not hold: at different distances, of different radii, or with axles
            that do not point to the robot's centre. `file` is named.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    axes = data.xmat[robot.chassis].reshape(3, 3)
    centres = (data.xanchor[robot.joints] - data.xpos[robot.chassis]) @ axes
    arm, radius = np.hypot(*centres[:, :2].T), data.xanchor[robot.joints, 2]
    if np.ptp(arm) > 1e-5 or np.ptp(radius) > 1e-5:
        raise OmniError(f"{file}: wheels at different distances ({arm} m) or of different radii ({radius} m)")
    inward = -centres * [1, 1, 0] / arm[:, None]
    if (bad := np.abs(data.xaxis[robot.joints] @ axes - inward).max(1) > 1e-4).any():
        hinge = model.joint(robot.joints[np.argmax(bad)]).name
        raise OmniError(
            f"{file}: the axis of {hinge!r} must point to the robot's centre: a positive speed drives counter-clockwise"
        )
    azimuths = np.arctan2(centres[:, 1], centres[:, 0]) % (2 * np.pi)
    return Kinematics(azimuths, float(arm[0]), float(radius[0]))


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
    def of(cls, model: mujoco.MjModel, robot: Robot) -> "WheelGeometry":
        """Read it from a compiled model."""
        return cls(
            robot.roller_dofs - robot.dofs.start,
            robot.wheel_qpos - robot.qpos.start,
            robot.wheel_dofs - robot.dofs.start,
            float(np.linalg.norm(model.body_pos[robot.rollers[0, 0]])),
            2 * np.pi / robot.rollers.shape[1],
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
