"""Read TOML files of scenarios and robots, apply --set overrides, and write TOML values."""

import json
import os
import re
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from omni_control.errors import OmniError, suggest_names, to_printable

MAX_FILE_BYTES = 2_000_000
MAX_NAME_LENGTH = 100  # characters, of a scenario's name


@cache
def find_packaged_files(folder: str) -> Mapping[str, Path]:
    """Return a mapping from file stem to path for the TOML files in a folder of the package."""
    return {path.stem: path for path in sorted((Path(__file__).parents[1] / folder).glob("*.toml"))}


def find_builtin_scenarios() -> Mapping[str, Path]:
    """Return a mapping from name to file for the scenarios of the package."""
    return find_packaged_files("scenarios")


def read_toml(path: Path, kind: str) -> dict[str, Any]:
    """Read a TOML file.

    Args:
        path: File.
        kind: Kind of file, for messages: "scenario".

    Raises:
        OmniError: The file cannot be read, is too large, or is not TOML.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise OmniError(f"cannot read {kind} {path}: {error.strerror}") from None
    except ValueError as error:  # a null character in the path
        raise OmniError(f"cannot read {kind} {path}: {error}") from None
    if len(data) > MAX_FILE_BYTES:
        raise OmniError(f"{kind} {path} has more than {MAX_FILE_BYTES / 1e6:g} MB")
    try:
        return parse_toml(data.decode())
    except ValueError as error:  # not TOML, not UTF-8, or an int of thousands of digits
        raise OmniError(f"{kind} {path} is not valid TOML: {to_printable(str(error))}") from None


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML.

    Raises:
        ValueError: The text is not TOML, or nested too deeply.
    """
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("lists or tables are nested too deeply") from None


def parse_value(text: str) -> Any:
    """Return a value written as in TOML, or the text itself."""
    try:
        return parse_toml(f"value = {text}")["value"]
    except ValueError:
        return text.strip()


def read_scenario_file(name_or_path: str) -> tuple[dict[str, Any], str]:
    """Return the values in a scenario file, and a name of the scenario made from the file's name.

    Args:
        name_or_path: Name of a scenario of the package, or path of a TOML file.

    Raises:
        OmniError: There is no such scenario or file, or the file is not TOML.
    """
    scenarios = find_builtin_scenarios()
    path = scenarios.get(name_or_path, Path(name_or_path))
    is_file = path.suffix == ".toml" or os.path.isfile(path)
    if name_or_path not in scenarios and not is_file:
        hint = suggest_names(name_or_path, sorted(scenarios))
        raise OmniError(f"unknown scenario {name_or_path!r}; {hint}, or a .toml file")
    name = re.sub(r"[^\w.-]+", "-", path.stem)[:MAX_NAME_LENGTH].strip(".")
    return read_toml(path, "scenario"), name or "scenario"


def apply_override(data: dict[str, Any], override: str) -> None:
    """Apply an override `section.field=value` to the values of a file, in place.

    A value that is not TOML is read as a string, such as `reference.mode=iterated`.

    Raises:
        OmniError: The override has another form, or does not name a field of a section.
    """
    key, equals, value_text = override.partition("=")
    # Parameters of controllers have names with three components: controller.NAME.PARAMETER.
    max_split = 2 if key.strip().startswith("controller.") else 1
    *sections, name = key.strip().split(".", max_split)
    if not equals or not sections:
        raise OmniError(
            f"cannot read --set {to_printable(override)}; write section.field=value, such as "
            "radio.delay_frames=3"
        )
    for section in sections:
        data = data.setdefault(section, {})
        if not isinstance(data, dict):
            raise OmniError(
                f"cannot set {to_printable(key)}: {to_printable(section)} is not a section"
            )
    data[name] = parse_value(value_text)


def format_toml_value(value: Any) -> str:
    """Return a value as text in TOML.

    JSON strings, numbers, booleans and lists are valid TOML if characters above U+FFFF stay
    unescaped and DEL is escaped.
    """
    if isinstance(value, dict):
        fields = [
            f"{format_toml_key(name)} = {format_toml_value(field)}" for name, field in value.items()
        ]
        return "{" + ", ".join(fields) + "}"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def format_toml_key(name: str) -> str:
    """Return a key as text in TOML, in quotes if necessary."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else format_toml_value(name)
