"""The settings of a scenario for a robot: the scenario's values, the robot's file and its own MJCF, and what follows.

The one function (scenario, robot) -> settings is `resolve`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omni_control.errors import OmniError
from omni_mj.scenarios import robots
from omni_mj.scenarios.checking import in_one, merged, plain, shown
from omni_mj.scenarios.robot_settings import BodySettings, ModelSettings, WheelSettings
from omni_mj.scenarios.settings import Settings

if TYPE_CHECKING:
    from omni_mj.mjcf.own import Own

HARDWARE = "body", "wheels", "motor", "firmware", "drive", "carpet"  # sections from which [control] follows
SAME = 1e-6  # relative difference of numbers that are equal


@dataclass(frozen=True)
class Robot:
    """A robot that was read and checked; whatever takes the name of a robot takes this too.

    Args:
        name: As it was asked for: a name, or the path of a .toml file.
        path: Its file.
        description: What the file says it is, in a line.
        settings: What it drives with if nothing else is said: the file's, and the defaults of all others.
        facts: What follows from its numbers; see `om.robot`.
    """

    name: str
    path: Path
    description: str
    settings: Settings
    facts: Mapping[str, float]

    def __str__(self) -> str:
        """Return its description, and a line for each fact."""
        return "\n".join([f"{self.name}: {self.description}", *(f"  {k} {v:.3g}" for k, v in self.facts.items())])


def resolve(given: Mapping[str, Any], robot: str) -> Settings:
    """Return the settings of a scenario for a robot.

    What neither says of `[control]` follows from the robot's own file and model, not from what a scenario changes of
    the robot, which its team need not know.

    Args:
        given: The scenario's sections of settings.
        robot: Name of a robot, or the path of its .toml file.

    Raises:
        OmniError: A value is not allowed; neither gives a setting that depends on the robot; or the robot's MJCF cannot
            be read or contradicts what is given. A line for each.
    """
    file = robots.sections(robot)
    whole = _with_model(file, given)
    in_one(
        f"{section}.{field} depends on the robot; give it in the scenario, or in {robots.robot_path(robot)}"
        for section, fields in robots.sections(robots.DEFAULT).items()
        for field in fields
        if section != "control" and not _has(whole, section, field)
    )
    control = whole.get("control", {})
    if isinstance(control, Mapping):
        creep = {"creep_s2_m": control["creep_s2_m"]} if "creep_s2_m" in control else {}
        hardware = merged(whole, {name: file[name] for name in HARDWARE if name in file})
        hardware = _with_model({name: hardware[name] for name in (*HARDWARE, "model") if name in hardware}, {})
        try:
            follows = dict(Settings(**hardware | {"control": creep}).control)
        except OmniError:  # reported below, with all other errors
            follows = {}
        whole["control"] = {name: follows[name] for name in _FOLLOWING if name in follows} | dict(control)
    return Settings(**whole)


_FOLLOWING = ("lag_s", "drag_m_s", "creep_s2_m", "creep_sideways_s2_m", "alpha_forward", "alpha_sideways")


def read_model(model: ModelSettings) -> "Own":
    """Return the robot's own MJCF that these settings name.

    Raises:
        OmniError: There is none, or it lacks something; a line for each.
    """
    from omni_mj.mjcf import own  # imports MuJoCo

    return own.read(model.file)


def contradictions(given: Mapping[str, Any], mjcf: "Own") -> Iterator[str]:
    """Yield a line for each value of given sections that differs from a robot's own MJCF."""
    for section, field, number in _numbers(mjcf):
        values = given.get(section, {})
        value = values.get(field, number) if isinstance(values, Mapping) else getattr(values, field, number)
        if not _same(value, number):
            yield (
                f"{section}.{field} = {shown(plain(value))} contradicts {mjcf.file.name}, which has "
                f"{_text(number)}; change the model, or leave it out"
            )


def differences(robot: str, model: ModelSettings) -> Iterator[str]:
    """Yield a line for each number in which a robot's own MJCF, if there is one, differs from the robot's file."""
    if not model.file:
        return
    mjcf, file = read_model(model), robots.sections(robot)
    for section, field, number in _numbers(mjcf):
        file_number = file.get(section, {}).get(field, number)
        if not _same(file_number, number):
            yield (
                f"{section}.{field} is {_text(number)} in {mjcf.file.name}, {_text(file_number)} in robot {robot}: the "
                "model's is simulated"
            )
    aside = float(mjcf.body.centre[1])
    if abs(aside) > 5e-4:
        yield (
            f"{mjcf.file.name} has its centre of mass {1e3 * aside:.1f} mm to the left: simulated, not told to "
            "controllers"
        )


def _with_model(file: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return a robot's sections with those `given` above them, and the numbers of the MJCF that they name."""
    whole = merged(file, given)
    model = whole.get("model", {})
    if isinstance(model, (str, Path)):
        model = {"file": str(model)}
    if not isinstance(model, ModelSettings):
        if not isinstance(model, Mapping):
            raise OmniError(f"model is a section, or the path of an MJCF, not {shown(model)}")
        model = ModelSettings(**model)
    if not model.file:
        return whole
    mjcf = read_model(model)
    numbers, errors = mjcf.numbers(), list(contradictions(given, mjcf))
    for kind, section in ((BodySettings, "body"), (WheelSettings, "wheels")):
        try:
            kind(**numbers[section])
        except OmniError as error:
            errors += [f"{mjcf.file.name}: {line}" for line in str(error).splitlines()]
    in_one(errors)
    return merged(whole, numbers | {"model": model})


def _has(whole: Mapping[str, Any], section: str, field: str) -> bool:
    values = whole.get(section, {})
    return field in values if isinstance(values, Mapping) else True  # a whole section, or an error


def _numbers(mjcf: "Own") -> Iterator[tuple[str, str, Any]]:
    return ((section, field, value) for section, fields in mjcf.numbers().items() for field, value in fields.items())


def _text(number: Any) -> str:
    if isinstance(number, (tuple, list)):
        return f"[{', '.join(map(_text, number))}]"
    return f"{number:.6g}" if isinstance(number, (int, float)) else shown(number)


def _same(first_number: Any, second_number: Any) -> bool:
    try:
        a, b = np.asarray(first_number, float), np.asarray(second_number, float)
    except (TypeError, ValueError):
        return False
    return a.shape == b.shape and bool(np.allclose(a, b, rtol=SAME, atol=1e-9))
