"""Frozen pydantic models that report all wrong values at once, as lines a user can act on."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, ClassVar, Literal, Self, get_args, get_origin

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from omni_control.errors import OmniError, choose, printable

REACH_M = 100.0  # largest coordinate of a pose
FRICTIONS = 0.01, 5.0  # smallest and largest coefficient of friction
SHOWN = 200  # longest wrong value in a message, characters
_KINDS = {int: "a whole number", float: "a number", bool: "true or false", str: "a string", tuple: "a list"}


def setting(
    default: Any, unit: str, doc: str, low: float | None = None, high: float | None = None, alias: str | None = None
) -> Any:
    """Declare a field with its unit, meaning and range.

    Args:
        default: Its value, a function that returns it, or `...` if the field must be given.
        unit: Its unit.
        doc: Its meaning.
        low: Smallest value, or smallest length of a list.
        high: Largest value, or largest length of a list.
        alias: Its name in files, if Python does not allow that name.
    """
    names = ("min_length", "max_length") if isinstance(default, tuple) else ("ge", "le")
    bounds: dict[str, Any] = {name: value for name, value in zip(names, (low, high), strict=True) if value is not None}
    bounds["default_factory" if callable(default) else "default"] = default
    return Field(description=doc, json_schema_extra={"unit": unit}, alias=alias, **bounds)


@dataclass(frozen=True)
class Setting:
    """The declaration of a field.

    Attributes:
        section: Name of its section; empty for a field of the scenario itself.
        name: Its name in files.
        kind: int, float, bool, str, or tuple for a list.
        default: Its default; None if it must be given or follows from other settings.
        unit: Its unit.
        doc: Its meaning.
        low: Smallest value or length, or None.
        high: Largest value or length, or None.
        choices: The allowed values of a choice.
    """

    section: str
    name: str
    kind: type
    default: Any
    unit: str
    doc: str
    low: float | None
    high: float | None
    choices: tuple[Any, ...]

    @property
    def full(self) -> str:
        """Its name with that of its section, as for --set."""
        return f"{self.section}.{self.name}" if self.section else self.name

    @property
    def number(self) -> bool:
        """Whether it is a number, whole or not."""
        return self.kind in (int, float)

    @property
    def allowed(self) -> str:
        """The allowed values in short: '0 to 600'; 'timed, iterated'."""
        if self.choices:
            return ", ".join(map(str, self.choices))
        if self.kind is bool:
            return "true, false"
        if self.low is None:
            return ""
        low = f"{self.low:.15g}"
        return f"at least {low}" if self.high is None else f"{low} to {self.high:.15g}"

    @property
    def wanted(self) -> str:
        """The allowed values in words: 'a whole number from 0 to 600 frames'."""
        if self.choices:
            return " or ".join(map(str, self.choices))
        if self.kind is tuple:
            return f"a list of {self.allowed} values, in {self.unit or 'whole numbers'}"
        kind = _KINDS.get(self.kind, self.kind.__name__)
        return f"{kind} from {self.allowed} {self.unit}".rstrip() if self.number else kind


class Checked(BaseModel):
    """A frozen model that raises one `OmniError` with a line for each wrong value."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False, defer_build=True)
    section: ClassVar[str] = ""  # its name in a scenario
    unknown: ClassVar[str] = "unknown setting"  # how messages call a name that it does not have

    def __init__(self, /, **values: Any) -> None:
        try:
            super().__init__(**{name: _from_numpy(value) for name, value in values.items()})
        except ValidationError as error:
            found = error.errors(include_url=False)
        else:
            return
        in_one(line for each in found for line in self._explain(each))

    def replace(self, **values: Any) -> Self:
        """Return a copy with other values, validated.

        Raises:
            OmniError: A value is not allowed.
        """
        return type(self)(**{**self.values(), **values})

    def values(self) -> dict[str, Any]:
        """Return its values by their names in files."""
        return {field.alias or name: getattr(self, name) for name, field in type(self).model_fields.items()}

    @classmethod
    @cache
    def declared(cls) -> tuple[Setting, ...]:
        """Return the declarations of its fields."""
        return tuple(cls._declared(name) for name in cls.model_fields)

    @classmethod
    def _declared(cls, name: str) -> Setting:
        field = cls.model_fields[name]
        kind: Any = get_origin(field.annotation) or field.annotation
        bounds = {
            key: getattr(constraint, key)
            for constraint in field.metadata
            for key in ("ge", "le", "min_length", "max_length")
            if hasattr(constraint, key)
        }
        extra = field.json_schema_extra
        return Setting(
            section=cls.section,
            name=field.alias or name,
            kind=str if kind is Literal else kind,
            default=None if field.is_required() else field.get_default(call_default_factory=True),
            unit=str(extra["unit"]) if isinstance(extra, dict) else "",
            doc=field.description or "",
            low=bounds.get("ge", bounds.get("min_length")),
            high=bounds.get("le", bounds.get("max_length")),
            choices=get_args(field.annotation) if kind is Literal else (),
        )

    @classmethod
    def _explain(cls, error: ErrorDetails) -> Iterator[str]:
        """Yield the lines of a message for an error of pydantic's."""
        kind, place = error["type"], error["loc"]
        if kind == "value_error":  # one of our own, perhaps of an element of a list
            prefix = f"{place[0]} {place[1] + 1}: " if len(place) > 1 and isinstance(place[1], int) else ""
            yield from (prefix + line for line in str(error["ctx"]["error"]).splitlines())
            return
        names = {each.name: each for each in cls.declared()}
        name = str(place[0])
        if kind == "extra_forbidden":
            prefix = f"{cls.section}." if cls.section else ""
            known = [prefix + each for each in names]
            yield f"{cls.unknown} {printable(prefix + name, SHOWN)}; {choose(prefix + name, known)}"
            return
        declared = names[name]
        if kind == "missing" and len(place) == 1:
            yield f"{declared.full} is missing; give {declared.wanted}"
        elif len(place) > 1 or kind in ("string_pattern_mismatch", "string_too_long"):
            path = "".join(f"[{index}]" for index in place[1:])
            yield f"{declared.full}{path}: {error['msg']}, not {shown(error['input'])}"
        else:
            yield f"{declared.full} must be {declared.wanted}, not {shown(error['input'])}"


