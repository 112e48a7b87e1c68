"""Frozen pydantic models that report all wrong values at once, as lines a user can act on."""

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

MAX_COORDINATE_M = 100.0  # largest coordinate of a pose
FRICTION_RANGE = 0.01, 5.0  # smallest and largest coefficient of friction
SHOWN = 200  # longest wrong value in a message, characters


def setting(
    default: Any, unit: str, doc: str, low: float | None = None, high: float | None = None
) -> Any:
    """Declare a field with its unit, meaning and range.

    Args:
        default: Its value, a function that returns it, or `...` if the field must be given.
        unit: Its unit.
        doc: Its meaning.
        low: Smallest value, or smallest length of a list.
        high: Largest value, or largest length of a list.
    """
    names = ("min_length", "max_length") if isinstance(default, tuple) else ("ge", "le")
    bounds: dict[str, Any] = {
        name: value for name, value in zip(names, (low, high), strict=True) if value is not None
    }
    bounds["default_factory" if callable(default) else "default"] = default
    allowed = (
        ""
        if low is None
        else f"at least {low:.15g}"
        if high is None
        else f"{low:.15g} to {high:.15g}"
    )
    extra: dict[str, Any] = {"unit": unit, "allowed": allowed}
    return Field(description=doc, json_schema_extra=extra, **bounds)


def _in_files(name: str) -> str:
    """Return the name of a field in files: `for`, which Python does not allow, is `for_`."""
    return name.rstrip("_")


class SettingInfo(NamedTuple):
    """The declaration of a field.

    Attributes:
        full: Its name with that of its section, as for --set.
        kind: int, float, bool, str, or tuple for a list.
        default: Its default; None if it must be given or follows from other settings.
        unit: Its unit.
        doc: Its meaning.
        allowed: The allowed values: '0 to 600', 'at least 2', 'timed, iterated'; may be empty.
    """

    full: str
    kind: type
    default: Any
    unit: str
    doc: str
    allowed: str

    @classmethod
    def of(cls, full: str, field: FieldInfo) -> Self:
        """Return the declaration of a pydantic field."""
        kind: Any = get_origin(field.annotation) or field.annotation
        choices = {Literal: get_args(field.annotation), bool: ("true", "false")}.get(kind, ())
        extra: Any = field.json_schema_extra or {}
        return cls(
            full=full,
            kind=str if kind is Literal else kind,
            default=None if field.is_required() else field.get_default(call_default_factory=True),
            unit=extra.get("unit", ""),
            doc=field.description or "",
            allowed=", ".join(map(str, choices)) or extra.get("allowed", ""),
        )

    @property
    def number(self) -> bool:
        """Whether it is a number, whole or not."""
        return self.kind in (int, float)


class SettingsModel(BaseModel):
    """A frozen model that raises one `OmniError` with a line for each wrong value."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, defer_build=True,
        alias_generator=_in_files,
    )  # fmt: skip
    section: ClassVar[str] = ""  # its name in a scenario, with a dot behind
    unknown: ClassVar[str] = "unknown setting"  # how messages call a name that it does not have

    def __init__(self, /, **values: Any) -> None:
        try:
            super().__init__(**{name: _from_numpy(value) for name, value in values.items()})
        except ValidationError as error:
            errors = error.errors(include_url=False)
        else:
            return
        raise_errors(line for each in errors for line in self._explain(each))

    def find_contradictions(self) -> Iterable[str]:
        """Return what its values cannot be together, a line each."""
        return ()

    @model_validator(mode="after")
    def _are_consistent(self) -> Self:
        raise_errors(self.find_contradictions())
        return self

    def replace(self, **values: Any) -> Self:
        """Return a copy with other values, validated.

        Raises:
            OmniError: A value is not allowed.
        """
        return type(self)(**{**self.values(), **values})

    def values(self) -> dict[str, Any]:
        """Return its values by their names in files."""
        return {_in_files(name): getattr(self, name) for name in type(self).model_fields}

    @classmethod
    def describe_fields(cls) -> dict[str, SettingInfo]:
        """Return the declarations of its fields by their names in files."""
        names = {_in_files(name): field for name, field in cls.model_fields.items()}
        return {name: SettingInfo.of(cls.section + name, field) for name, field in names.items()}

    @classmethod
    def _explain(cls, error: ErrorDetails) -> Iterator[str]:
        """Yield the lines of a message for an error of pydantic's."""
        kind, (name, *place), declared = error["type"], error["loc"] or ("",), cls.describe_fields()
        full = cls.section + "".join([str(name), *(f"[{index}]" for index in place)])
        if kind == "value_error":  # one of our own
            yield from str(error["ctx"]["error"]).splitlines()
        elif kind == "extra_forbidden":
            hint = suggest_names(full, [each.full for each in declared.values()])
            yield f"{cls.unknown} {to_printable(full, SHOWN)}; {hint}"
        elif kind == "missing":
            yield f"{full} is missing: {declared[str(name)].doc}"
        elif kind == "model_type":
            yield f"{full} is a section: write [{full}] and its fields, not {format_value(error['input'])}"
        else:
            what = re.sub("^(Input|Tuple|String) should", "must", error["msg"])
            what = what.partition(" after validation")[0].replace("tuple", "list")
            field = declared[str(name)]
            limits = f" ({field.allowed} {field.unit}".rstrip() + ")" if field.number else ""
            yield f"{full} {what}{limits}, not {format_value(error['input'])}"


def raise_errors(errors: Iterable[str]) -> None:
    """Raise one error with a line for each different message, if there are any.

    Raises:
        OmniError: There is a message.
    """
    if lines := dict.fromkeys(errors):
        raise OmniError("\n".join(lines))


@contextmanager
def collect_errors(errors: list[str]) -> Iterator[None]:
    """Within it, an `OmniError` is added to a list of messages, and ends the block."""
    try:
        yield
    except OmniError as error:
        errors.append(str(error))


def format_value(value: object) -> str:
    """Return a wrong value as a message shows it, on one line."""
    try:
        return to_printable(repr(value), SHOWN)
    except (
        ValueError,
        RecursionError,
    ):  # whole numbers of thousands of digits, deeply nested lists
        return "a value too large to print"


def merge_sections(sections: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return `sections` with `changes`; a mapping replaces some values of a section, anything else all of it."""
    result = dict(sections)
    for name, change in changes.items():
        section = sections.get(name, {})
        if isinstance(change, Mapping) and isinstance(section, (Mapping, SettingsModel)):
            change = merge_sections(dict(section), change)
        result[name] = change
    return result


def _from_numpy(value: Any) -> Any:
    """Return numbers and arrays of numpy's as those of Python's."""
    return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else value


def _with_heading(pose: Any) -> Any:
    """Complete a pose [x, y] with the heading 0."""
    return (*pose, 0.0) if isinstance(pose, (list, tuple)) and len(pose) == 2 else pose


_LIST = Field(strict=False)  # TOML has lists only
Coordinate = Annotated[float, Field(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]
Pose = Annotated[tuple[Coordinate, Coordinate, Coordinate], BeforeValidator(_with_heading), _LIST]
Poses = Annotated[tuple[Pose, ...], _LIST]
Patch = Annotated[
    tuple[
        Coordinate,
        Coordinate,
        Annotated[float, Field(gt=0, le=MAX_COORDINATE_M)],
        Annotated[float, Field(ge=FRICTION_RANGE[0], le=FRICTION_RANGE[1])],
    ],
    _LIST,
]
Patches = Annotated[tuple[Patch, ...], _LIST]
Angles = Annotated[tuple[Annotated[float, Field(ge=-360, le=360)], ...], _LIST]
