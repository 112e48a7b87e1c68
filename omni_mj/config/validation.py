"""Base class of settings: immutable pydantic models that report all wrong values at once."""

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import groupby
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self, get_args, get_origin

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    ValidationError,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from omni_control.errors import (
    MAX_LISTED_VALUES,
    MAX_VALUE_LENGTH,
    OmniError,
    format_value,
    list_first,
    suggest_names,
    to_printable,
)

REQUIRED: Any = ...  # in place of a default: the value must be given
FROM_ROBOT: Any = ...  # in place of a default: the robot's file gives the value, or implies it
MAX_COORDINATE_M = 100.0  # of a position
MAX_HEADING_RAD = 1000.0
MAX_TURN_RAD = 6.3  # a full turn: larger headings are taken for degrees
MIN_FRICTION, MAX_FRICTION = 0.01, 5.0  # coefficients of friction


def setting(
    default: Any,
    doc: str,
    unit: str = "",
    *,
    low: float | None = None,
    high: float | None = None,
    min_length: int | None = None,
    max_length: int | None = None,
) -> Any:
    """Declare a field with its meaning, unit and range.

    Args:
        default: Default value, `REQUIRED` or `FROM_ROBOT`.
        doc: Meaning, as shown by `omni-mj list settings`.
        unit: Unit. Default: dimensionless.
        low: Smallest value. Default: unlimited.
        high: Largest value. Default: unlimited.
        min_length: Smallest number of items in a list. Default: 0.
        max_length: Largest number of items in a list. Default: unlimited.
    """
    lower_limit = min_length if low is None else low
    upper_limit = max_length if high is None else high
    allowed = ""
    if lower_limit is not None:
        allowed = f"at least {lower_limit:.15g}"
    if upper_limit is not None:
        prefix = "at most" if lower_limit is None else f"{lower_limit:.15g} to"
        allowed = f"{prefix} {upper_limit:.15g}"
    return Field(
        default=default,
        description=doc,
        json_schema_extra={"unit": unit, "allowed": allowed},
        ge=low,
        le=high,
        min_length=min_length,
        max_length=max_length,
    )


class SettingInfo(NamedTuple):
    """The declaration of a setting.

    Attributes:
        full_name: Name with its section, such as "radio.delay_frames".
        value_type: int (also for a `Number`), float, bool, str, or tuple for a list.
        default: Default value; None if the value must be given or comes from the robot.
        unit: Unit; empty if dimensionless.
        doc: Meaning.
        allowed: Allowed values, such as '0 to 600', 'at least 2' or 'timed, iterated'.
        low: Smallest value of a number; -inf if unlimited.
        high: Largest value of a number; inf if unlimited.
    """

    full_name: str
    value_type: type
    default: Any
    unit: str
    doc: str
    allowed: str
    low: float
    high: float

    @classmethod
    def from_field(cls, full_name: str, field: FieldInfo) -> Self:
        """Return the declaration of a pydantic field."""
        origin: Any = get_origin(field.annotation) or field.annotation
        if origin is float and type(field.default) is int:  # a `Number`
            origin = int
        choices = {Literal: get_args(field.annotation), bool: ("true", "false")}.get(origin, ())
        extra: Any = field.json_schema_extra or {}
        limits = {
            key: getattr(rule, key)
            for rule in field.metadata
            for key in ("ge", "le")
            if hasattr(rule, key)
        }
        return cls(
            full_name=full_name,
            value_type=str if origin is Literal else origin,
            default=None if field.is_required() else field.default,
            unit=extra.get("unit", ""),
            doc=field.description or "",
            allowed=", ".join(map(str, choices)) or extra.get("allowed", ""),
            low=limits.get("ge", -math.inf),
            high=limits.get("le", math.inf),
        )

    @property
    def is_number(self) -> bool:
        """Whether the value is an int or a float."""
        return self.value_type in (int, float)


