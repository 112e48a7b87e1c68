"""Scenarios: what is run. They are made from TOML files, which override settings by name, or in Python."""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationInfo, field_validator

from omni_control.controllers import CONTROLLERS
from omni_control.controllers.base import Controller
from omni_control.errors import OmniError
from omni_mj.config import distributions, fault_checks, faults, plugins, robot_files
from omni_mj.config.resolve import Robot, resolve_settings
from omni_mj.config.settings import Settings
from omni_mj.config.toml_files import MAX_NAME_LENGTH, apply_override, read_scenario_file
from omni_mj.config.validation import (
    SettingsModel,
    collect_errors,
    format_value,
    merge_sections,
    raise_errors,
    setting,
)

_NOTHING: Any = {}
MOST_SEEDS = 100_000


class Scenario(SettingsModel):
    """What is run: the settings in force, the plant, the robot, the controllers and the seeds.

    Settings may be given as sections by name; they then start from the defaults that the robot's
    file gives.
    """

    unknown_name = "unknown name"

    name: Annotated[str, Field(pattern=r"^[\w-][\w.-]*$", max_length=MAX_NAME_LENGTH)] = setting(
        "scenario", "", "what it is called in tables and folders: letters, digits and ._-"
    )
    description: Annotated[str, Field(pattern=r"^[^\p{C}\p{Zl}\p{Zp}]*$", max_length=500)] = (
        setting("", "", "what it is, in a line")
    )
    paper_table: Literal[0, 3, 4] = setting(
        0, "", "the table of the paper (3 or 4) that reports the same experiment, or 0"
    )
    plant: str = setting(
        "mujoco", "", "what is driven: a plant that omni-mj list names, or file.py:Class"
    )
    robot: str = setting(
        robot_files.DEFAULT_ROBOT, "", "the name of a robot, or the path of a robot's .toml file"
    )
    controllers: tuple[str | type[Controller], ...] = setting(
        ("flc", "comp-flc"), "", "what drives it: names of controllers, or file.py:Class", 1
    )
    seed: int = setting(0, "", "first seed of the random numbers", 0, 2**63 - 1 - MOST_SEEDS)
    seeds: int = setting(1, "", "how many seeds, counting up from the first", 1, MOST_SEEDS)
    settings: Settings = Field(_NOTHING, validate_default=True)
    distributions: Mapping[str, Any] = Field(
        _NOTHING, description="settings that are drawn, each seed's its own"
    )

    @property
    def labels(self) -> tuple[str, ...]:
        """The names of the controllers in tables and files."""
        return tuple(plugins.label_controller(kind) for kind in self.controllers)

    @property
    def references_code(self) -> bool:
        """Whether its file names code: a controller or a plant of a user's own."""
        return any(
            plugins.is_class_reference(plugins.reference_controller(kind))
            for kind in (*self.controllers, self.plant)
        )

    @property
    def seed_list(self) -> list[int]:
        """The seeds; each is a row per controller."""
        return [self.seed + i for i in range(self.seeds)]

    def settings_for_seed(self, seed: int) -> Settings:
        """Return the settings of a seed's rows.

        Raises:
            OmniError: A drawn value is not allowed.
        """
        return distributions.draw_settings(self.settings, self.distributions, seed)

    def replace(self, **values: Any) -> Self:
        """Return a copy with other values, validated.

        Raises:
            OmniError: A value is not allowed, or another robot is given without settings.
        """
        if values.get("robot", self.robot) != self.robot and "settings" not in values:
            raise OmniError(
                "another robot has other settings: give robot= to load_scenario(...), or settings= as well"
            )
        return super().replace(**values)

    def settings_to_dict(self) -> dict[str, Any]:
        """Return the settings by section, as in a file, with distributions in place of values drawn from them."""
        sections = self.settings.to_dict()
        for name, each in self.distributions.items():
            section, field = name.split(".")
            sections[section][field] = {each.kind: list(each.values)}
        return sections

    def to_toml(self) -> str:
        """Return the effective scenario, every setting written out; reading it back gives an equal one.

        A controller that was given as a class is named by its file.
        """
        head = dict(self) | {
            "controllers": [plugins.reference_controller(kind) for kind in self.controllers]
        }
        sections = self.settings_to_dict()
        parameters, events = sections.pop("controller"), sections.pop("fault")
        tables = [(f"[{name}]", values) for name, values in sections.items()]
        tables += [(f"[controller.{_key(name)}]", values) for name, values in parameters.items()]
        tables += [("[[fault]]", values) for values in events]
        lines = [f"{name} = {_toml(head[name])}" for name in HEAD]
        for heading, values in tables:
            lines += [
                "",
                heading,
                *(f"{_key(name)} = {_toml(value)}" for name, value in values.items()),
            ]
        return "\n".join(lines) + "\n"

    @field_validator("plant")
    @classmethod
    def _plant(cls, plant: str) -> str:
        if plant not in plugins.PLANTS:  # those are imported when they are needed
            plugins.find_plant(plant)
        return plant

    @field_validator("robot", mode="before")
    @classmethod
    def _robot(cls, robot: Any) -> Any:
        name = (
            robot.name
            if isinstance(robot, Robot)
            else str(robot)
            if isinstance(robot, Path)
            else robot
        )
        if isinstance(name, str):
            robot_files.read_robot_sections(name)
        return name

    @field_validator("controllers", mode="before")
    @classmethod
    def _controllers(cls, kinds: Any) -> tuple[str | type[Controller], ...]:
        if not isinstance(kinds, (list, tuple)) or not kinds:
            raise ValueError(
                f"controllers must be a list of at least one name or class, not {format_value(kinds)}"
            )
        errors: list[str] = []
        for kind in kinds:
            with collect_errors(errors):
                if str(kind) not in CONTROLLERS:
                    plugins.find_controller(kind)
        labels = [plugins.label_controller(kind) for kind in kinds] if not errors else []
        raise_errors(
            [
                *errors,
                *(
                    f"controller {label!r} is named twice"
                    for label in labels
                    if labels.count(label) > 1
                ),
            ]
        )
        return tuple(kinds)

    @field_validator("settings", mode="before")
    @classmethod
    def _settings(cls, given: Any, info: ValidationInfo) -> Settings:
        """Return settings made of sections, with the controllers' parameters and the plant's faults validated."""
        head, errors = info.data, list[str]()
        settings = (
            given
            if isinstance(given, Settings)
            else resolve_settings(given, head.get("robot", robot_files.DEFAULT_ROBOT))
        )
        parameters = settings.controller
        if "plant" in head:
            with collect_errors(errors):
                fault_checks.check_plant_supports(settings.fault, head["plant"])
        if "controllers" in head:
            with collect_errors(errors):
                parameters = plugins.check_controller_parameters(parameters, head["controllers"])
        raise_errors(errors)
        return (
            settings
            if parameters == settings.controller
            else settings.replace(controller=parameters)
        )


