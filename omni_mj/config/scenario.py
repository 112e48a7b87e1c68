"""Scenarios: descriptions of experiments, from TOML files with overrides or from Python."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationInfo, field_validator

from omni_control.arguments import check_types
from omni_control.controllers.registry import CONTROLLERS
from omni_control.errors import OmniError, format_value
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
    merge_sections,
    raise_errors,
    setting,
)

MAX_SEEDS = 100_000
# Any text without control or other invisible characters (Unicode category C) and without
# separators of lines (Zl) and paragraphs (Zp).
ONE_LINE_PATTERN = r"^[^\p{C}\p{Zl}\p{Zp}]*$"
_EMPTY: Any = {}  # default of mappings, never changed


class Scenario(SettingsModel):
    """An experiment: settings, plant, robot, controllers and seeds.

    Settings may be given as sections by name. Missing values come from the robot's file, or are
    defaults.
    """

    unknown_name = "unknown name"

    name: Annotated[str, Field(pattern=r"^[\w-][\w.-]*$", max_length=MAX_NAME_LENGTH)] = setting(
        "scenario", "name in tables and folders: letters, digits and ._-"
    )
    description: Annotated[str, Field(pattern=ONE_LINE_PATTERN, max_length=500)] = setting(
        "", "description in one line"
    )
    paper_table: Literal[0, 3, 4] = setting(
        0, "number of the paper's table with the same experiment: 3 or 4; 0: none"
    )
    plant: str = setting("mujoco", "plant: a name of `omni-mj list plants`, or file.py:Class")
    robot: str = setting(
        robot_files.DEFAULT_ROBOT, "name of a robot, or path of a robot's .toml file"
    )
    controllers: tuple[plugins.ControllerSpec, ...] = setting(
        ("flc", "comp-flc"), "names of controllers, or file.py:Class", min_length=1
    )
    seed: int = setting(
        0,
        "first seed of the random numbers; others: seed + 1, seed + 2, ...",
        low=0,
        high=2**63 - 1 - MAX_SEEDS,
    )
    seeds: int = setting(1, "number of seeds", low=1, high=MAX_SEEDS)
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
        """Whether a controller or the plant is a class in a user's file."""
        specs = (*self.controllers, self.plant)
        return any(plugins.is_class_path(plugins.format_controller_spec(spec)) for spec in specs)

    @property
    def seed_list(self) -> list[int]:
        """All seeds: `seeds` consecutive integers from `seed`."""
        return [self.seed + i for i in range(self.seeds)]

    def settings_for_seed(self, seed: int) -> Settings:
        """Return the settings for a seed, with values drawn from the distributions.

        Raises:
            OmniError: A drawn value is not allowed.
        """
        return distributions.draw_settings(self.settings, self.distributions, seed)

    def replace(self, **values: Any) -> Self:
        """Return a validated copy with other values.

        Raises:
            OmniError: A value is not allowed, or `robot` is changed without `settings`.
        """
        robot = values.get("robot", self.robot)
        if isinstance(robot, str) and robot != self.robot and "settings" not in values:
            raise OmniError(
                "another robot has other settings: give robot= to load_scenario(...), or give "
                "settings= as well"
            )
        return super().replace(**values)

    def settings_to_dict(self) -> dict[str, Any]:
        """Return the settings by section as in a file: drawn values as distributions."""
        sections = self.settings.to_dict()
        for name, distribution in self.distributions.items():
            section, field = name.split(".")
            sections[section][field] = {distribution.kind: list(distribution.values)}
        return sections

    def to_toml(self) -> str:
        """Return the scenario with all settings as TOML. A scenario read from it is equal.

        A controller that was given as a class becomes its class path, `file.py:Class`.
        """
        specs = [plugins.format_controller_spec(spec) for spec in self.controllers]
        top_level = dict(self) | {"controllers": specs}
        sections = self.settings_to_dict()
        parameters = sections.pop("controller")
        fault_tables = sections.pop("fault")
        blocks = [(f"[{name}]", values) for name, values in sections.items()]
        for label, values in parameters.items():
            blocks.append((f"[controller.{format_toml_key(label)}]", values))
        blocks += [("[[fault]]", values) for values in fault_tables]
        lines = [f"{name} = {format_toml_value(top_level[name])}" for name in TOP_LEVEL_FIELDS]
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
        if plant not in plugins.PLANTS:  # the package's plants are not imported before a run
            plugins.find_plant(plant)
        return plant

    @field_validator("robot", mode="before")
    @classmethod
    def _check_robot(cls, robot: Any) -> Any:
        """Return the name of a robot that was given as a name, a path or a `Robot`."""
        if isinstance(robot, Robot):
            robot = robot.name
        elif isinstance(robot, Path):
            robot = str(robot)
        if isinstance(robot, str):
            robot_files.read_robot_sections(robot)
        return robot

    @field_validator("controllers", mode="before")
    @classmethod
    def _check_controllers(cls, specs: Any) -> tuple[plugins.ControllerSpec, ...]:
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
        """Return the settings for sections, after a check of faults and controllers' parameters."""
        valid_fields = info.data  # those declared before `settings` and without errors
        settings = sections
        if not isinstance(sections, Settings):
            if not isinstance(sections, Mapping):
                raise OmniError(f"settings must be sections by name, got {format_value(sections)}")
            settings = resolve_settings(
                sections, valid_fields.get("robot", robot_files.DEFAULT_ROBOT)
            )
        parameters = settings.controller
        errors: list[str] = []
        if "plant" in valid_fields:
            with collect_errors(errors):
                fault_checks.check_plant_supports(settings.fault, valid_fields["plant"])
        if "controllers" in valid_fields:
            with collect_errors(errors):
                parameters = plugins.validate_controller_parameters(
                    parameters, valid_fields["controllers"]
                )
        raise_errors(errors)
        if parameters == settings.controller:
            return settings
        return settings.replace(controller=parameters)


