"""Verify a saved run: repeat it, and compare its frames bit for bit.

If frames were not saved, the numbers of the summary are compared.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omni_control.errors import OmniError
from omni_mj import parquet
from omni_mj.atomic_files import read_json
from omni_mj.config.scenario import Scenario, load_with_overrides
from omni_mj.results import summary
from omni_mj.results.provenance import (
    PROVENANCE_FILE,
    PROVENANCE_FORMAT,
    describe_environment,
    sha256,
)
from omni_mj.results.result import Outcome
from omni_mj.simulation.simulation import Simulation
from omni_mj.studies.run_scenario import (
    StartProgress,
    StoppedError,
    count_frames,
    no_progress,
    run_simulation,
)

if TYPE_CHECKING:
    import pyarrow as pa

REPEATABLE_STUDIES = ("run", "compare")
# Keys of a scenario's entry in summary.json that depend on the frames
RESULT_KEYS = ("failures", "drawn_parameters", "events", "results")
ENVIRONMENT_KEYS = ("versions", "source", "git", "machine")  # of provenance.json


@dataclass
class VerifyResult:
    """Result of a repetition.

    Attributes:
        rows: Number of rows that were run.
        frames: Number of frames that were compared, summed over the rows; 0 if none were saved.
        differences: Differences from the saved run, a line each; empty if the run repeats.
        remarks: Remarks about a changed environment and skipped scenarios, a line each.
    """

    rows: int = 0
    frames: int = 0
    differences: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    @property
    def repeats(self) -> bool:
        """Whether the repetition is equal to the saved run."""
        return not self.differences

    def __str__(self) -> str:
        """Return the result as lines of text."""
        if not self.repeats:
            return "\n".join(["does not repeat", *self.differences, *self.remarks])
        compared = "the summary's numbers identical"
        if self.frames:
            compared = f"{self.frames} frames identical bit for bit"
        head = f"repeats: {self.rows} rows, {compared}"
        return "\n".join([head, *(f"note: {note}" for note in self.remarks)])


def verify(folder: str | Path, start_progress: StartProgress = no_progress) -> VerifyResult:
    """Repeat the run in a folder, and compare the results, as `omni-mj verify` does.

    Args:
        folder: Folder of a run, of a comparison, or of `Result.save`.
        start_progress: Called with a title and the number of frames before each scenario. It
            returns a function that is called with each frame's number.

    Raises:
        OmniError: The run cannot be repeated; a line for each reason.
    """
    path = Path(folder)
    if not (path / PROVENANCE_FILE).exists():
        raise OmniError(f"{path} holds no run that can be repeated: it has no {PROVENANCE_FILE}")
    record = read_json(path / PROVENANCE_FILE)
    try:
        return _repeat(path, record, start_progress)
    except OmniError:
        raise
    # Keys and values that no run writes
    except (LookupError, TypeError, AttributeError, ValueError, ArithmeticError) as error:
        raise OmniError(
            f"files in {path} were changed after the run, so it cannot be repeated"
        ) from error


def _repeat(path: Path, record: Mapping[str, Any], start_progress: StartProgress) -> VerifyResult:
    """Repeat and compare all scenarios in a folder.

    Args:
        path: Folder of the run.
        record: Content of its provenance.json.
        start_progress: See `verify`.
    """
    _check_record(path, record)
    scenarios = summary.read_summary(path)["scenarios"]
    several = len(scenarios) > 1
    result = VerifyResult()
    for name, entry in scenarios.items():
        if not entry["frames"]:
            result.remarks.append(f"{name} was not run: there is nothing to compare with")
            continue
        scenario_path = path / (f"scenarios/{name}.toml" if several else "scenario.toml")
        scenario = _load_saved_scenario(path, scenario_path, record["scenarios"][name], entry)
        outcome = _run_as_saved(scenario, entry, start_progress)
        result.rows += len(outcome.rows)
        if record["frames_saved"]:
            frames_path = f"trajectories/{name}.parquet" if several else "trajectory.parquet"
            saved = parquet.read_table(path / frames_path)
            result.frames += saved.num_rows
            assert outcome.log is not None
            lines = _frame_differences(saved, outcome.log.to_arrow())
        else:
            lines = _number_differences(entry, json.loads(json.dumps(outcome.entry)))
        result.differences += [f"{name}: {line}" for line in lines]
    if not result.rows:
        raise OmniError(f"nothing was recorded in {path}: there is nothing to compare with")
    changes = _environment_changes(record)
    if result.repeats:
        result.remarks += changes
    else:
        result.differences += changes or [
            "versions, source and processor are the same: look for random numbers without a seed, "
            "the clock, and files or modules that a controller reads"
        ]
    return result


def _check_record(path: Path, record: Mapping[str, Any]) -> None:
    """Raise `OmniError` if the study of a provenance.json cannot be repeated."""
    if record["format"] != PROVENANCE_FORMAT:
        raise OmniError(
            f"{path / PROVENANCE_FILE} has format {record['format']!r}; "
            f"it must be {PROVENANCE_FORMAT}"
        )
    if record["study"] not in REPEATABLE_STUDIES:
        raise OmniError(
            f"{path} is a result of omni-mj {record['study']}, which verify does not repeat; "
            f"repeat the study: {record['command'] or 'it was called from Python'}"
        )


def _load_saved_scenario(
    path: Path, scenario_path: Path, record: Mapping[str, Any], entry: Mapping[str, Any]
) -> Scenario:
    """Load a scenario as it was run, with the saved copies of the user's files.

    Args:
        path: Folder of the run.
        scenario_path: File of the scenario in this folder.
        record: Entry of the scenario in provenance.json.
        entry: Entry of the scenario in summary.json.

    Raises:
        OmniError: A copy is missing or was changed, or this version cannot run the scenario.
    """

    def find_copy(item: Mapping[str, Any]) -> str:
        if "not_copied" in item:
            raise OmniError(f"{item['name']} {item['not_copied']}")
        copy = path / item["file"]
        if not copy.is_file() or sha256(copy.read_bytes()) != item["sha256"]:
            raise OmniError(f"{copy} is missing, or was changed after the run: its SHA-256 differs")
        return str(copy)

    def find_name(item: Mapping[str, Any]) -> str:
        is_builtin = "file" not in item and "not_copied" not in item
        return item["name"] if is_builtin else f"{find_copy(item)}:{item['class']}"

    head = {
        "controllers": [find_name(item) for item in record["controllers"]],
        "plant": find_name(record["plant"]),
        "robot": find_copy(record["robot"]),
        "seed": entry["seeds"][0],
        "seeds": len(entry["seeds"]),
    }
    sections = {}
    if model := record.get("model"):
        sections["model"] = {"file": find_copy(model)}
        for included_file in model["included"]:
            find_copy(included_file)
    return load_with_overrides(str(scenario_path), (), head, sections=sections)


def _run_as_saved(
    scenario: Scenario, entry: Mapping[str, Any], start_progress: StartProgress
) -> Outcome:
    """Run a scenario for as many frames as the saved run."""
    simulation = Simulation(scenario)
    is_stopped = entry["status"] == "stopped"
    n_frames = entry["frames"] if is_stopped else count_frames(simulation)
    show = start_progress(scenario.name, n_frames)

    def after_frame(frame: int) -> None:
        show(frame)
        if is_stopped and frame + 1 == n_frames:
            raise StoppedError(str(entry["reason"]))

    return run_simulation(simulation, after_frame)


def _frame_differences(saved: "pa.Table", repeated: "pa.Table") -> Iterator[str]:
    """Yield the differences of two trajectories, a line each. NaNs are equal."""
    saved, repeated = (
        frames.set_column(0, "controller", frames["controller"].cast("string"))
        for frames in (saved, repeated)
    )
    n_frames = min(saved.num_rows, repeated.num_rows)
    if saved.num_rows != repeated.num_rows:
        yield f"the run has {saved.num_rows} frames, its repetition {repeated.num_rows}"
    first_difference: dict[str, int] = {}  # column -> row of the table
    for name in saved.column_names:
        if name not in repeated.column_names:
            yield f"the repetition has no column {name}"
            continue
        old, new = (frames[name].to_numpy()[:n_frames] for frames in (saved, repeated))
        differs = old != new
        if old.dtype == new.dtype == float:  # 0.0 and -0.0 differ
            differs = old.view(np.uint64) != new.view(np.uint64)
            differs &= ~(np.isnan(old) & np.isnan(new))
        if differs.any():
            first_difference[name] = int(differs.argmax())
    if first_difference:
        name = min(first_difference, key=first_difference.__getitem__)
        old, new = (
            frames.slice(first_difference[name], 1).to_pylist()[0] for frames in (saved, repeated)
        )
        yield (
            f"first in frame {old['frame']} of {old['controller']}, seed {old['seed']}, "
            f"slot {old['slot']}: {name} is {old[name]} in the run, {new[name]} here; "
            f"{len(first_difference)} channels differ"
        )


def _number_differences(saved: Mapping[str, Any], repeated: Mapping[str, Any]) -> Iterator[str]:
    """Yield the differences of a scenario's entries in two summaries, a line each."""
    old, new = (
        dict(summary.flatten({key: entry[key] for key in RESULT_KEYS}))
        for entry in (saved, repeated)
    )
    if differing := [name for name, value in old.items() if new.get(name, ...) != value]:
        name = differing[0]
        yield (
            f"summary.json: {name} is {old[name]} in the run, {new.get(name)} here; "
            f"{len(differing)} numbers differ"
        )


def _environment_changes(record: Mapping[str, Any]) -> list[str]:
    """Return the differences of this environment from the recorded one, a line each."""
    old = dict(summary.flatten({key: record.get(key) for key in ENVIRONMENT_KEYS}))
    new = dict(summary.flatten(describe_environment()))
    return [
        f"{name} was {old.get(name)} in the run, is {new.get(name)} here"
        for name in old | new
        if old.get(name) != new.get(name)
    ]
