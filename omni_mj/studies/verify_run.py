"""Verify a saved run, comparison or sweep: repeat it, and compare everything that it wrote.

All values of its JSON files and all columns of its tables must be the same, bit for bit. Drawings,
recordings and reports are made from these and are not compared.
"""

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
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
from omni_mj.io.atomic_files import MAX_JSON_BYTES, read_json, read_regular_file
from omni_mj.io.printable_text import format_count
from omni_mj.results import summary
from omni_mj.results.provenance import (
    ABSENT,
    ENVIRONMENT_KEYS,
    PROVENANCE_FILE,
    PROVENANCE_FORMAT,
    SOURCES_FOLDER,
    describe_environment,
    describe_study,
    find_differences,
    list_changes,
    sha256,
)
from omni_mj.results.result import Outcome, Result, name_files
from omni_mj.simulation.simulation import Simulation
from omni_mj.studies.run_scenario import (
    StartProgress,
    StoppedError,
    count_frames,
    list_privileged,
    no_progress,
    run_simulation,
)
from omni_mj.studies.sweep.sweep_plan import MODEL_AXIS, SWEEP_FILE, SweepPlan, check_axes
from omni_mj.studies.sweep.sweep_study import (
    ROWS,
    list_row_files,
    merge_rows,
    stored_shards,
    summarize_sweep,
)
from omni_mj.studies.sweep.workers import run_shards

Record = Mapping[str, Any]  # object of a JSON file

SUMMARY_FILE = "summary.json"
REPEATABLE_STUDIES = ("run", "compare", "sweep")
# Values that a repetition cannot have: times, and commands, which name folders
UNREPEATABLE = ("started", "command", "created", "wall_s", "repeat_command")
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

    def check_input(self, file: str, changes: Sequence[str] = ()) -> None:
        """Raise `OmniError` if a file is not that of the run; `changes` says in what it differs."""
        data = read_regular_file(self.path / file, MAX_JSON_BYTES)
        if sha256(data) != self.record["inputs"][file]:
            reason = changes[0] if changes else f"its SHA-256 is not that in {PROVENANCE_FILE}"
            raise OmniError(f"{self.path / file} is not the file of the run: {reason}")

    def load_scenario(self, name: str, file: str, settings: Record) -> Scenario:
        """Load a scenario as it was run.

        Args:
            name: Name of the scenario in provenance.json.
            file: Path of the scenario's file in the folder.
            settings: Its settings in summary.json.

        Raises:
            OmniError: A file is missing or was changed, code is not allowed, or this version cannot
                run the scenario.
        """
        content = toml_files.read_toml(self.path / file)
        sections = {key: content[key] for key in content if key not in TOP_LEVEL_FIELDS}
        keys = [key for key in {**settings, **sections} if settings.get(key) or key in sections]
        self.check_input(file, list_changes(settings, sections, keys))
        entry = self.record["scenarios"][name]
        robot, plant = self._find_copy(entry["robot"]), self._find_class(entry["plant"])
        controllers = [self._find_class(item) for item in entry["controllers"]]
        top_level = {"controllers": controllers, "plant": plant, "robot": robot}
        model_section = {}
        if models := self.find_models(name):
            is_drawn = len(models) > 1
            model_section["model"] = {"file": {"choice": models} if is_drawn else models[0]}
        return load_with_overrides(str(self.path / file), (), top_level, sections=model_section)

    def compare_record(
        self,
        study: str,
        scenarios: Sequence[Scenario],
        input_files: Iterable[str],
        options: Record,
    ) -> Iterator[str]:
        """Return the differences of provenance.json from that of the repetition, a line for all.

        Args:
            study: Name of the study.
            scenarios: Its scenarios as they were loaded.
            input_files: Files that describe it.
            options: Further keys and values.
        """
        repeated = {
            **describe_study(study, scenarios, {}),
            **{key: self.record[key] for key in (*ENVIRONMENT_KEYS, "command", "started")},
            "inputs": {file: self.record["inputs"][file] for file in input_files},
            **options,
        }
        return _compare_file(self.path / PROVENANCE_FILE, repeated)

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
    path, record, result = saved_run.path, saved_run.record, VerifyResult()
    saved_summary = summary.read_summary(path)
    several = len(record["scenarios"]) > 1
    outcomes: list[Outcome] = []
    for name in record["scenarios"]:
        entry, files = saved_summary["scenarios"][name], name_files(name, several)
        scenario = saved_run.load_scenario(name, files.scenario, entry["settings"])
        outcome = _run_as_saved(scenario, entry, start_progress)
        saved_scenario = toml_files.read_toml(path / files.scenario)
        outcome.entry.update({key: saved_scenario[key] for key in ("plant", "robot")})
        outcome.entry["settings"]["model"]["file"] = saved_scenario["model"]["file"]
        result.rows += len(outcome.rows)
        has_frames = record["frames_saved"] or (path / files.frames).exists()
        if has_frames and outcome.log and outcome.log.lengths.any():
            frames = outcome.log.to_arrow()
            result.frames += frames.num_rows
            result.differences += _compare_file(path / files.frames, frames)
        outcomes.append(replace(outcome, log=None))
    if not result.rows:
        raise OmniError(f"nothing was recorded in {path}: there is nothing to compare with")
    is_incomplete = any(outcome.entry["status"] == "not run" for outcome in outcomes)
    if is_incomplete:
        result.remarks.append("some scenarios were not run: there is nothing to compare with")
    first_scenario = outcomes[0].scenario
    repeated_summary = Result(
        outcomes,
        first_scenario.labels,
        list_privileged(first_scenario),
        first_scenario.seed_list,
        record["subject"],
        stopped=saved_summary["stopped"] if is_incomplete else None,
        complete=all(outcome.was_run for outcome in outcomes),
    ).summary()
    if saved_summary["versions"] == record["versions"]:  # other ones are a remark
        repeated_summary["versions"] = record["versions"]
    result.differences += _compare_file(path / SUMMARY_FILE, repeated_summary)
    study = "compare" if several or (path / "compare.md").exists() else "run"
    scenarios = [outcome.scenario for outcome in outcomes]
    input_files = [name_files(name, several).scenario for name in record["scenarios"]]
    frames_saved = bool(result.frames) or record["frames_saved"]
    options = {"frames_saved": frames_saved, "subject": saved_summary["subject"]}
    result.differences += saved_run.compare_record(study, scenarios, input_files, options)
    return result


