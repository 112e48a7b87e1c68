"""Settings of a robot whose MJCF is a user's own: what that file says goes before what the robot's file says."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omni_control.errors import OmniError
from omni_mj.scenarios.checking import in_one, shown
from omni_mj.scenarios.nested import merged, plain

if TYPE_CHECKING:
    from omni_mj.mjcf.own import Own
    from omni_mj.scenarios.robot_settings import ModelSettings

SECTION = "model"
SAME = 1e-6  # relative, of numbers that are one
MOTOR = 0.01  # relative, of motors that are one


def read(model: "ModelSettings") -> "Own":
    """The model that these settings name.

    Raises:
        OmniError: there is none, or it lacks something; a line for each.
    """
    from omni_mj.mjcf import own

    return own.read(model.file, model.names)


def named(sections: Mapping[str, Any]) -> "ModelSettings | None":
    """The settings of a model, if these sections name one.

    Raises:
        OmniError: the section is none.
    """
    from omni_mj.scenarios.robot_settings import ModelSettings

    given = sections.get(SECTION, {})
    if isinstance(given, ModelSettings):
        return given if given.file else None
    if isinstance(given, (str, Path)):
        given = {"file": str(given)}
    if not isinstance(given, Mapping):
        raise OmniError(f"model is a section, or the path of an MJCF, not {shown(given)}")
    found = ModelSettings(**given)
    return found if found.file else None


def applied(robot: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """The sections of a robot's file with those `given` above them, and the numbers of the model that they name.

    Raises:
        OmniError: the model cannot be read, or what is given contradicts it; a line for each.
    """
    whole = merged(robot, given)
    model = named(whole)
    if model is None:
        return whole
    found = read(model)
    in_one([*contradictions(given, found), *_out_of_range(found)])
    return merged(whole, found.numbers() | {SECTION: model})


def _out_of_range(found: "Own") -> Iterator[str]:
    """What no settings could hold, in lines."""
    from omni_mj.scenarios.robot_settings import BodySettings, WheelSettings

    numbers = found.numbers()
    for kind, section in ((BodySettings, "body"), (WheelSettings, "wheels")):
        try:
            kind(**numbers[section])
        except OmniError as error:
            yield from (f"{found.file.name}: {line}" for line in str(error).splitlines())


def contradictions(given: Mapping[str, Any], found: "Own") -> Iterator[str]:
    """What of given sections is not what a model says, in lines."""
    for section, fields in found.numbers().items():
        values = given.get(section, {})
        for field, number in fields.items():
            value = values.get(field, number) if isinstance(values, Mapping) else getattr(values, field, number)
            if not _same(value, number, SAME):
                yield (
                    f"{section}.{field} = {shown(plain(value))} contradicts {found.file.name}, which has "
                    f"{told(number)}; change the model, or leave it out"
                )


def differences(robot: Mapping[str, Any], name: str, model: "ModelSettings") -> Iterator[str]:
    """In what a model differs from a robot's file, in lines.

    Args:
        robot: sections of the robot's file.
        name: of the robot.
        model: which there is.
    """
    if not model.file:
        return
    found = read(model)
    file = found.file.name
    for section, fields in found.numbers().items():
        for field, number in fields.items():
            before = robot.get(section, {}).get(field, number)
            if not _same(before, number, SAME):
                yield (
                    f"{section}.{field} is {told(number)} in {file}, {told(before)} in robot {name}: the model's is "
                    "simulated"
                )
    aside = float(found.body.centre[1])
    if abs(aside) > 5e-4:
        yield f"{file} has its centre of mass {1e3 * aside:.1f} mm to the left: simulated, not told to controllers"
    motor = robot.get("motor", {})
    for field, number in (("constant_nm_a", found.constant), ("resistance_ohm", found.resistance)):
        if not _same(before := motor.get(field, number), number, MOTOR):
            yield (
                f"motor.{field} is {told(number)} in {file}, {told(before)} in robot {name}: motors are the robot's, "
                "by their datasheet"
            )


def told(number: Any) -> str:
    """As messages have it."""
    if isinstance(number, (tuple, list)):
        return f"[{', '.join(map(told, number))}]"
    return f"{number:.6g}" if isinstance(number, (int, float)) else shown(number)


def _same(one: Any, other: Any, tolerance: float) -> bool:
    try:
        a, b = np.asarray(one, float), np.asarray(other, float)
    except (TypeError, ValueError):
        return False
    return a.shape == b.shape and bool(np.allclose(a, b, rtol=tolerance, atol=1e-9))
