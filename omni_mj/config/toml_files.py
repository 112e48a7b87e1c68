"""Reading of TOML files of scenarios and robots and of --set overrides; formatting of TOML."""

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
MAX_NAME_LENGTH = 100  # characters of the name of a scenario


@cache
def find_packaged_files(folder: str) -> Mapping[str, Path]:
    """Return the TOML files in a folder of the package by name."""
    return {path.stem: path for path in sorted((Path(__file__).parents[1] / folder).glob("*.toml"))}


def find_builtin_scenarios() -> Mapping[str, Path]:
    """Return the scenario files of the package by name."""
    return find_packaged_files("scenarios")


def read_toml(path: Path, kind: str) -> dict[str, Any]:
    """Read a TOML file.

    Args:
        path: File.
        kind: What the file describes, for messages: "scenario".

    Raises:
        OmniError: The file cannot be read, or is not TOML.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
        if len(data) > MAX_FILE_BYTES:
            raise ValueError(f"it has more than {MAX_FILE_BYTES / 1e6:g} MB")
        return parse_toml(data.decode())
    except OSError as error:
        raise OmniError(f"cannot read {kind} {path}: {error.strerror}") from None
    # Not TOML, not UTF-8, an int of thousands of digits, or a null character in the path.
    except ValueError as error:
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
    """Return the values in a scenario file, and the name of the scenario by its file.

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

    A value that is not TOML is taken as a string, such as `reference.mode=iterated`.

    Raises:
        OmniError: The override has another form, or does not name a field of a section.
    """
    key, equals, value_text = override.partition("=")
    # Fields of controllers have three parts: controller.NAME.PARAMETER
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
    """Return a value in TOML.

    JSON is valid TOML if characters beyond U+FFFF are not escaped, and DEL is.
    """
    if isinstance(value, dict):
        fields = [
            f"{format_toml_key(name)} = {format_toml_value(field)}" for name, field in value.items()
        ]
        return "{" + ", ".join(fields) + "}"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def format_toml_key(name: str) -> str:
    """Return a key in TOML, quoted if necessary."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else format_toml_value(name)
