"""Files that appear whole or not at all."""

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from omni_control.errors import OmniError

SPARE_B = 1_000_000  # of disk, for what is small: summary, report, provenance
PARTIAL = ".partial"  # after the name of a file that is being written


@contextmanager
def open_atomic(path: Path) -> Iterator[BinaryIO]:
    """Give a file to write to, which takes the place of `path` once all of it is on the disk.

    Raises:
        OSError: it cannot be written; what was at `path` is as it was.
    """
    partial = path.with_name(path.name + PARTIAL)
    try:
        with partial.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    except OSError as error:
        if error.filename == str(partial):
            error.filename = str(path)  # what is wanted there
        raise
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def write_text(path: Path, content: str) -> None:
    """Write a text to a file that appears whole or not at all.

    Raises:
        OSError: see `open_atomic`.
    """
    with open_atomic(path) as file:
        file.write(content.encode())


def read_json(path: Path) -> dict[str, Any]:
    """Return the mapping that a JSON file holds.

    Raises:
        OmniError: It cannot be read, or is none.
    """
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise OmniError(f"{path} cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise OmniError(f"{path} is not valid JSON: {error}") from None
    if not isinstance(found, dict):
        raise OmniError(f"{path} is not what a run leaves; make the run again")
    return found


def check_disk_space(folder: Path, needed_b: float) -> None:
    """See that what can be done without leaves room for what cannot, so many bytes, on the disk of a folder.

    Raises:
        OmniError: it does not.
    """
    disk = shutil.disk_usage(folder)
    if disk.total and disk.free < needed_b + SPARE_B:  # some file systems say nothing
        raise OmniError(
            f"the {disk.free / 1e6:.1f} MB that are left on the disk are for the numbers"
        )
