"""Indices of a robot's parts in a compiled model, found by their function.

A wheel is a hinge that is driven by a <dcmotor> and has rollers. Wheels are numbered
counter-clockwise from forward, in any order of the file. Rollers are bodies with a hinge across the
axle, without a range and without further joints on them. They are all on one body, the rim: the
body of the wheel, or one on it, with or without a slip hinge along the axle. The encoder is the
<jointpos> sensor of the wheel's hinge. The chassis is the body with the <freejoint> that carries
the wheels, and the gyro is a <gyro> sensor on a site of the chassis, with its z axis up.
"""

from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config.robot_settings import AZIMUTH_DIGITS
from omni_mj.config.validation import raise_errors
from omni_mj.io.printable_text import format_count

Ids = NDArray[np.int_]
# Rollers of a wheel that is reduced to those at the bottom (`wheels.model = two-rollers`).
RETAINED_ROLLERS = 2
MIN_COUNT = 3  # least number of wheels, and of rollers of a wheel
HINGE = mujoco.mjtJoint.mjJNT_HINGE
DCMOTOR = mujoco.mjtGain.mjGAIN_DCMOTOR
_DCMOTOR_EXAMPLE = (
    '<dcmotor joint=... motorconst=... resistance=... gear=... armature=... input="voltage"/>'
)
_MAX_ROLLER_ALIGNMENT = 0.5  # cosine of the angle between the hinges of a roller and its wheel
_MAX_SPACING_ERROR_RAD = 1e-3
_KINDS = mujoco.mjtObj
# Kind of the elements of fields of `RobotIndices`; for addresses, the array of the first of each
_PARTS = (
    (_KINDS.mjOBJ_BODY, "", ("chassis", "wheels", "rims", "rollers")),
    (_KINDS.mjOBJ_JOINT, "", ("joints",)),
    (_KINDS.mjOBJ_ACTUATOR, "", ("motors",)),
    (_KINDS.mjOBJ_JOINT, "jnt_qposadr", ("qpos", "wheel_qpos", "slip_qpos")),
    (_KINDS.mjOBJ_JOINT, "jnt_dofadr", ("dofs", "wheel_dofs", "slip_dofs", "roller_dofs")),
    (_KINDS.mjOBJ_SENSOR, "sensor_adr", ("encoders", "gyro")),
)


@dataclass(frozen=True, eq=False)
class RobotIndices:
    """Indices of one robot's parts in a compiled model, and addresses of their state.

    Attributes:
        chassis: Body with the free joint.
        qpos: Addresses of all positions, (nq,), the free joint's seven first.
        dofs: Addresses of all degrees of freedom, (nv,), the free joint's six first.
        joints: Hinges of the wheels, (wheels,).
        wheel_qpos: Addresses of their angles, (wheels,).
        wheel_dofs: Addresses of their speeds, (wheels,).
        wheels: Bodies of the wheels, (wheels,).
        rims: Bodies of the rims, (wheels,).
        slip_qpos, slip_dofs: Addresses of the angles and speeds of the rims relative to the hubs,
            (wheels,), or (0,) without slip hinges.
        rollers: Bodies of the rollers, (wheels, rollers). The first one is at the bottom at the
            wheel angle 0; the others follow in the order in which they reach the bottom.
        roller_dofs: Addresses of their speeds, (wheels, rollers).
        motors: Actuators, (wheels,).
        encoders: Addresses in sensordata, (wheels,).
        gyro: Address in sensordata of the turn rate about the robot's z axis.
        phases: Angle of each wheel, minus its slip, at which its first roller is at the bottom,
            (wheels,) rad.
    """

    chassis: int
    qpos: Ids
    dofs: Ids
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

    @property
    def bodies(self) -> Ids:
        """Bodies of the chassis, wheels, rims and rollers, (n,)."""
        return np.array([self.chassis, *self.wheels, *self.rims, *self.rollers.ravel()])


