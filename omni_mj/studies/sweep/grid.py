"""What a sweep varies: settings, each with the values that it takes; all combinations of them are its points."""

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from omni_control.errors import OmniError, choose
from omni_mj.scenarios.checking import Setting, shown
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import every_setting

Value = int | float | str | bool
WRITE = "write section.field=LOW:HIGH:N, LOW:HIGH:STEP of whole numbers, or A,B,C"
MOST = 1000  # values of an axis


@dataclass(frozen=True)
class Axis:
    """A setting and its values.

    Args:
        name: section.field.
        values: in their order.
    """

    name: str
    values: tuple[Value, ...]


def axis(text: str) -> Axis:
    """An axis as the command line has it: `carpet.friction=0.3:1.0:8`, `radio.delay_frames=0:12:2`, `a.b=1,2,4`.

    The third number says how many values there are, both ends among them; of whole numbers it is the step.

    Raises:
        OmniError: it cannot be read, or there is no such setting.
    """
    name, equals, written = (part.strip() for part in text.partition("="))
    if not equals or not written:
        raise OmniError(f"cannot read --vary {text}; {WRITE}")
    declared = _declared(name)
    parts = [_value(each) for each in written.split(":" if ":" in written else ",")]
    if ":" not in written:
        return made(name, parts)
    numbers = [each for each in parts if isinstance(each, (int, float)) and not isinstance(each, bool)]
    if len(parts) != 3 or len(numbers) != 3 or not declared.number:
        raise OmniError(f"cannot read --vary {text}; {WRITE}")
    low, high, last = numbers
    if declared.kind is int:
        if any(isinstance(each, float) for each in numbers) or last < 1 or low > high:
            raise OmniError(f"--vary {text}: {name} is a whole number: LOW:HIGH:STEP, with a step of at least 1")
        return made(name, range(int(low), int(high) + 1, int(last)))
    if not isinstance(last, int) or last < 2 or low >= high:
        raise OmniError(f"--vary {text}: LOW:HIGH:N, with N values of which there are at least 2")
    return made(name, [float(f"{each:.12g}") for each in np.linspace(low, high, min(last, MOST + 1))])


def made(name: str, values: Iterable[Any]) -> Axis:
    """An axis of a setting.

    Raises:
        OmniError: there is no such setting, or it has no values, too many, or one twice.
    """
    declared = _declared(name)
    own = tuple(each.item() if isinstance(each, np.generic) else each for each in values)
    if declared.kind is float:
        own = tuple(float(each) if isinstance(each, int) and not isinstance(each, bool) else each for each in own)
    if not 1 <= len(own) <= MOST or len(set(own)) != len(own):
        raise OmniError(f"{name} must have 1 to {MOST} values, each once, not {shown(list(own))}")
    return Axis(name, own)


def axes(vary: Mapping[str, Iterable[Any]] | Sequence[Axis]) -> tuple[Axis, ...]:
    """The axes of a mapping from settings to values, or as given.

    Raises:
        OmniError: see `made`; or a setting is varied twice.
    """
    found = tuple(made(name, values) for name, values in vary.items()) if isinstance(vary, Mapping) else tuple(vary)
    names = [each.name for each in found]
    if len(set(names)) != len(names):
        raise OmniError(f"{max(names, key=names.count)} is varied twice; give all of its values at once")
    return found


def points(grid: Sequence[Axis]) -> list[dict[str, Value]]:
    """All combinations of the axes' values, the last axis changing first."""
    return [
        dict(zip((each.name for each in grid), values, strict=True)) for values in product(*(a.values for a in grid))
    ]


def together(samples: Sequence[Axis]) -> list[dict[str, Value]]:
    """The first value of each axis as a point, the second of each, and so on."""
    names = [each.name for each in samples]
    return [dict(zip(names, values, strict=True)) for values in zip(*(a.values for a in samples), strict=True)]


def at(scenario: Scenario, point: Mapping[str, Value]) -> Scenario:
    """The scenario at a point.

    Raises:
        OmniError: a value is not allowed, there or together with the others.
    """
    sections: dict[str, dict[str, Value]] = {}
    for name, value in point.items():
        section, field = name.split(".")
        sections.setdefault(section, {})[field] = value
    left = {name: each for name, each in scenario.distributions.items() if name not in point}
    return scenario.replace(settings=scenario.settings.replace(**sections), distributions=left)


def _declared(name: str) -> Setting:
    known = {each.full: each for each in every_setting()}
    if name not in known:
        raise OmniError(f"unknown setting {name}; {choose(name, list(known))}")
    return known[name]


def _value(text: str) -> Value:
    try:
        value = tomllib.loads(f"value = {text.strip()}")["value"]
    except ValueError:
        return text.strip()
    if not isinstance(value, (int, float, str, bool)):
        raise OmniError(f"{text.strip()} is no single value; {WRITE}")
    return value
