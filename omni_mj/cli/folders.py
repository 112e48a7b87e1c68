"""Folders for results: made when needed, never overwritten unasked, and then only what a run of ours left there."""

import json
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from itertools import chain, count
from pathlib import Path, PurePosixPath
from typing import Any

from omni_control.errors import OmniError
from omni_mj.files import PARTIAL, text_of

PROVENANCE = (
    "provenance.json",
    "sources",
)  # what says what was run, of which `omni_mj.provenance.record` has the names
MARKS = {PROVENANCE[0]: ("format", "study", "scenarios"), "identify.json": ("format", "robot")}  # in folders of ours


def prepare(out: Path | None, name: str, outputs: Iterable[str], overwrite: bool) -> Path:
    """Return a folder for results, made if need be.

    Args:
        out: the folder, or None for a new one below runs/.
        name: of what is run, for a new folder's name.
        outputs: files and folders that an earlier run may have left there, removed when overwriting: of a folder, the
            files that are a run's by their names or by what that run noted down. All else stays.
        overwrite: whether the folder of an earlier run may be used again.

    Raises:
        OmniError: the folder is a file, is not empty, is none that a run left, or cannot be made.
    """
    try:
        if out is None:
            return _new(name)
        if out.exists() and not out.is_dir():
            raise OmniError(f"--out {out} is a file; give a folder")
        if out.is_dir() and any(out.iterdir()):
            if not overwrite:
                raise OmniError(
                    f"--out {out} is not empty; give another folder, or --overwrite to replace the run in it"
                )
            _clear(out, list(outputs))
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OmniError(f"cannot use the folder {out or 'runs'}: {error.strerror}; give another with --out") from None
    return out


def _new(name: str) -> Path:
    """A folder below runs/ that was not there; two runs may start in the same second."""
    base = Path("runs") / f"{name}-{datetime.now(UTC):%Y%m%d-%H%M%S}"
    for path in chain([base], (Path(f"{base}-{i}") for i in count(2))):
        try:
            path.mkdir(parents=True)
        except FileExistsError:
            continue
        return path
    raise AssertionError("there is no last number")


def _clear(out: Path, outputs: list[str]) -> None:
    """Remove what a run left in its folder.

    Raises:
        OmniError: no run left the folder, or one of its folders is a link to somewhere else.
    """
    begun = {f"{mark}{PARTIAL}" for mark in MARKS}
    if all(path.name in begun and path.is_file() for path in out.iterdir()):  # a run was killed in its first moment
        for path in list(out.iterdir()):
            path.unlink()
        return
    record = next((found for mark, keys in MARKS.items() if (found := _record(out / mark, keys)) is not None), None)
    if record is None:
        raise OmniError(
            f"--out {out} was not left by a run: it has no {' or '.join(MARKS)} of one; --overwrite replaces runs, "
            "and nothing else; give another folder"
        )
    for output in outputs:
        if (out / output).is_symlink() and (out / output).is_dir():
            raise OmniError(
                f"--out {out}: {output} is a link to another folder, which no run made; give another folder"
            )
    places = [place for each in outputs for place in (_inside(out, each, record) if (out / each).is_dir() else [each])]
    for path in (out / f"{place}{ending}" for place in places for ending in ("", PARTIAL)):
        if path.is_file() or path.is_symlink():
            path.unlink()
    above = {up for place in places for up in PurePosixPath(place).parents if up.name}
    for folder in (out / up for up in sorted(above, key=lambda up: len(up.parts), reverse=True)):
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()


def _record(path: Path, keys: Iterable[str]) -> dict[str, Any] | None:
    """What a run noted down in a file, or None if no run wrote it."""
    try:
        found = json.loads(text_of(path))
    except (OSError, ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) and all(key in found for key in keys) else None


def _inside(out: Path, folder: str, record: dict[str, Any]) -> Iterator[str]:
    """The files of a run in one of its folders, by their places in `out`."""
    scenarios = record.get("scenarios")
    names = list(scenarios) if isinstance(scenarios, dict) else []
    if folder == "figures":
        from omni_mj.show.style import FIGURES

        yield from (f"{folder}/{name}{ending}" for name in FIGURES for ending in (".png", ".svg"))
    elif folder == PROVENANCE[1]:
        for place in _kept(record):
            parts = PurePosixPath(place).parts
            linked = any((out / up).is_symlink() for up in PurePosixPath(place).parents)
            if parts[:1] == (folder,) and ".." not in parts and not linked:
                yield place
    else:
        ending = {"scenarios": ".toml", "trajectories": ".parquet"}[folder]
        yield from (f"{folder}/{name}{ending}" for name in names if "/" not in name)


def _kept(record: Any) -> Iterator[str]:
    """The places of all files of which a run noted down that it kept a copy."""
    if isinstance(record, dict):
        if isinstance(record.get("file"), str) and isinstance(record.get("sha256"), str):
            yield record["file"]
        for each in record.values():
            yield from _kept(each)
    elif isinstance(record, list):
        for each in record:
            yield from _kept(each)