def _repeat_sweep(saved_run: _SavedRun, start_progress: StartProgress) -> VerifyResult:
    """Repeat and compare the stored rows of a sweep."""
    path = saved_run.path
    saved_run.check_input(SWEEP_FILE)
    saved_plan, saved_summary = read_json(path / SWEEP_FILE), read_json(path / SUMMARY_FILE)
    name, *variants = saved_run.record["scenarios"]
    scenario = saved_run.load_scenario(name, "scenario.toml", saved_summary["settings"])
    axes = dict(saved_plan["axes"])
    models = [file for variant in variants for file in saved_run.find_models(variant)]
    if models:
        axes[MODEL_AXIS] = models
    plan = SweepPlan(scenario, check_axes(axes.items()), saved_plan["batch_size"])
    shards = stored_shards(plan, path)
    if not shards:
        raise OmniError(f"nothing was recorded in {path}: there is nothing to compare with")
    shard_rows = dict(run_shards(plan, shards, start_progress("sweep", plan.frames * len(shards))))
    if models:
        saved_models = dict(zip(models, saved_plan["axes"][MODEL_AXIS], strict=True))
        shard_rows = {
            shard: _rename_models(rows, saved_models) for shard, rows in shard_rows.items()
        }
    all_rows = merge_rows(plan, list(shard_rows.values()))
    result = VerifyResult(all_rows.num_rows, is_sweep=True)
    for file, shards_in_file in list_row_files(plan, path).items():
        if file.exists():
            rows = all_rows if file.name == ROWS else shard_rows[shards_in_file[0]]
            result.differences += _compare_file(file, rows)
    repeated_summary = summarize_sweep(plan, all_rows, len(shards), path)
    saved_scenario = toml_files.read_toml(path / "scenario.toml")
    repeated_summary["settings"]["model"]["file"] = saved_scenario["model"]["file"]
    result.differences += _compare_file(path / SUMMARY_FILE, repeated_summary)
    options = {"frames_saved": False, "subject": None}
    result.differences += saved_run.compare_record(
        "sweep", plan.recorded_scenarios, plan.files, options
    )
    return result