def compute_initial_kinematics(model: mujoco.MjModel) -> mujoco.MjData:
    """Return the positions of all parts in the initial configuration of a model."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return data


def find_robots(model: mujoco.MjModel) -> tuple[RobotIndices, ...]:
    """Return the indices of all robots of a model, in the order of their bodies.

    The robots stand upright, and whatever is on a chassis belongs to the robot.

    Raises:
        OmniError: Parts are missing. One line per part, with the element that is needed.
    """
    data = compute_initial_kinematics(model)
    motors, chassis_of_motor = _find_wheel_motors(data)
    return tuple(
        _find_parts(data, int(chassis), motors[chassis_of_motor == chassis])
        for chassis in np.unique(chassis_of_motor)
    )


def find_by_names(
    robot: RobotIndices,
    source: mujoco.MjModel,
    model: mujoco.MjModel,
    prefixes: tuple[str, str],
) -> RobotIndices:
    """Return the indices of a robot in another model, in which its parts have other prefixes.

    Args:
        robot: Indices of the robot in the first model.
        source: The first model. All parts of the robot have names.
        model: The other model, which may contain anything else.
        prefixes: Prefixes of names in the first and in the other model.

    Raises:
        OmniError: The other model lacks a part.
    """

    def find_parts(kind: mujoco.mjtObj, ids: Ids) -> Any:
        """Return the indices of the elements with these indices in the first model."""
        indices = []
        for i in np.ravel(ids):
            name = mujoco.mj_id2name(source, kind, i).replace(*prefixes, 1)
            indices.append(mujoco.mj_name2id(model, kind, name))
            if indices[-1] < 0:
                raise OmniError(
                    f"the model has no {kind.name[6:].lower()} {name!r}: compile the scene to "
                    "which add_robot attached the robot"
                )
        return np.array(indices, int).reshape(np.shape(ids))[()]

    result: dict[str, Any] = {}
    for kind, address_field, fields in _PARTS:
        for field in fields:
            values = getattr(robot, field)
            if address_field:
                starts = getattr(source, address_field)
                ids = np.searchsorted(starts, values, side="right") - 1
                new_starts = getattr(model, address_field)[find_parts(kind, ids)]
                result[field] = new_starts + values - starts[ids]
            else:
                result[field] = find_parts(kind, values)
    return replace(robot, **result)


def find_roller_geoms(model: mujoco.MjModel, robot: RobotIndices) -> Ids:
    """Return the geoms of a robot's rollers, (n,)."""
    return np.flatnonzero(np.isin(model.geom_bodyid, robot.rollers))


def find_chassis_names(model: mujoco.MjModel) -> list[str]:
    """Return the names of the bodies that carry wheels, in any orientation.

    Raises:
        OmniError: There are none.
    """
    _, chassis_of_motor = _find_wheel_motors(compute_initial_kinematics(model))
    return [model.body(chassis).name for chassis in np.unique(chassis_of_motor)]


def find_slip_hinges(model: mujoco.MjModel, wheel: int, rim: int) -> list[int]:
    """Return the hinge on which a rim slips, in a list, or an empty list.

    Args:
        model: Compiled model.
        wheel: Hinge of the wheel.
        rim: Body of the rim: the wheel's own or one on it.
    """
    start, count = model.body_jntadr[rim], model.body_jntnum[rim]
    return [joint for joint in range(start, start + count) if joint != wheel]


def _find_wheel_motors(data: mujoco.MjData) -> tuple[Ids, Ids]:
    """Return the <dcmotor>s that drive wheels, and the chassis of each.

    Raises:
        OmniError: There are none, or a hinge with rollers on the same chassis has none.
    """
    model = data.model
    is_dc = model.actuator_gaintype == DCMOTOR
    hinges = np.flatnonzero(model.jnt_type == HINGE).tolist()
    rollers = {hinge: set(_find_rollers(data, hinge).tolist()) for hinge in hinges}
    wheels = [hinge for hinge in hinges if len(rollers[hinge]) >= RETAINED_ROLLERS]
    is_at_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    motors = np.flatnonzero(is_dc & is_at_joint & np.isin(model.actuator_trnid[:, 0], wheels))
    if not motors.size:
        hint = "" if is_dc.all() else f"; other actuators do not count: write {_DCMOTOR_EXAMPLE}"
        raise OmniError(
            "no wheels; a wheel is a hinge that a <dcmotor> drives, with rollers: bodies on it "
            f"with a hinge each, without a range, across the axle{hint}"
        )
    driven = model.actuator_trnid[motors, 0]
    chassis_of_joint = model.body_rootid[model.jnt_bodyid]
    errors, driven_rollers = list[str](), set[int]().union(*(rollers[hinge] for hinge in driven))
    for hinge in wheels:
        is_on_robot = chassis_of_joint[hinge] in chassis_of_joint[driven]
        is_driven = rollers[hinge] & driven_rollers  # also a hinge between hub and rim
        if is_on_robot and not is_driven and len(rollers[hinge]) >= MIN_COUNT:
            driven_rollers |= rollers[hinge]  # one error for hub and rim
            errors.append(
                f"{model.joint(hinge).name!r} has rollers, but no <dcmotor> drives it: "
                f"write {_DCMOTOR_EXAMPLE}"
            )
    raise_errors(errors)
    return motors, chassis_of_joint[driven]


