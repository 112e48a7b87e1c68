"""Models that are checked wherever they are made, and say all that is wrong with them at once."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, ClassVar, Literal, Self, get_args, get_origin

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, field_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from omni_control.errors import OmniError, choose, printable

REACH_M = 100.0  # the farthest coordinate of a pose, either way
FRICTIONS = 0.01, 5.0  # of a patch, from and to
SHOWN = 200  # characters of a wrong value in a message, at most
_KINDS = {int: "a whole number", float: "a number", bool: "true or false", str: "a string"}
_LISTED = {  # several values, by how many numbers each has
    3: f"poses [x, y] or [x, y, heading] in m and rad, within {REACH_M:g} m",
    4: f"patches [x, y, radius, friction] in m, within {REACH_M:g} m, of friction {FRICTIONS[0]:g} to {FRICTIONS[1]:g}",
}


def setting(
    default: Any,
    unit: str,
    doc: str,
    low: float | None = None,
    high: float | None = None,
    several: bool = False,
    alias: str | None = None,
) -> Any:
    """A field of a model with its unit, meaning and range; a callable default is read when needed, `...` is none.

    The annotation says the rest: an int is whole, a Literal is a choice. Of `several` values, such as poses, `low` and
    `high` are how many. `alias` is what it is called where Python would not have its name.
    """
    bounds = ("min_length", "max_length") if several or isinstance(default, tuple) else ("ge", "le")
    given: dict[str, Any] = {name: value for name, value in zip(bounds, (low, high), strict=True) if value is not None}
    given["default_factory" if callable(default) else "default"] = default
    return Field(description=doc, json_schema_extra={"unit": unit}, alias=alias, **given)


@dataclass(frozen=True)
class Setting:
    """What the declaration of a field says.

    Attributes:
        section: that it is in; empty for a field of the scenario itself.
        name: of the field.
        kind: int, float, bool, str, or tuple for several.
        default: its value where nothing else is given; None where it must be.
        unit, doc: its unit and meaning.
        low, high: its range, or how many poses there may be; None where there is no limit.
        choices: those there are, where one must be chosen.
        numbers: how many each of the several values has: 3 a pose, 4 a patch; 1 where they are no lists themselves.
    """

    section: str
    name: str
    kind: type
    default: Any
    unit: str
    doc: str
    low: float | None
    high: float | None
    choices: tuple[str, ...]
    numbers: int

    @property
    def full(self) -> str:
        """Its name with that of its section, as in messages and for --set."""
        return f"{self.section}.{self.name}" if self.section else self.name

    @property
    def number(self) -> bool:
        """Whether it is a number, whole or not."""
        return self.kind in (int, float)

    @property
    def allowed(self) -> str:
        """What is allowed, in short: '0 to 600'; 'timed, iterated'."""
        if self.choices:
            return ", ".join(self.choices)
        if self.kind is bool:
            return "true, false"
        if self.low is None:
            return ""
        low, high = _written(self.low), None if self.high is None else _written(self.high)
        return f"at least {low}" if high is None else f"{low} to {high}"

    @property
    def wanted(self) -> str:
        """What is allowed, in words: 'a whole number from 0 to 600 frames'."""
        if self.choices:
            return " or ".join(self.choices)
        if self.kind is tuple:
            numbers = f"numbers in {self.unit}" if self.unit else "whole numbers"
            return f"a list of {self.allowed} {_LISTED.get(self.numbers, numbers)}"
        kind = _KINDS.get(self.kind, self.kind.__name__)
        return f"{kind} from {self.allowed} {self.unit}".rstrip() if self.number else kind


class Checked(BaseModel):
    """A model that cannot be changed and holds no nonsense.

    Raises:
        OmniError: when it is made from values that are not allowed; the message has a line for each of them.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False, defer_build=True)

    section: ClassVar[str] = ""  # its name in a scenario
    unknown: ClassVar[str] = "unknown setting"  # what a name is called that it does not have

    def __init__(self, /, **values: Any) -> None:
        errors: list[ErrorDetails] = []
        try:
            super().__init__(**values)
        except ValidationError as error:
            errors = error.errors(include_url=False)
        in_one(line for error in errors for line in self._say(error))

    def __setattr__(self, name: str, value: Any) -> None:
        raise OmniError(f"{type(self).__name__}.{name} cannot be changed; replace() gives a changed copy")

    def replace(self, **values: Any) -> Self:
        """A copy with other values, checked like any.

        Raises:
            OmniError: a value is not allowed.
        """
        return type(self)(**{**self.values(), **values})

    def values(self) -> dict[str, Any]:
        """Its values, by the names that files have for them."""
        return {known: getattr(self, name) for known, name in self._names().items()}

    @classmethod
    @cache
    def declared(cls) -> tuple[Setting, ...]:
        """What the declarations of its fields say."""
        return tuple(cls._declared(name) for name in cls.model_fields)

    @classmethod
    def _names(cls) -> dict[str, str]:
        """What fields are called in files -> and in Python."""
        return {field.alias or name: name for name, field in cls.model_fields.items()}

    @classmethod
    def _declared(cls, name: str) -> Setting:
        field = cls.model_fields[name]
        kind: Any = get_origin(field.annotation) or field.annotation
        low, high = (
            next((getattr(each, key) for each in field.metadata for key in keys if hasattr(each, key)), None)
            for keys in (("ge", "min_length"), ("le", "max_length"))
        )
        return Setting(
            section=cls.section,
            name=field.alias or name,
            kind=str if kind is Literal else kind,
            default=None if field.is_required() else field.get_default(call_default_factory=True),
            unit=str(field.json_schema_extra["unit"]) if isinstance(field.json_schema_extra, dict) else "",
            doc=field.description or "",
            low=low,
            high=high,
            choices=get_args(field.annotation) if kind is Literal else (),
            numbers=len(get_args(get_args(field.annotation)[0])) or 1 if kind is tuple else 1,
        )

    @classmethod
    def _say(cls, error: ErrorDetails) -> Iterator[str]:
        """An error of pydantic's in our words: a line, or several that came from within."""
        name = str(error["loc"][0]) if error["loc"] else ""
        if error["type"] == "value_error":  # one of our own
            yield from str(error["ctx"]["error"]).splitlines()
        elif error["type"] == "extra_forbidden":
            prefix = f"{cls.section}." if cls.section else ""
            known = [prefix + each for each in cls._names()]
            yield f"{cls.unknown} {printable(prefix + name, SHOWN)}; {choose(prefix + name, known)}"
        else:
            declared = cls._declared(cls._names()[name])
            if error["type"] == "missing":
                yield f"{declared.full} is missing; give {declared.wanted}"
                return
            why = (
                f"; {error['msg']}"
                if error["type"] in ("pose", "patch", "angles", "wholes")
                else f", not {shown(error['input'])}"
            )
            yield f"{declared.full} must be {declared.wanted}{why}"

    @field_validator("*", mode="before")
    @classmethod
    def _numpy(cls, value: Any) -> Any:
        """A number of numpy's serves as well as one of Python's."""
        return value.item() if isinstance(value, np.generic) else value


