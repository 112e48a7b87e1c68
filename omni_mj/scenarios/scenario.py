"""Scenarios: TOML files that override settings by name; reading, checking, writing them."""

import dataclasses
import json
import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from omni_control.errors import OmniError, choose
from omni_control.reference.curves import CURVES
from omni_mj.scenarios import controllers
from omni_mj.scenarios.settings import Settings

PLANTS = ("mujoco", "kinematic")


@dataclass(frozen=True)
class Scenario:
    """What is run: the settings in force, the plant, the controllers and the seeds.

    `paper_table` is the table of the paper (3 or 4) that reports the same experiment, or 0.
    """

    name: str
    description: str = ""
    paper_table: int = 0
    plant: str = "mujoco"
    controllers: tuple[str, ...] = ("flc", "comp-flc")
    seed: int = 0
    seeds: int = 1
    settings: Settings = field(default_factory=Settings)

    @property
    def labels(self) -> tuple[str, ...]:
        """What the controllers are called in tables and files."""
        return tuple(controllers.label(name) for name in self.controllers)

    @property
    def seed_list(self) -> list[int]:
        """The seeds, one row of the batch each per controller."""
        return [self.seed + i for i in range(self.seeds)]

    def to_toml(self) -> str:
        """The effective scenario, every setting written out; reading it back gives an equal one."""
        lines = [f"{f.name} = {_toml(getattr(self, f.name))}" for f in dataclasses.fields(self) if f.name != "settings"]
        for section in dataclasses.fields(self.settings):
            values = dataclasses.asdict(getattr(self.settings, section.name))
            lines += ["", f"[{section.name}]", *(f"{name} = {_toml(value)}" for name, value in values.items())]
        return "\n".join(lines) + "\n"


def builtin() -> dict[str, Path]:
    """The scenarios that come with the package, by name."""
    folder = Path(str(resources.files("omni_mj"))) / "scenarios" / "library"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def load(name_or_path: str, overrides: Iterable[str] = (), head: Mapping[str, Any] | None = None) -> Scenario:
    """Read a scenario by name or from a TOML file, apply `section.field=value` overrides, and check all of it.

    `head` replaces fields of `Scenario` itself, such as plant or seeds.

    Raises:
        OmniError: no such scenario or file, not TOML, an unknown name, a value of the wrong type or out of range.
    """
    path = builtin().get(name_or_path)
    if path is None and (name_or_path.endswith(".toml") or Path(name_or_path).is_file()):
        path = Path(name_or_path)
    if path is None:
        hint = choose(name_or_path, sorted(builtin()))
        raise OmniError(f"unknown scenario {name_or_path!r}; {hint}, or a .toml file")
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise OmniError(f"cannot read scenario {path}: {error.strerror}") from None
    except ValueError as error:  # not TOML, not UTF-8, a number of absurd length, a file name with a null
        raise OmniError(f"scenario {path} is not valid TOML: {error}") from None
    for override in overrides:
        _override(data, override)
    return _parse(data | dict(head or {}), re.sub(r"[^\w.-]+", "-", path.stem))


def _override(data: dict[str, Any], override: str) -> None:
    key, equals, text = override.partition("=")
    section, dot, name = key.strip().partition(".")
    if not equals or not dot:
        raise OmniError(f"cannot read --set {override}; write section.field=value, such as radio.delay_frames=3")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except ValueError:
        value = text.strip()  # a bare word, such as reference.mode=iterated
    if not isinstance(data.setdefault(section, {}), dict):
        raise OmniError(f"cannot set {key.strip()}: {section} is not a section")
    data[section][name] = value


def _parse(data: Mapping[str, Any], stem: str) -> Scenario:
    sections = {f.name: f.default_factory for f in dataclasses.fields(Settings)}
    head = {f.name: f for f in dataclasses.fields(Scenario) if f.name != "settings"}
    values: dict[str, Any] = {"name": stem}
    parsed: dict[str, Any] = {}
    for key, value in data.items():
        if key in sections:
            parsed[key] = _parse_section(key, sections[key], value)
        elif key in head:
            values[key] = value
        else:
            kind, allowed = ("section", sections) if isinstance(value, dict) else ("name", head)
            raise OmniError(f"unknown {kind} {key!r} in a scenario; {choose(key, sorted(allowed))}")
    settings = Settings(**parsed)
    _check_head(values)
    _check_together(settings)
    values["controllers"] = tuple(values.get("controllers", Scenario.controllers))
    return Scenario(**values, settings=settings)


