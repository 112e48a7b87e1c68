"""Runs again what a folder holds, and compares: the frames bit for bit, and what the summary says of them."""

import json
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from omni_control.errors import OmniError
from omni_mj.measure.result import Outcome, Result
from omni_mj.provenance import frames, here
from omni_mj.provenance.folder import PARTS, Folder, importable
from omni_mj.provenance.record import ASKED, IDENTIFIED, MODULES, SOURCES
from omni_mj.scenarios.scenario import Scenario
from omni_mj.studies import alpha, compare, limit, loop, slip
from omni_mj.studies.outcome import AfterFrame, StoppedError, drive, joined, nothing, total_frames
from omni_mj.studies.run import prepare

RESULTS = ("failed", "drawn", "events", "results")  # what a summary says of a scenario that its frames decide
NAMED = 3  # numbers of the summary that are named
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


def verify(folder: str | Path, begin: Begin = lambda title, count: nothing) -> Repetition:
    """Run again what a folder holds, wherever it is now, and compare bit for bit, as `omni-mj verify` does.

    Args:
        folder: that a run, a comparison or `Result.save` left.
        begin: called with a title and a number of frames before a scenario is run; what it returns is called after
            each frame.

    Raises:
        OmniError: it cannot be run again; a line for each reason.
    """
    try:
        return _repeated(Folder(Path(folder)), begin)
    except OmniError:
        raise
    except (LookupError, TypeError, AttributeError, ValueError, ArithmeticError) as error:  # whatever was changed
        raise OmniError(f"what {folder} holds is not as a run leaves it; make the run again") from error


def _repeated(folder: Folder, begin: Begin) -> Repetition:
    found, study = Repetition(), folder.record["study"]
    with tempfile.TemporaryDirectory() as temporary:
        copies = Path(temporary)
        folder.copy(copies)
        with importable(copies / SOURCES / MODULES):
            if study in ("run", "compare", "limit"):
                _run(folder, copies, found, begin)
            elif study in ("alpha", "slip", "loop"):
                _study(folder, study, copies, found, begin)
            elif study == IDENTIFIED:
                _identify(folder, copies, found)
            else:
                again = folder.summary.get("repeat") or folder.record.get("command")
                raise OmniError(f"{folder.path} is of omni-mj {study}, which is repeated as a whole: {again}")
    changed = here.differences(folder.record)
    if found.repeats:
        found.notes += changed
    else:
        found.differences += changed or [
            "versions, source, commit and processor are the run's: look for random numbers without a seed, for the"
            " clock, and for files that a controller reads, which are not in the folder"
        ]
    return found


def _run(folder: Folder, copies: Path, found: Repetition, begin: Begin) -> None:
    """Run scenarios again and compare their frames and numbers."""
    every = folder.summary["scenarios"]
    entries = {name: entry for name, entry in every.items() if entry["frames"]}
    if not entries:
        raise OmniError(f"nothing was recorded in {folder.path}: there is nothing to compare with")
    found.notes += [f"{name} was not run: there is nothing to compare with" for name in every if name not in entries]
    if stopped := folder.summary["stopped"]:
        found.notes.append(f"the run was {stopped}; what it recorded until then is compared")
    scenarios = {name: folder.scenario(name, copies) for name in entries}
    for name, scenario in scenarios.items():
        prefix = f"{name}: " if folder.several else ""
        outcome = _again(folder, scenario, entries[name], begin)
        found.rows += len(outcome.rows)
        lines: list[str] = []
        if folder.record["frames_kept"]:
            again = copies / "trajectory.parquet"
            assert outcome.log is not None
            outcome.log.save(again)  # so that what is compared has been through the same
            count, lines = frames.differences(folder.trajectory(name), again)
            found.frames += count
        else:
            found.notes.append(f"{prefix}no frames were kept; the summary's numbers are compared")
        entry, now = entries[name], json.loads(json.dumps(outcome.entry))
        before, after = ({part: each.get(part) for part in RESULTS} for each in (entry, now))
        lines += _differing(before, after)
        found.differences += [prefix + line for line in lines]


