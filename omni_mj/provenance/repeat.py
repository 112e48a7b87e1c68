"""Runs again what a folder holds, and compares: the frames bit for bit, and what the summary says of them."""

import json
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from omni_control.errors import OmniError
from omni_mj.measure.result import Outcome
from omni_mj.provenance import frames, here, identified, studies
from omni_mj.provenance.folder import Folder, importable
from omni_mj.provenance.record import MODULES, SOURCES
from omni_mj.scenarios.scenario import Scenario
from omni_mj.studies.limit import limit
from omni_mj.studies.outcome import AfterFrame, StoppedError, drive, nothing, total_frames
from omni_mj.studies.run import prepare

STUDIES = ("run", "compare", "limit")  # whose frames, or numbers of the summary, can be compared
RESULTS = ("failed", "drawn", "events", "results")  # what a summary says of a scenario that its frames decide
TOLD = 3  # numbers of the summary that are named
Begin = Callable[[str, int], AfterFrame]


@dataclass
class Repetition:
    """What came of running it again.

    Attributes:
        rows: how many were run.
        frames: how many of all rows were compared.
        differences: in what they, or the summary, differ from the run, in lines; none if it repeats.
        notes: what is not as it was in the run but decided nothing, or was left out, in lines.
        what: rows are.
    """

    rows: int = 0
    frames: int = 0
    differences: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    what: str = "rows"

    @property
    def repeats(self) -> bool:
        """Whether all is the same."""
        return not self.differences

    def __str__(self) -> str:
        """What came of it, in lines."""
        if not self.repeats:
            return "\n".join(["does not repeat", *self.differences, *self.notes])
        compared = f"{self.frames} frames identical bit for bit" if self.frames else "the summary's numbers identical"
        return "\n".join([f"repeats: {self.rows} {self.what}, {compared}", *(f"note: {note}" for note in self.notes)])


def verify(folder: str | Path) -> Repetition:
    """Run again what a folder holds, wherever it is now, and compare bit for bit, as `omni-mj verify` does.

    Args:
        folder: that a run, a comparison or `Result.save` left.

    Raises:
        OmniError: it cannot be run again; a line for each reason.
    """
    return repeat(Path(folder))


def repeat(path: Path, begin: Begin = lambda title, count: nothing) -> Repetition:
    """Run again what a folder holds, wherever it is now, and compare.

    Args:
        path: of the folder.
        begin: called with a title and a number of frames before a scenario is run; what it returns is called after
            each frame.

    Raises:
        OmniError: it cannot be run again; a line for each reason.
    """
    try:
        return _repeated(path, begin)
    except OmniError:
        raise
    except (LookupError, TypeError, AttributeError, ValueError, ArithmeticError) as error:  # whatever was changed
        raise OmniError(f"what {path} holds is not as a run leaves it; make the run again") from error


def _repeated(path: Path, begin: Begin) -> Repetition:
    folder, found = Folder(path), Repetition()
    study = folder.record["study"]
    if study in studies.NAMES:
        return _found(folder, found, lambda copies: _study(folder, copies, found, begin))
    if study == identified.STUDY:
        return _found(folder, found, lambda copies: _identified(folder, copies, found))
    if study not in STUDIES:
        again = folder.summary.get("repeat") or folder.record.get("command")
        raise OmniError(f"{path} is of omni-mj {study}, which is repeated as a whole: {again}")
    entries = {name: entry for name, entry in folder.summary["scenarios"].items() if entry["frames"]}
    if not entries:
        raise OmniError(f"nothing was recorded in {path}: there is nothing to compare with")

    def run(copies: Path) -> None:
        scenarios = {name: folder.scenario(name, copies) for name in entries}
        for name, chosen in scenarios.items():
            several = f"{name}: " if folder.several else ""
            _compare(folder, name, _again(folder.record, chosen, entries[name], begin), copies, found, several)

    skipped = [name for name in folder.summary["scenarios"] if name not in entries]
    found.notes += [f"{name} was not run: there is nothing to compare with" for name in skipped]
    if stopped := folder.summary["stopped"]:
        found.notes.append(f"the run was {stopped}: it was repeated up to there")
    return _found(folder, found, run)


