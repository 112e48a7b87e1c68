"""Where a robot's parts are in a compiled model, found by what they do, or by names where that does not say it.

A wheel is a hinge driven by a <dcmotor>, and wheels are numbered in the order of these. Its rollers are the bodies
below it that have a hinge across the axle, all on one body, the rim: one on the wheel's or that itself, with or without
a hinge along the axle on which it slips. Its encoder is the <jointpos> sensor on its hinge. The body with the
<freejoint> that carries the wheels is the chassis, and the <gyro> is the one on a site of it.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from omni_control.errors import OmniError
from omni_control.kinematics import Array

Ids = NDArray[np.int_]
Names = Mapping[str, tuple[str, ...]]  # of parts, by the roles in ROLES
ROLES = "chassis", "wheels", "gyro", "hull"
KEPT = 2  # rollers of a wheel that is computed with those at the bottom alone (`two_rollers`)
LEAST = 3  # wheels, or rollers of one
_NOTHING: Names = {}
_JOINT = mujoco.mjtTrn.mjTRN_JOINT
_WRITE = 'write <dcmotor joint=... motorconst=... resistance=... gear=... armature=... input="voltage"/>'
_ALONG = 0.5  # cosine of the angle to the axle, above which a hinge turns as the wheel does


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
        phases: how far each wheel must turn for its first roller to be at the bottom, less its slip, (wheels,) rad.
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


def find(
    model: mujoco.MjModel, file: str, names: Names = _NOTHING, prefixes: Mapping[int, str] | None = None
) -> tuple[Robot, ...]:
    """Find robots of a model.

    Args:
        model: compiled; robots stand upright in it.
        file: named in messages.
        names: of parts that are not found by what they do.
        prefixes: which are sought, by their numbers in the order of bodies, and what is before the names of their
            parts. [all, nothing]

    Raises:
        OmniError: roles that nothing fills, by name, and what would fill them, a line each.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    roots = np.unique(model.body_rootid[model.jnt_bodyid[model.actuator_trnid[dc_motors(model), 0]]])
    if not roots.size:
        raise OmniError(f"{file}: no wheels; a wheel is a hinge that a <dcmotor> drives" + _other_motors(model))
    sought = dict.fromkeys(range(len(roots)), "") if prefixes is None else prefixes
    return tuple(
        _Finder(model, data, file, names, prefix).robot(int(roots[number])) for number, prefix in sought.items()
    )


def _other_motors(model: mujoco.MjModel) -> str:
    others = [name for i in range(model.nu) if (name := model.actuator(i).name)]
    if not model.nu:
        return ""
    return f"; actuators of other kinds ({', '.join(others) or model.nu}) drive none: {_WRITE}"


def dc_motors(model: mujoco.MjModel) -> Ids:
    """Numbers of the <dcmotor>s on joints."""
    return np.flatnonzero(
        (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_DCMOTOR)
        & (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT)
    )


def slip_hinges(model: mujoco.MjModel, wheel: int, rim: int) -> list[int]:
    """The hinge on which a rim slips, or none.

    Args:
        model: compiled.
        wheel: the wheel's hinge.
        rim: a body, the wheel's own or one on it.
    """
    first, count = model.body_jntadr[rim], model.body_jntnum[rim]
    return [joint for joint in range(first, first + count) if joint != wheel]


def below(model: mujoco.MjModel, body: int, ancestor: int) -> bool:
    """Whether a body hangs, over others or not, on another."""
    while body > ancestor:
        body = int(model.body_parentid[body])
        if body == ancestor:
            return True
    return False


