"""Scenarios: what is run. They are made from TOML files, which override settings by name, or in Python."""

import inspect
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Self

from pydantic import Field, ValidationInfo, field_validator

from omni_control.controllers.base import Controller
from omni_control.errors import OmniError
from omni_control.registry import CONTROLLERS
from omni_mj.scenarios import controllers, distributions, faults, robots, user_files
from omni_mj.scenarios.checking import Checked, Setting, in_one, setting, shown
from omni_mj.scenarios.given import NAME_LETTERS, check_code, put, read_file
from omni_mj.scenarios.nested import merged
from omni_mj.scenarios.parameters import Parameters
from omni_mj.scenarios.plants import check_plant
from omni_mj.scenarios.settings import Settings

DESCRIPTION_LETTERS = 500  # at most
_NOTHING: Any = {}


class Scenario(Checked):
    """What is run: the settings in force, the plant, the robot, the controllers and the seeds.

    Settings may be given as sections by name; they then start from the defaults that the robot's file gives.
    """

    unknown = "unknown name"

    name: str = setting("scenario", "", "what it is called in tables and folders: letters, digits and ._-")
    description: str = setting("", "", "what it is, in a line")
    paper_table: int = setting(0, "", "the table of the paper (3 or 4) that reports the same experiment, or 0", 0, 4)
    plant: str = setting("mujoco", "", "what is driven: a plant that --list names, or file.py:Class")
    robot: str = setting(robots.DEFAULT, "", "the name of a robot, or the path of a robot's .toml file")
    controllers: tuple[str | type[Controller], ...] = setting(
        ("flc", "comp-flc"), "", "what drives it: names of controllers, or file.py:Class", 1
    )
    seed: int = setting(0, "", "first seed of the random numbers", 0, 2**63 - 1)
    seeds: int = setting(1, "", "how many seeds, counting up from the first", 1, 100_000)
    settings: Settings = Field(_NOTHING, validate_default=True)
    distributions: Mapping[str, Any] = Field(_NOTHING, description="settings that are drawn, each seed's its own")

    @property
    def labels(self) -> tuple[str, ...]:
        """What the controllers are called in tables and files."""
        return tuple(controllers.label(kind) for kind in self.controllers)

    @property
    def has_code(self) -> bool:
        """Whether its file names code: a controller or a plant of a user's own."""
        return any(user_files.names_class(controllers.written(kind)) for kind in (*self.controllers, self.plant))

    @property
    def seed_list(self) -> list[int]:
        """The seeds, one row of the batch each per controller."""
        return [self.seed + i for i in range(self.seeds)]

    @classmethod
    @cache
    def declared(cls) -> tuple[Setting, ...]:
        """What the declarations of its own fields say; those of the settings are in their sections."""
        return tuple(cls._declared(name) for name in cls.model_fields if name not in ("settings", "distributions"))

    def settings_of(self, seed: int) -> Settings:
        """The settings of a seed's rows; an `OmniError` where what is drawn is not allowed."""
        return distributions.drawn(self.settings, self.distributions, seed)

    def replace(self, **values: Any) -> Self:
        """A copy with other values, checked like any.

        Raises:
            OmniError: a value is not allowed, or another robot is given without settings.
        """
        if values.get("robot", self.robot) != self.robot and "settings" not in values:
            raise OmniError("another robot has other settings: give robot= to scenario(...), or settings= as well")
        return super().replace(**values)

    def plain_settings(self) -> dict[str, Any]:
        """The settings by section, as they stand in a file, distributions in place of what is drawn from them."""
        return distributions.written(self.settings.plain(), self.distributions)

    def to_toml(self) -> str:
        """The effective scenario, every setting written out; reading it back gives an equal one.

        A controller that was given as a class is named by its file.
        """
        head = dict(self) | {"controllers": [controllers.written(kind) for kind in self.controllers]}
        sections = self.plain_settings()
        named, happening = sections.pop("controller"), sections.pop("fault")
        tables = [(f"[{name}]", values) for name, values in sections.items()]
        tables += [(f"[controller.{_key(name)}]", values) for name, values in named.items()]
        tables += [("[[fault]]", values) for values in happening]
        lines = [f"{each.name} = {_toml(head[each.name])}" for each in self.declared()]
        for heading, values in tables:
            lines += ["", heading, *(f"{_key(name)} = {_toml(value)}" for name, value in values.items())]
        return "\n".join(lines) + "\n"

    @field_validator("name")
    @classmethod
    def _file_name(cls, name: str) -> str:
        if not re.fullmatch(r"[\w.-]+", name):
            raise ValueError(f"the name of a scenario may hold letters, digits and ._-, unlike {shown(name)}")
        if len(name) > NAME_LETTERS or name.startswith("."):  # files and folders are called so
            raise ValueError(
                f"the name of a scenario has 1 to {NAME_LETTERS} letters, the first no dot, unlike {shown(name)}"
            )
        return name

    @field_validator("description")
    @classmethod
    def _line(cls, text: str) -> str:
        if len(text) > DESCRIPTION_LETTERS or not text.isprintable():
            what = f"a line of at most {DESCRIPTION_LETTERS} letters without control characters"
            raise ValueError(f"description must be {what}, not {shown(text)}")
        return text

    @field_validator("paper_table")
    @classmethod
    def _of_paper(cls, table: int) -> int:
        if table not in (0, 3, 4):
            raise ValueError(f"paper_table must be 3, 4 or 0 (none), not {table}")
        return table

    @field_validator("plant")
    @classmethod
    def _plant(cls, plant: str) -> str:
        check_plant(plant)
        return plant

    @field_validator("robot", mode="before")
    @classmethod
    def _named(cls, robot: Any) -> Any:
        return robot.name if isinstance(robot, robots.Robot) else str(robot) if isinstance(robot, Path) else robot

    @field_validator("robot")
    @classmethod
    def _robot(cls, robot: str) -> str:
        robots.sections(robot)
        return robot

    @field_validator("controllers", mode="before")
    @classmethod
    def _controllers(cls, kinds: Any) -> tuple[str | type[Controller], ...]:
        if not isinstance(kinds, (list, tuple)) or not kinds or not all(_names_controller(kind) for kind in kinds):
            what = "a list of at least one name, or class derived from omni_control.Controller"
            raise ValueError(f"controllers must be {what}, not {shown(kinds)}")
        errors = []
        for kind in dict.fromkeys(kinds):
            try:
                if kind not in CONTROLLERS:
                    controllers.find(kind)
            except OmniError as error:
                errors.append(str(error))
        labels = [controllers.label(kind) for kind in kinds]
        twice = dict.fromkeys(label for label in labels if labels.count(label) > 1)
        errors += [f"controller {label!r} is named twice; name each once" for label in twice]
        in_one(errors)
        return tuple(kinds)

    @field_validator("seeds")
    @classmethod
    def _last_seed(cls, seeds: int, info: ValidationInfo) -> int:
        if info.data.get("seed", 0) + seeds > 2**63:  # each is a 64-bit column of the results
            raise ValueError("seed must leave the last seed, seed + seeds - 1, below 2^63")
        return seeds

    @field_validator("settings", mode="before")
    @classmethod
    def _settings(cls, given: Any, info: ValidationInfo) -> Settings:
        """Settings from sections, parameters that the controllers have, faults that the plant knows; all errors."""
        if not isinstance(given, (Mapping, Settings)):
            raise ValueError(f"settings must be Settings, or sections by name, not {shown(given)}")
        errors, settings, parameters = [], given, None
        try:
            if isinstance(given, Mapping):
                settings = Settings(**robots.completed(given, info.data.get("robot", robots.DEFAULT)))
        except OmniError as error:
            errors.append(str(error))
        try:
            parameters = _parameters(given, info.data.get("controllers"))
        except OmniError as error:
            errors.append(str(error))
        try:
            if isinstance(settings, Settings) and "plant" in info.data:
                faults.check_plant(settings.fault, info.data["plant"])
        except OmniError as error:
            errors.append(str(error))
        in_one(errors)
        assert isinstance(settings, Settings)
        return settings if parameters is None else settings.replace(controller=parameters)


