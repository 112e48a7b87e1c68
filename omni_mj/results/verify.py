"""Run again what a folder holds, and compare: frames bit for bit, or else the summary's numbers."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omni_control.errors import OmniError
from omni_mj import parquet
from omni_mj.config import scenario
from omni_mj.config.scenario import Scenario
from omni_mj.files import read_json
from omni_mj.results import summary
from omni_mj.results.provenance import FILE, FORMAT, describe_environment, sha256
from omni_mj.results.result import Outcome
from omni_mj.simulation.simulation import Simulation
from omni_mj.studies.study_runner import (
    StartProgress,
    StoppedError,
    count_frames,
    no_progress,
    run_simulation,
)

if TYPE_CHECKING:
    import pyarrow as pa

REPEATED = ("run", "compare")  # studies that are run again
RESULTS = (
    "failures",
    "drawn_parameters",
    "events",
    "results",
)  # parts of a scenario's entry that frames decide
ENVIRONMENT = ("versions", "source", "git", "machine")  # parts of a record


@dataclass
class VerifyResult:
    """The outcome of running it again.

    Attributes:
        rows: Number of rows that were run.
        frames: Number of frames of all rows that were compared.
        differences: What differs from the run, in lines; empty if it repeats.
        notes: What is not as it was but decided nothing, or was left out, in lines.
    """

    rows: int = 0
    frames: int = 0
    differences: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def repeats(self) -> bool:
        """Whether all is the same."""
        return not self.differences

    def __str__(self) -> str:
        """Return the outcome in lines."""
        if not self.repeats:
            return "\n".join(["does not repeat", *self.differences, *self.notes])
        compared = f"{self.frames} frames identical bit for bit"
        compared = compared if self.frames else "the summary's numbers identical"
        head = f"repeats: {self.rows} rows, {compared}"
        return "\n".join([head, *(f"note: {note}" for note in self.notes)])


def verify(folder: str | Path, start_progress: StartProgress = no_progress) -> VerifyResult:
    """Run again what a folder holds, and compare bit for bit, as `omni-mj verify` does.

    Args:
        folder: Folder that a run, a comparison or `Result.save` left.
        start_progress: Called with a title and a number of frames before a scenario is run; its result is
            called after each frame.

    Raises:
        OmniError: It cannot be run again; a line for each reason.
    """
    path = Path(folder)
    if not (path / FILE).exists():
        raise OmniError(f"{path} holds no run that can be repeated: it has no {FILE}")
    record = read_json(path / FILE)
    try:
        return _repeat(path, record, start_progress)
    except OmniError:
        raise
    except (LookupError, TypeError, AttributeError, ValueError, ArithmeticError) as error:
        raise OmniError(f"{path} is not as a run leaves it; make the run again") from error


def _repeat(path: Path, record: Mapping[str, Any], start_progress: StartProgress) -> VerifyResult:
    if record["format"] != FORMAT:
        raise OmniError(f"{path / FILE} is of format {record['format']!r}; known is {FORMAT}")
    if record["study"] not in REPEATED:
        raise OmniError(
            f"{path} is of omni-mj {record['study']}, which verify does not run again; repeat it as a "
            f"whole: {record['command'] or 'it was called from Python'}"
        )
    scenarios = summary.read_summary(path)["scenarios"]
    result = VerifyResult()
    for name, entry in scenarios.items():
        if not entry["frames"]:
            result.notes.append(f"{name} was not run: there is nothing to compare with")
            continue
        place = "scenarios/{}.toml" if len(scenarios) > 1 else "scenario.toml"
        chosen = _load(path, path / place.format(name), record["scenarios"][name], entry)
        outcome = _run(chosen, entry, start_progress)
        result.rows += len(outcome.rows)
        if record["frames_saved"]:
            place = "trajectories/{}.parquet" if len(scenarios) > 1 else "trajectory.parquet"
            recorded = parquet.read_table(path / place.format(name))
            result.frames += recorded.num_rows
            assert outcome.log is not None
            lines = _frame_differences(recorded, outcome.log.table())
        else:
            lines = _number_differences(entry, json.loads(json.dumps(outcome.entry)))
        result.differences += [f"{name}: {line}" for line in lines]
    if not result.rows:
        raise OmniError(f"nothing was recorded in {path}: there is nothing to compare with")
    changed = _changes(record)
    if result.repeats:
        result.notes += changed
    else:
        result.differences += changed or [
            "versions, source and processor are the run's: look for random numbers without a seed, "
            "the clock, and files or modules that a controller reads"
        ]
    return result


def _load(path: Path, file: Path, said: Mapping[str, Any], entry: Mapping[str, Any]) -> Scenario:
    """Return a scenario as it was run, made of the copies in the folder.

    Raises:
        OmniError: A copy is missing or not what was run, or this version cannot run the scenario.
    """

    def copy(part: Mapping[str, Any]) -> str:
        if "reason" in part:
            raise OmniError(f"{part['name']} {part['reason']}")
        place = path / part["file"]
        if not place.is_file() or sha256(place.read_bytes()) != part["sha256"]:
            raise OmniError(f"{place} is missing, or not what was run: its SHA-256 is another")
        return str(place)

    def kind(part: Mapping[str, Any]) -> str:
        is_here = "file" not in part and "reason" not in part
        return part["name"] if is_here else f"{copy(part)}:{part['class']}"

    head = {
        "controllers": [kind(part) for part in said["controllers"]],
        "plant": kind(said["plant"]),
        "robot": copy(said["robot"]),
        "seed": entry["seeds"][0],
        "seeds": len(entry["seeds"]),
    }
    sections = {}
    if model := said.get("model"):
        sections["model"] = {"file": copy(model)}
        for part in model["parts"]:
            copy(part)
    return scenario.load_with_overrides(str(file), (), head, sections=sections)


def _run(chosen: Scenario, entry: Mapping[str, Any], start_progress: StartProgress) -> Outcome:
    """Run a scenario as far as it was run."""
    simulation = Simulation(chosen)
    count = entry["frames"] if entry["status"] == "stopped" else count_frames(simulation)
    show = start_progress(chosen.name, count)

    def after_frame(frame: int) -> None:
        show(frame)
        if entry["status"] == "stopped" and frame + 1 == count:
            raise StoppedError(str(entry["reason"]))

    return run_simulation(simulation, after_frame)


def _frame_differences(recorded: "pa.Table", again: "pa.Table") -> Iterator[str]:
    """Yield how trajectories differ; a value that is not a number equals any other such."""
    old, new = (
        table.set_column(0, "controller", table["controller"].cast("string"))
        for table in (recorded, again)
    )
    n = min(old.num_rows, new.num_rows)
    if old.num_rows != new.num_rows:
        yield f"{old.num_rows} frames are in the run, {new.num_rows} here"
    first: dict[str, int] = {}
    for name in old.column_names:
        if name not in new.column_names:
            yield f"nothing is recorded here of {name}"
            continue
        before, after = (table[name].to_numpy()[:n] for table in (old, new))
        differs = before != after
        if before.dtype == after.dtype == float:
            differs = before.view(np.uint64) != after.view(np.uint64)
            differs &= ~(np.isnan(before) & np.isnan(after))
        if differs.any():
            first[name] = int(differs.argmax())
    if first:
        name = min(first, key=first.__getitem__)
        row, here = (table.slice(first[name], 1).to_pylist()[0] for table in (old, new))
        yield (
            f"first in frame {row['frame']} of {row['controller']}, seed {row['seed']}, "
            f"slot {row['slot']}: {name} is {row[name]} in the run, {here[name]} here; "
            f"{len(first)} channels differ"
        )


def _number_differences(before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[str]:
    """Yield how the entries of a scenario in two summaries differ."""
    old, new = (
        dict(summary.flatten({part: entry[part] for part in RESULTS})) for entry in (before, after)
    )
    if differing := [name for name, value in old.items() if new.get(name, ...) != value]:
        name = differing[0]
        yield (
            f"summary.json: {name} is {old[name]} in the run, {new.get(name)} here; {len(differing)} numbers differ"
        )


def _changes(record: Mapping[str, Any]) -> list[str]:
    """Return how this environment differs from the recorded one, a line each."""
    here, now = describe_environment(), {part: record.get(part) for part in ENVIRONMENT}
    old, new = dict(summary.flatten(now)), dict(summary.flatten(here))
    return [
        f"{name} was {old.get(name)} in the run, is {new.get(name)} here"
        for name in {**old, **new}
        if old.get(name) != new.get(name)
    ]