def _rename_models(rows: pa.Table, names: Mapping[str, str]) -> pa.Table:
    """Return rows of a sweep over models with other names of these."""
    index = rows.column_names.index(MODEL_AXIS)
    renamed = [names[file] for file in rows[MODEL_AXIS].to_pylist()]
    return rows.set_column(index, MODEL_AXIS, pa.array(renamed))


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
    if entry["status"] == "not run":
        return Outcome.not_run(scenario)
    try:
        simulation = Simulation(scenario)
    except OmniError as error:
        if entry["status"] != "failed":
            raise
        return Outcome.not_run(scenario, " ".join(str(error).split()))
    is_stopped = entry["status"] == "stopped"
    n_frames = entry["frames"] if is_stopped else count_frames(simulation)
    show = start_progress(scenario.name, n_frames)

    def after_frame(frame: int) -> None:
        show(frame)
        if is_stopped and frame + 1 == n_frames:
            raise StoppedError(str(entry["reason"]))

    return run_simulation(simulation, after_frame)


def _compare_file(path: Path, repeated: Any) -> Iterator[str]:
    """Yield the differences of a file from the content that its repetition has, a line each.

    Args:
        path: JSON file or table.
        repeated: Mapping or table.
    """
    if isinstance(repeated, pa.Table):
        lines = _compare_tables(parquet.read_table(path), repeated)
    else:
        lines = _compare_json(read_json(path), repeated)
    yield from (f"{path.name}: {line}" for line in lines)


def _compare_json(saved: Record, repeated: Record) -> Iterator[str]:
    """Yield the differences of two JSON objects, a line for all."""
    differences = {
        name: values
        for name, values in find_differences(saved, repeated).items()
        if ABSENT in values or name.rpartition(".")[2] not in UNREPEATABLE
    }
    if differences:
        name, values = next(iter(differences.items()))
        saved_value, repeated_value = map(json.dumps, values)
        yield (
            f"{name} is {saved_value} in the run, {repeated_value} here; "
            f"{format_count(len(differences), 'different number')}"
        )


def _compare_tables(saved: pa.Table, repeated: pa.Table) -> Iterator[str]:
    """Yield the differences of two tables, a line each. NaNs are equal."""
    if saved.num_rows != repeated.num_rows:
        yield (
            f"the run has {format_count(saved.num_rows, 'line')}, its repetition "
            f"{repeated.num_rows}"
        )
    n_lines = min(saved.num_rows, repeated.num_rows)
    first_difference: dict[str, int] = {}  # column -> line of the table
    for name in dict.fromkeys(saved.column_names + repeated.column_names):
        if name not in repeated.column_names:
            yield f"the repetition has no column {name}"
            continue
        if name not in saved.column_names:
            yield f"the run has no column {name}"
            continue
        old, new = (_decode(rows[name].slice(0, n_lines)) for rows in (saved, repeated))
        if old.type != new.type:
            yield f"{name} has the type {old.type} in the run, {new.type} here"
            continue
        differs = _compare_bits(old, new)
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


def _decode(column: pa.ChunkedArray) -> pa.ChunkedArray:
    """Return a column without a dictionary."""
    is_encoded = pa.types.is_dictionary(column.type)
    return column.cast(column.type.value_type) if is_encoded else column


def _compare_bits(old: pa.ChunkedArray, new: pa.ChunkedArray) -> np.ndarray:
    """Return where two columns differ, shape (n,). NaNs are equal; 0.0 and -0.0 differ."""
    other_nulls = old.is_null().to_numpy() != new.is_null().to_numpy()
    old_values, new_values = old.to_numpy(), new.to_numpy()
    if old_values.dtype != float:
        return other_nulls | (old_values != new_values)
    is_nan = np.isnan(old_values) & np.isnan(new_values)
    return other_nulls | ((old_values.view(np.uint64) != new_values.view(np.uint64)) & ~is_nan)
