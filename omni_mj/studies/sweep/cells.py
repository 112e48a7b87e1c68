"""What a sweep says of each point and controller: how often robots fail, and how far they stray, with confidence."""

from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.measure.statistics import CONFIDENCE, plain

if TYPE_CHECKING:
    import pyarrow as pa

STRAYED = "distance_max_m"
SHOWN = {STRAYED: "maximum error in the plane, m", "distance_mean_m": "mean error in the plane, m"}


@cache
def wilson(failed: int, count: int) -> tuple[float, float]:
    """Return the 95 % interval of a failure rate by Wilson's method: sane for 0 of n as well."""
    from scipy.stats import binomtest

    interval = binomtest(failed, count).proportion_ci(CONFIDENCE, method="wilson")
    return float(interval.low), float(interval.high)


def median(values: Array) -> tuple[float, float, float]:
    """Return the median of samples (n,), infinite for robots that failed, and its 95 % interval by order statistics.

    The interval has no assumption on how values spread: as many lie below the median as heads come of n coins. Its ends
    are NaN where samples are too few (below 6).
    """
    ordered, n = np.sort(values), len(values)
    low = _below_interval(n)
    with np.errstate(invalid="ignore"):  # infinite less infinite
        middle = float(np.median(ordered))
    return (middle, float(ordered[low]), float(ordered[n - 1 - low])) if low >= 0 else (middle, np.nan, np.nan)


@cache
def _below_interval(n: int) -> int:
    """Return how many of n samples are below the interval of their median; -1 where all would have to be within."""
    from scipy.stats import binom

    beyond = (1 - CONFIDENCE) / 2  # how likely so few of n samples lie below the median
    low = int(binom.ppf(beyond, n, 0.5))
    return low - bool(binom.cdf(low, n, 0.5) > beyond)


def of(table: "pa.Table", axes: list[str]) -> list[dict[str, Any]]:
    """Return a dictionary for each point and controller, in order: numbers, or None where none is finite."""
    names = ("point", "controller", "failed_at_s", *SHOWN)
    column = {name: table[name].to_numpy(zero_copy_only=False) for name in names}
    where = {name: table[name].to_pylist() for name in axes}
    found, controllers = [], list(dict.fromkeys(column["controller"]))
    numbers, first = np.unique(column["point"], return_index=True)  # rows of a point stand together
    for point, start, stop in zip(numbers, first, [*first[1:], table.num_rows], strict=True):
        for controller in controllers:
            own = start + np.flatnonzero(column["controller"][start:stop] == controller)
            if not own.size:
                continue
            failed = int((~np.isnan(column["failed_at_s"][own])).sum())
            low, high = wilson(failed, own.size)
            cell: dict[str, Any] = {"point": int(point), **{name: where[name][own[0]] for name in axes}}
            cell |= {"controller": controller, "robots": own.size, "failed": failed}
            cell |= {"failure_rate": failed / own.size, "failure_low": low, "failure_high": high}
            for name in SHOWN:
                tail = float(np.quantile(column[name][own], 0.9, method="higher"))
                ends = zip(("median", "low", "high"), median(column[name][own]), strict=True)
                cell[name] = {key: plain(value) for key, value in (*ends, ("p90", tail))}
            found.append(cell)
    return found
