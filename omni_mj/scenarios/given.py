"""What a user gives for a scenario, in files and on the command line, before it is checked."""

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from omni_control.errors import OmniError, choose, printable
from omni_mj.scenarios import toml_files, user_files
from omni_mj.scenarios.checking import SHOWN, in_one, shown
from omni_mj.scenarios.library import builtin

NAME_LETTERS = 100  # of a scenario, at most


def read_file(name_or_path: str) -> tuple[dict[str, Any], str]:
    """What a scenario's file holds, and the name it gives the scenario.

    Raises:
        OmniError: there is no such scenario or file, or it is not TOML.
    """
    path = builtin().get(name_or_path)
    if path is None and (name_or_path.endswith(".toml") or os.path.isfile(name_or_path)):
        path = Path(name_or_path)
    if path is None:
        hint = choose(name_or_path, sorted(builtin()))
        raise OmniError(f"unknown scenario {name_or_path!r}; {hint}, or a .toml file")
    data = toml_files.read(path, "scenario")
    return data, re.sub(r"[^\w.-]+", "-", path.stem)[:NAME_LETTERS].strip(".") or "scenario"


def check_code(data: Mapping[str, Any], head: Mapping[str, Any]) -> None:
    """See that a file names no code that nobody asked for by naming it, or by saying that it may.

    Raises:
        OmniError: it does.
    """
    kinds, plant = data.get("controllers"), data.get("plant")
    named = [("--controller", kind) for kind in kinds if "controllers" not in head] if isinstance(kinds, list) else []
    named += [] if "plant" in head else [("--plant", plant)]
    in_one(
        f"the scenario's file names code, {shown(kind)}, which is not run unasked; name it yourself by {option}, or "
        "allow it by --allow-code (in Python: code=True)"
        for option, kind in named
        if isinstance(kind, str) and user_files.names_class(kind)
    )


def put(data: dict[str, Any], text: str) -> None:
    """Put a value given as `section.field=value` into what a file holds.

    Raises:
        OmniError: it is none.
    """
    key, equals, written = text.partition("=")
    *sections, name = key.strip().split(".", 2 if key.strip().startswith("controller.") else 1)
    if not equals or not sections:
        raise OmniError(
            f"cannot read --set {printable(text, SHOWN)}; write section.field=value, such as radio.delay_frames=3"
        )
    try:
        value = toml_files.parse(f"value = {written}")["value"]
    except ValueError:
        value = written.strip()  # a bare word, such as reference.mode=iterated
    for section in sections:
        data = data.setdefault(section, {})
        if not isinstance(data, dict):
            raise OmniError(f"cannot set {printable(key, SHOWN)}: {printable(section, SHOWN)} is not a section")
    data[name] = value
