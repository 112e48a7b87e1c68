"""Base class of settings: frozen pydantic models that report all wrong values at once."""

import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self, get_args, get_origin

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from omni_control.errors import OmniError, suggest_names, to_printable

MAX_COORDINATE_M = 100.0  # of a pose
FRICTION_RANGE = 0.01, 5.0  # smallest and largest coefficient of friction
MAX_VALUE_LENGTH = 200  # characters of a wrong value in a message


def setting(
    default: Any, unit: str, doc: str, low: float | None = None, high: float | None = None
) -> Any:
    """Declare a field with its unit, meaning and range.

    Args:
        default: Default value, or `...` if the field is required.
        unit: Unit; empty if dimensionless.
        doc: Meaning, as shown by `omni-mj list settings`.
        low: Smallest value, or smallest length of a list.
        high: Largest value, or largest length of a list.
    """
    names = ("min_length", "max_length") if isinstance(default, tuple) else ("ge", "le")
    arguments: dict[str, Any] = {"default": default}
    for name, limit in zip(names, (low, high), strict=True):
        if limit is not None:
            arguments[name] = limit
    if low is None:
        allowed = ""
    elif high is None:
        allowed = f"at least {low:.15g}"
    else:
        allowed = f"{low:.15g} to {high:.15g}"
    return Field(description=doc, json_schema_extra={"unit": unit, "allowed": allowed}, **arguments)


class SettingInfo(NamedTuple):
    """The declaration of a field.

    Attributes:
        full_name: Name with its section, as for --set.
        kind: int, float, bool, str, or tuple for a list.
        default: Default value; None if the field is required.
        unit: Unit; empty if dimensionless.
        doc: Meaning.
        allowed: Allowed values, such as '0 to 600', 'at least 2' or 'timed, iterated'.
    """

    full_name: str
    kind: type
    default: Any
    unit: str
    doc: str
    allowed: str

    @classmethod
    def from_field(cls, full_name: str, field: FieldInfo) -> Self:
        """Return the declaration of a pydantic field."""
        kind: Any = get_origin(field.annotation) or field.annotation
        choices = {Literal: get_args(field.annotation), bool: ("true", "false")}.get(kind, ())
        extra: Any = field.json_schema_extra or {}
        return cls(
            full_name=full_name,
            kind=str if kind is Literal else kind,
            default=None if field.is_required() else field.default,
            unit=extra.get("unit", ""),
            doc=field.description or "",
            allowed=", ".join(map(str, choices)) or extra.get("allowed", ""),
        )

    @property
    def is_number(self) -> bool:
        """Whether the value is an int or a float."""
        return self.kind in (int, float)


class SettingsModel(BaseModel):
    """A frozen model that raises one `OmniError` with a line for each wrong value."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, defer_build=True
    )
    section: ClassVar[str] = ""  # prefix of field names in messages: "radio."
    unknown_name: ClassVar[str] = "unknown setting"  # start of the message for an unknown name

    def __init__(self, /, **values: Any) -> None:
        try:
            super().__init__(**{name: _from_numpy(value) for name, value in values.items()})
        except ValidationError as error:
            details = error.errors(include_url=False)
        else:
            return
        raise_errors(line for detail in details for line in self._format_error(detail))

    def find_contradictions(self) -> Iterable[str]:
        """Return a message for each contradiction between values."""
        return ()

    @model_validator(mode="after")
    def _check_contradictions(self) -> Self:
        raise_errors(self.find_contradictions())
        return self

    def replace(self, **values: Any) -> Self:
        """Return a validated copy with other values.

        Raises:
            OmniError: A value is not allowed.
        """
        return type(self)(**{**self.values(), **values})

    def values(self) -> dict[str, Any]:
        """Return all values by name."""
        return {name: getattr(self, name) for name in type(self).model_fields}

    @classmethod
    def describe_fields(cls) -> dict[str, SettingInfo]:
        """Return the declarations of all fields by name."""
        return {
            name: SettingInfo.from_field(cls.section + name, field)
            for name, field in cls.model_fields.items()
        }

    @classmethod
    def _format_error(cls, error: ErrorDetails) -> Iterator[str]:
        """Yield the lines of a message for an error of pydantic."""
        kind = error["type"]
        name, *indices = error["loc"] or ("",)
        fields = cls.describe_fields()
        full_name = cls.section + str(name) + "".join(f"[{index}]" for index in indices)
        if kind == "value_error":  # an OmniError of this package
            yield from str(error["ctx"]["error"]).splitlines()
        elif kind == "extra_forbidden":
            hint = suggest_names(full_name, [field.full_name for field in fields.values()])
            yield f"{cls.unknown_name} {to_printable(full_name, MAX_VALUE_LENGTH)}; {hint}"
        elif kind == "missing":
            yield f"{full_name} is missing: {fields[str(name)].doc}"
        elif kind == "model_type":
            value = format_value(error["input"])
            yield f"{full_name} is a section: write [{full_name}] and its fields, not {value}"
        else:
            rule = re.sub("^(Input|Tuple|String) should", "must", error["msg"])
            rule = rule.partition(" after validation")[0].replace("tuple", "list")
            field = fields[str(name)]
            limits = f" ({field.allowed} {field.unit}".rstrip() + ")" if field.is_number else ""
            yield f"{full_name} {rule}{limits}, not {format_value(error['input'])}"


def raise_errors(messages: Iterable[str]) -> None:
    """Raise one error with a line for each different message, if there are any.

    Raises:
        OmniError: There is a message.
    """
    if lines := dict.fromkeys(messages):
        raise OmniError("\n".join(lines))


@contextmanager
def collect_errors(messages: list[str]) -> Iterator[None]:
    """Append the message of an `OmniError`, which ends the block, to a list."""
    try:
        yield
    except OmniError as error:
        messages.append(str(error))


def format_value(value: object) -> str:
    """Return a wrong value as one printable line of limited length."""
    try:
        return to_printable(repr(value), MAX_VALUE_LENGTH)
    except (ValueError, RecursionError):  # an int of thousands of digits, deeply nested lists
        return "a value too large to print"


def merge_sections(sections: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return sections with changes.

    A mapping replaces fields of a section. Any other value replaces the whole section.
    """
    result = dict(sections)
    for name, change in changes.items():
        section = sections.get(name, {})
        if isinstance(change, Mapping) and isinstance(section, (Mapping, SettingsModel)):
            change = merge_sections(dict(section), change)
        result[name] = change
    return result


def _from_numpy(value: Any) -> Any:
    """Convert numbers and arrays of numpy to Python numbers and lists."""
    return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else value


def _append_heading(pose: Any) -> Any:
    """Complete a pose [x, y] with the heading 0."""
    return (*pose, 0.0) if isinstance(pose, (list, tuple)) and len(pose) == 2 else pose


_LIST = Field(strict=False)  # accepts lists for tuples, because TOML has lists only
Coordinate = Annotated[float, Field(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]
Pose = Annotated[tuple[Coordinate, Coordinate, Coordinate], BeforeValidator(_append_heading), _LIST]
Poses = Annotated[tuple[Pose, ...], _LIST]
CarpetPatch = Annotated[
    tuple[
        Coordinate,
        Coordinate,
        Annotated[float, Field(gt=0, le=MAX_COORDINATE_M)],
        Annotated[float, Field(ge=FRICTION_RANGE[0], le=FRICTION_RANGE[1])],
    ],
    _LIST,
]
CarpetPatches = Annotated[tuple[CarpetPatch, ...], _LIST]
Angles = Annotated[tuple[Annotated[float, Field(ge=-360, le=360)], ...], _LIST]
