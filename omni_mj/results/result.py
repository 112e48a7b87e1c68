"""The result of a study, with an outcome for each scenario, and its files."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from omni_control.arguments import check_types
from omni_control.errors import OmniError, suggest_names
from omni_mj.config.rows import Row
from omni_mj.config.scenario import Scenario
from omni_mj.config.settings import Settings
from omni_mj.io.atomic_files import create_folder, lock_folder, write_json, write_text
from omni_mj.results import summary
from omni_mj.results.result_tables import results_table
from omni_mj.results.text_table import format_table
from omni_mj.simulation.log import Failure, Log

if TYPE_CHECKING:
    import pyarrow as pa


@dataclass(frozen=True)
class Outcome:
    """Outcome of one scenario.

    Attributes:
        scenario: The scenario as it was run.
        entry: Its entry in the summary.
        rows: Rows that were run.
        failures: Rows that were stopped before their end, with the causes.
        metrics: Metrics of the rows, name -> shape (n,).
        log: Recorded frames, or None if they were not kept.
        drawn_parameters: Parameters drawn for each row, name -> shape (n,).
    """

    scenario: Scenario
    entry: summary.Entry
    rows: Sequence[Row] = ()
    failures: Sequence[Failure] = ()
    metrics: Mapping[str, np.ndarray] = field(default_factory=dict)
    log: Log | None = None
    drawn_parameters: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def was_run(self) -> bool:
        """Whether the scenario ran to its end, and no controller failed at its start."""
        return self.entry["status"] == "done" and all(row.time_s > 0 for row in self.failures)

    @classmethod
    def not_run(cls, scenario: Scenario, reason: str | None = None) -> "Outcome":
        """Return the outcome of a scenario that was not run.

        Args:
            scenario: The scenario.
            reason: Reason why it cannot be run, or None if it was not reached.
        """
        entry = summary.empty_entry(scenario)
        return cls(scenario, entry | {"status": "failed", "reason": reason} if reason else entry)


@dataclass
class Result:
    """Result of a study, which may be incomplete.

    Attributes:
        outcomes: Outcomes of the scenarios, in the order of their runs.
        controllers: Labels of the controllers.
        privileged: Controllers that know the true state and do not compete.
        seeds: Seeds of the random numbers.
        subject: Controller that the verdicts are about, or None.
        created: Start of the study, ISO 8601.
        wall_s: Duration of the study, s.
        stopped: Reason why the study ended early, or None.
        repeat_command: Command line that repeats the study, or None.
        complete: Whether everything was run.
    """

    outcomes: list[Outcome]
    controllers: Sequence[str] = ()
    privileged: Sequence[str] = ()
    seeds: Sequence[int] = ()
    subject: str | None = None
    created: str = field(default_factory=lambda: datetime.now(UTC).isoformat(timespec="seconds"))
    wall_s: float = 0.0
    stopped: str | None = None
    repeat_command: str | None = None
    complete: bool = False

    @property
    def failures(self) -> list[Failure]:
        """All rows that were stopped before their end."""
        return [failure for outcome in self.outcomes for failure in outcome.failures]

    @check_types
    def __getitem__(self, scenario: str) -> Outcome:
        """Return the outcome of a scenario, given its name."""
        outcomes = {outcome.scenario.name: outcome for outcome in self.outcomes}
        if scenario not in outcomes:
            hint = suggest_names(scenario, outcomes)
            raise OmniError(f"the result has no scenario {scenario!r}; {hint}")
        return outcomes[scenario]

    def summary(self) -> dict[str, Any]:
        """Return the content of summary.json: all numbers and their definitions."""
        reasons = [
            self.stopped,
            *(outcome.entry["reason"] for outcome in self.outcomes),
            *(failure.cause for failure in self.failures if not failure.time_s),
            summary.UNFINISHED,
        ]
        stopped = None if self.complete else next(filter(None, reasons))
        head = {
            "created": self.created,
            "complete": self.complete,
            "stopped": stopped,
            "wall_s": round(self.wall_s, 3),
            "repeat_command": self.repeat_command,
            "controllers": list(self.controllers),
            "privileged": list(self.privileged),
            "seeds": list(self.seeds),
            "subject": self.subject,
        }
        entries = {outcome.scenario.name: outcome.entry for outcome in self.outcomes}
        return summary.build_summary(entries, head)

    def table(self) -> str:
        """Return the controllers' errors and settling times as lines of text."""
        return format_table(results_table(self.summary()))

    def frames(self) -> "pa.Table":
        """Return all recorded frames, a line per row and frame.

        If there are several scenarios, the first column has their names.

        Raises:
            OmniError: The frames were not kept.
        """
        import pyarrow as pa

        frames = {
            outcome.scenario.name: outcome.log.to_arrow()
            for outcome in self.outcomes
            if outcome.log
        }
        if not frames:
            raise OmniError("no frames were kept; compare(..., keep_frames=True) keeps them")
        if len(self.outcomes) == 1:
            return next(iter(frames.values()))
        named_frames = [
            rows.add_column(0, "scenario", pa.array([name] * rows.num_rows, pa.string()))
            for name, rows in frames.items()
        ]
        return pa.concat_tables(named_frames, promote_options="default").unify_dictionaries()

    def rows(self) -> "pa.Table":
        """Return a table with one line per row: names, failure, settings and metrics.

        Settings that are equal in all rows are left out.
        """
        import pyarrow as pa

        row_tables = [pa.table({}), *map(_tabulate_rows, self.outcomes)]
        rows = pa.concat_tables(row_tables, promote_options="permissive")
        equal_settings = [
            name
            for name in rows.column_names
            if ("." in name or name == "fault") and len(rows[name].unique()) == 1
        ]
        return rows.drop_columns(equal_settings)

    @check_types
    def save(self, folder: str | Path) -> None:
        """Write summary.json, the scenarios, the frames if they were kept, and the provenance.

        One scenario is written to scenario.toml and trajectory.parquet; several to
        scenarios/NAME.toml and trajectories/NAME.parquet. `omni_mj.verify` needs provenance.json
        and sources/. Folders are created; files of the same names are replaced. Each file appears
        complete or not at all.
        """
        from omni_mj.results import provenance

        study = type(self).__name__.removesuffix("Result").lower()
        study = study or ("compare" if len(self.outcomes) > 1 else "run")
        scenarios = [outcome.scenario for outcome in self.outcomes]
        options = provenance.describe_options(
            scenario_texts(scenarios),
            all(outcome.log is not None for outcome in self.outcomes),
            self.subject,
        )
        create_folder(Path(folder))
        with lock_folder(Path(folder)):
            self.save_files(Path(folder))
            provenance.save_provenance(Path(folder), study, None, scenarios, options)

    def save_files(self, folder: Path) -> None:
        """Write the same files as `save`, except for the provenance.

        The summary is written last: if it says that the result is complete, all files exist.
        """
        for outcome in self.outcomes:
            self.save_outcome(outcome, folder)
        self.save_summary(folder)

    def save_summary(self, folder: Path) -> dict[str, Any]:
        """Write summary.json, strict JSON without NaN, and return its content."""
        create_folder(folder)
        content = self.summary()
        write_json(folder / "summary.json", content)
        return content

    def save_outcome(self, outcome: Outcome, folder: Path) -> None:
        """Write a scenario as it was run, and its frames if they were kept."""
        names = name_files(outcome.scenario.name, several=len(self.outcomes) > 1)
        scenario_path, frames_path = (folder / name for name in names)
        create_folder(scenario_path.parent)
        write_text(scenario_path, outcome.scenario.to_toml())
        if outcome.log and outcome.log.lengths.any():
            create_folder(frames_path.parent)
            outcome.log.save(frames_path)


