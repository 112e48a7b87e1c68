"""Scenarios: what is run. They are made from TOML files with overrides, or in Python."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationInfo, field_validator

from omni_control.controllers.base import Controller
from omni_control.controllers.registry import CONTROLLERS
from omni_control.errors import OmniError
from omni_mj.config import distributions, fault_checks, faults, plugins, robot_files
from omni_mj.config.resolve import Robot, resolve_settings
from omni_mj.config.settings import Settings
from omni_mj.config.toml_files import (
    MAX_NAME_LENGTH,
    apply_override,
    format_toml_key,
    format_toml_value,
    read_scenario_file,
)
from omni_mj.config.validation import (
    SettingsModel,
    collect_errors,
    format_value,
    merge_sections,
    raise_errors,
    setting,
)

_EMPTY: Any = {}
MAX_SEEDS = 100_000


class Scenario(SettingsModel):
    """What is run: settings, plant, robot, controllers and seeds.

    Settings may be given as sections by name. Values that are left out are those of the robot.
    """

    unknown_name = "unknown name"

    name: Annotated[str, Field(pattern=r"^[\w-][\w.-]*$", max_length=MAX_NAME_LENGTH)] = setting(
        "scenario", "name in tables and folders: letters, digits and ._-"
    )
    description: Annotated[str, Field(pattern=r"^[^\p{C}\p{Zl}\p{Zp}]*$", max_length=500)] = (
        setting("", "description in one line")
    )
    paper_table: Literal[0, 3, 4] = setting(
        0, "number of the paper's table with the same experiment: 3 or 4; 0: none"
    )
    plant: str = setting("mujoco", "plant: a name of `omni-mj list plants`, or file.py:Class")
    robot: str = setting(
        robot_files.DEFAULT_ROBOT, "name of a robot, or path of a robot's .toml file"
    )
    controllers: tuple[str | type[Controller], ...] = setting(
        ("flc", "comp-flc"), "names of controllers, or file.py:Class", min_length=1
    )
    seed: int = setting(0, "first seed of the random numbers", low=0, high=2**63 - 1 - MAX_SEEDS)
    seeds: int = setting(1, "number of consecutive seeds", low=1, high=MAX_SEEDS)
    settings: Settings = Field(_EMPTY, validate_default=True)
    distributions: Mapping[str, Any] = Field(
        _EMPTY, description="distributions of settings that are drawn for each seed"
    )

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the controllers in tables and files."""
        return tuple(plugins.label_controller(spec) for spec in self.controllers)

    @property
    def names_user_code(self) -> bool:
        """Whether its file names code: a controller or plant in a user's file."""
        specs = (*self.controllers, self.plant)
        return any(plugins.is_class_path(plugins.format_controller_spec(spec)) for spec in specs)

    @property
    def seed_list(self) -> list[int]:
        """All seeds."""
        return [self.seed + i for i in range(self.seeds)]

    def settings_for_seed(self, seed: int) -> Settings:
        """Return the settings of a seed, with values drawn from distributions.

        Raises:
            OmniError: A drawn value is not allowed.
        """
        return distributions.draw_settings(self.settings, self.distributions, seed)

    def replace(self, **values: Any) -> Self:
        """Return a validated copy with other values.

        Raises:
            OmniError: A value is not allowed, or another robot is given without settings.
        """
        if values.get("robot", self.robot) != self.robot and "settings" not in values:
            raise OmniError(
                "another robot has other settings: give robot= to load_scenario(...), or settings= "
                "as well"
            )
        return super().replace(**values)

    def settings_to_dict(self) -> dict[str, Any]:
        """Return the settings by section, as in a file, with distributions in place of values."""
        sections = self.settings.to_dict()
        for name, distribution in self.distributions.items():
            section, field = name.split(".")
            sections[section][field] = {distribution.kind: list(distribution.values)}
        return sections

    def to_toml(self) -> str:
        """Return the effective scenario with all settings. Reading it back gives an equal one.

        A controller that was given as a class is named by its file.
        """
        specs = [plugins.format_controller_spec(spec) for spec in self.controllers]
        head = dict(self) | {"controllers": specs}
        sections = self.settings_to_dict()
        parameters = sections.pop("controller")
        fault_tables = sections.pop("fault")
        blocks = [(f"[{name}]", values) for name, values in sections.items()]
        for label, values in parameters.items():
            blocks.append((f"[controller.{format_toml_key(label)}]", values))
        blocks += [("[[fault]]", values) for values in fault_tables]
        lines = [f"{name} = {format_toml_value(head[name])}" for name in TOP_LEVEL_FIELDS]
        for heading, values in blocks:
            lines += ["", heading]
            lines += [
                f"{format_toml_key(name)} = {format_toml_value(value)}"
                for name, value in values.items()
            ]
        return "\n".join(lines) + "\n"

    @field_validator("plant")
    @classmethod
    def _check_plant(cls, plant: str) -> str:
        if plant not in plugins.PLANTS:  # those of the package are imported when they are needed
            plugins.find_plant(plant)
        return plant

    @field_validator("robot", mode="before")
    @classmethod
    def _check_robot(cls, robot: Any) -> Any:
        if isinstance(robot, Robot):
            robot = robot.name
        elif isinstance(robot, Path):
            robot = str(robot)
        if isinstance(robot, str):
            robot_files.read_robot_sections(robot)
        return robot

    @field_validator("controllers", mode="before")
    @classmethod
    def _check_controllers(cls, specs: Any) -> tuple[str | type[Controller], ...]:
        if not isinstance(specs, (list, tuple)) or not specs:
            raise ValueError(
                "controllers must be a list of at least one name or class, "
                f"not {format_value(specs)}"
            )
        errors: list[str] = []
        for spec in specs:
            with collect_errors(errors):
                if str(spec) not in CONTROLLERS:
                    plugins.find_controller(spec)
        if not errors:
            labels = [plugins.label_controller(spec) for spec in specs]
            errors = [
                f"controller {label!r} is named twice"
                for label in labels
                if labels.count(label) > 1
            ]
        raise_errors(errors)
        return tuple(specs)

    @field_validator("settings", mode="before")
    @classmethod
    def _resolve_settings(cls, sections: Any, info: ValidationInfo) -> Settings:
        """Resolve sections to settings; check faults and parameters of controllers."""
        head = info.data  # fields that were validated before
        settings = sections
        if not isinstance(sections, Settings):
            settings = resolve_settings(sections, head.get("robot", robot_files.DEFAULT_ROBOT))
        parameters = settings.controller
        errors: list[str] = []
        if "plant" in head:
            with collect_errors(errors):
                fault_checks.check_plant_supports(settings.fault, head["plant"])
        if "controllers" in head:
            with collect_errors(errors):
                parameters = plugins.validate_controller_parameters(parameters, head["controllers"])
        raise_errors(errors)
        if parameters == settings.controller:
            return settings
        return settings.replace(controller=parameters)


