"""The settings of a scenario for a robot: the scenario's values, the robot's file and its own MJCF, and what follows.

The one function (scenario, robot) -> settings is `resolve`.
"""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omni_control.errors import OmniError
from omni_mj.config import robot_files
from omni_mj.config.robot_settings import ModelSettings
from omni_mj.config.settings import ControlSettings, Settings
from omni_mj.config.validation import SettingsModel, merge_sections, raise_errors

if TYPE_CHECKING:
    from omni_mj.mjcf.custom_robot import CustomRobotSpec

HARDWARE = (
    "body",
    "wheels",
    "motor",
    "firmware",
    "drivetrain",
    "carpet",
)  # sections from which [control] follows
FOLLOWING = [name for name, field in ControlSettings.model_fields.items() if field.default is None]
SAME = 1e-6  # relative difference of numbers that are equal


@dataclass(frozen=True)
class Robot:
    """A robot that was read and checked; whatever takes the name of a robot takes this too.

    Args:
        name: As it was asked for: a name, or the path of a .toml file.
        path: Its file.
        description: What the file says it is, in a line.
        settings: What it drives with if nothing else is said: the file's, and the defaults of all
            others.
        facts: What follows from its numbers; see `om.load_robot`.
    """

    name: str
    path: Path
    description: str
    settings: Settings
    facts: Mapping[str, float]

    def __str__(self) -> str:
        """Return its description, and a line for each fact."""
        return "\n".join(
            [f"{self.name}: {self.description}", *(f"  {k} {v:.3g}" for k, v in self.facts.items())]
        )


def resolve_settings(given: Mapping[str, Any], robot: str) -> Settings:
    """Return the settings of a scenario for a robot.

    What neither says of `[control]` follows from the robot's own file and model, not from what a
    scenario changes of the robot, which its team need not know.

    Args:
        given: The scenario's sections of settings.
        robot: Name of a robot, or the path of its .toml file.

    Raises:
        OmniError: A value is not allowed; neither gives a setting that depends on the robot; or the
            robot's MJCF cannot be read or contradicts what is given. A line for each.
    """
    file = robot_files.read_robot_sections(robot)
    whole = _with_model(file, given)
    raise_errors(
        f"{section}.{field} depends on the robot; give it in the scenario, or in {robot_files.find_robot_file(robot)}"
        for section, fields in robot_files.read_robot_sections(robot_files.DEFAULT_ROBOT).items()
        for field in fields
        if section != "control"
        and isinstance(whole.get(section, {}), Mapping)
        and field not in whole.get(section, {})
    )
    control = whole.get("control", {})
    if isinstance(control, Mapping):
        hardware = merge_sections(whole, {name: file[name] for name in HARDWARE if name in file})
        own = _with_model(
            {name: hardware[name] for name in (*HARDWARE, "model") if name in hardware}, {}
        )
        creep = {name: control[name] for name in ("assumed_creep_s2_m",) if name in control}
        following: dict[str, Any] = {}
        with suppress(OmniError):  # reported below, with all other errors
            beliefs = dict(Settings(**own, control=creep).control)
            following = {name: beliefs[name] for name in FOLLOWING}
        whole["control"] = following | dict(control)
    return Settings(**whole)


def read_model(model: ModelSettings) -> "CustomRobotSpec":
    """Return the robot's own MJCF that these settings name.

    Raises:
        OmniError: There is none, or it lacks something; a line for each.
    """
    from omni_mj.mjcf import custom_robot

    return custom_robot.read_custom_robot(model.file)


def _with_model(file: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return a robot's sections with those `given` above them, and the numbers of the MJCF that they name."""
    whole = merge_sections(file, given)
    model = whole.get("model", {})
    if isinstance(model, (str, Path)):
        model = {"file": str(model)}
    if isinstance(model, Mapping):
        whole["model"] = model = ModelSettings(**model)
    if isinstance(model, ModelSettings) and model.file:
        mjcf = read_model(model)
        raise_errors(find_model_contradictions(given, mjcf))
        whole = merge_sections(whole, mjcf.implied_settings)
    return whole


def find_model_contradictions(given: Mapping[str, Any], mjcf: "CustomRobotSpec") -> Iterator[str]:
    """Yield a line for each value of given sections that differs from a robot's own MJCF."""
    for section, fields in mjcf.implied_settings.items():
        values = given.get(section)
        for field, number in fields.items():
            other = (
                dict(values).get(field, number)
                if isinstance(values, (Mapping, SettingsModel))
                else number
            )
            if not _is_same(number, other):
                yield (
                    f"{section}.{field} = {other} contradicts {mjcf.file}, which has {number}; "
                    "change the model, or leave it out"
                )


def _is_same(number: Any, other: Any) -> bool:
    try:
        return np.shape(number) == np.shape(other) and np.allclose(
            number, other, rtol=SAME, atol=1e-9
        )
    except (TypeError, ValueError):
        return False
