"""Fuzzy rules by loops, one evaluation after the other, for a compiler: what `Mamdani` does by numpy.

To the same bits: memberships and regions are reckoned by its laws, and added in its order.
"""

import numpy as np

from omni_control.fuzzy.centroid import under
from omni_control.fuzzy.mamdani import degree
from omni_control.fuzzy.tables import Rows, Tables
from omni_control.kinematics import Array


def velocity(t: Tables, ranges: tuple[float, float], x: float, y: float) -> tuple[float, float]:
    """The velocity for errors of a position, m; see `FuzzyLaw`, which has the ranges. Of what is no number, none."""
    errors, found = np.empty(2), np.empty(2)
    errors[0], errors[1] = x / ranges[0], y / ranges[0]
    if np.isnan(errors).any():
        return np.nan, np.nan
    evaluate(t, errors, found)
    return ranges[1] * found[0], ranges[1] * found[1]


def evaluate(t: Tables, values: Array, outputs: Array) -> None:
    """Find the outputs (outputs,), written, for inputs (inputs,) that are numbers."""
    degrees = np.empty(len(t.owner))
    for k in range(len(degrees)):
        i = t.owner[k]
        value = min(max(values[i], t.ends[0, i]), t.ends[1, i])
        degrees[k] = degree(value, t.sides[0, k], t.sides[1, k], t.sides[2, k], t.sides[3, k])
    strengths = np.empty(t.conditions.shape[1])
    for k in range(len(strengths)):
        strengths[k] = degrees[t.conditions[0, k]]
        for j in range(1, len(t.conditions)):
            strengths[k] = min(strengths[k], degrees[t.conditions[j, k]])
    heights = np.empty(t.rules.shape[1])
    for k in range(len(heights)):
        heights[k] = _highest(strengths, t.rules[:, k])
    for o in range(len(outputs)):
        area, moment = 0.0, 0.0
        for k in range(t.regions.shape[1]):
            r = t.regions[:, k, o]
            more, turning = under(_highest(heights, t.members[:, k, o]), r[0], r[1], r[2], r[3], r[4], r[5], r[6])
            area, moment = area + more, moment + turning
        outputs[o] = t.middle[o] + moment / area


def _highest(values: Array, rows: Rows) -> float:
    """The highest of some values."""
    highest: float = values[rows[0]]
    for j in range(1, len(rows)):
        highest = max(highest, values[rows[j]])
    return highest
