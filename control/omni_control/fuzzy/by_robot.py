"""Fuzzy rules by loops, one evaluation after the other, for a compiler: what `Mamdani` does by numpy.

To the same bits: memberships and regions are reckoned by its laws, and added in its order.
"""

import numpy as np

from omni_control.fuzzy.centroid import under
from omni_control.fuzzy.mamdani import degree
from omni_control.fuzzy.tables import Tables
from omni_control.kinematics import Array


def velocity(t: Tables, ranges: tuple[float, float], x: float, y: float) -> tuple[float, float]:
    """The velocity for errors of a position, m; see `FuzzyLaw`, which has the ranges. Of what is no number, none."""
    if np.isnan(x) or np.isnan(y):
        return np.nan, np.nan
    heights = np.empty(t.rules.shape[1])
    infer(t, (x / ranges[0], y / ranges[0]), heights)
    return ranges[1] * centre(t, heights, 0), ranges[1] * centre(t, heights, 1)


def infer(t: Tables, values: tuple[float, ...], heights: Array) -> None:
    """Find the heights (sets,), written, of outputs' sets for inputs that are numbers; see `Mamdani.infer`."""
    for k in range(len(heights)):
        heights[k] = -np.inf
        for j in range(len(t.rules)):
            strength = np.inf
            for condition in range(len(t.conditions)):
                s = t.conditions[condition, t.rules[j, k]]
                i = t.owner[s]
                value = min(max(values[i], t.ends[0, i]), t.ends[1, i])
                strength = min(strength, degree(value, t.sides[0, s], t.sides[1, s], t.sides[2, s], t.sides[3, s]))
            heights[k] = max(heights[k], strength)


def centre(t: Tables, heights: Array, o: int) -> float:
    """An output for heights; see `CentreOfGravity`."""
    area, moment, r = 0.0, 0.0, t.regions
    for k in range(r.shape[1]):
        level = heights[t.members[0, k, o]]
        for j in range(1, len(t.members)):
            level = max(level, heights[t.members[j, k, o]])
        polynomials = r[2, k, o], r[3, k, o], r[4, k, o], r[5, k, o], r[6, k, o]
        more, turning = under(level, r[0, k, o], r[1, k, o], *polynomials)
        area, moment = area + more, moment + turning
    found: float = t.middle[o] + moment / area
    return found