def _found(folder: Folder, found: Repetition, run: Callable[[Path], None]) -> Repetition:
    """What was found, when it was run from copies of the user's files."""
    with tempfile.TemporaryDirectory(prefix="omni-mj-") as name:
        copies = Path(name)
        folder.copy(copies)
        with importable(copies / SOURCES / MODULES):
            run(copies)
    elsewhere = here.differences(folder.record)
    if found.repeats:
        found.notes += elsewhere
    else:
        found.differences += elsewhere or [
            "versions, source, commit and processor are the run's: what differs may be the run's files, or what drives"
            " it uses what is not recorded, such as the clock, random numbers without a seed, or files that it reads"
        ]
    return found


def _study(folder: Folder, copies: Path, found: Repetition, begin: Begin) -> None:
    """Run a study again and compare what it found."""
    result, before, now = studies.again(folder, copies, begin)
    found.rows += sum(len(outcome.rows) for outcome in result.outcomes)
    found.differences += _differing(
        dict(_flat(before, folder.record["study"])), dict(_flat(now, folder.record["study"]))
    )


def _identified(folder: Folder, copies: Path, found: Repetition) -> None:
    """Identify a robot again and compare what was found."""
    found.rows, before, now = identified.again(folder, copies)
    found.what = "log" if found.rows == 1 else "logs"
    found.differences += _differing(dict(_flat(before)), dict(_flat(now)), file=identified.FILE)


def _again(record: Mapping[str, Any], chosen: Scenario, entry: Mapping[str, Any], begin: Begin) -> Outcome:
    """Run a scenario as far as it was run."""
    if record["study"] == "limit":
        return limit(chosen, chosen.seed_list, record["given"]["iterations"], begin=begin).outcomes[0]
    simulation = prepare(chosen)
    count = entry["frames"] if entry["status"] == "stopped" else None
    show = begin(chosen.name, count or total_frames(simulation))

    def after_frame(frame: int) -> None:
        show(frame)
        if frame + 1 == count:
            raise StoppedError(str(entry["reason"]))

    return drive(simulation, after_frame)


def _compare(folder: Folder, name: str, outcome: Outcome, copies: Path, found: Repetition, prefix: str) -> None:
    """Add what came of a scenario to what was found."""
    assert outcome.log is not None
    found.rows += len(outcome.rows)
    lines: list[str] = []
    if folder.record["frames_kept"]:
        recorded, again = frames.read(folder.trajectory(name)), copies / "trajectory.parquet"
        outcome.log.save(again)  # so that what is compared has been through the same
        found.frames += recorded.count
        lines += frames.differences(recorded, frames.read(again))
    else:
        found.notes.append(f"{prefix}no frames were kept; the summary's numbers are compared")
    entry, now = folder.summary["scenarios"][name], json.loads(json.dumps(outcome.entry))
    lines += _failures(entry, now)
    lines += _numbers(entry, now)
    found.differences += [prefix + line for line in lines]


def _failures(recorded: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """Rows that failed in one of the two."""
    for ones, others, where, other in ((now, recorded, "here", "in the run"), (recorded, now, "in the run", "here")):
        known = [(each["controller"], each["seed"], each["place"]) for each in others["failed"]]
        for each in ones["failed"]:
            if (each["controller"], each["seed"], each["place"]) not in known:
                which = f"{each['controller']}, seed {each['seed']}"
                yield f"{which} failed {where} at {each['time_s']:.3f} s, not {other}: {each['cause']}"


def _numbers(recorded: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """What the summary says and is not so here; results that only this version has are not among it."""
    old, new = (dict(_flat({part: entry.get(part) for part in RESULTS})) for entry in (recorded, now))
    return _differing(old, new)


def _differing(old: Mapping[str, Any], new: Mapping[str, Any], file: str = "summary.json") -> Iterator[str]:
    """Of flat summaries what is not the same in both, in lines."""
    keys = dict.fromkeys([*old, *(key for key in new if not key.startswith("results."))])
    texts = {key: [json.dumps(each[key]) if key in each else "not there" for each in (old, new)] for key in keys}
    differ = {key: both for key, both in texts.items() if both[0] != both[1]}
    for key, (before, after) in list(differ.items())[:TOLD]:
        yield f"{file}: {key} is {before} in the run, {after} here"
    if (more := len(differ) - TOLD) > 0:
        yield f"{file}: {more} more values differ"


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    parts: Iterator[tuple[Any, Any]] | None = None
    if isinstance(value, Mapping):
        parts = iter(value.items())
    elif isinstance(value, list):
        parts = enumerate(value)
    if parts is None:
        yield name, value
        return
    for key, each in parts:
        yield from _flat(each, f"{name}.{key}" if name else str(key))
