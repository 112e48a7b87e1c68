"""Files that appear whole or not at all, and are still there after the power failed."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from omni_control.errors import OmniError

SPARE_B = 1_000_000  # of disk, for what is small: summary, report, provenance
PARTIAL = ".partial"  # after the name of a file that is being written


@contextmanager
def whole(path: Path) -> Iterator[BinaryIO]:
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
        _sync_names(path.parent)
    finally:
        partial.unlink(missing_ok=True)


def write(path: Path, content: str) -> None:
    """Write a text to a file that appears whole or not at all.

    Raises:
        OSError: see `whole`.
    """
    with whole(path) as file:
        file.write(content.encode())


def check_room(folder: Path, needed_b: float) -> None:
    """See that what can be done without leaves room for what cannot, so many bytes, on the disk of a folder.

    Raises:
        OmniError: it does not.
    """
    disk = shutil.disk_usage(folder)
    if disk.total and disk.free < needed_b + SPARE_B:  # some file systems say nothing
        raise OmniError(f"the {disk.free / 1e6:.1f} MB that are left on the disk are for the numbers")


def _sync_names(folder: Path) -> None:
    """See that a renamed file has its name after the power failed; where folders cannot be opened, it has anyway."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    except OSError:  # a file system that syncs no folders
        pass
    finally:
        os.close(handle)