def scenario(
    name_or_path: str | Path,
    *,
    plant: str | None = None,
    robot: str | Path | robots.Robot | None = None,
    controllers: Sequence[str | type[Controller]] | None = None,
    seed: int | None = None,
    seeds: int | None = None,
    code: bool = False,
    **sections: Any,
) -> Scenario:
    """A scenario by name or from a TOML file, with changes: `scenario("rect", radio={"delay_frames": 9})`.

    Args:
        name_or_path: one of those that come with the package, or a file.
        plant: what is driven: "mujoco", "planar", "kinematic", or `file.py:Class`.
        robot: name of a robot, path of its .toml file, or what `om.robot` gave.
        controllers: names, classes derived from `omni_control.Controller`, or `file.py:Class`.
        seed: the first.
        seeds: how many.
        code: whether controllers and plants of a user's own that the file names, `file.py:Class`, may be run.
        sections: values of settings by section and field.

    Raises:
        OmniError: there is no such scenario, or something is unknown or not allowed; a line for each.
    """
    data, stem = read_file(str(name_or_path))
    head = {"plant": plant, "robot": robot, "controllers": controllers, "seed": seed, "seeds": seeds}
    head = {name: value for name, value in head.items() if value is not None}
    if not code:
        check_code(data, head)
    return _made(merged(data, sections) | head, stem)