TOP_LEVEL_FIELDS = tuple(
    name for name in Scenario.model_fields if name not in ("settings", "distributions")
)


def load_scenario(
    name_or_path: str | Path,
    *,
    plant: str | None = None,
    robot: str | Path | Robot | None = None,
    controllers: Sequence[str | type[Controller]] | None = None,
    seed: int | None = None,
    seeds: int | None = None,
    allow_code: bool = False,
    **sections: Any,
) -> Scenario:
    """Return a scenario by name or from a TOML file, with changes.

    For instance `load_scenario("rect", radio={"delay_frames": 9})`.

    Args:
        name_or_path: Name of a scenario of the package, or path of a TOML file.
        plant: Plant: "mujoco", "planar", "kinematic", or `file.py:Class`.
        robot: Name of a robot, path of its .toml file, or the result of `om.load_robot`.
        controllers: Names, classes derived from `omni_control.Controller`, or `file.py:Class`.
        seed: First seed.
        seeds: Number of seeds.
        allow_code: Whether classes that the scenario's file names, `file.py:Class`, may be run.
        sections: Values of settings by section and field.

    Raises:
        OmniError: There is no such scenario, a name is unknown, or a value is not allowed; a line
            for each error.
    """
    head = {
        "plant": plant,
        "robot": robot,
        "controllers": controllers,
        "seed": seed,
        "seeds": seeds,
    }
    head = {name: value for name, value in head.items() if value is not None}
    return load_with_overrides(str(name_or_path), (), head, allow_code, sections)


