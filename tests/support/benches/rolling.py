"""Robots as plain MJCF in a scene of somebody else: how far they roll for their wheel angles."""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from omni_control.kinematics import Kinematics

SPACING_M = 3.0
SETTLING_S, ROLLING_S = 0.1, 0.2
SPEED_M_S, TURN_RATE_RAD_S = 1.0, 8.0
# Twists (9, 3) in m/s, m/s, rad/s: eight directions, and on the spot.
TWISTS = np.array(
    [
        *([SPEED_M_S * np.cos(a), SPEED_M_S * np.sin(a), 0] for a in np.arange(8) * np.pi / 4),
        [0, 0, TURN_RATE_RAD_S],
    ]
)


def make_floor(floor: str, **options: Any) -> mujoco.MjSpec:
    """Return a scene with nothing but a floor, and MuJoCo's default options except these."""
    scene = mujoco.MjSpec()
    for name, value in options.items():
        setattr(scene.option, name, value)
    if floor == "hfield":
        scene.add_hfield(
            name="floor", nrow=40, ncol=40, size=[9, 9, 0.1, 0.1], userdata=np.zeros(1600)
        )
        scene.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname="floor")
    elif floor == "box":
        scene.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[9, 9, 1], pos=[0, 0, -1])
    else:
        scene.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[9, 9, 1])
    return scene


def attach(scene: mujoco.MjSpec, robot: mujoco.MjSpec, n: int = len(TWISTS)) -> mujoco.MjModel:
    """Return the scene with n robots, `0/` and so on, on a grid."""
    for i in range(n):
        frame = scene.worldbody.add_frame(pos=[*(SPACING_M * (np.array([i % 3, i // 3]) - 1)), 0])
        scene.attach(robot.copy(), frame=frame, prefix=f"{i}/")
    return scene.compile()


def measure_rolling(
    model: mujoco.MjModel, kinematics: Kinematics, ramp_s: float = 0.4
) -> tuple[NDArray, NDArray]:
    """Drive the robots of `attach`, each with a twist of its own, by voltages of their motors.

    Args:
        model: Model of `attach`.
        kinematics: Those of each robot.
        ramp_s: Time in which the voltages increase.

    Returns:
        The difference of the motion (9, 3) from that of the wheels in the robot's frame, over the
        distance, with turns times the arm of the wheels; and the largest change of the height
        (9,), m.
    """
    data, n, n_wheels = mujoco.MjData(model), len(TWISTS), len(kinematics.matrix)
    # Joints and actuators of a robot are consecutive and start with the free joint.
    hinges = np.flatnonzero(np.isin(np.arange(model.njnt), model.actuator_trnid[:, 0]))
    wheels = model.jnt_qposadr[hinges].reshape(n, n_wheels)
    bases = model.jnt_qposadr[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]
    resistance, torque_constant = model.actuator_gainprm[0, :2]
    torque_per_ampere = torque_constant * model.actuator_gear[0, 0]  # also V s/rad, at the wheel
    speeds = (TWISTS @ kinematics.matrix.T).ravel() / kinematics.radius
    dofs = model.jnt_dofadr[hinges]
    torques = model.dof_frictionloss[dofs] * np.sign(speeds.round(6)) + (
        model.dof_damping[dofs].reshape(len(dofs), -1)[:, 0] * speeds
    )
    voltages = torque_per_ampere * speeds + resistance * torques / torque_per_ampere
    mujoco.mj_step(model, data, nstep=round(SETTLING_S / model.opt.timestep))
    rest_height = data.qpos[bases + 2]
    from_rims = np.linalg.pinv(kinematics.matrix).T
    hop, rolled, moved = np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3))
    for step in range(round((ramp_s + ROLLING_S) / model.opt.timestep)):
        data.ctrl[:] = voltages * min(1.0, step * model.opt.timestep / ramp_s)
        before, angles, heading = data.qpos.copy(), data.qpos[wheels], _headings(data, bases)
        mujoco.mj_step(model, data)
        turn = (_headings(data, bases) - heading + np.pi) % (2 * np.pi) - np.pi
        rolled += kinematics.radius * (data.qpos[wheels] - angles) @ from_rims
        shift = (data.qpos - before)[bases[:, None] + [0, 1]]
        cos, sin = np.cos(heading + turn / 2), np.sin(heading + turn / 2)
        moved[:, 0] += cos * shift[:, 0] + sin * shift[:, 1]
        moved[:, 1] += cos * shift[:, 1] - sin * shift[:, 0]
        moved[:, 2] += turn
        hop = np.maximum(hop, np.abs(data.qpos[bases + 2] - rest_height))
    lengths = np.array([1, 1, kinematics.arm])
    distance = np.linalg.norm(rolled * lengths, axis=1)
    assert (distance > 0.04).all()
    return (moved - rolled) * lengths / distance[:, None], hop


def _headings(data: mujoco.MjData, bases: NDArray) -> NDArray:
    """Return the headings of robots with these free joints, (n,) rad."""
    w, x, y, z = data.qpos[bases[:, None] + [3, 4, 5, 6]].T
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