def load(
    name_or_path: str | None,
    overrides: Iterable[str] = (),
    head: Mapping[str, Any] | None = None,
    code: bool = False,
) -> Scenario:
    """Read a scenario by name or from a TOML file, apply `section.field=value` overrides, and check all of it.

    Without a name, all is as the defaults are. `head` replaces fields of `Scenario` itself, such as plant or seeds.
    Controllers and plants of a user's own that the file names, rather than `head`, are run if `code` says so.

    Raises:
        OmniError: no such scenario or file, not TOML; an unknown name, a value of the wrong type or out of range, each
            in a line.
    """
    data, stem = ({}, "scenario") if name_or_path is None else read_file(name_or_path)
    if not code:
        check_code(data, head or {})
    errors = []
    for override in overrides:
        try:
            put(data, override)
        except OmniError as error:
            errors.append(str(error))
    return _made(data | dict(head or {}), stem, errors)


def _made(data: Mapping[str, Any], stem: str, errors: Sequence[str] = ()) -> Scenario:
    """A scenario of what a file holds, unless there are `errors` already; all are raised as one."""
    head = {each.name for each in Scenario.declared()}
    sections = {key for key, value in data.items() if key not in head and isinstance(value, (Mapping, Checked))}
    sections |= data.keys() & {*Settings.model_fields, "settings"}
    values = {key: value for key, value in data.items() if key not in sections}
    try:
        settings, drawn = distributions.split({key: data[key] for key in data if key in sections})
        made = Scenario(**{"name": stem, **values, "settings": settings, "distributions": drawn})
        distributions.check(made.settings, made.distributions)
    except OmniError as error:
        in_one([*errors, str(error)])
        raise
    in_one(list(errors))
    return made


def _parameters(settings: Settings | Mapping[str, Any], kinds: Sequence[str | type[Controller]] | None) -> Any:
    """The parameters given, as the controllers have them; None without any, or without controllers that there are."""
    given = settings.controller if isinstance(settings, Settings) else settings.get("controller")
    if not given or not isinstance(given, Mapping) or kinds is None:
        return None
    return Parameters(**given).of(controllers.resolve(kinds))


def _names_controller(kind: Any) -> bool:
    return isinstance(kind, str) or (inspect.isclass(kind) and issubclass(kind, Controller))


def _toml(value: Any) -> str:
    """A value in TOML; JSON writes the same, but escapes characters beyond U+FFFF and leaves DEL as it is."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(name)} = {_toml(each)}" for name, each in value.items()) + "}"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _toml(name)
