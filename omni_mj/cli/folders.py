"""Folders for results: made when needed, never overwritten unasked, and then only what a run of ours left there."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from itertools import count
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from omni_control.errors import OmniError
from omni_mj.files import PARTIAL, text_of

if TYPE_CHECKING:
    from omni_mj.scenarios.scenario import Scenario

PROVENANCE = ("provenance.json", "sources")  # names given by `omni_mj.provenance.record`
MARKS = {PROVENANCE[0]: ("format", "study", "scenarios"), "identify.json": ("format", "robot")}  # in folders of ours


def prepare(out: Path | None, name: str, outputs: Iterable[str], overwrite: bool) -> Path:
    """Return a folder for results, made if need be.

    Args:
        out: The folder, or None for a new one below runs/.
        name: Of what is run, for a new folder's name.
        outputs: Files and folders that an earlier run may have left there, removed when overwriting: of a folder, the
            files that are a run's by their names or by its record. All else stays.
        overwrite: Whether the folder of an earlier run may be used again.

    Raises:
        OmniError: The folder is a file, is not empty, is none that a run left, or cannot be made.
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
    """Make a folder below runs/ that was not there; two runs may start in the same second."""
    base = f"{name}-{datetime.now(UTC):%Y%m%d-%H%M%S}"
    for number in count(1):
        path = Path("runs") / (base if number == 1 else f"{base}-{number}")
        try:
            path.mkdir(parents=True)
        except FileExistsError:
            continue
        return path
    raise AssertionError("there is no last number")


def _clear(out: Path, outputs: list[str]) -> None:
    """Remove what a run left in its folder.

    Raises:
        OmniError: No run left the folder, or one of its folders is a link to somewhere else.
    """
    was_begun = {path.name for path in out.iterdir()} <= {f"{mark}{PARTIAL}" for mark in MARKS}  # killed at once
    record = next((found for mark, keys in MARKS.items() if (found := _record(out / mark, keys))), None)
    if record is None and not was_begun:
        raise OmniError(
            f"--out {out} was not left by a run: it has no {' or '.join(MARKS)} of one; --overwrite replaces runs, "
            "and nothing else; give another folder"
        )
    for output in outputs:
        if (out / output).is_symlink() and (out / output).is_dir():
            raise OmniError(
                f"--out {out}: {output} is a link to another folder, which no run made; give another folder"
            )
    places = [*outputs, *MARKS, *_inside(out, record or {})]
    for path in (out / f"{place}{ending}" for place in places for ending in ("", PARTIAL)):
        if path.is_file() or path.is_symlink():
            path.unlink()
    above = {out / parent for place in places for parent in PurePosixPath(place).parents if parent.name}
    for folder in sorted(above, reverse=True):
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()


def _record(path: Path, keys: Iterable[str]) -> dict[str, Any] | None:
    """Return the record of a run in a file, or None if no run wrote it."""
    try:
        found = json.loads(text_of(path))
    except (OSError, ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) and all(key in found for key in keys) else None


def _inside(out: Path, record: Mapping[str, Any]) -> Iterator[str]:
    """Yield the files of a run in its folders, by their places in `out`."""
    from omni_mj.show.style import FIGURES

    yield from (f"figures/{name}{ending}" for name in FIGURES for ending in (".png", ".svg"))
    for name in record["scenarios"] if isinstance(record.get("scenarios"), dict) else ():
        yield from (f"scenarios/{PurePosixPath(name).name}.toml", f"trajectories/{PurePosixPath(name).name}.parquet")
    copies: list[str] = []  # places of all files of which the record says that it has a copy

    def collect(entry: dict[str, Any]) -> None:
        if isinstance(entry.get("file"), str) and isinstance(entry.get("sha256"), str):
            copies.append(entry["file"])

    json.loads(json.dumps(record), object_hook=collect)
    for place in map(PurePosixPath, copies):
        linked = any((out / parent).is_symlink() for parent in place.parents)
        if place.parts[:1] == (PROVENANCE[1],) and ".." not in place.parts and not linked:
            yield str(place)


def begin_record(
    folder: Path,
    study: str,
    command: str | None,
    scenarios: "Sequence[Scenario]",
    frames: bool = True,
    given: Mapping[str, Any] | None = None,
) -> None:
    """Write what is about to be run, and a summary of nothing done, which a killed run leaves.

    Args and errors: see `omni_mj.provenance.record.save`.
    """
    from omni_mj.measure.result import Outcome, Result
    from omni_mj.provenance import record

    record.save(folder, study, command, scenarios, frames, given)
    outcomes = [Outcome.not_run(scenario) for scenario in scenarios]
    Result(outcomes, scenarios[0].labels, seeds=scenarios[0].seed_list).save_summary(folder)
