"""Where a robot's parts are in a compiled model, found by what they do, not by what they are called.

A wheel is a hinge driven by a <dcmotor>, and wheels are numbered in the order of these. On its hub is one body, the
rim, with or without a hinge to slip on; its rollers are the bodies on the rim that have a hinge of their own; its
encoder is the <jointpos> sensor on its hinge. The body with the <freejoint> that carries the wheels is the chassis, and
the <gyro> is the one on a site of it.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from omni_control.errors import OmniError

Ids = NDArray[np.int_]
KEPT = 2  # rollers of a wheel that is computed with those at the bottom alone (`two_rollers`)


@dataclass(frozen=True, eq=False)
class Robot:
    """Numbers of one robot's parts in a compiled model, and addresses of what belongs to them.

    Args:
        chassis: body with the free joint.
        qpos: all its positions (range), the free joint's seven first.
        dofs: all its degrees of freedom (range), the free joint's six first.
        joints: hinges of the wheels, (wheels,).
        wheel_qpos: addresses of their angles, (wheels,).
        wheel_dofs: addresses of their speeds, (wheels,).
        wheels: bodies, (wheels,).
        rims: bodies, (wheels,).
        slip_qpos, slip_dofs: addresses of the angles and speeds of the rims on the hubs, (wheels,), or none (0,).
        rollers: bodies, (wheels, rollers), the one at the bottom at the wheel angle 0 first, then in the order in which
            they come there as the wheel turns on.
        roller_dofs: addresses of their speeds, (wheels, rollers).
        motors: actuators, (wheels,).
        encoders: addresses in sensordata, (wheels,).
        gyro: address in sensordata of the turn rate about the robot's z axis.
    """

    chassis: int
    qpos: range
    dofs: range
    joints: Ids
    wheel_qpos: Ids
    wheel_dofs: Ids
    wheels: Ids
    rims: Ids
    slip_qpos: Ids
    slip_dofs: Ids
    rollers: Ids
    roller_dofs: Ids
    motors: Ids
    encoders: Ids
    gyro: int


def find(model: mujoco.MjModel, file: str) -> tuple[Robot, ...]:
    """Find the robots of a model, in the order of their bodies.

    Args:
        model: compiled.
        file: named in messages.

    Raises:
        OmniError: a role that nothing fills, by name, and what would fill it.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    motors = np.flatnonzero(
        (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_DCMOTOR)
        & (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT)
    )
    if not motors.size:
        raise OmniError(f"{file}: no wheels; a wheel is a hinge that a <dcmotor> drives")
    roots = model.body_rootid[model.jnt_bodyid[model.actuator_trnid[motors, 0]]]
    return tuple(_robot(model, data, int(root), motors[roots == root], file) for root in np.unique(roots))


def _robot(model: mujoco.MjModel, data: mujoco.MjData, chassis: int, motors: Ids, file: str) -> Robot:
    name = model.body(chassis).name
    free = int(model.body_jntadr[chassis])
    if model.body_jntnum[chassis] != 1 or model.jnt_type[free] != mujoco.mjtJoint.mjJNT_FREE:
        raise OmniError(f"{file}: the body {name!r}, which carries the wheels, has no <freejoint>")
    joints = model.actuator_trnid[motors, 0]
    for joint in joints:
        if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE:
            raise OmniError(f"{file}: the joint {model.joint(joint).name!r}, which a <dcmotor> drives, is no hinge")
    rims = np.array([_rim(model, int(joint), file) for joint in joints])
    slips = model.body_jntadr[rims[model.body_jntnum[rims] == 1]]
    if 0 < slips.size < rims.size:
        raise OmniError(f"{file}: some rims have a hinge to slip on, and some have none")
    rollers = [_rollers(model, data, int(joint), int(rim), file) for joint, rim in zip(joints, rims, strict=True)]
    if len({len(r) for r in rollers}) > 1:
        raise OmniError(f"{file}: wheels with different numbers of rollers: {[len(r) for r in rollers]}")
    own = np.flatnonzero(model.body_rootid[model.jnt_bodyid] == chassis)  # joints, one after the other
    sizes = np.diff([*model.jnt_qposadr, model.nq]), np.diff([*model.jnt_dofadr, model.nv])
    first, last = own[0], own[-1]
    return Robot(
        chassis=chassis,
        qpos=range(int(model.jnt_qposadr[first]), int(model.jnt_qposadr[last] + sizes[0][last])),
        dofs=range(int(model.jnt_dofadr[first]), int(model.jnt_dofadr[last] + sizes[1][last])),
        joints=joints,
        wheel_qpos=model.jnt_qposadr[joints],
        wheel_dofs=model.jnt_dofadr[joints],
        wheels=model.jnt_bodyid[joints],
        rims=rims,
        slip_qpos=model.jnt_qposadr[slips],
        slip_dofs=model.jnt_dofadr[slips],
        rollers=np.array(rollers),
        roller_dofs=model.body_dofadr[np.array(rollers)],
        motors=motors,
        encoders=np.array([_encoder(model, int(joint), file) for joint in joints]),
        gyro=_gyro(model, data, chassis, file),
    )


