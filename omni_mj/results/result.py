"""What a study leaves: outcomes of its scenarios, as a summary, a table, Arrow tables and files."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omni_control.errors import OmniError
from omni_mj.config.rows import Row
from omni_mj.config.scenario import Scenario
from omni_mj.files import write_text
from omni_mj.results import summary
from omni_mj.results.result_tables import format_table, results_table
from omni_mj.simulation.log import Log

if TYPE_CHECKING:
    import pyarrow as pa

    from omni_mj.simulation.simulation import Failure


@dataclass(frozen=True)
class Outcome:
    """What came of one scenario.

    Attributes:
        scenario: as it was run.
        entry: what the summary says of it.
        rows: the robots that were run.
        failures: those that were stopped before their end, and why.
        metrics: numbers of each row, name -> (n,).
        log: all that was recorded, where it was kept.
        drawn_parameters: what sets the rows' robots apart, name -> (n,).
    """

    scenario: Scenario
    entry: summary.Entry
    rows: Sequence[Row] = ()
    failures: "Sequence[Failure]" = ()
    metrics: Mapping[str, np.ndarray] = field(default_factory=dict)
    log: Log | None = None
    drawn_parameters: Mapping[str, np.ndarray] = field(default_factory=dict)

    @classmethod
    def not_run(cls, scenario: Scenario, reason: str | None = None) -> "Outcome":
        """That of a scenario that has not been run, or that for a `reason` cannot be."""
        entry = summary.empty_entry(scenario)
        return cls(scenario, entry | {"status": "failed", "reason": reason} if reason else entry)


@dataclass
class Result:
    """What a study leaves, or has so far.

    Attributes:
        outcomes: of each scenario, in the order in which they are run.
        controllers: labels of those that were compared.
        privileged: those of them that are given the true state, and are no competitors.
        seeds: of the random numbers.
        subject: the controller of which verdicts were asked for, or None.
        created: when the study began, ISO 8601.
        wall_s: how long it took, s.
        stopped: why it ended before its time, or None; the summary of one that is not complete
            without a reason says that it goes on, or was killed.
        repeat_command: the command line that gives the same, where there is one.
        complete: whether all that was asked for has been done.
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
    def failures(self) -> "list[Failure]":
        """Every row that was stopped before its end."""
        return [failure for outcome in self.outcomes for failure in outcome.failures]

    def __getitem__(self, scenario: str) -> Outcome:
        """The outcome of a scenario, by its name."""
        return {outcome.scenario.name: outcome for outcome in self.outcomes}[scenario]

    def summary(self) -> dict[str, Any]:
        """What summary.json holds: every number, with its definition."""
        names = (
            "created",
            "complete",
            "stopped",
            "wall_s",
            "repeat_command",
            "controllers",
            "privileged",
            "seeds",
        )
        head = {name: getattr(self, name) for name in (*names, "subject")}
        head |= {name: list(head[name]) for name in ("controllers", "privileged", "seeds")}
        head |= {"stopped": None if self.complete else self.stopped or summary.UNFINISHED}
        head |= {"wall_s": round(self.wall_s, 3)}
        return summary.build_summary(
            {outcome.scenario.name: outcome.entry for outcome in self.outcomes}, head
        )

    def table(self) -> str:
        """The controllers' errors, effort and time to settle, as lines of text."""
        return format_table(results_table(self.summary()))

    def frames(self) -> "pa.Table":
        """Everything that was recorded: one line per row and frame, after the scenario's name if there are several.

        Raises:
            OmniError: nothing was kept of the frames.
        """
        import pyarrow as pa

        logs = {outcome.scenario.name: outcome.log for outcome in self.outcomes if outcome.log}
        if not logs:
            raise OmniError("no frames were kept; compare(..., keep=True) keeps them")
        tables = [log.table() for log in logs.values()]
        if len(self.outcomes) == 1:
            return tables[0]
        names = [
            pa.array([name] * each.num_rows, pa.string())
            for name, each in zip(logs, tables, strict=True)
        ]
        tables = [
            each.add_column(0, "scenario", name) for each, name in zip(tables, names, strict=True)
        ]
        return pa.concat_tables(tables, promote_options="default").unify_dictionaries()

    def rows(self) -> "pa.Table":
        """One line per row: what it is, when and why it failed, the settings in which rows differ, and its numbers."""
        import pyarrow as pa

        lines = [line for outcome in self.outcomes for line in _lines(outcome)]
        names = dict.fromkeys(name for line in lines for name in line)
        settings = {name for name in names if "." in name or name == "fault"}
        same = {
            name for name in settings if all(line.get(name) == lines[0].get(name) for line in lines)
        }
        return pa.table(
            {
                name: pa.array([line.get(name) for line in lines])
                for name in names
                if name not in same
            }
        )

    def save(self, folder: str | Path) -> None:
        """Write summary.json, the effective scenarios and, where they were kept, the frames; each whole or not at all.

        One scenario leaves scenario.toml and trajectory.parquet; several scenarios/NAME.toml and
        trajectories/NAME.parquet. provenance.json and sources/ say what was run, for
        `omni_mj.verify`. Folders are made; files of the same names are replaced.
        """
        from omni_mj.results import provenance

        self.save_files(Path(folder))
        study = type(self).__name__.removesuffix("Result").lower()
        study = study or ("compare" if len(self.outcomes) > 1 else "run")
        kept = all(outcome.log is not None for outcome in self.outcomes)
        provenance.save_provenance(
            Path(folder), study, None, [outcome.scenario for outcome in self.outcomes], kept
        )

    def save_files(self, folder: Path) -> None:
        """As `save`, without what says what was run; the summary last, since it says that all is there."""
        for outcome in self.outcomes:
            self.save_outcome(outcome, folder)
        self.save_summary(folder)

    def save_summary(self, folder: Path) -> None:
        """Write summary.json: strict JSON, in which nothing is not a number."""
        folder.mkdir(parents=True, exist_ok=True)
        write_text(
            folder / "summary.json", json.dumps(self.summary(), indent=2, allow_nan=False) + "\n"
        )

    def save_outcome(self, outcome: Outcome, folder: Path) -> None:
        """Write a scenario as it was run and, where they were kept, its frames."""
        name, several = outcome.scenario.name, len(self.outcomes) > 1
        scenario = folder / "scenarios" / f"{name}.toml" if several else folder / "scenario.toml"
        scenario.parent.mkdir(parents=True, exist_ok=True)
        write_text(scenario, outcome.scenario.to_toml())
        if outcome.log and outcome.log.lengths.any():
            frames = (
                folder / "trajectories" / f"{name}.parquet"
                if several
                else folder / "trajectory.parquet"
            )
            frames.parent.mkdir(exist_ok=True)
            outcome.log.save(frames)


def _lines(outcome: Outcome) -> Iterator[dict[str, Any]]:
    """Yield a row's name, failure, settings and numbers, row by row."""
    failures = {failure.row: failure for failure in outcome.failures}
    settings = {id(row.settings): row.settings for row in outcome.rows}  # rows share them
    plain = {key: dict(summary.flatten(value.to_dict())) for key, value in settings.items()}
    for i, row in enumerate(outcome.rows):
        failure = failures.get(i)
        yield {
            "scenario": outcome.scenario.name,
            "controller": row.controller,
            "seed": row.seed,
            "slot": row.slot,
            "failed_at_s": failure.time_s if failure else None,
            "cause": failure.cause if failure else None,
            **{
                name: json.dumps(value) if isinstance(value, list | tuple) else value
                for name, value in plain[id(row.settings)].items()
            },
            **{
                name: values[i]
                for name, values in {**outcome.metrics, **outcome.drawn_parameters}.items()
            },
        }
