"""Indices of a robot's parts in a compiled model, found by their function.

A wheel is a hinge that is driven by a <dcmotor> and has rollers. Wheels are numbered
counter-clockwise from forward, in any order of the file. Rollers are bodies with a hinge across the
axle, without a range and without further joints on them. They are all on one body, the rim: the
body of the wheel, or one on it, with or without a slip hinge along the axle. The encoder is the
<jointpos> sensor of the wheel's hinge. The chassis is the body with the <freejoint> that carries
the wheels, and the gyro is a <gyro> sensor on a site of the chassis, with its z axis up.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

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
_DCMOTOR_HINT = (
    'write <dcmotor joint=... motorconst=... resistance=... gear=... armature=... input="voltage"/>'
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

    The robots stand upright, and all bodies attached to a chassis belong to the robot.

    Raises:
        OmniError: Parts are missing. One line per part, with the element that is needed.
    """
    data = compute_initial_kinematics(model)
    wheels = _find_wheels(data)
    raise_errors(_list_missing_parts(data, wheels))
    return tuple(
        _index_robot(data, chassis, wheels_of_chassis)
        for chassis, wheels_of_chassis in wheels.items()
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
    wheels = _find_wheels(compute_initial_kinematics(model))
    return [model.body(chassis).name for chassis in wheels]


class _Wheel(NamedTuple):
    """A wheel, of which parts may be missing.

    Attributes:
        joint: Its hinge.
        motors: The <dcmotor>s that drive it.
        encoders: The <jointpos> sensors of its hinge.
        rims: Bodies that carry its rollers.
        slip_hinges: Hinges of the rim, without that of the wheel.
        rollers: Bodies in the order in which they reach the bottom.
        phase: Angle of the wheel at which the first roller is at the bottom, rad.
        is_even: Whether the rollers are evenly spaced.
    """

    joint: int
    motors: Ids
    encoders: Ids
    rims: Ids
    slip_hinges: list[int]
    rollers: Ids
    phase: float
    is_even: bool


def _find_wheels(data: mujoco.MjData) -> dict[int, list[_Wheel]]:
    """Return the wheels of each chassis, counter-clockwise from forward.

    Raises:
        OmniError: No <dcmotor> drives a hinge with rollers.
    """
    model = data.model
    is_dcmotor = model.actuator_gaintype == DCMOTOR
    is_at_joint = is_dcmotor & (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT)
    driven = model.actuator_trnid[is_at_joint, 0]
    hinges = np.flatnonzero(model.jnt_type == HINGE)
    is_driven = np.isin(hinges, driven)
    wheels = defaultdict[int, list[_Wheel]](list)
    known_rollers = set[int]()
    # Driven hinges first: of a hub and a rim on it, the driven one is the wheel.
    for joint in [*hinges[is_driven], *hinges[~is_driven]]:
        motors = np.flatnonzero(is_at_joint & (model.actuator_trnid[:, 0] == joint))
        rollers = _find_rollers(data, joint)
        chassis = int(model.body_rootid[model.jnt_bodyid[joint]])
        is_undriven_wheel = chassis in wheels and known_rollers.isdisjoint(rollers)
        if len(rollers) >= (RETAINED_ROLLERS if motors.size else MIN_COUNT) and (
            motors.size or is_undriven_wheel
        ):
            known_rollers.update(rollers)
            wheels[chassis].append(_measure_wheel(data, joint, motors, rollers))
    if not wheels:
        hint = "" if is_dcmotor.all() else f"; other actuators do not count: {_DCMOTOR_HINT}"
        raise OmniError(
            "no wheels; a wheel is a hinge that a <dcmotor> drives, with rollers: bodies on it "
            f"with a hinge each, without a range, across the axle{hint}"
        )

    def compute_azimuth(wheel: _Wheel) -> float:
        x, y, _ = data.xanchor[wheel.joint] - data.xpos[chassis]
        return float(np.round(np.degrees(np.arctan2(y, x)), AZIMUTH_DIGITS)) % 360

    return {chassis: sorted(wheels[chassis], key=compute_azimuth) for chassis in sorted(wheels)}


def _find_rollers(data: mujoco.MjData, joint: int) -> Ids:
    """Return the bodies with one hinge across that of a wheel, on the wheel's body or one on it."""
    model, axes = data.model, data.xaxis
    wheel, parent = model.jnt_bodyid[joint], model.body_parentid
    is_last_link = model.body_jntnum == 1
    is_last_link[parent[model.jnt_bodyid]] = False
    bodies = np.flatnonzero(((parent == wheel) | (parent[parent] == wheel)) & is_last_link)
    hinges = model.body_jntadr[bodies]
    is_hinge = (model.jnt_type[hinges] == HINGE) & (model.jnt_limited[hinges] == 0)
    is_across = np.abs(axes[hinges] @ axes[joint]) < _MAX_ROLLER_ALIGNMENT
    return bodies[is_hinge & is_across]


def _measure_wheel(data: mujoco.MjData, joint: int, motors: Ids, bodies: Ids) -> _Wheel:
    """Return a wheel from its hinge, its motors, and the bodies of its rollers in any order."""
    model, count = data.model, len(bodies)
    rims = np.unique(model.body_parentid[bodies])
    start = model.body_jntadr[rims[0]]
    slip_hinges = [i for i in range(start, start + model.body_jntnum[rims[0]]) if i != joint]
    is_position = model.sensor_type == mujoco.mjtSensor.mjSENS_JOINTPOS
    encoders = np.flatnonzero(is_position & (model.sensor_objid == joint))
    # Wheel angle at which each roller is at the bottom.
    spokes = data.xpos[bodies] - data.xanchor[joint]
    down = np.array([0.0, 0.0, -1.0])
    angles = np.arctan2(np.cross(spokes, down) @ data.xaxis[joint], spokes @ down)
    angles = angles + model.qpos0[model.jnt_qposadr[slip_hinges]].sum()
    if count == RETAINED_ROLLERS:
        rollers, phase, is_even = bodies[np.argsort(np.abs(angles))], 0.0, True
    else:
        pitch = 2 * np.pi / count
        # Circular mean of the angles modulo the pitch.
        phase = float(np.angle(np.exp(1j * angles * count).mean())) / count
        positions = np.rint((angles - phase) / pitch).astype(int)
        spacing_error = np.abs(angles - phase - positions * pitch).max()
        positions %= count
        is_even = spacing_error <= _MAX_SPACING_ERROR_RAD and len(set(positions)) == count
        rollers = bodies[np.argsort(positions)]
    return _Wheel(joint, motors, encoders, rims, slip_hinges, rollers, phase, is_even)


def _find_gyros(data: mujoco.MjData, chassis: int) -> tuple[Ids, Ids]:
    """Return the gyros on a chassis, and those of them whose z axis points up."""
    model = data.model
    gyros = np.flatnonzero(model.sensor_type == mujoco.mjtSensor.mjSENS_GYRO)
    gyros = gyros[model.site_bodyid[model.sensor_objid[gyros]] == chassis]
    return gyros, gyros[data.site_xmat[model.sensor_objid[gyros], 8] > 1 - 1e-6]


def _list_missing_parts(
    data: mujoco.MjData, wheels_by_chassis: Mapping[int, Sequence[_Wheel]]
) -> Iterator[str]:
    """Yield a line for each part that a robot lacks, with the element that is needed."""
    model = data.model
    for chassis, wheels in wheels_by_chassis.items():
        name = repr(model.body(chassis).name)
        is_free = model.jnt_type[model.body_jntadr[chassis]] == mujoco.mjtJoint.mjJNT_FREE
        if model.body_jntnum[chassis] != 1 or not is_free:
            yield f"the body {name}, which carries the wheels, has no <freejoint>"
        if len(wheels) < MIN_COUNT:
            yield f"{format_count(len(wheels), 'wheel')}; at least {MIN_COUNT} are needed"
        gyros, upright_gyros = _find_gyros(data, chassis)
        if not gyros.size:
            yield f"no gyro; it is a <gyro> sensor on a site of the body {name}"
        elif not upright_gyros.size:
            yield "the z axis of the gyro's site must point up, like the robot's"
        for wheel in wheels:
            yield from _list_missing_parts_of_wheel(model, wheel)
        counts = [len(wheel.rollers) for wheel in wheels]
        if len(set(counts)) > 1:
            yield f"wheels with different numbers of rollers: {counts}"
        if len({bool(wheel.slip_hinges) for wheel in wheels}) > 1:
            yield "some rims have a slip hinge, and some have none"


def _list_missing_parts_of_wheel(model: mujoco.MjModel, wheel: _Wheel) -> Iterator[str]:
    """Yield a line for each part that a wheel lacks or has twice."""
    hinge = repr(model.joint(wheel.joint).name)
    body = repr(model.body(model.jnt_bodyid[wheel.joint]).name)
    if not wheel.motors.size:
        yield f"{hinge} has rollers, but no <dcmotor> drives it: {_DCMOTOR_HINT}"
    if wheel.motors.size > 1:
        yield "two <dcmotor>s drive one hinge; leave one"
    if wheel.rims.size > 1:
        yield f"the rollers of the wheel {body} must be on one body, the wheel's or a rim on it"
    if not wheel.is_even:
        yield f"the {len(wheel.rollers)} rollers of the wheel {body} must be evenly spaced"
    if not wheel.encoders.size:
        yield f"no encoder on {hinge}; it is a <jointpos> sensor of that joint"


def _index_robot(data: mujoco.MjData, chassis: int, wheels: Sequence[_Wheel]) -> RobotIndices:
    """Return the indices of the robot with a chassis and wheels, of which no part is missing."""
    model = data.model
    joints = np.array([wheel.joint for wheel in wheels])
    slip_hinges = np.array([hinge for wheel in wheels for hinge in wheel.slip_hinges], int)
    rollers = np.array([wheel.rollers for wheel in wheels])
    _, (gyro, *_) = _find_gyros(data, chassis)
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
        rims=np.array([wheel.rims[0] for wheel in wheels]),
        slip_qpos=model.jnt_qposadr[slip_hinges],
        slip_dofs=model.jnt_dofadr[slip_hinges],
        rollers=rollers,
        roller_dofs=model.body_dofadr[rollers],
        motors=np.array([wheel.motors[0] for wheel in wheels]),
        encoders=np.array([model.sensor_adr[wheel.encoders[0]] for wheel in wheels]),
        gyro=int(model.sensor_adr[gyro]) + 2,
        phases=np.array([wheel.phase for wheel in wheels]),
    )
