"""Complete a scenario's settings with those of its robot, and with defaults.

The value of a setting comes from the first of these that gives one:

1. the scenario's sections,
2. the robot's MJCF file, if it has one, which must not contradict the scenario,
3. the robot's TOML file,
4. for assumptions in `[control]`, the closed-form model of the robot as its files describe it
   (`omni_mj.config.nominal_model`). The team does not know which hardware the scenario changes.
5. the defaults in `omni_mj.config.settings`.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omni_control.errors import OmniError
from omni_mj.config import nominal_model, robot_files
from omni_mj.config.robot_files import DEFAULT_ROBOT
from omni_mj.config.robot_settings import ModelSettings
from omni_mj.config.settings import Settings, get_section_classes
from omni_mj.config.team_settings import ControlSettings
from omni_mj.config.validation import merge_sections, raise_errors

# Sections from which the assumptions of the team are derived.
HARDWARE_SECTIONS = ("body", "wheels", "motor", "firmware", "drivetrain", "carpet")
_NO_SECTIONS: Mapping[str, Any] = {}  # default of mappings, never changed


@dataclass(frozen=True)
class Robot:
    """A robot that was read and validated. It is accepted wherever the name of a robot is.

    Attributes:
        name: Name of the robot, or path of its .toml file, as it was requested.
        path: File of the robot.
        description: One-line description in the file.
        settings: The file's settings, completed with defaults.
        facts: Name -> quantity that follows from the settings; see `om.load_robot`.
    """

    name: str
    path: Path
    description: str
    settings: Settings
    facts: Mapping[str, float]

    def __str__(self) -> str:
        """Return the description, and a line for each fact."""
        facts = [f"  {name} {value:.3g}" for name, value in self.facts.items()]
        return "\n".join([f"{self.name}: {self.description}", *facts])


def resolve_settings(
    sections: Mapping[str, Any] = _NO_SECTIONS, robot: str = DEFAULT_ROBOT
) -> Settings:
    """Return the settings of a scenario with a robot.

    Args:
        sections: The scenario's sections of settings.
        robot: Name of a robot, or path of its .toml file.

    Raises:
        OmniError: A value is not allowed; a required value is missing; or the robot's MJCF cannot
            be read or contradicts the sections. The message has one line per error.
    """
    robot_sections = robot_files.read_robot_sections(robot)
    resolved = _merge_with_mjcf(robot_sections, sections)
    _check_required_values(resolved, robot)
    control = resolved.setdefault("control", {})
    if isinstance(control, Mapping):
        resolved["control"] = _derive_assumptions(resolved, robot_sections) | dict(control)
    return _build_settings(resolved)


def _merge_with_mjcf(
    robot_sections: Mapping[str, Any], sections: Mapping[str, Any]
) -> dict[str, Any]:
    """Return a robot's sections with those of a scenario and the values that its MJCF implies."""
    merged = merge_sections(robot_sections, sections)
    model = merged.get("model", {})
    if isinstance(model, (str, Path)):
        model = {"file": str(model)}
    if isinstance(model, Mapping):
        model = merged["model"] = ModelSettings(**model)
    if isinstance(model, ModelSettings) and model.file:
        # Imported here, because it imports MuJoCo, which most scenarios do not need for settings.
        from omni_mj.mjcf.custom_robot import read_custom_robot

        mjcf = read_custom_robot(model.file)
        raise_errors(mjcf.find_contradictions(sections))
        merged = merge_sections(merged, mjcf.implied_settings)
    return merged


def _check_required_values(sections: Mapping[str, Any], robot: str) -> None:
    """Check that sections have all values without a default, except assumptions.

    Raises:
        OmniError: A value is missing. The message has one line per value.
    """
    errors = []
    for section, settings in get_section_classes().items():
        values = sections.get(section, {})
        if section == "control" or not isinstance(values, Mapping):
            continue
        errors += [
            f"{section}.{name} depends on the robot; give it in the scenario, or in "
            f"{robot_files.find_robot_file(robot)}"
            for name, field in settings.model_fields.items()
            if field.is_required() and name not in values
        ]
    raise_errors(errors)


def _derive_assumptions(
    resolved: Mapping[str, Any], robot_sections: Mapping[str, Any]
) -> dict[str, float]:
    """Return the team's assumptions about the robot, as defaults of `[control]`.

    The assumptions follow from the robot's TOML and MJCF files, without the scenario's changes. If
    these are invalid alone, the assumptions follow from the resolved hardware. If this is invalid,
    too, they are 0: the error is reported later, together with all others.
    """
    control = resolved["control"]
    names = [name for name in ControlSettings.model_fields if name.startswith("assumed_")]
    placeholders = dict.fromkeys(names, 0.0)
    if "assumed_creep_s2_m" in control:
        placeholders["assumed_creep_s2_m"] = control["assumed_creep_s2_m"]
    robot_hardware = {name: robot_sections.get(name, {}) for name in HARDWARE_SECTIONS}
    for hardware in (robot_hardware, {}):  # {}: the resolved hardware
        with suppress(OmniError):
            sections = _merge_with_mjcf(merge_sections(resolved, hardware), {})
            settings = _build_settings(sections | {"control": placeholders, "fault": ()})
            return nominal_model.derive_assumptions(settings, control.get("assumed_creep_s2_m"))
    return placeholders


def _build_settings(sections: Mapping[str, Any]) -> Settings:
    """Return settings, with defaults for sections that are left out."""
    return Settings(**{name: {} for name in get_section_classes()} | dict(sections))