def _rim(model: mujoco.MjModel, joint: int, file: str) -> int:
    wheel = model.jnt_bodyid[joint]
    on_it = np.flatnonzero(model.body_parentid == wheel)
    if len(on_it) != 1:
        raise OmniError(f"{file}: the wheel {model.body(wheel).name!r} must carry one body, its rim, not {len(on_it)}")
    return int(on_it[0])


def _rollers(model: mujoco.MjModel, data: mujoco.MjData, joint: int, rim: int, file: str) -> Ids:
    """Bodies of a wheel's rollers, in the order in which they come to the bottom."""
    wheel = model.jnt_bodyid[joint]
    one_hinge = (model.body_jntnum == 1) & (model.jnt_type[model.body_jntadr] == mujoco.mjtJoint.mjJNT_HINGE)
    bodies = np.flatnonzero((model.body_parentid == rim) & one_hinge)
    if not bodies.size:
        raise OmniError(
            f"{file}: the wheel {model.body(wheel).name!r} has no rollers, bodies on its rim with a hinge each"
        )
    spokes, axle, down = data.xpos[bodies] - data.xanchor[joint], data.xaxis[joint], np.array([0.0, 0.0, -1.0])
    ahead = np.arctan2(np.cross(spokes, down) @ axle, spokes @ down)  # how far the wheel must turn for each
    if len(bodies) == KEPT:  # of a wheel whose other rollers are lumped
        return bodies[np.argsort(np.abs(ahead))]
    pitch = 2 * np.pi / len(bodies)
    order = np.rint(ahead / pitch).astype(int) % len(bodies)
    apart = np.abs(ahead - np.rint(ahead / pitch) * pitch).max()
    if apart > 1e-3 or len(set(order)) < len(bodies):
        raise OmniError(
            f"{file}: the rollers of the wheel {model.body(wheel).name!r} must be evenly spaced, one at the bottom"
        )
    return bodies[np.argsort(order)]


def _encoder(model: mujoco.MjModel, joint: int, file: str) -> int:
    mine = (model.sensor_type == mujoco.mjtSensor.mjSENS_JOINTPOS) & (model.sensor_objid == joint)
    if not mine.any():
        raise OmniError(f"{file}: no encoder on {model.joint(joint).name!r}; it is a <jointpos> sensor of that joint")
    return int(model.sensor_adr[np.flatnonzero(mine)[0]])


def _gyro(model: mujoco.MjModel, data: mujoco.MjData, chassis: int, file: str) -> int:
    for sensor in np.flatnonzero(model.sensor_type == mujoco.mjtSensor.mjSENS_GYRO):
        site = model.sensor_objid[sensor]
        if model.site_bodyid[site] == chassis:
            up = data.site_xmat[site].reshape(3, 3)[2, 2]
            if up < 1 - 1e-6:
                raise OmniError(f"{file}: the z axis of the gyro's site must point up, as the robot's does")
            return int(model.sensor_adr[sensor]) + 2
    raise OmniError(f"{file}: no gyro; it is a <gyro> sensor on a site of the body {model.body(chassis).name!r}")
