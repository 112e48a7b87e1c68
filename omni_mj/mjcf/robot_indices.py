"""Where a robot's parts are in a compiled model, found by what they do.

A wheel is a hinge driven by a <dcmotor> and has rollers, and wheels are numbered in the order of these motors. Rollers
are bodies with a hinge across the axle, all on one body, the rim: the wheel's body or one on it, with or without a
hinge along the axle on which it slips. The encoder is the <jointpos> sensor on the wheel's hinge. The body with the
<freejoint> that carries the wheels is the chassis, and the <gyro> is the one on a site of it.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config.validation import raise_errors

Ids = NDArray[np.int_]
# Rollers of a wheel that is computed with those at the bottom alone (`wheels.model = two-rollers`)
RETAINED_ROLLERS = 2
MIN_COUNT = 3  # wheels, or rollers of one
HINGE = mujoco.mjtJoint.mjJNT_HINGE
_WRITE = (
    'write <dcmotor joint=... motorconst=... resistance=... gear=... armature=... input="voltage"/>'
)
_ALONG = 0.5  # cosine of the angle to the axle, above which a hinge turns as the wheel does


@dataclass(frozen=True, eq=False)
class RobotIndices:
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
        slip_qpos, slip_dofs: addresses of the angles and speeds of the rims on the hubs, (wheels,),
            or none (0,).
        rollers: bodies, (wheels, rollers), the one at the bottom at the wheel angle 0 first, then
            in the order in which they come there as the wheel turns on.
        roller_dofs: addresses of their speeds, (wheels, rollers).
        motors: actuators, (wheels,).
        encoders: addresses in sensordata, (wheels,).
        gyro: address in sensordata of the turn rate about the robot's z axis.
        phases: how far each wheel must turn for its first roller to be at the bottom, less its
            slip, (wheels,) rad.
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
    phases: Array


def find_robots(model: mujoco.MjModel) -> tuple[RobotIndices, ...]:
    """Find the robots of a model, which stand upright in it, in the order of their bodies.

    Raises:
        OmniError: parts are missing; a line for each, with how to give it.
    """
    data, errors = mujoco.MjData(model), list[str]()
    mujoco.mj_kinematics(model, data)
    motors = _wheel_motors(model, data)
    roots = model.body_rootid[model.jnt_bodyid[model.actuator_trnid[motors, 0]]]
    robots = [
        _find_robot(model, data, int(root), motors[roots == root], errors)
        for root in np.unique(roots)
    ]
    raise_errors(dict.fromkeys(errors))
    return tuple(robot for robot in robots if robot)


def find_chassis_names(model: mujoco.MjModel) -> list[str]:
    """Names of the bodies that carry wheels, however they stand.

    Raises:
        OmniError: there are none.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    joints = model.actuator_trnid[_wheel_motors(model, data), 0]
    return [
        model.body(root).name for root in np.unique(model.body_rootid[model.jnt_bodyid[joints]])
    ]


def find_slip_hinges(model: mujoco.MjModel, wheel: int, rim: int) -> list[int]:
    """The hinge on which a rim slips, or none.

    Args:
        model: compiled.
        wheel: the wheel's hinge.
        rim: a body, the wheel's own or one on it.
    """
    first, count = model.body_jntadr[rim], model.body_jntnum[rim]
    return [joint for joint in range(first, first + count) if joint != wheel]


def _wheel_motors(model: mujoco.MjModel, data: mujoco.MjData) -> Ids:
    """Numbers of the <dcmotor>s that drive wheels; hinges that have rollers but no such motor are errors."""
    is_dc = model.actuator_gaintype == mujoco.mjtGain.mjGAIN_DCMOTOR
    motors = np.flatnonzero(is_dc & (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT))
    motors = np.array(
        [m for m in motors if _find_rollers(model, data, model.actuator_trnid[m, 0]).size], int
    )
    if not motors.size:
        raise OmniError(
            "no wheels; a wheel is a hinge that a <dcmotor> drives, with rollers, bodies on it with a hinge each, "
            "across the axle" + ("" if is_dc.all() else f"; other actuators drive none: {_WRITE}")
        )
    wheels = model.jnt_bodyid[model.actuator_trnid[motors, 0]]
    errors = []
    for joint in np.flatnonzero(model.jnt_type == HINGE).tolist():
        body = model.jnt_bodyid[joint]
        is_known = body in wheels or model.body_parentid[body] in wheels
        if not is_known and _find_rollers(model, data, joint).size >= MIN_COUNT:
            errors.append(
                f"{model.joint(joint).name!r} has rollers, but no <dcmotor> drives it: {_WRITE}"
            )
    raise_errors(errors)
    return motors


def _find_rollers(model: mujoco.MjModel, data: mujoco.MjData, joint: int) -> Ids:
    """Bodies on a hinge's body, or on one on that, that have a hinge each, across its axis."""
    wheel, parent, axes = model.jnt_bodyid[joint], model.body_parentid, data.xaxis
    hinged = (model.body_jntnum == 1) & (model.jnt_type[model.body_jntadr] == HINGE)
    across = np.abs(axes[model.body_jntadr] @ axes[joint]) < _ALONG
    return np.flatnonzero(hinged & across & ((parent == wheel) | (parent[parent] == wheel)))


