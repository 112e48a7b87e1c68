"""Parameters of controllers: what a scenario gives, checked against what the controllers have."""

import math
import sys
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from omni_control.errors import choose
from omni_mj.scenarios.checking import in_one, shown

Value = float | int | bool | str
_KINDS: dict[type, str] = {bool: "true or false", int: "a whole number", float: "a number", str: "a string"}


class Frozen(Mapping[str, Any]):
    """A mapping that cannot be changed, and can be a key of another."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        self._values = dict(values)

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __hash__(self) -> int:
        return hash(frozenset(self._values.items()))

    def __repr__(self) -> str:
        return repr(self._values)


class Parameters(Frozen):
    """The section [controller.NAME] of each controller that has one: controller -> parameter -> value.

    Raises:
        OmniError: a section is none, or a value is neither a finite number, nor true or false, nor a string; the
            message has a line for each.
    """

    def __init__(self, /, **sections: Mapping[str, Value]) -> None:
        errors, kept = [], {}
        for name, given in sections.items():
            if not isinstance(given, Mapping):
                errors.append(f"controller.{name} is a section: write [controller.{name}] and its parameters below")
                continue
            values = {key: v.item() if isinstance(v, np.generic) else v for key, v in given.items()}
            errors += [
                f"controller.{name}.{key} must be a number, true or false, or a string, not {shown(value)}"
                for key, value in values.items()
                if not isinstance(value, (int, float, str)) or (isinstance(value, float) and not math.isfinite(value))
            ]
            kept[name] = Frozen(values)
        in_one(errors)
        super().__init__(kept)

    def of(self, defaults: Mapping[str, Mapping[str, Value]]) -> "Parameters":
        """The same as what controllers have for it: whole numbers become numbers where those are wanted.

        Args:
            defaults: of each controller that there is, by its label: parameter -> default.

        Raises:
            OmniError: there is no such controller, or it has no such parameter, or a value is not of the kind of the
                parameter's default; the message has a line for each.
        """
        errors, kept = [], {}
        for name, given in self.items():
            if name not in defaults:
                errors.append(f"unknown controller {name!r} in [controller.{name}]; {choose(name, defaults)}")
                continue
            has = defaults[name]
            wrong = [error for key, value in given.items() if (error := _error(name, key, value, has))]
            errors += wrong
            if not wrong:
                kept[name] = {key: float(v) if type(has[key]) is float else v for key, v in given.items()}
        in_one(errors)
        return Parameters(**kept)


def _error(name: str, key: str, value: Value, has: Mapping[str, Value]) -> str:
    """What is wrong with a parameter, if anything."""
    full = f"controller.{name}.{key}"
    if not has:
        return f"unknown parameter {full}; {name} has none"
    if key not in has:
        return f"unknown parameter {full}; {choose(full, [f'controller.{name}.{known}' for known in has])}"
    kind = type(has[key])
    fits = type(value) is kind or (kind is float and type(value) is int and abs(value) <= sys.float_info.max)
    return "" if fits else f"{full} must be {_KINDS[kind]}, not {shown(value)}"
