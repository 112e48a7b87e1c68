"""A user's own robot in MJCF: read, checked for what the program needs, and made ready for a world.

What is changed of the file, beside what every plant writes (motors' constants, friction of hinges):

- the robot stands upright with the origin of its chassis on the carpet, under where its axles meet;
- hinges of wheels turn the robot counter-clockwise about its middle where they are positive;
- rims get the hinge on which rubber creeps, where the file has none; without a rim it is on the wheel;
- nothing touches anything but rollers the carpet, and hulls each other; what else is in its world is left out.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from omni_control.errors import OmniError, printable
from omni_mj.mjcf import prepare, roles
from omni_mj.mjcf.files import parts_of
from omni_mj.mjcf.geometry import Body, Wheels
from omni_mj.mjcf.roles import Names, Robot, dc_motors


@dataclass(frozen=True, eq=False)
class Own:
    """A robot's model that was read.

    Attributes:
        file: it is in.
        spec: of the robot alone, ready to be attached; to be copied, not changed.
        model: compiled from it.
        robot: its parts.
        names: of parts, as the file says; of its hull those that there are.
        touching: names of the rollers' geoms that touch the carpet.
        wheels, body: what was measured of it.
        gear: turns of the motor for one of the wheel.
        rotor_inertia: of a motor with all that turns as fast, kg m^2.
    """

    file: Path
    spec: mujoco.MjSpec
    model: mujoco.MjModel
    robot: Robot
    names: Names
    touching: tuple[str, ...]
    wheels: Wheels
    body: Body
    gear: float
    rotor_inertia: float

    def numbers(self) -> dict[str, dict[str, Any]]:
        """What it says of settings, by section and field."""
        inertia = self.body.inertia
        x, _, z = (_round(value) for value in self.body.centre)
        return {
            "body": {
                "mass_kg": _round(self.body.mass),
                "centre_x_m": x,
                "centre_height_m": z,
                "yaw_inertia_kg_m2": _round(inertia[2, 2]),
                "tilt_inertia_kg_m2": _round((inertia[0, 0] + inertia[1, 1]) / 2),
            },
            "wheels": {
                "azimuths_deg": self.wheels.azimuths,
                "arm_m": self.wheels.arm,
                "radius_m": self.wheels.radius,
                "rollers": self.wheels.rollers,
                "roller_radius_m": self.wheels.roller_radius,
            },
            "motor": {"gear": self.gear, "rotor_inertia_kg_m2": self.rotor_inertia},
        }

    def unlike(self) -> Iterator[str]:
        """Yield why two rollers of a wheel could not stand for all, in lines."""
        model, rollers = self.model, self.robot.rollers
        mass, inertia = model.body_mass[rollers], np.sort(model.body_inertia[rollers], axis=-1)
        pairs = zip(self.robot.rims, self.robot.joints, strict=True)
        axles = np.stack([prepare.seen_from(model, int(rim), int(joint))[1] for rim, joint in pairs])
        along = np.einsum("wri,wi->wr", model.body_pos[rollers], axles)
        geoms = {len(np.flatnonzero(model.geom_bodyid == roller)) for roller in rollers.ravel()}
        if np.ptp(along, axis=1).max() > 1e-4 or np.ptp(mass) > 1e-6 or np.ptp(inertia, axis=(0, 1)).max() > 1e-9:
            yield "wheels.model = two-rollers needs rollers that are all alike, in one row; take rollers"
        elif geoms != {1}:
            yield "wheels.model = two-rollers needs rollers of one geom each; take rollers"


def read(file: str | Path) -> Own:
    """Read a robot's MJCF.

    Args:
        file: its path.

    Raises:
        OmniError: there is no such file, it is no MJCF, or it lacks what the program needs; a line for each.
    """
    path = Path(file)
    if not os.path.isfile(path):
        raise OmniError(f"there is no model {printable(str(path))}; give the path of a robot's MJCF: robot.xml")
    changed = tuple(part.stat().st_mtime_ns for part in parts_of(path) if part.is_file())
    return _read(path, path.resolve(), changed)


@lru_cache(maxsize=16)
def _read(path: Path, resolved: Path, changed: tuple[int, ...]) -> Own:
    file = path.name
    try:
        spec = mujoco.MjSpec.from_file(str(resolved))
    except ValueError as error:
        raise OmniError(f"{file}: {' '.join(str(error).split())}") from None
    if spec.compiler.settotalmass > 0:
        raise OmniError(f"{file}: <compiler settotalmass> scales what is compiled alone, not in a world; write masses")
    spec.compiler.discardvisual = spec.compiler.fusestatic = False  # all that is named stays
    names = _names(spec, file)
    prepare.name_all(spec)
    _compile(spec, file)  # so that what MuJoCo does not understand is said first
    chassis = _chassis(spec, names, file)
    prepare.isolate(spec, chassis)
    _compile(spec, f"{file}, with all but the body {chassis.name!r} left out")
    prepare.stand(chassis)
    model = _compile(spec, file)
    (robot,) = roles.find(model, file, names)
    touching = prepare.touching(spec, model, robot)
    wheels = Wheels.of(model, robot, _ids(model, touching), file)
    errors = [f"{file}: {line}" for line in _unfit(model, robot)]
    names["hull"] = _hull(spec, names, file, errors)
    if errors:
        raise OmniError("\n".join(dict.fromkeys(errors)))
    prepare.drive(spec, model, robot, wheels)
    prepare.lower(chassis, wheels.radius - wheels.height)
    model = _compile(spec, file)
    (robot,) = roles.find(model, file, names)
    motor, hub = int(robot.motors[0]), int(robot.wheel_dofs[0])
    gear = float(model.actuator_gear[motor, 0])
    rotor = float(model.actuator_armature[motor] + model.dof_armature[hub] / gear**2)
    body = Body.of(model, robot)
    return Own(path, spec, model, robot, names, touching, wheels, body, _round(gear), _round(rotor))


def _names(spec: mujoco.MjSpec, file: str) -> dict[str, tuple[str, ...]]:
    """Return the names of parts by role, from the file's custom data."""
    names = {text.name: tuple(text.data.split()) for text in spec.texts if text.name in roles.ROLES}
    for role in ("chassis", "gyro"):
        if len(names.get(role, ())) > 1:
            raise OmniError(f"{file}: {role!r} must name one, not {' '.join(names[role])}")
    return names