def load_with_overrides(
    name_or_path: str | None,
    overrides: Iterable[str] = (),
    head: Mapping[str, Any] = _EMPTY,
    allow_code: bool = False,
    sections: Mapping[str, Any] = _EMPTY,
) -> Scenario:
    """Return a scenario as the command line describes it; the base of `load_scenario`.

    Args:
        name_or_path: Name of a scenario of the package, or path of a TOML file. None: the defaults.
        overrides: Settings as `section.field=value`.
        head: Fields of `Scenario` itself, such as plant or seeds.
        allow_code: Whether classes that the scenario's file names, `file.py:Class`, may be run.
        sections: Values of settings by section and field.

    Raises:
        OmniError: As `load_scenario`.
    """
    data, name = ({}, "scenario") if name_or_path is None else read_scenario_file(name_or_path)
    if not allow_code:
        _check_no_code(data, head)
    errors: list[str] = []
    for override in overrides:
        with collect_errors(errors):
            apply_override(data, override)
    data = merge_sections(data, sections) | dict(head)
    fields: dict[str, Any] = {"name": name}
    settings_sections: dict[str, Any] = {}
    known_names = {**Settings.model_fields, **Scenario.model_fields}
    for key, value in data.items():
        is_section = key in known_names or isinstance(value, (Mapping, SettingsModel))
        target = settings_sections if is_section and key not in TOP_LEVEL_FIELDS else fields
        target[key] = value
    with collect_errors(errors):
        fields["settings"], fields["distributions"] = distributions.split_distributions(
            settings_sections
        )
        scenario = Scenario(**fields)
        distributions.check_bounds(scenario.settings, scenario.distributions)
    raise_errors(errors)
    return scenario


def _check_no_code(data: Mapping[str, Any], head: Mapping[str, Any]) -> None:
    """Check that a file names no classes in files, except in fields that the user overrides.

    Raises:
        OmniError: It does.
    """
    plants = [] if "plant" in head else [data.get("plant")]
    controllers = [] if "controllers" in head else data.get("controllers", [])
    specs = [*plants, *(controllers if isinstance(controllers, list) else [])]
    raise_errors(
        f"the scenario's file names code, {format_value(spec)}, which is not run unasked; name it "
        "yourself by --plant or --controller, or allow it by --allow-code "
        "(in Python: allow_code=True)"
        for spec in specs
        if isinstance(spec, str) and plugins.is_class_path(spec)
    )


def build_json_schema() -> dict[str, Any]:
    """Return the JSON Schema of scenario files, with which TOML editors complete and check them.

    Names of plants, robots and controllers are not restricted, because users may have their own.
    Numbers may be drawn from distributions.
    """
    scenario = Scenario.model_json_schema()
    definitions = scenario.pop("$defs")
    sections = definitions.pop("Settings")["properties"]
    fault_properties = definitions["Fault"]["properties"]
    fault_properties["kind"] = {"enum": list(faults.FAULT_KINDS)}
    for fault_class in faults.FAULT_KINDS.values():
        fault_properties |= fault_class.model_json_schema()["properties"]
    for name, section in definitions.items():
        if name == "Fault":
            continue
        section.pop("required", None)
        for field in section["properties"].values():
            if field.get("type") in ("number", "integer"):
                field["type"] = [field["type"], "object"]  # object: a distribution
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "a scenario of omni-mj",
        "type": "object",
        "additionalProperties": False,
        "properties": {name: scenario["properties"][name] for name in TOP_LEVEL_FIELDS} | sections,
        "$defs": definitions,
    }