HEAD = tuple(name for name in Scenario.model_fields if name not in ("settings", "distributions"))


def load_scenario(
    name_or_path: str | Path,
    *,
    plant: str | None = None,
    robot: str | Path | Robot | None = None,
    controllers: Sequence[str | type[Controller]] | None = None,
    seed: int | None = None,
    seeds: int | None = None,
    code: bool = False,
    **sections: Any,
) -> Scenario:
    """Return a scenario by name or from a TOML file, with changes: `load_scenario("rect", radio={"delay_frames": 9})`.

    Args:
        name_or_path: One of those that come with the package, or a file.
        plant: What is driven: "mujoco", "planar", "kinematic", or `file.py:Class`.
        robot: Name of a robot, path of its .toml file, or the result of `om.load_robot`.
        controllers: Names, classes derived from `omni_control.Controller`, or `file.py:Class`.
        seed: The first.
        seeds: How many.
        code: Whether controllers and plants of a user's own that the file names, `file.py:Class`,
            may be run.
        sections: Values of settings by section and field.

    Raises:
        OmniError: There is no such scenario, or something is unknown or not allowed; a line for
            each.
    """
    head = {
        "plant": plant,
        "robot": robot,
        "controllers": controllers,
        "seed": seed,
        "seeds": seeds,
    }
    return load_with_overrides(
        str(name_or_path),
        (),
        {k: value for k, value in head.items() if value is not None},
        code,
        sections,
    )