def in_one(errors: Iterable[str]) -> None:
    """Raise one error with a line for each different message, if there are any.

    Raises:
        OmniError: There is a message.
    """
    if lines := dict.fromkeys(errors):
        raise OmniError("\n".join(lines))


def shown(value: object) -> str:
    """Return a wrong value as a message shows it, on one line."""
    try:
        return printable(repr(value), SHOWN)
    except (ValueError, RecursionError):  # whole numbers of thousands of digits, deeply nested lists
        return "a value too large to print"


def merged(sections: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return `sections` with `changes`; a mapping replaces some values of a section, anything else all of it."""
    result = dict(sections)
    for name, change in changes.items():
        section = sections.get(name, {})
        both = isinstance(section, (Mapping, Checked)) and isinstance(change, Mapping)
        result[name] = merged(dict(section), change) if both else change
    return result


def plain(value: Any) -> Any:
    """Return lists and dictionaries in place of tuples and other mappings."""
    if isinstance(value, Mapping):
        return {key: plain(each) for key, each in value.items()}
    return [plain(each) for each in value] if isinstance(value, (tuple, list)) else value


def _from_numpy(value: Any) -> Any:
    """Return numbers and arrays of numpy's as those of Python's."""
    return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else value


def _with_heading(pose: Any) -> Any:
    """Complete a pose [x, y] with the heading 0."""
    return (*pose, 0.0) if isinstance(pose, (list, tuple)) and len(pose) == 2 else pose


_LIST = Field(strict=False)  # TOML has lists only
Coordinate = Annotated[float, Field(ge=-REACH_M, le=REACH_M)]
Pose = Annotated[tuple[Coordinate, Coordinate, Coordinate], BeforeValidator(_with_heading), _LIST]
Poses = Annotated[tuple[Pose, ...], _LIST]
Patch = Annotated[
    tuple[
        Coordinate,
        Coordinate,
        Annotated[float, Field(gt=0, le=REACH_M)],
        Annotated[float, Field(ge=FRICTIONS[0], le=FRICTIONS[1])],
    ],
    _LIST,
]
Patches = Annotated[tuple[Patch, ...], _LIST]
Angles = Annotated[tuple[Annotated[float, Field(ge=-360, le=360)], ...], _LIST]