# Fields at the top of a scenario file, above the sections of settings: name, plant, seed, ...
TOP_LEVEL_FIELDS = tuple(
    name for name in Scenario.model_fields if name not in ("settings", "distributions")
)


@check_types
def load_scenario(
    name_or_path: str | Path,
    *,
    plant: str | None = None,
    robot: str | Path | Robot | None = None,
    controllers: Sequence[plugins.ControllerSpec] | None = None,
    seed: int | None = None,
    seeds: int | None = None,
    allow_code: bool = False,
    **sections: Any,
) -> Scenario:
    """Return a scenario by name or from a TOML file, with changes.

    For instance `load_scenario("rect", radio={"delay_frames": 9})`.

    Args:
        name_or_path: Name of a scenario of the package, or path of a TOML file.
        plant: Name of a plant, such as "mujoco", "planar" or "kinematic", or `file.py:Class`.
        robot: Name of a robot, path of its .toml file, or the result of `om.load_robot`.
        controllers: Names, classes derived from `omni_control.Controller`, or `file.py:Class`.
        seed: First seed.
        seeds: Number of consecutive seeds.
        allow_code: Whether classes that the scenario's file names, `file.py:Class`, may be run.
        sections: Values of settings by section and field.

    Raises:
        OmniError: There is no such scenario, a name is unknown, or a value is not allowed. The
            message has one line per error.
    """
    top_level = {
        "plant": plant,
        "robot": robot,
        "controllers": controllers,
        "seed": seed,
        "seeds": seeds,
    }
    top_level = {name: value for name, value in top_level.items() if value is not None}
    return load_with_overrides(str(name_or_path), (), top_level, allow_code, sections)


def load_with_overrides(
    name_or_path: str | None,
    overrides: Iterable[str] = (),
    top_level: Mapping[str, Any] = _EMPTY,
    allow_code: bool = False,
    sections: Mapping[str, Any] = _EMPTY,
) -> Scenario:
    """Return a scenario as the command line and `load_scenario` describe it.

    Values of the file are replaced by `overrides`, then by `sections` and `top_level`.

    Args:
        name_or_path: Name of a scenario of the package, or path of a TOML file. None: the defaults.
        overrides: Settings as `section.field=value`.
        top_level: Values of `TOP_LEVEL_FIELDS`, such as plant or seeds.
        allow_code: Whether classes that the scenario's file names, `file.py:Class`, may be run.
        sections: Values of settings by section and field.

    Raises:
        OmniError: As `load_scenario`.
    """
    data, name = ({}, "scenario") if name_or_path is None else read_scenario_file(name_or_path)
    if not allow_code:
        _check_no_user_code(data, top_level)
    errors: list[str] = []
    for override in overrides:
        with collect_errors(errors):
            apply_override(data, override)
    data = merge_sections(data, sections) | dict(top_level)
    fields: dict[str, Any] = {"name": name}
    settings_sections: dict[str, Any] = {}
    known_names = {**Settings.model_fields, **Scenario.model_fields}
    # An unknown table is an error of `Settings` ("unknown section"), another unknown value one of
    # `Scenario` ("unknown name").
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


def _check_no_user_code(data: Mapping[str, Any], top_level: Mapping[str, Any]) -> None:
    """Check that a scenario file refers to no user code, unless the caller replaces that field.

    Raises:
        OmniError: A plant or controller in the file's values is a class path, `file.py:Class`.
    """
    plants = [] if "plant" in top_level else [data.get("plant")]
    controllers = [] if "controllers" in top_level else data.get("controllers", [])
    specs = [*plants, *(controllers if isinstance(controllers, list) else [])]
    raise_errors(
        f"the scenario's file names code, {format_value(spec)}, which is not run without "
        "permission; name it yourself by --plant or --controller, or allow it by --allow-code "
        "(in Python: allow_code=True)"
        for spec in specs
        if isinstance(spec, str) and plugins.is_class_path(spec)
    )


def build_json_schema() -> dict[str, Any]:
    """Return the JSON Schema of scenario files. TOML editors use it to complete and check files.

    Names of plants, robots and controllers are not restricted, because users may have their own.
    In place of a number, the schema allows a table, such as `{uniform = [0.4, 0.9]}`.
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
                field["type"] = [field["type"], "object"]  # object: table of a distribution
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "a scenario of omni-mj",
        "type": "object",
        "additionalProperties": False,
        "properties": {name: scenario["properties"][name] for name in TOP_LEVEL_FIELDS} | sections,
        "$defs": definitions,
    }
