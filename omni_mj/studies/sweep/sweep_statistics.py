"""What a sweep says: how often robots fail and how far they stray, what matters, and which runs are the worst."""

import shlex
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omni_mj.config.plugins import written
from omni_mj.results.statistics import CONFIDENCE, finite_or_none
from omni_mj.studies.sweep.sweep_plan import SweepPlan

if TYPE_CHECKING:
    import pyarrow as pa

STRAYED = "position_max_m"
SHOWN = (STRAYED, "position_mean_m")  # maximum and mean error in the plane
N_WORST = 3


def cells(table: "pa.Table", axes: list[str]) -> list[dict[str, Any]]:
    """Return a dictionary for each point and controller, in order: numbers, or None where none is finite.

    Failure rates have Wilson's 95 % interval, which is sane for 0 of n as well. Medians have one by
    order statistics, which assumes nothing about the samples, infinite for robots that failed;
    there is none below 6 samples.

    Args:
        table: Rows of the sweep, those of a point and controller together.
        axes: Names of the settings that are varied.
    """
    from scipy.stats import binomtest, quantile_test

    keys = list(zip(table["point"].to_pylist(), table["controller"].to_pylist(), strict=True))
    result = []
    for (point, controller), group in groupby(range(len(keys)), keys.__getitem__):
        rows = table.take(list(group))
        n_failed = rows.num_rows - rows["cause"].null_count
        rate = binomtest(n_failed, rows.num_rows).proportion_ci(CONFIDENCE, method="wilson")
        cell = {
            "point": point,
            **{name: rows[name][0].as_py() for name in axes},
            "controller": controller,
        }
        cell |= {
            "robots": rows.num_rows,
            "failed": n_failed,
            "failure_rate": n_failed / rows.num_rows,
        }
        cell |= {"failure_low": float(rate.low), "failure_high": float(rate.high)}
        for name in SHOWN:
            errors = rows[name].to_numpy()
            interval = quantile_test(errors, p=0.5).confidence_interval(CONFIDENCE)
            with np.errstate(invalid="ignore"):  # infinite less infinite
                median = np.median(errors)
            numbers = {"median": median, "low": interval.low, "high": interval.high}
            numbers["p90"] = np.quantile(errors, 0.9, method="higher")
            cell[name] = {key: finite_or_none(value) for key, value in numbers.items()}
        result.append(cell)
    return result


def correlations(table: "pa.Table") -> list[dict[str, Any]]:
    """Return Spearman's rank correlation of each number that is varied or drawn with each controller's errors.

    A robot that failed ranks behind all others. It is None where errors are all the same.
    """
    from scipy.stats import spearmanr

    result = []
    for controller in table["controller"].unique().to_pylist():
        rows = table.take(
            np.flatnonzero(table["controller"].to_numpy(zero_copy_only=False) == controller)
        )
        for setting in (name for name in table.column_names if "." in name):
            values = np.array(rows[setting].to_pylist())
            if values.dtype.kind in "if" and np.ptp(values) > 0:
                line = {"controller": controller, "setting": setting}
                for error in SHOWN:
                    errors = rows[error].to_numpy()
                    is_constant = (errors == errors[0]).all()
                    line[error] = (
                        None if is_constant else finite_or_none(spearmanr(values, errors).statistic)
                    )
                result.append(line)
    return result


def worst(table: "pa.Table", plan: SweepPlan, folder: Path) -> list[dict[str, Any]]:
    """Return the worst runs, and the command that repeats each: those that failed first, then those that strayed most.

    Args:
        table: Rows of the sweep.
        plan: Of the sweep.
        folder: Of the sweep, with its scenario.
    """
    kinds = dict(zip(plan.scenario.labels, map(written, plan.scenario.controllers), strict=True))
    keys = [("failed_at_s", "ascending"), (STRAYED, "descending")]
    result = []
    for row in table.sort_by(keys).slice(0, N_WORST).to_pylist():
        words = [
            "--scenario",
            str(folder / "scenario.toml"),
            "--controller",
            kinds[row["controller"]],
        ]
        words += ["--seed", str(row["seed"]), "--seeds", "1"]
        words += [word for name in plan.axes for word in ("--set", f"{name}={row[name]}")]
        columns = ("point", *plan.axes, "controller", "seed", "cause")
        line = {name: row[name] for name in columns} | {STRAYED: finite_or_none(row[STRAYED])}
        result.append({**line, "repeat_command": shlex.join(["omni-mj", "run", *words])})
    return result