class ScenarioFiles(NamedTuple):
    """Paths of a scenario and of its frames in the folder of a result."""

    scenario: str
    frames: str


def name_files(name: str, several: bool) -> ScenarioFiles:
    """Return the paths of a scenario's files, given its name and whether there are others."""
    if several:
        return ScenarioFiles(f"scenarios/{name}.toml", f"trajectories/{name}.parquet")
    return ScenarioFiles("scenario.toml", "trajectory.parquet")


def scenario_texts(scenarios: Sequence[Scenario]) -> dict[str, str]:
    """Return the texts of all scenarios of a result, by their paths in its folder."""
    several = len(scenarios) > 1
    return {name_files(item.name, several).scenario: item.to_toml() for item in scenarios}


def list_row_columns(rows: Sequence[Row], failures: Iterable[Failure]) -> dict[str, Any]:
    """Return columns with controller, seed, slot and failure of rows, name -> n values."""
    import pyarrow as pa

    failure_times = {failure.row: failure.time_s for failure in failures}
    failure_causes = {failure.row: failure.cause for failure in failures}
    return {
        "controller": [row.controller for row in rows],
        "seed": [row.seed for row in rows],
        "slot": [row.slot for row in rows],
        "failed_at_s": pa.array(map(failure_times.get, range(len(rows))), pa.float64()),
        "cause": pa.array(map(failure_causes.get, range(len(rows))), pa.string()),
    }


def _tabulate_rows(outcome: Outcome) -> "pa.Table":
    """Return names, failure, settings and metrics of the rows of an outcome."""
    import pyarrow as pa

    @cache  # rows share settings
    def flatten_settings(settings: Settings) -> dict[str, Any]:
        return {
            name: json.dumps(value) if isinstance(value, list) else value
            for name, value in summary.flatten(settings.to_dict())
        }

    settings = pa.Table.from_pylist([flatten_settings(row.settings) for row in outcome.rows])
    return pa.table(
        {
            "scenario": [outcome.scenario.name] * len(outcome.rows),
            **list_row_columns(outcome.rows, outcome.failures),
            **dict(zip(settings.column_names, settings.columns, strict=True)),
            **outcome.metrics,
            **outcome.drawn_parameters,
        }
    )
