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


def wilson(failed: int, count: int) -> tuple[float, float]:
    """95 % interval of a failure rate (Wilson, J. Am. Stat. Assoc. 22, 1927): sane for 0 of n as well."""
    from scipy.special import ndtri

    z = float(ndtri((1 + CONFIDENCE) / 2))
    rate, weight = failed / count, z * z / count
    centre = (rate + weight / 2) / (1 + weight)
    half = z * np.sqrt(rate * (1 - rate) / count + weight / (4 * count)) / (1 + weight)
    return float(centre - half) if failed else 0.0, float(centre + half) if failed < count else 1.0


def median(values: Array) -> tuple[float, float, float]:
    """Median of samples (n,), infinite for robots that failed, and its 95 % interval by order statistics.

    The interval has no assumption on how values spread: as many lie below the median as heads come of n coins. Not a
    number for its ends where samples are too few (below 6).
    """
    ordered, n = np.sort(values), len(values)
    low = _left_out(n)
    with np.errstate(invalid="ignore"):  # infinite less infinite
        middle = float(np.median(ordered))
    return (middle, float(ordered[low]), float(ordered[n - 1 - low])) if low >= 0 else (middle, np.nan, np.nan)


@cache
def _left_out(n: int) -> int:
    """How many of n samples are below the interval of their median; -1 where all would have to be within."""
    from scipy.stats import binom

    beyond = (1 - CONFIDENCE) / 2  # how likely so few of n samples lie below the median
    low = int(binom.ppf(beyond, n, 0.5))
    return low - bool(binom.cdf(low, n, 0.5) > beyond)


def of(table: "pa.Table", axes: list[str]) -> list[dict[str, Any]]:
    """A dictionary for each point and controller, in order: numbers, or None where there is none that is finite."""
    column = {
        name: table[name].to_numpy(zero_copy_only=False) for name in ("point", "controller", "failed_at_s", *SHOWN)
    }
    where = {name: table[name].to_pylist() for name in axes}
    numbers, first = np.unique(column["point"], return_index=True)  # rows of a point stand together
    found, controllers = [], list(dict.fromkeys(column["controller"]))
    for point, low_row, high_row in zip(numbers, first, [*first[1:], table.num_rows], strict=True):
        for controller in controllers:
            own = low_row + np.flatnonzero(column["controller"][low_row:high_row] == controller)
            if not own.size:
                continue
            failed = int((~np.isnan(column["failed_at_s"][own])).sum())
            low, high = wilson(failed, own.size)
            cell: dict[str, Any] = {"point": int(point), **{name: where[name][own[0]] for name in axes}}
            cell |= {"controller": controller, "robots": own.size, "failed": failed}
            cell |= {"failure_rate": failed / own.size, "failure_low": low, "failure_high": high}
            for name in SHOWN:
                values = column[name][own]
                middle, least, most = median(values)
                tail = float(np.quantile(values, 0.9, method="higher"))
                cell[name] = {"median": plain(middle), "low": plain(least), "high": plain(most), "p90": plain(tail)}
            found.append(cell)
    return found