def _find_rollers(data: mujoco.MjData, joint: int) -> Ids:
    """Return the bodies with one hinge across that of a wheel, on the wheel's body or one on it."""
    model, axes = data.model, data.xaxis
    wheel, parent = model.jnt_bodyid[joint], model.body_parentid
    bodies = np.flatnonzero(((parent == wheel) | (parent[parent] == wheel)) & _is_last_link(model))
    hinges = model.body_jntadr[bodies]
    is_hinge = (model.jnt_type[hinges] == HINGE) & (model.jnt_limited[hinges] == 0)
    is_across = np.abs(axes[hinges] @ axes[joint]) < _MAX_ROLLER_ALIGNMENT
    return bodies[is_hinge & is_across]


def _is_last_link(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Return whether each body has one joint, and none of the bodies on it has any."""
    is_last = model.body_jntnum == 1
    is_last[model.body_parentid[model.jnt_bodyid]] = False
    return is_last


def _find_parts(data: mujoco.MjData, chassis: int, motors: Ids) -> RobotIndices:
    """Return the indices of the robot with a chassis and motors.

    Raises:
        OmniError: Parts are missing. One line per part.
    """
    model, errors = data.model, list[str]()
    joints = model.actuator_trnid[motors, 0]
    x, y, _ = (data.xanchor[joints] - data.xpos[chassis]).T
    azimuths = np.degrees(np.arctan2(y, x))
    order = np.argsort(np.round(azimuths, AZIMUTH_DIGITS) % 360, kind="stable")
    motors, joints = motors[order], joints[order]
    _check_chassis_and_joints(model, chassis, joints, errors)
    rims, rollers, phases = zip(
        *(_order_rollers(data, joint, errors) for joint in joints), strict=True
    )
    gyro = _find_gyro(data, chassis, errors)
    encoders = [_find_encoder(model, joint, errors) for joint in joints]
    counts = [len(wheel_rollers) for wheel_rollers in rollers]
    slip_hinges = np.concatenate(
        [find_slip_hinges(model, joint, rim) for joint, rim in zip(joints, rims, strict=True)]
    ).astype(int)
    if len(set(counts)) > 1:
        errors.append(f"wheels with different numbers of rollers: {counts}")
    if 0 < len(slip_hinges) < len(joints):
        errors.append("some rims have a slip hinge, and some have none")
    raise_errors(errors)
    joint_of_qpos = np.repeat(np.arange(model.njnt), np.diff([*model.jnt_qposadr, model.nq]))
    is_own_joint = model.body_rootid[model.jnt_bodyid] == chassis
    return RobotIndices(
        chassis=chassis,
        qpos=np.flatnonzero(is_own_joint[joint_of_qpos]),
        dofs=np.flatnonzero(is_own_joint[model.dof_jntid]),
        joints=joints,
        wheel_qpos=model.jnt_qposadr[joints],
        wheel_dofs=model.jnt_dofadr[joints],
        wheels=model.jnt_bodyid[joints],
        rims=np.array(rims),
        slip_qpos=model.jnt_qposadr[slip_hinges],
        slip_dofs=model.jnt_dofadr[slip_hinges],
        rollers=np.array(rollers),
        roller_dofs=model.body_dofadr[np.array(rollers)],
        motors=motors,
        encoders=np.array(encoders),
        gyro=gyro,
        phases=np.array(phases),
    )


def _check_chassis_and_joints(
    model: mujoco.MjModel, chassis: int, joints: Ids, errors: list[str]
) -> None:
    """Append errors of the free joint, and of the number and the motors of the wheels."""
    free_joint = model.body_jntadr[chassis]
    is_free = model.jnt_type[free_joint] == mujoco.mjtJoint.mjJNT_FREE
    if model.body_jntnum[chassis] != 1 or not is_free:
        errors.append(
            f"the body {model.body(chassis).name!r}, which carries the wheels, has no <freejoint>"
        )
    if len(joints) < MIN_COUNT:
        errors.append(f"{format_count(len(joints), 'wheel')}; at least {MIN_COUNT} are needed")
    if len(set(joints.tolist())) < len(joints):
        errors.append("two <dcmotor>s drive one hinge; leave one")


def _order_rollers(data: mujoco.MjData, joint: int, errors: list[str]) -> tuple[int, Ids, float]:
    """Find the rollers of the wheel on a hinge.

    Returns:
        The rim that carries them, the rollers in the order in which they reach the bottom, and the
        wheel angle at which the first one is there, rad.
    """
    model = data.model
    wheel, bodies = model.jnt_bodyid[joint], _find_rollers(data, joint)
    name, axle = model.body(wheel).name, data.xaxis[joint]
    rims = np.unique(model.body_parentid[bodies])
    if len(rims) > 1:
        errors.append(
            f"the rollers of the wheel {name!r} must be on one body, the wheel's or a rim on it"
        )
    rim = rims[0]
    # Wheel angle at which each roller is at the bottom.
    spokes = data.xpos[bodies] - data.xanchor[joint]
    down = np.array([0.0, 0.0, -1.0])
    angles = np.arctan2(np.cross(spokes, down) @ axle, spokes @ down)
    slip_hinges = find_slip_hinges(model, joint, rim)
    angles = angles + model.qpos0[model.jnt_qposadr[slip_hinges]].sum()
    count = len(bodies)
    if count == RETAINED_ROLLERS:
        return rim, bodies[np.argsort(np.abs(angles))], 0.0
    pitch = 2 * np.pi / count
    # Circular mean of the angles modulo the pitch.
    phase = float(np.angle(np.exp(1j * angles * count).mean())) / count
    positions = np.rint((angles - phase) / pitch).astype(int)
    spacing_error = np.abs(angles - phase - positions * pitch).max()
    positions %= count
    if spacing_error > _MAX_SPACING_ERROR_RAD or len(set(positions)) < count:
        errors.append(f"the {count} rollers of the wheel {name!r} must be evenly spaced")
    return rim, bodies[np.argsort(positions)], phase


def _find_encoder(model: mujoco.MjModel, joint: int, errors: list[str]) -> int:
    """Return the address in sensordata of the encoder of a wheel's hinge, or -1 and an error."""
    is_position = model.sensor_type == mujoco.mjtSensor.mjSENS_JOINTPOS
    is_encoder = is_position & (model.sensor_objid == joint)
    if not is_encoder.any():
        errors.append(
            f"no encoder on {model.joint(joint).name!r}; it is a <jointpos> sensor of that joint"
        )
        return -1
    return int(model.sensor_adr[np.argmax(is_encoder)])


def _find_gyro(data: mujoco.MjData, chassis: int, errors: list[str]) -> int:
    """Return the address in sensordata of the turn rate of a gyro, or -1 and an error."""
    model = data.model
    gyros = np.flatnonzero(model.sensor_type == mujoco.mjtSensor.mjSENS_GYRO)
    sites = model.sensor_objid[gyros]
    on_chassis = np.flatnonzero(model.site_bodyid[sites] == chassis)
    is_upright = data.site_xmat[sites[on_chassis], 8] > 1 - 1e-6
    if not on_chassis.size:
        errors.append(
            f"no gyro; it is a <gyro> sensor on a site of the body {model.body(chassis).name!r}"
        )
        return -1
    if not is_upright.any():
        errors.append("the z axis of the gyro's site must point up, like the robot's")
    return int(model.sensor_adr[gyros[on_chassis[np.argmax(is_upright)]]]) + 2
