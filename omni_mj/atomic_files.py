"""Atomic writes: files appear complete or not at all. Reading of JSON."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from omni_control.errors import OmniError

PARTIAL_SUFFIX = ".partial"  # after the name of a file that is being written


@contextmanager
def open_atomic(path: Path) -> Iterator[BinaryIO]:
    """Open a temporary file for writing, which replaces `path` when the block ends.

    Raises:
        OSError: The file cannot be written. `path` is unchanged.
    """
    partial = path.with_name(path.name + PARTIAL_SUFFIX)
    try:
        with partial.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    except OSError as error:
        if error.filename in (None, str(partial)):
            error.filename = str(path)  # the name that the user knows
        raise
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file, which appears complete or not at all.

    Raises:
        OSError: See `open_atomic`.
    """
    with open_atomic(path) as file:
        file.write(text.encode())


def read_json(path: Path) -> dict[str, Any]:
    """Return the mapping in a JSON file.

    Raises:
        OmniError: The file cannot be read, or contains no mapping.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise OmniError(f"{path} cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise OmniError(f"{path} is not valid JSON: {error}") from None
    if not isinstance(content, dict):
        raise OmniError(f"{path} must contain a JSON object; make the run again")
    return content