def in_one(errors: Iterable[str]) -> None:
    """Raise all errors as one, each once, if there are any.

    Raises:
        OmniError: there are; the message has a line for each.
    """
    if lines := dict.fromkeys(errors):
        raise OmniError("\n".join(lines))


def shown(value: object) -> str:
    """A wrong value as messages show it, in one line."""
    try:
        return printable(repr(value), SHOWN)
    except ValueError:  # Python does not print whole numbers of thousands of digits
        return "a number of absurd length"
    except RecursionError:
        return "what is nested too deeply"


def _written(number: float) -> str:
    return str(number) if isinstance(number, int) else f"{number:g}"


def _poses(value: Any) -> tuple[tuple[float, ...], ...]:
    """Poses from lists of two or three coordinates; without a heading, it is zero."""
    points = value.tolist() if isinstance(value, np.ndarray) else value
    for point in points if isinstance(points, (list, tuple)) else [points]:
        if not isinstance(point, (list, tuple)) or len(point) not in (2, 3) or not all(map(_is_coordinate, point)):
            raise PydanticCustomError("pose", "{point} is not one", {"point": shown(point)})
    return tuple(tuple(float(c) for c in point) + (0.0,) * (3 - len(point)) for point in points)


def _patches(value: Any) -> tuple[tuple[float, ...], ...]:
    """Patches from lists of a centre, a radius and a friction."""
    patches = value.tolist() if isinstance(value, np.ndarray) else value
    for patch in patches if isinstance(patches, (list, tuple)) else [patches]:
        known = isinstance(patch, (list, tuple)) and len(patch) == 4 and all(map(_is_coordinate, patch))
        if not known or patch[2] <= 0 or not FRICTIONS[0] <= patch[3] <= FRICTIONS[1]:
            raise PydanticCustomError("patch", "{patch} is not one", {"patch": shown(patch)})
    return tuple(tuple(map(float, patch)) for patch in patches)


def _angles(value: Any) -> tuple[float, ...]:
    """Numbers from a list of them."""
    numbers = value.tolist() if isinstance(value, np.ndarray) else value
    if not isinstance(numbers, (list, tuple)):
        raise PydanticCustomError("angles", "{value} is no list", {"value": shown(value)})
    for number in numbers:
        if not isinstance(number, (int, float)) or isinstance(number, bool) or not -360 <= number <= 360:
            raise PydanticCustomError("angles", "{number} is none from -360 to 360", {"number": shown(number)})
    return tuple(map(float, numbers))


def _wholes(value: Any) -> tuple[int, ...]:
    """Whole numbers from a list of them."""
    numbers = value.tolist() if isinstance(value, np.ndarray) else value
    if not isinstance(numbers, (list, tuple)):
        raise PydanticCustomError("wholes", "{value} is no list", {"value": shown(value)})
    for number in numbers:
        if not isinstance(number, int) or isinstance(number, bool):
            raise PydanticCustomError("wholes", "{number} is none", {"number": shown(number)})
    return tuple(numbers)


def _is_coordinate(value: Any) -> bool:
    number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
    return number and bool(-REACH_M <= value <= REACH_M)


Poses = Annotated[tuple[tuple[float, float, float], ...], BeforeValidator(_poses)]
Patches = Annotated[tuple[tuple[float, float, float, float], ...], BeforeValidator(_patches)]
Wholes = Annotated[tuple[int, ...], BeforeValidator(_wholes)]
Angles = Annotated[tuple[float, ...], BeforeValidator(_angles)]
