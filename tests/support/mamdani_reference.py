"""A Mamdani controller as plainly as it can be written: one evaluation, loops, no tables. Numbers of any type will do.

The clipped union is piecewise linear, and bends nowhere but where lines meet that bound it: sides and clipping heights.
Between two neighbouring meetings it is one line, whose area and moment follow from its values at two inner points.
"""

import itertools
from collections.abc import Sequence
from dataclasses import astuple
from fractions import Fraction
from typing import Any

from omni_control.fuzzy.mamdani import Rule, Variable

Corners = tuple[Any, Any, Any, Any]


def membership(corners: Corners, z: Any) -> Any:
    """Degree to which z belongs to a trapezoid."""
    left_foot, left_shoulder, right_shoulder, right_foot = corners
    if not left_foot <= z <= right_foot:
        return 0 * z
    if z < left_shoulder:
        return (z - left_foot) / (left_shoulder - left_foot)
    if z > right_shoulder:
        return (right_foot - z) / (right_foot - right_shoulder)
    return 0 * z + 1


def centre_of_gravity(sets: Sequence[Corners], heights: Sequence[Any], low: Any, high: Any) -> Any:
    """Centre of gravity of the maximum of the sets clipped at the heights."""
    lines = [(0 * h, h) for h in heights]  # slope, value at 0
    for a, b, c, d in sets:
        if a < b:
            lines.append((1 / (b - a), -a / (b - a)))
        if c < d:
            lines.append((-1 / (d - c), d / (d - c)))
    meetings = [(s - q) / (p - r) for (p, q), (r, s) in itertools.combinations(lines, 2) if p != r]
    bends = sorted({low, high, *(z for z in [*itertools.chain(*sets), *meetings] if low < z < high)})
    area = moment = 0 * low
    for p, q in itertools.pairwise(bends):
        length, middle = q - p, (p + q) / 2
        left, right = (
            max(min(h, membership(s, middle + shift)) for s, h in zip(sets, heights, strict=True))
            for shift in (-length / 4, length / 4)
        )
        piece = length * (left + right) / 2
        area += piece
        moment += middle * piece + (right - left) * length**2 / 6
    return moment / area


def evaluate(
    inputs: Sequence[Variable], outputs: Sequence[Variable], rules: Sequence[Rule], values: Sequence[Any]
) -> list[Any]:
    """Outputs of one evaluation."""
    exact = Fraction if isinstance(values[0], Fraction) else float

    def corners(variable: Variable, label: str) -> Corners:
        return tuple(exact(z) for z in astuple(variable.sets[label]))

    clipped = {v.name: min(max(z, exact(v.low)), exact(v.high)) for v, z in zip(inputs, values, strict=True)}
    known = {v.name: v for v in inputs}
    results = []
    for output in outputs:
        heights = dict.fromkeys(output.sets, exact(0))
        for conditions, conclusions in rules:
            if output.name in conclusions:
                strength = min(membership(corners(known[n], label), clipped[n]) for n, label in conditions.items())
                heights[conclusions[output.name]] = max(heights[conclusions[output.name]], strength)
        sets = [corners(output, label) for label in output.sets]
        results.append(centre_of_gravity(sets, list(heights.values()), exact(output.low), exact(output.high)))
    return results
