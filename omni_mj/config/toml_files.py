"""TOML files of scenarios and robots, and values of --set."""

import os
import re
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from omni_control.errors import OmniError, suggest_names, to_printable

MOST_BYTES = 2_000_000
NAME_LETTERS = 100  # longest name of a scenario


@cache
def find_packaged_files(folder: str) -> Mapping[str, Path]:
    """Return the TOML files of a folder of the package, by name."""
    return {path.stem: path for path in sorted((Path(__file__).parents[1] / folder).glob("*.toml"))}


def find_builtin_scenarios() -> Mapping[str, Path]:
    """Return the files of the scenarios that come with the package, by name."""
    return find_packaged_files("scenarios")


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """Read a TOML file.

    Args:
        path: Of the file.
        what: Its kind, for messages: "scenario".

    Raises:
        OmniError: It cannot be read, or is not TOML.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
        if len(data) > MOST_BYTES:
            raise ValueError(f"it has more than {MOST_BYTES / 1e6:g} MB")
        return parse_toml(data.decode())
    except OSError as error:
        raise OmniError(f"cannot read {what} {path}: {error.strerror}") from None
    except (
        ValueError
    ) as error:  # not TOML, not UTF-8, a number of absurd length, a file name with a null
        raise OmniError(f"{what} {path} is not valid TOML: {to_printable(str(error))}") from None


def parse_toml(text: str) -> dict[str, Any]:
    """Parse a text in TOML.

    Raises:
        ValueError: It is not TOML, or too deeply nested.
    """
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("lists or tables are nested too deeply") from None


def read_scenario_file(name_or_path: str) -> tuple[dict[str, Any], str]:
    """Return the values of a scenario's file, and the name it gives the scenario.

    Raises:
        OmniError: There is no such scenario or file, or it is not TOML.
    """
    path = find_builtin_scenarios().get(name_or_path, Path(name_or_path))
    if name_or_path not in find_builtin_scenarios() and not (
        path.suffix == ".toml" or os.path.isfile(path)
    ):
        hint = suggest_names(name_or_path, sorted(find_builtin_scenarios()))
        raise OmniError(f"unknown scenario {name_or_path!r}; {hint}, or a .toml file")
    name = re.sub(r"[^\w.-]+", "-", path.stem)[:NAME_LETTERS].strip(".")
    return read_toml(path, "scenario"), name or "scenario"


def apply_override(data: dict[str, Any], text: str) -> None:
    """Put a value given as `section.field=value` into the values of a file.

    Raises:
        OmniError: The text is none.
    """
    key, equals, written = text.partition("=")
    *sections, name = key.strip().split(".", 2 if key.strip().startswith("controller.") else 1)
    if not equals or not sections:
        raise OmniError(
            f"cannot read --set {to_printable(text)}; write section.field=value, such as radio.delay_frames=3"
        )
    try:
        value = parse_toml(f"value = {written}")["value"]
    except ValueError:
        value = written.strip()  # a bare word, such as reference.mode=iterated
    for section in sections:
        data = data.setdefault(section, {})
        if not isinstance(data, dict):
            raise OmniError(
                f"cannot set {to_printable(key)}: {to_printable(section)} is not a section"
            )
    data[name] = value