class SettingsModel(BaseModel):
    """Immutable settings. Wrong values raise one `OmniError` whose message has a line for each."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, defer_build=True
    )
    section_prefix: ClassVar[str] = ""  # of field names in messages: "radio."
    unknown_name: ClassVar[str] = "unknown setting"  # start of the message for an unknown name

    def __init__(self, /, **values: Any) -> None:
        try:
            super().__init__(**{name: _from_numpy(value) for name, value in values.items()})
        except ValidationError as error:
            details = error.errors(include_url=False)
        else:
            return
        # Outside of `except`, so that tracebacks do not include pydantic's error.
        messages = []
        for _, field_details in groupby(details, lambda detail: detail["loc"][:1]):
            groups = [list(self._format_error(detail)) for detail in field_details]
            n_values = len(groups)  # of a list; a section is one group with a line per field
            lines = [line for group in groups for line in group]
            messages.append(list_first(lines, "\n") if n_values > 1 else "\n".join(lines))
        raise_errors(messages, limit=len(messages))

    def find_contradictions(self) -> Iterable[str]:
        """Return a message for each contradiction between values; overridden by subclasses."""
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
        return type(self)(**dict(self) | values)

    @classmethod
    def describe_fields(cls) -> dict[str, SettingInfo]:
        """Return the declarations of all fields by name."""
        return {
            name: SettingInfo.from_field(cls.section_prefix + name, field)
            for name, field in cls.model_fields.items()
        }

    @classmethod
    def _format_error(cls, error: ErrorDetails) -> Iterator[str]:
        """Yield the lines of the message for one of pydantic's errors."""
        kind = error["type"]
        name, *indices = error["loc"] or ("",)
        fields = cls.describe_fields()
        full_name = cls.section_prefix + str(name) + "".join(f"[{index}]" for index in indices)
        if kind == "value_error":  # raised by a validator of this package
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


def raise_errors(messages: Iterable[str], limit: int = MAX_LISTED_VALUES) -> None:
    """Raise one error for the first messages, without duplicates. Do nothing if there are none.

    Raises:
        OmniError: There is a message. The error's text has one line for each of the first messages.
    """
    if lines := list(dict.fromkeys(messages)):
        raise OmniError(list_first(lines, "\n", limit))


def find_degrees(name: str, turns: Iterable[float]) -> Iterator[str]:
    """Yield a message if angles in rad seem to be degrees.

    Args:
        name: Name of the poses in the message.
        turns: Headings, or their changes from pose to pose, rad.
    """
    largest = max(turns, key=abs)
    if abs(largest) > MAX_TURN_RAD:
        yield (
            f"{name}: headings are in rad and change by at most one turn (6.28 rad) from pose to "
            f"pose, got {largest:.6g}; convert degrees to rad"
        )


@contextmanager
def collect_errors(messages: list[str], prefix: str = "") -> Iterator[None]:
    """End the `with` block at an `OmniError`, and append its message to a list.

    Args:
        messages: The list.
        prefix: Text before each line of the message.
    """
    try:
        yield
    except OmniError as error:
        messages.append("\n".join(prefix + line for line in str(error).splitlines()))


def merge_sections(sections: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return sections of settings with changes.

    A mapping changes only the fields that it names. Any other value replaces the whole section.
    Names become strings.
    """
    result = dict(sections)
    for name, change in ((str(name), change) for name, change in changes.items()):
        section = sections.get(name, {})
        if isinstance(change, Mapping) and isinstance(section, (Mapping, SettingsModel)):
            change = merge_sections(dict(section), change)
        result[name] = change
    return result


def drop_zero_fraction(number: float) -> float:
    """Convert a whole number to an int; keep any other."""
    return int(number) if number == int(number) else number


def _from_numpy(value: Any) -> Any:
    """Convert a NumPy number or array to a Python number or list; keep any other value."""
    return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else value


def _append_heading(pose: Any) -> Any:
    """Append the heading 0 to a pose [x, y]; keep any other value."""
    return (*pose, 0.0) if isinstance(pose, (list, tuple)) and len(pose) == 2 else pose


# TOML has lists, and immutable settings need tuples: convert lists to tuples.
_LIST = Field(strict=False)
# A number that is mostly whole; it is then an int, so that files show 6 instead of 6.0.
Number = Annotated[
    float, AfterValidator(drop_zero_fraction), PlainSerializer(drop_zero_fraction, Any)
]
Coordinate = Annotated[float, Field(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]
Heading = Annotated[float, Field(ge=-MAX_HEADING_RAD, le=MAX_HEADING_RAD)]
Pose = Annotated[tuple[Coordinate, Coordinate, Heading], BeforeValidator(_append_heading), _LIST]
Vectors = Annotated[tuple[Annotated[tuple[Coordinate, Coordinate], _LIST], ...], _LIST]
Poses = Annotated[tuple[Pose, ...], _LIST]
CarpetPatch = Annotated[
    tuple[
        Coordinate,
        Coordinate,
        Annotated[float, Field(gt=0, le=MAX_COORDINATE_M)],
        Annotated[float, Field(ge=MIN_FRICTION, le=MAX_FRICTION)],
    ],
    _LIST,
]
CarpetPatches = Annotated[tuple[CarpetPatch, ...], _LIST]
Angles = Annotated[tuple[Annotated[float, Field(ge=-360, le=360)], ...], _LIST]
