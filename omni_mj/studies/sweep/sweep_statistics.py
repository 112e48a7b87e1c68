"""Statistics of a sweep: failure rates, errors, rank correlations, and the worst runs."""

import shlex
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omni_mj.config.plugins import format_controller_spec
from omni_mj.results.statistics import CONFIDENCE, finite_or_none
from omni_mj.studies.sweep.sweep_plan import SweepPlan

if TYPE_CHECKING:
    import pyarrow as pa

MAX_ERROR = "position_max_m"
ERROR_COLUMNS = (MAX_ERROR, "position_mean_m")
N_WORST = 3


def summarize_points(all_rows: "pa.Table", axes: list[str]) -> list[dict[str, Any]]:
    """Return the statistics of each point and controller.

    Failure rates have Wilson's 95 % interval, which is also valid for 0 of n failures. Medians have
    an interval by order statistics, which assumes no distribution. An error is infinite for a robot
    that failed. Below 6 samples there is no interval.

    Args:
        all_rows: Rows of the sweep; those of a point and controller are adjacent.
        axes: Names of the settings that vary.

    Returns:
        A dictionary for each point and controller; None stands for a number that is not finite.
    """
    keys = list(zip(all_rows["point"].to_pylist(), all_rows["controller"].to_pylist(), strict=True))
    statistics = []
    for (point, controller), indices in groupby(range(len(keys)), keys.__getitem__):
        rows = all_rows.take(list(indices))
        values = {name: rows[name][0].as_py() for name in axes}
        errors = {name: _error_statistics(rows[name].to_numpy()) for name in ERROR_COLUMNS}
        statistics.append(
            {"point": point, **values, "controller": controller} | _failure_rate(rows) | errors
        )
    return statistics


def _failure_rate(rows: "pa.Table") -> dict[str, Any]:
    """Return the number of robots that failed, and the failure rate with its interval."""
    from scipy.stats import binomtest

    n_failed = rows.num_rows - rows["cause"].null_count
    interval = binomtest(n_failed, rows.num_rows).proportion_ci(CONFIDENCE, method="wilson")
    return {
        "n_robots": rows.num_rows,
        "n_failed": n_failed,
        "failure_rate": n_failed / rows.num_rows,
        "failure_low": float(interval.low),
        "failure_high": float(interval.high),
    }


def _error_statistics(errors: np.ndarray) -> dict[str, float | None]:
    """Return median, its interval, and 90th percentile; None if infinite or unknown."""
    from scipy.stats import quantile_test

    interval = quantile_test(errors, p=0.5).confidence_interval(CONFIDENCE)
    with np.errstate(invalid="ignore"):  # infinity minus infinity
        median = np.median(errors)
    p90 = np.quantile(errors, 0.9, method="higher")
    statistics = {"median": median, "low": interval.low, "high": interval.high, "p90": p90}
    return {name: finite_or_none(value) for name, value in statistics.items()}


def rank_correlations(all_rows: "pa.Table") -> list[dict[str, Any]]:
    """Return Spearman's correlation of each varied or drawn number with each controller's errors.

    A robot that failed ranks last. The correlation is None if all errors are equal.
    """
    from scipy.stats import spearmanr

    correlations = []
    controllers = all_rows["controller"].to_numpy(zero_copy_only=False)
    for controller in all_rows["controller"].unique().to_pylist():
        rows = all_rows.take(np.flatnonzero(controllers == controller))
        for setting in (name for name in all_rows.column_names if "." in name):
            values = np.array(rows[setting].to_pylist())
            is_varied = values.dtype.kind in "if" and np.ptp(values) > 0
            if not is_varied:
                continue
            correlation: dict[str, Any] = {"controller": controller, "setting": setting}
            for name in ERROR_COLUMNS:
                errors = rows[name].to_numpy()
                is_constant = (errors == errors[0]).all()
                rho = np.nan if is_constant else spearmanr(values, errors).statistic
                correlation[name] = finite_or_none(rho)
            correlations.append(correlation)
    return correlations


def worst_runs(all_rows: "pa.Table", plan: SweepPlan, folder: Path) -> list[dict[str, Any]]:
    """Return the worst runs, with a command that repeats each.

    Runs that failed come first, then those with the largest errors.

    Args:
        all_rows: Rows of the sweep.
        plan: Plan of the sweep.
        folder: Folder of the sweep, with its scenario.
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
            command += ["--set", f"{name}={row[name]}"]
        run = {name: row[name] for name in columns}
        run[MAX_ERROR] = finite_or_none(row[MAX_ERROR])
        runs.append(run | {"repeat_command": shlex.join(command)})
    return runs