class _Finder:
    """Finds the parts of one robot, and gathers what is missing."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, file: str, names: Names, prefix: str) -> None:
        self._model, self._data, self._file, self._names, self._prefix = model, data, file, names, prefix
        self._errors: list[str] = []

    def robot(self, chassis: int) -> Robot:
        model = self._model
        free = int(model.body_jntadr[chassis])
        if model.body_jntnum[chassis] != 1 or model.jnt_type[free] != mujoco.mjtJoint.mjJNT_FREE:
            self._say(f"the body {model.body(chassis).name!r}, which carries the wheels, has no <freejoint>")
        joints, motors = self._wheels(chassis)
        self._raise()
        parts = [self._rollers(int(joint)) for joint in joints]
        gyro = self._gyro(chassis)
        encoders = [self._encoder(int(joint)) for joint in joints]
        counts = [len(rollers) for _, rollers, _ in parts]
        if len(set(counts)) > 1:
            self._say(f"wheels with different numbers of rollers: {counts}")
        self._raise()
        rims = np.array([rim for rim, _, _ in parts])
        slips = [joint for joint, rim in zip(joints, rims, strict=True) for joint in slip_hinges(model, joint, rim)]
        if 0 < len(slips) < rims.size:
            raise OmniError(f"{self._file}: some rims have a hinge to slip on, and some have none")
        rollers = np.array([ids for _, ids, _ in parts])
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
            slip_qpos=model.jnt_qposadr[np.array(slips, int)],
            slip_dofs=model.jnt_dofadr[np.array(slips, int)],
            rollers=rollers,
            roller_dofs=model.body_dofadr[rollers],
            motors=motors,
            encoders=np.array(encoders),
            gyro=gyro,
            phases=np.array([phase for _, _, phase in parts]),
        )

    def _say(self, line: str) -> None:
        self._errors.append(f"{self._file}: {line}")

    def _raise(self) -> None:
        if self._errors:
            raise OmniError("\n".join(dict.fromkeys(self._errors)))

    def _named(self, kind: str, role: str, there: Iterable[int]) -> Iterator[int]:
        """Numbers of the elements of a kind that are named for a role, of those that there are for it."""
        for name in self._names.get(role, ()):
            try:
                yield int(getattr(self._model, kind)(self._prefix + name).id)
            except KeyError:
                names = [getattr(self._model, kind)(int(i)).name.removeprefix(self._prefix) for i in there]
                known = ", ".join(filter(None, names)) or "none with a name"
                self._say(f"there is no {kind} {name!r}, which {role!r} names; there are {known}")

    def _wheels(self, chassis: int) -> tuple[Ids, Ids]:
        """Hinges of the wheels and their motors."""
        model, motors = self._model, dc_motors(self._model)
        driven = model.actuator_trnid[motors, 0]
        mine = model.body_rootid[model.jnt_bodyid[driven]] == chassis
        motors, driven = motors[mine], driven[mine]
        if "wheels" in self._names:
            order = []
            for joint in self._named("joint", "wheels", driven):
                found = np.flatnonzero(driven == joint)
                if found.size != 1:
                    self._say(
                        f"{len(found) or 'no'} <dcmotor> drives {model.joint(joint).name!r}, which 'wheels' names; "
                        "one must"
                    )
                order += found[:1].tolist()
            motors, driven = motors[order], driven[order]
        else:
            self._undriven(chassis, driven)
        for joint in driven:
            if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE:
                self._say(f"the joint {model.joint(joint).name!r}, which a <dcmotor> drives, is no hinge")
        if len(driven) < LEAST and not self._errors:
            self._say(f"{len(driven)} wheels; it takes {LEAST} to move in every direction")
        if len(set(driven.tolist())) < len(driven):
            self._say("two <dcmotor>s drive one hinge; one must")
        return driven, motors

    def _undriven(self, chassis: int, driven: Ids) -> None:
        """Say which hinges look like wheels but have no motor."""
        model = self._model
        for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE):
            body = int(model.jnt_bodyid[joint])
            known = any(body == wheel or below(model, body, int(wheel)) for wheel in model.jnt_bodyid[driven])
            if known or model.body_rootid[body] != chassis or (count := len(self._rolling(int(joint)))) < LEAST:
                continue
            by = np.flatnonzero((model.actuator_trnid[:, 0] == joint) & (model.actuator_trntype == _JOINT))
            what = f"{model.actuator(by[0]).name!r}, which is none, does" if by.size else "nothing does"
            self._say(
                f"{model.joint(joint).name!r} has {count} rollers, but no <dcmotor> drives it: {what}; {_WRITE}, or "
                "name the hinges that are wheels: 'wheels'"
            )

    def _rolling(self, joint: int) -> Ids:
        """Bodies below a hinge that have a hinge each, across its axis."""
        model, axes, wheel = self._model, self._data.xaxis, int(self._model.jnt_bodyid[joint])
        hinged = (model.body_jntnum == 1) & (model.jnt_type[model.body_jntadr] == mujoco.mjtJoint.mjJNT_HINGE)
        across = np.abs(axes[model.body_jntadr] @ axes[joint]) < _ALONG
        return np.flatnonzero(hinged & across & [below(model, body, wheel) for body in range(model.nbody)])

    def _rollers(self, joint: int) -> tuple[int, Ids, float]:
        """A wheel's rim, its rollers in the order in which they come to the bottom, and the way of the first."""
        model, data, wheel = self._model, self._data, int(self._model.jnt_bodyid[joint])
        none = -1, np.zeros(0, int), 0.0
        name, axle = self._model.body(wheel).name, data.xaxis[joint]
        bodies = self._rolling(joint)
        if not bodies.size:
            self._say(
                f"the wheel {name!r} has no rollers, bodies on its rim with a hinge each, across the axle; if "
                f"{model.joint(joint).name!r} drives no wheel, name the hinges that do: 'wheels'"
            )
            return none
        rims = np.unique(model.body_parentid[bodies])
        if len(rims) > 1 or (rims[0] != wheel and model.body_parentid[rims[0]] != wheel):
            self._say(f"the rollers of the wheel {name!r} must be on one body, the wheel's or a rim on it")
            return none
        spokes, down = data.xpos[bodies] - data.xanchor[joint], np.array([0.0, 0.0, -1.0])
        ahead = np.arctan2(np.cross(spokes, down) @ axle, spokes @ down)  # how far the wheel must turn for each
        slips = slip_hinges(model, joint, int(rims[0]))
        ahead = ahead + (model.qpos0[model.jnt_qposadr[slips[0]]] if slips else 0.0)
        if len(bodies) == KEPT:  # of a wheel whose other rollers are lumped
            return int(rims[0]), bodies[np.argsort(np.abs(ahead))], 0.0
        pitch = 2 * np.pi / len(bodies)
        phase = float(np.angle(np.exp(1j * ahead * len(bodies)).mean())) / len(bodies)
        order = np.rint((ahead - phase) / pitch).astype(int)
        apart = np.abs(ahead - phase - order * pitch).max()
        order %= len(bodies)
        if apart > 1e-3 or len(set(order)) < len(bodies):
            self._say(f"the {len(bodies)} rollers of the wheel {name!r} must be evenly spaced")
            return none
        return int(rims[0]), bodies[np.argsort(order)], phase

    def _encoder(self, joint: int) -> int:
        model = self._model
        mine = (model.sensor_type == mujoco.mjtSensor.mjSENS_JOINTPOS) & (model.sensor_objid == joint)
        if not mine.any():
            self._say(f"no encoder on {model.joint(joint).name!r}; it is a <jointpos> sensor of that joint")
            return -1
        return int(model.sensor_adr[np.flatnonzero(mine)[0]])

    def _gyro(self, chassis: int) -> int:
        model = self._model
        gyros = np.flatnonzero(model.sensor_type == mujoco.mjtSensor.mjSENS_GYRO)
        mine = [int(sensor) for sensor in gyros if model.site_bodyid[model.sensor_objid[sensor]] == chassis]
        if "gyro" in self._names:
            chosen = list(self._named("sensor", "gyro", gyros))
            mine = [sensor for sensor in mine if sensor in chosen]
            if not chosen:
                return -1
        if not mine:
            self._say(f"no gyro; it is a <gyro> sensor on a site of the body {model.body(chassis).name!r}")
            return -1
        if len(mine) > 1:
            self._say(f"{len(mine)} gyros on the body {model.body(chassis).name!r}; name one: 'gyro'")
        if self._data.site_xmat[model.sensor_objid[mine[0]]].reshape(3, 3)[2, 2] < 1 - 1e-6:
            self._say("the z axis of the gyro's site must point up, as the robot's does")
        return int(model.sensor_adr[mine[0]]) + 2