def _check_head(values: Mapping[str, Any]) -> None:
    kinds = {"name": str, "description": str, "plant": str, "paper_table": int, "seed": int, "seeds": int}
    for name, kind in kinds.items():
        if name in values and (not isinstance(values[name], kind) or isinstance(values[name], bool)):
            raise OmniError(f"{name} must be {'a string' if kind is str else 'a whole number'}, not {values[name]!r}")
    names = values.get("controllers", Scenario.controllers)
    if not isinstance(names, (list, tuple)) or not names or not all(isinstance(name, str) for name in names):
        raise OmniError(f"controllers must be a list of at least one name, not {names!r}")
    for name in names:
        controllers.find(name)
    if len({controllers.label(name) for name in names}) < len(names):
        raise OmniError("a controller is named twice; name each once")
    if values.get("plant", "mujoco") not in PLANTS:
        raise OmniError(f"unknown plant {values['plant']!r}; {choose(values['plant'], sorted(PLANTS))}")
    if values.get("paper_table", 0) not in (0, 3, 4):
        raise OmniError(f"paper_table must be 3, 4 or 0 (none), not {values['paper_table']}")
    if not 1 <= values.get("seeds", 1) <= 100_000:
        raise OmniError(f"seeds must be 1 to 100000, not {values['seeds']}")
    if not 0 <= values.get("seed", 0) <= 2**63 - values.get("seeds", 1):
        raise OmniError(f"seed must be at least 0, and the last seed below 2^63, not {values['seed']}")
    if not re.fullmatch(r"[\w.-]+", values["name"]):
        raise OmniError(f"the name of a scenario may hold letters, digits and ._-, unlike {values['name']!r}")


def _parse_section(section: str, kind: Any, data: Any) -> Any:
    if not isinstance(data, dict):
        raise OmniError(f"{section} is a section: write [{section}] and its fields below")
    fields = {f.name: f for f in dataclasses.fields(kind)}
    for name in data:
        if name not in fields:
            full = [f"{section}.{field}" for field in fields]
            raise OmniError(f"unknown setting {section}.{name}; {choose(f'{section}.{name}', sorted(full))}")
    return kind(**{name: _check(f"{section}.{name}", fields[name], value) for name, value in data.items()})


def _check(name: str, spec: dataclasses.Field[Any], value: Any) -> Any:
    meta = spec.metadata
    if meta["choices"]:
        if value not in meta["choices"]:
            raise OmniError(f"{name} must be {' or '.join(meta['choices'])}, not {value!r}")
        return value
    if spec.type is bool:
        if not isinstance(value, bool):
            raise OmniError(f"{name} must be true or false, not {value!r}")
        return value
    if name == "reference.waypoints":
        return _check_waypoints(value)
    whole = spec.type is int
    valid = _is_number(value) and (isinstance(value, int) or not whole)
    if not valid or not meta["low"] <= value <= meta["high"]:
        kind = "a whole number" if whole else "a number"
        unit = f" {meta['unit']}" if meta["unit"] else ""
        raise OmniError(f"{name} must be {kind} from {meta['low']:g} to {meta['high']:g}{unit}, not {value!r}")
    return value if whole else float(value)


def _toml(value: Any) -> str:
    """A value in TOML; JSON writes the same, but escapes characters beyond U+FFFF and leaves DEL as it is."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _is_number(value: Any) -> bool:
    # Compared rather than asked whether it is finite, which fails for integers beyond a float's range.
    return isinstance(value, (int, float)) and not isinstance(value, bool) and -math.inf < value < math.inf


def _check_waypoints(value: Any) -> list[list[float]]:
    message = "reference.waypoints must be a list of at least two [x, y] or [x, y, heading] in m and rad, within 100 m"
    if not isinstance(value, list) or len(value) < 2:
        raise OmniError(f"{message}, not {value!r}")
    poses = []
    for point in value:
        if (
            not isinstance(point, list)
            or len(point) not in (2, 3)
            or not all(_is_number(c) and abs(c) <= 100 for c in point)
        ):
            raise OmniError(f"{message}; {point!r} is not one")
        poses.append([float(c) for c in point] + [0.0] * (3 - len(point)))
    return poses


def _check_together(settings: Settings) -> None:
    if settings.reference.mode == "iterated" and settings.reference.shape in CURVES:
        raise OmniError(
            "reference.mode = iterated plans from way-point to way-point, of which a curve has none; "
            f"reference.shape = {settings.reference.shape} needs reference.mode = timed"
        )
    if settings.kinematic.alpha_low > settings.kinematic.alpha_high:
        raise OmniError("kinematic.alpha_low must not be above kinematic.alpha_high")
    if settings.radio.jitter_frames > settings.radio.delay_frames:
        raise OmniError("radio.jitter_frames must not be above radio.delay_frames: no packet arrives before it is sent")