def _compile(spec: mujoco.MjSpec, file: str) -> mujoco.MjModel:
    try:
        return spec.compile()
    except ValueError as error:
        raise OmniError(f"{file}: {' '.join(str(error).split())}") from None


def _chassis(spec: mujoco.MjSpec, names: Names, file: str) -> mujoco.MjsBody:
    """The body that carries the wheels."""
    model = _compile(spec, file)
    if name := "".join(names.get("chassis", ())):
        if (chassis := spec.body(name)) is None:
            bodies = ", ".join(body.name for body in spec.worldbody.bodies)
            raise OmniError(f"{file}: there is no body {name!r}, which 'chassis' names; there are {bodies}")
        if chassis.parent.name != "world":
            raise OmniError(f"{file}: the body {chassis.name!r}, which 'chassis' names, must be one of the worldbody's")
        return chassis
    driven = model.actuator_trnid[dc_motors(model), 0]
    roots = np.unique(model.body_rootid[model.jnt_bodyid[driven]])
    if len(roots) > 1:
        bodies = ", ".join(model.body(root).name for root in roots)
        raise OmniError(f"{file}: <dcmotor>s drive {len(roots)} bodies, {bodies}; name the robot's: 'chassis'")
    if not len(roots):
        roles.find(model, file)  # which says so
    return spec.body(model.body(roots[0]).name)


def _ids(model: mujoco.MjModel, geoms: tuple[str, ...]) -> roles.Ids:
    return np.array([model.geom(name).id for name in geoms], int)


def _hull(spec: mujoco.MjSpec, names: Names, file: str, errors: list[str]) -> tuple[str, ...]:
    known, hull = {geom.name for geom in spec.geoms}, names.get("hull", ())
    errors += [f"{file}: there is no geom {name!r}, which 'hull' names" for name in hull if name not in known]
    return hull or tuple(geom.name for geom in spec.geoms if geom.classname.name == "hull")


def _unfit(model: mujoco.MjModel, robot: Robot) -> list[str]:
    """What a wheel or its motor cannot be here, in lines."""
    lines = []
    gears, armatures = model.actuator_gear[robot.motors, 0], model.actuator_armature[robot.motors]
    for motor, joint, gear, armature in zip(robot.motors, robot.joints, gears, armatures, strict=True):
        name, hinge = model.actuator(motor).name, model.joint(joint).name
        if gear <= 0:
            lines.append(f"the gear of the <dcmotor> {name!r} must be above 0, not {gear:g}; turn the hinge's axis")
        if armature + model.dof_armature[model.jnt_dofadr[joint]] <= 0:
            lines.append(f"the <dcmotor> {name!r} has no rotor: give its inertia in kg m^2, armature=")
        more = model.actuator_gainprm[motor, 2:], model.actuator_biasprm[motor], model.actuator_dynprm[motor]
        if any(each.any() for each in more):
            lines.append(
                f"the <dcmotor> {name!r} must be driven by a voltage, with motorconst, resistance, gear and armature "
                "alone; heat, friction and limits are in the robot's file"
            )
        if model.jnt_limited[joint] or model.jnt_stiffness[joint].any():
            lines.append(f"the hinge {hinge!r} has a range or a spring; a wheel turns freely")
    for what, values in (("gears", gears), ("rotors' inertias", armatures)):
        if np.ptp(values) > 1e-6 * np.abs(values).max():
            lines.append(f"motors must be alike, but their {what} are {', '.join(f'{value:g}' for value in values)}")
    return lines


def _round(value: float) -> float:
    """Without the last digits, which are rounding of the compiler's."""
    return float(f"{value:.10g}")
