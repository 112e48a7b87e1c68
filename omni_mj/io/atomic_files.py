"""Atomic writes, locks of output folders, and reads of regular files of bounded size."""

import errno
import fcntl
import json
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from omni_control.errors import OmniError, format_value

MAX_JSON_BYTES = 500_000_000
PARTIAL_SUFFIX = ".partial"  # after the name of a file that is being written
_locked_folders: dict[Path, int] = {}  # absolute path -> file descriptor that holds the lock


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Reserve a folder for the results that the block writes. Other programs may read it.

    The system ends the lock with the process. Locks of file systems without locks have no effect.

    Raises:
        OmniError: Another program, or another thread of this one, writes results to the folder.
    """
    descriptor = os.open(folder, os.O_RDONLY)
    path = folder.absolute()
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OmniError(
                f"another run is writing its results to {folder}: wait for its end, or name "
                "another folder"
            ) from None
        except OSError:
            pass  # such as on some network drives
        _locked_folders[path] = descriptor
        try:
            yield
        finally:
            del _locked_folders[path]
    finally:
        os.close(descriptor)


def check_folder(path: Path) -> None:
    """Check that no folder above a path was deleted or replaced since this program locked it.

    Raises:
        OmniError: It was.
    """
    absolute_path = path.absolute()
    for folder, descriptor in list(_locked_folders.items()):
        if not absolute_path.is_relative_to(folder):
            continue
        if not (folder.exists() and os.path.samestat(folder.stat(), os.fstat(descriptor))):
            raise OmniError(f"{folder} was deleted or replaced while results were written to it")


def create_folder(folder: Path) -> None:
    """Create a folder and its parents if they do not exist.

    Raises:
        OmniError: Its name is too long, or see `check_folder`.
        OSError: The folder cannot be created.
    """
    check_folder(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        raise OmniError(f"the name {format_value(str(folder))} is too long") from None


@contextmanager
def open_atomic(path: Path) -> Iterator[BinaryIO]:
    """Open a temporary file for writing, which replaces `path` when the block ends.

    Raises:
        OSError: The file cannot be written. `path` is unchanged.
        OmniError: See `check_folder`.
    """
    check_folder(path)
    partial = path.with_name(path.name + PARTIAL_SUFFIX)
    try:
        with partial.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    except OSError as error:
        check_folder(path)
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


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files, given by their paths in a folder, with the folders that they need.

    Raises:
        OSError: See `open_atomic`.
    """
    for name, data in files.items():
        create_folder((folder / name).parent)
        with open_atomic(folder / name) as file:
            file.write(data)


def encode_json(content: Mapping[str, Any]) -> str:
    """Return a mapping as strict JSON.

    Raises:
        ValueError: A number is NaN or infinite.
    """
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a mapping as strict JSON, which appears complete or not at all.

    Raises:
        OSError: See `open_atomic`.
        ValueError: See `encode_json`.
    """
    write_text(path, encode_json(content))


def read_regular_file(path: Path, max_bytes: int) -> bytes:
    """Return the content of a file. Devices and pipes are not read.

    Raises:
        OmniError: The file cannot be read, is not a regular file, or is too large.
    """
    try:
        # Without O_NONBLOCK, opening a pipe would wait for a writer.
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
        with open(descriptor, "rb") as file:
            if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                raise OmniError(f"{path} cannot be read: it is not a regular file")
            data = file.read(max_bytes + 1)
    except OmniError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        raise OmniError(f"{path} cannot be read: {getattr(error, 'strerror', error)}") from None
    if len(data) > max_bytes:
        raise OmniError(f"{path} has more than {max_bytes / 1e6:g} MB")
    return data


def read_json(path: Path) -> dict[str, Any]:
    """Return the mapping in a JSON file.

    Raises:
        OmniError: See `read_regular_file`; or the file contains no mapping.
    """
    data = read_regular_file(path, MAX_JSON_BYTES)
    try:
        content = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise OmniError(f"{path} is not valid JSON: {error}") from None
    if not isinstance(content, dict):
        raise OmniError(f"{path} must contain a JSON object; make the run again")
    return content