def load_with_overrides(
    name_or_path: str | None,
    overrides: Iterable[str] = (),
    head: Mapping[str, Any] = _NOTHING,
    code: bool = False,
    sections: Mapping[str, Any] = _NOTHING,
) -> Scenario:
    """Read a scenario by name or from a TOML file, change it, and validate all of it.

    Args:
        name_or_path: A built-in scenario, or a file; None for the defaults.
        overrides: Settings as `section.field=value`.
        head: Fields of `Scenario` itself, such as plant or seeds.
        code: Whether controllers and plants of a user's own that the file names, rather than
            `head`, may be run.
        sections: Values of settings by section and field.

    Raises:
        OmniError: No such scenario or file, not TOML, an unknown name, or a value that is not
            allowed; a line for each.
    """
    data, stem = ({}, "scenario") if name_or_path is None else read_scenario_file(name_or_path)
    if not code:
        _check_code(data, head)
    errors: list[str] = []
    for override in overrides:
        with collect_errors(errors):
            apply_override(data, override)
    data = merge_sections(data, sections) | dict(head)
    values: dict[str, Any] = {}
    own: dict[str, Any] = {}
    known = {**Settings.model_fields, **Scenario.model_fields}
    for name, value in data.items():
        is_section = name in known or isinstance(value, (Mapping, SettingsModel))
        (own if is_section and name not in HEAD else values)[name] = value
    with collect_errors(errors):
        settings, drawn = distributions.split_distributions(own)
        result = Scenario(**{"name": stem, **values, "settings": settings, "distributions": drawn})
        distributions.check_bounds(result.settings, result.distributions)
    raise_errors(errors)
    return result


def _check_code(data: Mapping[str, Any], head: Mapping[str, Any]) -> None:
    """Check that a file names no code but what the user names as well.

    Raises:
        OmniError: It does.
    """
    plants = [] if "plant" in head else [data.get("plant")]
    kinds = [] if "controllers" in head else data.get("controllers", [])
    raise_errors(
        f"the scenario's file names code, {format_value(name)}, which is not run unasked; name it yourself by "
        "--plant or --controller, or allow it by --allow-code (in Python: code=True)"
        for name in [*plants, *(kinds if isinstance(kinds, list) else [])]
        if isinstance(name, str) and plugins.is_class_reference(name)
    )


def _toml(value: Any) -> str:
    """Return a value in TOML; JSON writes the same, but escapes characters beyond U+FFFF and leaves DEL as it is."""
    if isinstance(value, dict):
        return (
            "{" + ", ".join(f"{_key(name)} = {_toml(each)}" for name, each in value.items()) + "}"
        )
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _toml(name)


def build_json_schema() -> dict[str, Any]:
    """Return the JSON Schema of a scenario's file, by which editors of TOML complete, explain and check it.

    Plants, robots and controllers are open, since they may be a user's own; numbers may be drawn.
    """
    scenario = Scenario.model_json_schema()
    definitions = scenario.pop("$defs")
    settings = definitions.pop("Settings")["properties"]
    definitions["Fault"]["properties"] |= {"kind": {"enum": list(faults.FAULT_KINDS)}}
    for kind in faults.FAULT_KINDS.values():
        definitions["Fault"]["properties"] |= kind.model_json_schema()["properties"]
    for name, section in definitions.items():
        if name != "Fault":
            section.pop("required", None)
            for field in section["properties"].values():
                if field.get("type") in (
                    "number",
                    "integer",
                ):  # or a distribution, of which numbers have bounds
                    field["type"] = [field["type"], "object"]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "a scenario of omni-mj",
        "type": "object",
        "additionalProperties": False,
        "properties": {name: scenario["properties"][name] for name in HEAD} | settings,
        "$defs": definitions,
    }
