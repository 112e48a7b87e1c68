"""Read TOML files of scenarios and robots, apply --set overrides, and write TOML values."""

import codecs
import json
import os
import re
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from omni_control.errors import OmniError, suggest_names, to_printable
from omni_mj.io.atomic_files import read_regular_file

MAX_FILE_BYTES = 2_000_000
MAX_NAME_LENGTH = 100  # characters, of a scenario's name


@cache
def find_builtin_files(folder: str) -> Mapping[str, Path]:
    """Return a mapping from name to file for the package's "scenarios" or "robots"."""
    return {path.stem: path for path in sorted((Path(__file__).parents[1] / folder).glob("*.toml"))}


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises:
        OmniError: The file cannot be read, is too large, or is not TOML.
    """
    data = read_regular_file(path, MAX_FILE_BYTES)
    try:
        return parse_toml(decode_utf8(data))
    except ValueError as error:  # not TOML, not UTF-8, or an int of thousands of digits
        raise OmniError(f"{path} is not valid TOML: {to_printable(str(error))}") from None


def decode_utf8(data: bytes, errors: str = "strict") -> str:
    """Decode UTF-8 with or without a byte order mark.

    Args:
        data: Encoded text.
        errors: As in `bytes.decode`.

    Raises:
        ValueError: The text is not UTF-8.
    """
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) or b"\0" in data[:4]:
        raise ValueError("the file is UTF-16; save it as UTF-8")
    return data.decode("utf-8-sig", errors)


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
    """Return the value that a text has in TOML, or the text itself if it is not TOML."""
    try:
        return parse_toml(f"value = {text}")["value"]
    except ValueError:
        return text.strip()


def read_scenario_file(name_or_path: str) -> tuple[dict[str, Any], str]:
    """Return the values in a scenario file, and the file's name as the name of the scenario.

    Characters that a scenario's name cannot have are replaced.

    Args:
        name_or_path: Name of a scenario of the package, or path of a TOML file.

    Raises:
        OmniError: There is no such scenario or file, or the file is not TOML.
    """
    scenarios = find_builtin_files("scenarios")
    path = scenarios.get(name_or_path, Path(name_or_path))
    # Path.is_file would raise an exception if the name is too long.
    if path.suffix != ".toml" and not os.path.isfile(path):
        hint = suggest_names(name_or_path, scenarios)
        raise OmniError(f"unknown scenario {name_or_path!r}; {hint}, or a .toml file")
    name = re.sub(r"[^\w.-]+", "-", path.stem)[:MAX_NAME_LENGTH].strip(".")
    return read_toml(path), name or "scenario"


def apply_override(data: dict[str, Any], override: str) -> None:
    """Apply an override `section.field=value` to the values of a file, in place.

    The key is a dotted key as in TOML; parameters of controllers are `controller.NAME.PARAMETER`. A
    value that is not TOML is read as a string, such as `reference.mode=iterated`.

    Raises:
        OmniError: The override has another form, or does not name a field of a section.
    """
    key, equals, value_text = override.partition("=")
    *sections, name = key.strip().split(".")
    if not equals or not sections:
        raise OmniError(
            f"cannot read --set {to_printable(override)}; write section.field=value, such as "
            "radio.delay_frames=3"
        )
    fields = data
    for section in sections:
        fields = fields.setdefault(section, {})
        if not isinstance(fields, dict):
            raise OmniError(
                f"cannot set {to_printable(key)}: {to_printable(section)} is not a section"
            )
    fields[name] = parse_value(value_text)


def format_toml_value(value: Any) -> str:
    """Return a value as text in TOML.

    Tables are formatted here. All other values are equal in JSON and TOML if JSON escapes DEL, and
    no character that is not ASCII: it would use surrogates.
    """
    if isinstance(value, dict):
        assignments = [
            f"{format_toml_key(name)} = {format_toml_value(field)}" for name, field in value.items()
        ]
        return "{" + ", ".join(assignments) + "}"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def format_toml_key(name: str) -> str:
    """Return a key as text in TOML, in quotes if necessary."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else format_toml_value(name)
