r"""The exact centre of gravity of fuzzy sets clipped at given heights and united.

Points (z, s) of the universe and degrees of membership fall into regions by which sets reach above them:

    s |      /\      /\       Two overlapping sets make three regions: of the left set alone, of the right one alone,
      |     /  \    /  \      and of both, the small triangle. A point in the region of the sets U belongs to the
      |    /    \  /    \     clipped union if s is at most the largest height of U: each region counts up to one level.
      |   /      \/      \
      |  /       /\       \
      +-/-------/--\-------\-- z

Sides are straight: from one level at which any of them cross to the next, the area of a region up to a level is a
quadratic polynomial of the level, and its first moment a cubic one. Their coefficients are worked out once; what is
left for an evaluation are maxima, minima and polynomials. Nothing is sampled or sorted, any number of sets may overlap
in any way, and since areas are only added, none cancel.
"""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omni_control.kinematics import Array


class CentreOfGravity:
    """The centres of gravity of one or more outputs, each with trapezoids as fuzzy sets.

    Args:
        outputs: of each output the corners (sets, 4) of its sets, in ascending order from foot to foot, and the low
            and high end of its universe, where the sets are cut off.
    """

    def __init__(self, outputs: Sequence[tuple[Array, float, float]]) -> None:
        regions = [sorted(_regions(*output), key=lambda region: region[1]) for output in outputs]
        shape = (max(map(len, regions)), len(outputs))
        members = np.zeros((max(len(corners) for corners, _, _ in outputs), *shape), int)
        regions_of = np.zeros((7, *shape))
        regions_of[:2] = 1.0
        first_set = 0
        for o, (corners, _, _) in enumerate(outputs):
            for r, (above, *levels, polynomials) in enumerate(regions[o]):
                members[:, r, o] = first_set + np.resize(above, len(members))
                regions_of[:, r, o] = *levels, *polynomials
            first_set += len(corners)
        self._members = members[: max(len(above) for of_output in regions for above, *_ in of_output)].copy()
        self._regions = tuple(regions_of[..., None])
        self._middle = np.array([[(low + high) / 2] for _, low, high in outputs])

    def __call__(self, heights: Array) -> Array:
        """Return the centres (outputs, n) of the sets clipped at `heights` (sets, n), given output by output.

        At least one height of each output must be positive.
        """
        # numpy adds up the rows of a table in order, but those of a lone column pairwise.
        if heights.shape[1] * len(self._middle) == 1:
            return self(heights.repeat(2, axis=1))[:, :1]
        level = np.maximum.reduce(heights.take(self._members, axis=0))  # (regions, outputs, n)
        bottom, top, a1, a2, m1, m2, m3 = self._regions
        u = np.maximum(np.minimum(level, top), bottom) - bottom
        area, moment = (a2 * u + a1) * u, ((m3 * u + m2) * u + m1) * u
        return self._middle + np.add.reduce(moment) / np.add.reduce(area)


def _regions(corners: Array, low: float, high: float) -> list[tuple[tuple[int, ...], float, float, Array]]:
    """Return the regions of an output's sets, cut at the levels at which they bend.

    Of each piece: the sets that reach above it, its bottom and top level, and the coefficients (5,) of the area
    a1 u + a2 u^2 and the moment m1 u + m2 u^2 + m3 u^3, about the middle of the universe, of what lies between its
    bottom and u above it.
    """
    count = len(corners)
    # At level s there are lines at z = foot + s slope: left sides, right sides, and the ends of the universe.
    foot = np.concatenate([corners[:, 0], corners[:, 3], [low, high]])
    slope = np.concatenate([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 3], [0, 0]])
    levels = {0.0, 1.0}
    for (a, p), (b, q) in itertools.combinations(zip(foot.tolist(), slope.tolist(), strict=True), 2):
        if p != q and 0 < (crossing := (b - a) / (p - q)) < 1:
            levels.add(round(crossing, 12))  # joins what rounding tore apart; the polynomials differ by its square

    pieces: dict[tuple[int, ...], list[tuple[float, float, list[tuple[int, int]]]]] = {}
    for bottom, top in itertools.pairwise(sorted(levels)):
        at = foot + slope * (bottom + top) / 2
        between: dict[tuple[int, ...], list[tuple[int, int]]] = {}
        for left, right in itertools.pairwise(np.argsort(at, kind="stable").tolist()):
            z = (at[left] + at[right]) / 2
            above = tuple(np.flatnonzero((at[:count] < z) & (z < at[count:-2])).tolist())
            if above and low < z < high and at[left] < at[right]:
                between.setdefault(above, []).append((left, right))
        for above, lines in between.items():
            stack = pieces.setdefault(above, [])
            straight_on = stack and stack[-1][1:] == (bottom, lines)
            stack.append((stack.pop()[0] if straight_on else bottom, top, lines))
    return [
        (above, bottom, top, _coefficients(foot, slope, bottom, np.array(lines), (low + high) / 2))
        for above, stack in pieces.items()
        for bottom, top, lines in stack
    ]


def _coefficients(foot: Array, slope: Array, bottom: float, lines: NDArray[np.int64], origin: float) -> Array:
    """Integrate width, and width times centre, between pairs of lines (k, 2) over the level above `bottom`."""
    left, right = lines.T
    widening, drift = slope[right] - slope[left], (slope[right] + slope[left]) / 2
    width = foot[right] - foot[left] + widening * bottom
    centre = (foot[right] + foot[left]) / 2 + drift * bottom - origin
    terms = [width, widening / 2, width * centre, (width * drift + widening * centre) / 2, widening * drift / 3]
    return np.array(terms).sum(1)
