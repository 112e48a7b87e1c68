"""Parameters of controllers: what a scenario gives, checked against what the controllers have."""

import sys
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from omni_control.controllers import checked_parameters
from omni_control.controllers.base import Controller
from omni_control.errors import OmniError, choose
from omni_mj.scenarios.checking import in_one, shown

Value = float | int | bool | str
_LARGEST = sys.float_info.max  # what is more is infinite, or a whole number of absurd length


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
                if not (isinstance(value, str) or (isinstance(value, (int, float)) and abs(value) <= _LARGEST))
            ]
            kept[name] = Frozen(values)
        in_one(errors)
        super().__init__(kept)

    def of(self, kinds: Mapping[str, type[Controller]]) -> "Parameters":
        """The same as the controllers take them: a whole number becomes a number where one is wanted.

        Args:
            kinds: the controllers that there are, by their labels.

        Raises:
            OmniError: there is no such controller, or it has no such parameter, or a value is not of the parameter's
                type; the message has a line for each.
        """
        errors: list[str] = []
        kept: dict[str, dict[str, Value]] = {}
        for name, given in self.items():
            if name not in kinds:
                errors.append(f"unknown controller {name!r} in [controller.{name}]; {choose(name, kinds)}")
                continue
            kept[name] = {}
            for key, value in given.items():
                try:
                    kept[name] |= checked_parameters(kinds[name], {key: value})
                except OmniError as error:
                    errors.append(f"controller.{name}.{key}: {error}")
        in_one(errors)
        return Parameters(**kept)