def _again(folder: Folder, scenario: Scenario, entry: Mapping[str, Any], begin: Begin) -> Outcome:
    """Run a scenario as far as it was run, its seeds in the blocks in which they were."""
    seeds = scenario.seed_list
    if folder.record["study"] == "limit":
        return limit.limit(scenario, seeds, folder.record["given"]["iterations"], begin=begin).outcomes[0]
    block = compare.BLOCK if folder.summary["half_width"] else len(seeds)
    count, parts = entry["frames"] if folder.record["study"] == "run" and entry["status"] == "stopped" else None, []
    for first in range(0, len(seeds), block):
        simulation = prepare(scenario, seeds=seeds[first : first + block])
        show = begin(scenario.name, count or total_frames(simulation))

        def after_frame(frame: int, show: AfterFrame = show) -> None:
            show(frame)
            if frame + 1 == count:
                raise StoppedError(str(entry["reason"]))

        parts.append(drive(simulation, after_frame))
    return joined(parts)


def _study(folder: Folder, study: str, copies: Path, found: Repetition, begin: Begin) -> None:
    """Run a study of its own scenarios again, as a whole, and compare what it found."""
    asked, before = folder.record["given"].get(ASKED), folder.summary.get(study)
    if not isinstance(asked, dict):
        command = folder.summary.get("repeat") or folder.record.get("command")
        raise OmniError(
            f"{folder.path} does not say what omni-mj {study} was asked for; repeat it as a whole: {command}"
        )
    if before is None:
        raise OmniError(f"nothing was found in {folder.path}: there is nothing to compare with")
    scenarios = [folder.asked(text, name, copies) for name, text in asked.items()]
    result = STUDIES[study](scenarios, begin)
    found.rows += sum(len(outcome.rows) for outcome in result.outcomes)
    now = json.loads(json.dumps(result.summary()[study]))
    found.differences += _differing({study: before}, {study: now})


STUDIES: dict[str, Callable[[list[Scenario], Begin], Result]] = {
    "alpha": lambda given, begin: alpha.alpha(given[0], begin=begin),
    "loop": lambda given, begin: loop.loop(
        given[0], given[0].controllers, after_frame=begin("loop", loop.drive.FRAMES)
    ),
    "slip": lambda given, begin: slip.slip(given, before_robot=begin),
}


def _identify(folder: Folder, copies: Path, found: Repetition) -> None:
    """Identify a robot again from the copies of its logs, and compare what was found."""
    from omni_mj.studies.identify.logs import read
    from omni_mj.studies.identify.study import of_logs

    words, text = (folder.record["given"].get(key) for key in ("logs", "scenario"))
    paths = [copies / each["file"] for each in folder.record.get("data", [])]
    if not words or not isinstance(text, str) or sum(each["files"] for each in words) != len(paths):
        raise OmniError(f"{folder.path} does not say which logs it is of; repeat it as a whole")
    (name,) = folder.record["scenarios"]
    chosen, logs = folder.asked(text, name, copies), list[Any]()
    for each in words:
        own, paths = paths[: each["files"]], paths[each["files"] :]
        logs += read(Path(each["word"].format(*own)))
    now = json.loads(json.dumps(of_logs(logs, chosen).report()))
    found.rows, found.what = len(logs), "log" if len(logs) == 1 else "logs"
    before, after = ({part: values[part] for part in PARTS} for values in (folder.summary, now))
    found.differences += _differing(before, after, file=f"{IDENTIFIED}.json")


def _differing(old: Mapping[str, Any], new: Mapping[str, Any], file: str = "summary.json") -> Iterator[str]:
    """Yield what is not the same in both; results that only this version has are not among it."""
    before, after = dict(_flat(old)), dict(_flat(new))
    keys = dict.fromkeys([*before, *(key for key in after if not key.startswith("results."))])
    texts = {key: [json.dumps(each[key]) if key in each else "not there" for each in (before, after)] for key in keys}
    differ = {key: both for key, both in texts.items() if both[0] != both[1]}
    for key, both in list(differ.items())[:NAMED]:
        yield f"{file}: {key} is {both[0]} in the run, {both[1]} here"
    if (more := len(differ) - NAMED) > 0:
        yield f"{file}: {more} more values differ"


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield all that a value holds, by names such as `results.flc.0`."""
    if isinstance(value, Mapping | list):
        for key, each in value.items() if isinstance(value, Mapping) else enumerate(value):
            yield from _flat(each, f"{name}.{key}" if name else str(key))
    else:
        yield name, value