def _find_robot(
    model: mujoco.MjModel, data: mujoco.MjData, chassis: int, motors: Ids, errors: list[str]
) -> RobotIndices | None:
    """Find the parts of a robot; None if some are missing, with a line of errors for each."""
    before, free = len(errors), int(model.body_jntadr[chassis])
    joints = model.actuator_trnid[motors, 0]
    if model.body_jntnum[chassis] != 1 or model.jnt_type[free] != mujoco.mjtJoint.mjJNT_FREE:
        errors.append(
            f"the body {model.body(chassis).name!r}, which carries the wheels, has no <freejoint>"
        )
    if len(joints) < MIN_COUNT:
        errors.append(f"{len(joints)} wheels; it takes {MIN_COUNT} to move in every direction")
    if len(set(joints.tolist())) < len(joints):
        errors.append("two <dcmotor>s drive one hinge; one must")
    parts = [_order_rollers(model, data, int(joint), errors) for joint in joints]
    gyro = _find_gyro(model, data, chassis, errors)
    encoders = [_find_encoder(model, int(joint), errors) for joint in joints]
    counts = [len(rollers) for _, rollers, _ in parts]
    rims = np.array([rim for rim, _, _ in parts])
    slips = [
        joint
        for joint, rim in zip(joints, rims, strict=True)
        for joint in find_slip_hinges(model, joint, rim)
    ]
    if len(set(counts)) > 1:
        errors.append(f"wheels with different numbers of rollers: {counts}")
    if 0 < len(slips) < len(joints):
        errors.append("some rims have a hinge to slip on, and some have none")
    if len(errors) > before:
        return None
    rollers = np.array([ids for _, ids, _ in parts])
    own = np.flatnonzero(
        model.body_rootid[model.jnt_bodyid] == chassis
    )  # joints, one after the other
    first, last = own[0], own[-1]
    qpos, dofs = [*model.jnt_qposadr, model.nq], [*model.jnt_dofadr, model.nv]
    return RobotIndices(
        chassis=chassis,
        qpos=range(int(qpos[first]), int(qpos[last + 1])),
        dofs=range(int(dofs[first]), int(dofs[last + 1])),
        joints=joints,
        wheel_qpos=model.jnt_qposadr[joints],
        wheel_dofs=model.jnt_dofadr[joints],
        wheels=model.jnt_bodyid[joints],
        rims=rims,
        slip_qpos=model.jnt_qposadr[np.array(slips, int)],
        slip_dofs=model.jnt_dofadr[np.array(slips, int)],
        rollers=rollers,
        roller_dofs=model.body_dofadr[rollers],
        motors=motors,
        encoders=np.array(encoders),
        gyro=gyro,
        phases=np.array([phase for _, _, phase in parts]),
    )


def _order_rollers(
    model: mujoco.MjModel, data: mujoco.MjData, joint: int, errors: list[str]
) -> tuple[int, Ids, float]:
    """A wheel's rim, its rollers in the order in which they come to the bottom, and how far off the first is, rad."""
    wheel, bodies = int(model.jnt_bodyid[joint]), _find_rollers(model, data, joint)
    name, axle = model.body(wheel).name, data.xaxis[joint]
    rims = np.unique(model.body_parentid[bodies])
    if len(rims) > 1:
        errors.append(
            f"the rollers of the wheel {name!r} must be on one body, the wheel's or a rim on it"
        )
    spokes, down = data.xpos[bodies] - data.xanchor[joint], np.array([0.0, 0.0, -1.0])
    ahead = np.arctan2(
        np.cross(spokes, down) @ axle, spokes @ down
    )  # how far the wheel must turn for each
    slips = find_slip_hinges(model, joint, int(rims[0]))
    ahead = ahead + (model.qpos0[model.jnt_qposadr[slips[0]]] if slips else 0.0)
    count = len(bodies)
    if count == RETAINED_ROLLERS:  # of a wheel whose other rollers are lumped
        return int(rims[0]), bodies[np.argsort(np.abs(ahead))], 0.0
    pitch = 2 * np.pi / count
    phase = float(np.angle(np.exp(1j * ahead * count).mean())) / count
    order = np.rint((ahead - phase) / pitch).astype(int)
    off = np.abs(ahead - phase - order * pitch).max()
    order %= count
    if off > 1e-3 or len(set(order)) < count:
        errors.append(f"the {count} rollers of the wheel {name!r} must be evenly spaced")
    return int(rims[0]), bodies[np.argsort(order)], phase


def _find_encoder(model: mujoco.MjModel, joint: int, errors: list[str]) -> int:
    sensors = (model.sensor_type == mujoco.mjtSensor.mjSENS_JOINTPOS) & (
        model.sensor_objid == joint
    )
    if not sensors.any():
        errors.append(
            f"no encoder on {model.joint(joint).name!r}; it is a <jointpos> sensor of that joint"
        )
        return -1
    return int(model.sensor_adr[np.argmax(sensors)])


def _find_gyro(model: mujoco.MjModel, data: mujoco.MjData, chassis: int, errors: list[str]) -> int:
    """Address of the turn rate that the first gyro of the chassis shows."""
    gyros = np.flatnonzero(model.sensor_type == mujoco.mjtSensor.mjSENS_GYRO)
    sites = model.sensor_objid[gyros]
    on_chassis = np.flatnonzero(model.site_bodyid[sites] == chassis)
    if not on_chassis.size:
        errors.append(
            f"no gyro; it is a <gyro> sensor on a site of the body {model.body(chassis).name!r}"
        )
        return -1
    if data.site_xmat[sites[on_chassis[0]]].reshape(3, 3)[2, 2] < 1 - 1e-6:
        errors.append("the z axis of the gyro's site must point up, as the robot's does")
    return int(model.sensor_adr[gyros[on_chassis[0]]]) + 2
