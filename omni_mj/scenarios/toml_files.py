"""TOML of whoever wrote it, read with bounds: none takes long, or all memory, and what is wrong is one line."""

import re
import tomllib
from pathlib import Path
from typing import Any

from omni_control.errors import OmniError, printable

MOST_BYTES = 2_000_000
PARTS = 16  # of a key, such as controller.Mine.gain; what reads them takes time with the square of their number
_KEY = r"""(?:(?<![\w-])[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
_LONG_KEY = re.compile(rf"{_KEY}(?:\.[ \t]*+{_KEY}){{{PARTS}}}")


def read(path: Path, what: str) -> dict[str, Any]:
    """What a TOML file holds.

    Args:
        path: of the file.
        what: it is, for messages: "scenario".

    Raises:
        OmniError: it cannot be read, or is not TOML.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
        if len(data) > MOST_BYTES:
            raise ValueError(f"it has more than {MOST_BYTES / 1e6:g} MB")
        return parse(data.decode())
    except OSError as error:
        raise OmniError(f"cannot read {what} {path}: {error.strerror}") from None
    except ValueError as error:  # not TOML, not UTF-8, a number of absurd length, a file name with a null
        raise OmniError(f"{what} {path} is not valid TOML: {printable(str(error))}") from None


def parse(text: str) -> dict[str, Any]:
    """What a text in TOML holds.

    Raises:
        ValueError: it is not TOML, or nobody means it.
    """
    if _LONG_KEY.search(text):
        raise ValueError(f"a key has more than {PARTS} parts")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("lists or tables are nested too deeply") from None
