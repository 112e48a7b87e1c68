"""Laws of the fuzzy controller, against an exact integral and geometry done by hand."""

import numpy as np
import pytest
from benches.control import LABELS, FuzzyLaw, OmniError, compute_memberships
from hypothesis import given
from hypothesis import strategies as st

RANGE_M, SPEED = 0.1, 1.0
FLC = FuzzyLaw(RANGE_M, SPEED)
PEAKS = np.array([-1, -0.5, 0, 0.5, 1])  # of the sets NB to PB
# Tables 1 and 2 with the labels of the example below them: rows e_y, columns e_x, from NB to PB
TABLE_1 = ["NB", "NS", "ZO", "PS", "PB"] * 5
TABLE_2 = [label for label in TABLE_1[:5] for _ in range(5)]

# Errors well inside, at and beyond the ends of the input range.
errors = st.tuples(st.floats(-0.15, 0.15), st.floats(-0.15, 0.15))


def triangles(value: float) -> np.ndarray:
    """Return the degrees of membership, (5,), in the sets of figures 5 and 6."""
    return np.maximum(1 - 2 * np.abs(PEAKS - value), 0)


@given(st.floats(-1, 1))
def test_the_sets_are_the_triangles_of_figure_5(value: float) -> None:
    """The degrees of membership are those of five triangular sets, and sum to one everywhere."""
    degrees = compute_memberships(np.array([[value]]))[:, 0, 0]
    np.testing.assert_allclose(degrees, triangles(value), rtol=0, atol=1e-15)
    assert degrees.sum() == pytest.approx(1, abs=1e-15)


def centre(heights: dict[str, float]) -> float:
    """Return the exact centroid of the union of clipped triangles, by pieces between crossings."""
    peaks = dict(zip(LABELS, PEAKS, strict=True))
    levels = {0.0, 0.5, 1.0, *heights.values()}
    z = {
        peak + side * (1 - level) / 2
        for peak in peaks.values()
        for side in (-1, 1)
        for level in levels
    }
    points = np.array(sorted(x for x in z if -1 <= x <= 1))
    points = np.sort(np.concatenate([points, (points[1:] + points[:-1]) / 2]))  # Simpson's rule
    degrees = [
        np.minimum(height, 1 - 2 * np.abs(points - peaks[label]))
        for label, height in heights.items()
    ]
    mu, step = np.max([*degrees, 0 * points], axis=0), np.diff(points)[::2]
    area, moment = (((f[:-1:2] + 4 * f[1::2] + f[2::2]) * step).sum() for f in (mu, points * mu))
    return float(moment / area)


@given(st.tuples(st.floats(-1.1, 1.1), st.floats(-1.1, 1.1)))
def test_the_surface_is_exact(error: tuple[float, float]) -> None:
    """The rules of tables 1 and 2, evaluated one by one: on, between and beyond the peaks."""
    x, y = map(triangles, np.clip(error, -1, 1))
    for rule_table, velocity in zip((TABLE_1, TABLE_2), FuzzyLaw(1, 1)(error), strict=True):
        heights = dict.fromkeys(LABELS, 0.0)
        for rule, label in enumerate(rule_table):
            heights[label] = max(heights[label], min(y[rule // 5], x[rule % 5]))
        assert velocity == pytest.approx(centre(heights), abs=1e-14)


@given(errors, st.floats(0.01, 1), st.floats(0.1, 4))
def test_the_ranges_only_scale_the_axes(
    error: tuple[float, float], range_m: float, speed: float
) -> None:
    """Velocity over its range is one function of error over its range."""
    scaled = FuzzyLaw(range_m, speed)(np.multiply(error, range_m / RANGE_M))
    # One rounding of the scaled error times the steepest slope of the controller, 2 * 15 / 10 of
    # the ranges' ratio.
    np.testing.assert_allclose(scaled, speed / SPEED * FLC(error), rtol=0, atol=1e-14 * speed)


def test_the_papers_example() -> None:
    """If e_x is NB and e_y is PS, then v_x is NB and v_y is PS: -5/6 and 1/2 (below table 2)."""
    # Roundings of numbers of size 1.
    np.testing.assert_allclose(FLC([-RANGE_M, RANGE_M / 2]), [-5 / 6, 1 / 2], rtol=0, atol=1e-15)


def test_a_nan_error_is_rejected() -> None:
    """A lost position must not become a velocity."""
    for error in [[np.nan, 0.0], [0.0, np.nan], [[0.0, 0.0], [np.nan, 0.01]]]:
        with pytest.raises(OmniError, match="got NaN"):
            FLC(error)
