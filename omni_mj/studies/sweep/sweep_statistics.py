"""Statistics of a sweep and their tables: failure rates, errors, rank correlations, worst runs.

Functions import scipy.stats, which takes a second, because processes that simulate do not need it.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from omni_mj.config.plugins import format_controller_spec
from omni_mj.config.toml_files import format_toml_value
from omni_mj.io.printable_text import format_count, join_words
from omni_mj.results.seed_statistics import CONFIDENCE, finite_or_none
from omni_mj.results.text_table import (
    Table,
    drop_equal_columns,
    format_markdown,
    format_number,
    format_table,
)
from omni_mj.studies.sweep.sweep_plan import SweepPlan

Record = dict[str, Any]  # object of summary.json

MAX_ERROR = "position_max_m"
ERROR_COLUMNS = (MAX_ERROR, "position_mean_m")
N_WORST = 3
MAX_LINES = 60  # of a table on a terminal
QUANTITIES = ("failed, %", "interval, %", "median, cm", "interval, cm", "p90, cm")


def summarize_points(all_rows: pa.Table, axes: list[str]) -> list[Record]:
    """Return the statistics of each point and controller.

    Failure rates have Wilson's 95 % interval, which is also valid for 0 of n failures. Medians have
    a 95 % interval by order statistics, which assumes no distribution and needs 6 samples. The
    error of a robot that failed is infinite.

    Args:
        all_rows: Rows of the sweep.
        axes: Names of the settings that vary.

    Returns:
        A dictionary for each point and controller; None stands for a number that is not finite.
    """
    aggregations = [(name, "list") for name in (*ERROR_COLUMNS, "cause")]
    groups = all_rows.group_by(["point", *axes, "controller"], use_threads=False)
    return [
        {name: group[name] for name in ("point", *axes, "controller")}
        | _failure_rate(group["cause_list"])
        | {name: _error_statistics(np.array(group[f"{name}_list"])) for name in ERROR_COLUMNS}
        for group in groups.aggregate(aggregations).to_pylist()
    ]


def _failure_rate(causes: list[str | None]) -> Record:
    """Return the number of robots that failed, and the failure rate with its interval."""
    from scipy.stats import binomtest

    n_robots, n_failed = len(causes), len(causes) - causes.count(None)
    interval = binomtest(n_failed, n_robots).proportion_ci(CONFIDENCE, method="wilson")
    return {
        "n_robots": n_robots,
        "n_failed": n_failed,
        "failure_rate": n_failed / n_robots,
        "failure_low": float(interval.low),
        "failure_high": float(interval.high),
    }


def _error_statistics(errors: np.ndarray) -> dict[str, float | None]:
    """Return median, 95 % interval of the median, and 90th percentile; None if not finite."""
    from scipy.stats import quantile_test

    interval = quantile_test(errors, p=0.5).confidence_interval(CONFIDENCE)
    with np.errstate(invalid="ignore"):  # infinity minus infinity
        median = np.median(errors)
    p90 = np.quantile(errors, 0.9, method="higher")
    return finite_or_none(
        {"median": median, "low": interval.low, "high": interval.high, "p90": p90}
    )


def rank_correlations(all_rows: pa.Table) -> list[Record]:
    """Return Spearman's correlations between settings that are numbers and controllers' errors.

    Robots that failed have the highest rank. The correlation is None if all errors are equal.

    Args:
        all_rows: Rows of the sweep.
    """
    from scipy.stats import spearmanr

    correlations = []
    for controller in all_rows["controller"].unique().to_pylist():
        rows = all_rows.filter(pc.field("controller") == controller)
        for setting in (name for name in all_rows.column_names if "." in name):
            values = np.array(rows[setting].to_pylist())
            if values.dtype.kind not in "if" or np.ptp(values) == 0:
                continue
            correlation: Record = {"controller": controller, "setting": setting}
            for name in ERROR_COLUMNS:
                errors = rows[name].to_numpy()
                is_constant = (errors == errors[0]).all()
                rho = np.nan if is_constant else spearmanr(values, errors).statistic
                correlation[name] = finite_or_none(rho)
            correlations.append(correlation)
    return correlations


def worst_runs(all_rows: pa.Table, plan: SweepPlan, folder: Path) -> list[Record]:
    """Return the worst runs, each with the command that repeats it.

    Runs that failed come first, the earliest failure at the top, then those with the largest
    errors.

    Args:
        all_rows: Rows of the sweep.
        plan: Plan of the sweep.
        folder: Folder of the sweep, which holds the scenario.
    """
    scenario = plan.scenario
    controllers = dict(
        zip(scenario.labels, map(format_controller_spec, scenario.controllers), strict=True)
    )
    keys = [("failed_at_s", "ascending"), (MAX_ERROR, "descending")]
    columns = ("point", *plan.axes, "controller", "seed", "cause")
    runs = []
    for row in all_rows.sort_by(keys).slice(0, N_WORST).to_pylist():
        command = ["omni-mj", "run", "--scenario", str(folder / "scenario.toml")]
        command += ["--controller", controllers[row["controller"]]]
        command += ["--seed", str(row["seed"]), "--seeds", "1"]
        for name in plan.axes:
            command += ["--set", f"{name}={format_toml_value(row[name])}"]
        run = {name: row[name] for name in columns}
        error_m = finite_or_none(row[MAX_ERROR])
        runs.append(run | {MAX_ERROR: error_m, "repeat_command": join_words(command)})
    return runs


def format_sweep_tables(plan: SweepPlan, summary: Record) -> str:
    """Return the tables as text; for a large sweep only the worst lines."""
    points = summary["points"]
    if len(points) > MAX_LINES:  # most failures first, then largest errors
        points = sorted(
            points, key=lambda point: (-point["failure_rate"], -(point[MAX_ERROR]["p90"] or 1e9))
        )[:MAX_LINES]
    return "\n\n".join(map(format_table, _list_tables(plan, summary, points)))


def format_sweep_markdown(plan: SweepPlan, summary: Record) -> str:
    """Return the complete tables as Markdown."""
    blocks = [
        f"{table.title}\n\n{format_markdown(table)}\n"
        for table in _list_tables(plan, summary, summary["points"])
    ]
    return "\n".join(blocks)


def _list_tables(plan: SweepPlan, summary: Record, points: list[Record]) -> list[Table]:
    """Return the table of points, and that of rank correlations if there are any."""
    sweep_tables = [_point_table(plan, summary, points)]
    rows = [
        [line["controller"], line["setting"], *(format_number(line[e]) for e in ERROR_COLUMNS)]
        for line in summary["correlations"]
    ]
    if rows:
        title = "settings that affect the position error: Spearman's rank correlation"
        sweep_tables.append(Table(title, ["controller", "setting", "maximum", "mean"], rows, 2))
    return sweep_tables


def _point_table(plan: SweepPlan, summary: Record, points: list[Record]) -> Table:
    """Return failure rates and maximum position errors with 95 % intervals."""
    names = list(plan.axes)
    n_robots = max(point["n_robots"] for point in points)
    title = f"{plan.scenario.name} on the {plan.scenario.plant} plant, "
    title += f"{format_count(n_robots, 'robot')} per line: maximum error, with 95 % intervals"
    if not summary["complete"]:
        title += f", {summary['n_done']} of {summary['n_shards']} shards"
    if len(points) < len(summary["points"]):
        title += f"; the worst {len(points)} of {len(summary['points'])} lines"
    headings = [*names, "controller", *QUANTITIES]
    rows = [_point_row(point, names) for point in points]
    return drop_equal_columns(Table(title, headings, rows, len(names) + 1), ["median, cm"])


def _point_row(point: Record, names: list[str]) -> list[str]:
    """Return the cells of a point and controller."""
    errors = {
        key: "∞" if error_m is None else f"{100 * error_m:.2f}"
        for key, error_m in point[MAX_ERROR].items()
    }
    values = [point[name] for name in names]
    return [
        *(f"{value:g}" if isinstance(value, float) else str(value) for value in values),
        point["controller"],
        f"{100 * point['failure_rate']:.3g}",
        f"{100 * point['failure_low']:.0f} to {100 * point['failure_high']:.0f}",
        errors["median"],
        f"{errors['low']} to {errors['high']}" if point[MAX_ERROR]["low"] is not None else "",
        errors["p90"],
    ]
