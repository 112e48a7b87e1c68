"""Verify a saved run or sweep: repeat it, and compare its frames or rows bit for bit.

The numbers of the summary are compared too.
"""

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from omni_control.arguments import check_types
from omni_control.errors import OmniError
from omni_mj.config import toml_files
from omni_mj.config.plugins import is_class_path
from omni_mj.config.scenario import TOP_LEVEL_FIELDS, Scenario, load_with_overrides
from omni_mj.io import parquet
from omni_mj.io.atomic_files import read_json
from omni_mj.io.printable_text import format_count
from omni_mj.results import summary
from omni_mj.results.provenance import (
    ENVIRONMENT_KEYS,
    PROVENANCE_FILE,
    PROVENANCE_FORMAT,
    SOURCES_FOLDER,
    describe_environment,
    find_differences,
    flatten_as_json,
    list_changes,
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
from omni_mj.studies.sweep.sweep_plan import MODEL_AXIS, SWEEP_FILE, SweepPlan, check_axes
from omni_mj.studies.sweep.sweep_study import SweepResult, merge_rows, stored_shards
from omni_mj.studies.sweep.workers import run_shards

Record = Mapping[str, Any]  # object of a JSON file

REPEATABLE_STUDIES = ("run", "compare", "sweep")
# Keys of a scenario's entry in summary.json that depend on the frames
RESULT_KEYS = ("failures", "drawn_parameters", "events", "results")
SWEEP_RESULT_KEYS = ("points", "correlations")  # of a sweep's summary.json
ROW_KEYS = ("frame", "point", "controller", "seed", "slot")  # columns that name a line of a table


@dataclass
class VerifyResult:
    """Result of a repetition.

    Attributes:
        rows: Number of rows that were run.
        is_sweep: Whether the rows of a sweep were compared.
        frames: Number of frames that were compared, summed over the rows; 0 if none were saved.
        differences: Differences from the saved run, a line each; empty if the run repeats.
        remarks: Remarks about a changed environment and skipped scenarios, a line each.
    """

    rows: int = 0
    is_sweep: bool = False
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
        if self.is_sweep:
            compared = "identical bit for bit"
        elif self.frames:
            compared = f"{format_count(self.frames, 'frame')} identical bit for bit"
        head = f"repeats: {format_count(self.rows, 'row')}, {compared}"
        return "\n".join([head, *(f"note: {note}" for note in self.remarks)])


@check_types
def verify(
    folder: str | Path,
    start_progress: StartProgress = no_progress,
    allow_code: bool = False,
) -> VerifyResult:
    """Repeat the run in a folder, and compare the results, as `omni-mj verify` does.

    Args:
        folder: Folder of a run, of a comparison, of a sweep, or of `Result.save`.
        start_progress: Called with a title and the number of frames before each scenario. It
            returns a function that is called with each frame's number.
        allow_code: Whether copies of controllers and plants in the folder may be run.

    Raises:
        OmniError: The run cannot be repeated; a line for each reason.
    """
    path = Path(folder)
    if not os.path.exists(path / PROVENANCE_FILE):
        raise OmniError(f"{path} holds no run that can be repeated: it has no {PROVENANCE_FILE}")
    record = read_json(path / PROVENANCE_FILE)
    try:
        _check_record(path, record)
        repeat = _repeat_sweep if record["study"] == "sweep" else _repeat_runs
        result = repeat(_SavedRun(path, record, allow_code), start_progress)
    except OmniError:
        raise
    # Keys and values that no run writes
    except (LookupError, TypeError, AttributeError, ValueError, ArithmeticError) as error:
        raise OmniError(
            f"files in {path} were changed after the run, so it cannot be repeated"
        ) from error
    changes = list_changes(record, describe_environment(), ENVIRONMENT_KEYS)
    if result.repeats:
        result.remarks += changes
    else:
        result.differences += changes or [
            "versions, source and processor are the same: look for random numbers without a seed, "
            "the clock, and files or modules that a controller reads"
        ]
    return result


@dataclass(frozen=True)
class _SavedRun:
    """Folder of a run, from which scenarios are loaded with the copies of the user's files.

    Attributes:
        path: The folder.
        record: Content of its provenance.json.
        allow_code: Whether copies of controllers and plants may be run.
    """

    path: Path
    record: Record
    allow_code: bool

    def load_scenario(self, file: str, name: str, settings: Record, head: Record) -> Scenario:
        """Load a scenario as it was run.

        Args:
            file: Path of the scenario's file in the folder.
            name: Name of the scenario in provenance.json.
            settings: Its settings in summary.json, which must be those in the file.
            head: Values that replace those in the file.

        Raises:
            OmniError: A file is missing or was changed, code is not allowed, or this version cannot
                run the scenario.
        """
        content = toml_files.read_toml(self.path / file)
        saved_sections = {key: content[key] for key in content if key not in TOP_LEVEL_FIELDS}
        if changes := list_changes(settings, saved_sections, [*settings, *saved_sections]):
            raise OmniError(f"{self.path / file} was changed after the run: {changes[0]}")
        entry = self.record["scenarios"][name]
        top_level = {
            "controllers": [self._find_class(item) for item in entry["controllers"]],
            "plant": self._find_class(entry["plant"]),
            "robot": self._find_copy(entry["robot"]),
            **head,
        }
        sections = {}
        if models := self.find_models(name):
            is_drawn = len(models) > 1
            sections["model"] = {"file": {"choice": models} if is_drawn else models[0]}
        return load_with_overrides(str(self.path / file), (), top_level, sections=sections)

    def find_models(self, name: str) -> list[str]:
        """Return the copies of a scenario's models, after a check of the files that they name."""
        models = self.record["scenarios"][name].get("models", [])
        for model in models:
            for included_file in model.get("included", []):
                self._find_copy(included_file)
        return [self._find_copy(model) for model in models]

    def _find_copy(self, item: Record) -> str:
        """Return the path of a copy, or raise OmniError if there is none in sources/."""
        if "not_copied" in item:
            raise OmniError(f"{item['name']} {item['not_copied']}")
        copy = self.path / item["file"]
        if not copy.resolve().is_relative_to((self.path / SOURCES_FOLDER).resolve()):
            raise OmniError(f"{PROVENANCE_FILE} names {copy}, which is not in {SOURCES_FOLDER}/")
        if not copy.is_file() or sha256(copy.read_bytes()) != item["sha256"]:
            raise OmniError(f"{copy} is missing, or was changed after the run: its SHA-256 differs")
        return str(copy)

    def _find_class(self, item: Record) -> str:
        """Return the name of a built-in class, or the class path of a copy."""
        if "file" not in item and "not_copied" not in item:
            if is_class_path(item["name"]):
                raise OmniError(f"{PROVENANCE_FILE} names {item['name']}, of which it has no copy")
            return item["name"]
        file = self._find_copy(item)
        if not self.allow_code:
            raise OmniError(
                f"the run needs code in its folder, {file}, which is not run without permission; "
                "allow it by --allow-code (in Python: allow_code=True)"
            )
        return f"{file}:{item['class']}"


def _repeat_runs(saved_run: _SavedRun, start_progress: StartProgress) -> VerifyResult:
    """Repeat and compare all scenarios in a folder."""
    path, result = saved_run.path, VerifyResult()
    scenarios = summary.read_summary(path)["scenarios"]
    several = len(scenarios) > 1
    for name, entry in scenarios.items():
        if not entry["frames"]:
            result.remarks.append(f"{name} was not run: there is nothing to compare with")
            continue
        file = f"scenarios/{name}.toml" if several else "scenario.toml"
        seeds = {"seed": entry["seeds"][0], "seeds": len(entry["seeds"])}
        scenario = saved_run.load_scenario(file, name, entry["settings"], seeds)
        outcome = _run_as_saved(scenario, entry, start_progress)
        result.rows += len(outcome.rows)
        lines: list[str] = []
        if saved_run.record["frames_saved"]:
            frames_path = f"trajectories/{name}.parquet" if several else "trajectory.parquet"
            saved = parquet.read_table(path / frames_path)
            result.frames += saved.num_rows
            assert outcome.log is not None
            lines += _table_differences(saved, outcome.log.to_arrow())
        lines += _number_differences(entry, outcome.entry, RESULT_KEYS)
        result.differences += [f"{name}: {line}" for line in lines]
    if not result.rows:
        raise OmniError(f"nothing was recorded in {path}: there is nothing to compare with")
    return result


def _repeat_sweep(saved_run: _SavedRun, start_progress: StartProgress) -> VerifyResult:
    """Repeat and compare the stored rows of a sweep."""
    path = saved_run.path
    saved_plan = read_json(path / SWEEP_FILE)
    name, *variants = saved_run.record["scenarios"]
    saved_summary = read_json(path / "summary.json")
    scenario = saved_run.load_scenario("scenario.toml", name, saved_summary["settings"], {})
    axes = dict(saved_plan["axes"])
    if MODEL_AXIS in axes:
        axes[MODEL_AXIS] = [file for variant in variants for file in saved_run.find_models(variant)]
    plan = SweepPlan(scenario, check_axes(axes.items()), saved_plan["batch_size"])
    shards = stored_shards(plan, path)
    saved = SweepResult(plan, len(shards), None, path)
    after_frame = start_progress("sweep", plan.frames * len(shards))
    shard_tables = [rows for _, rows in run_shards(plan, shards, after_frame)]
    saved_rows, repeated_rows = saved.rows(), merge_rows(plan, shard_tables)
    if MODEL_AXIS in saved_rows.column_names:  # paths, which differ from those of the copies
        saved_rows = saved_rows.drop_columns(MODEL_AXIS)
    lines = [*_table_differences(saved_rows, repeated_rows)]
    lines += _number_differences(saved_summary, saved.summary, SWEEP_RESULT_KEYS)
    return VerifyResult(repeated_rows.num_rows, is_sweep=True, differences=lines)


def _check_record(path: Path, record: Record) -> None:
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


def _run_as_saved(scenario: Scenario, entry: Record, start_progress: StartProgress) -> Outcome:
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


def _table_differences(saved: pa.Table, repeated: pa.Table) -> Iterator[str]:
    """Yield the differences of two trajectories or tables of rows, a line each. NaNs are equal."""
    saved, repeated = (_decode_controllers(rows) for rows in (saved, repeated))
    n_lines = min(saved.num_rows, repeated.num_rows)
    if saved.num_rows != repeated.num_rows:
        yield (
            f"the run has {format_count(saved.num_rows, 'line')}, its repetition "
            f"{repeated.num_rows}"
        )
    first_difference: dict[str, int] = {}  # column -> line of the table
    for name in saved.column_names:
        if name not in repeated.column_names:
            yield f"the repetition has no column {name}"
            continue
        old, new = (rows[name].slice(0, n_lines) for rows in (saved, repeated))
        if old.type != new.type:
            yield f"{name} has the type {old.type} in the run, {new.type} here"
            continue
        differs = _compare_bits(old.to_numpy(), new.to_numpy())
        if differs.any():
            first_difference[name] = int(differs.argmax())
    if first_difference:
        name = min(first_difference, key=first_difference.__getitem__)
        line = first_difference[name]
        old_row, new_row = (rows.slice(line, 1).to_pylist()[0] for rows in (saved, repeated))
        keys = ", ".join(f"{key} {old_row[key]}" for key in ROW_KEYS if key in old_row)
        yield (
            f"first in {keys}: {name} is {old_row[name]} in the run, {new_row[name]} here; "
            f"{format_count(len(first_difference), 'different channel')}"
        )


def _decode_controllers(rows: pa.Table) -> pa.Table:
    """Return a table whose controllers are strings, without a dictionary."""
    index = rows.column_names.index("controller")
    return rows.set_column(index, "controller", rows["controller"].cast("string"))


def _compare_bits(old: np.ndarray, new: np.ndarray) -> np.ndarray:
    """Return where two columns differ, shape (n,). NaNs are equal; 0.0 and -0.0 differ."""
    if old.dtype != float:
        return old != new
    return (old.view(np.uint64) != new.view(np.uint64)) & ~(np.isnan(old) & np.isnan(new))


def _number_differences(saved: Record, repeated: Record, keys: Sequence[str]) -> Iterator[str]:
    """Yield the differences of some keys of two summaries, a line for all.

    Results that only this version has are no differences.
    """
    old, new = (flatten_as_json({key: entry[key] for key in keys}) for entry in (saved, repeated))
    new = {
        name: value for name, value in new.items() if name in old or not name.startswith("results.")
    }
    if differences := find_differences(old, new):
        name, values = next(iter(differences.items()))
        saved_value, repeated_value = map(json.dumps, values)
        yield (
            f"summary.json: {name} is {saved_value} in the run, {repeated_value} here; "
            f"{format_count(len(differences), 'different number')}"
        )
