"""Laws of the fuzzy controller, against rational numbers, brute force, scikit-fuzzy, and geometry done by hand."""

from fractions import Fraction

import mamdani_reference as reference
import numpy as np
import pytest
import scikit_flc
from benches.control import ENGINE, LABELS, FuzzyLaw, OmniError, memberships
from hypothesis import given
from hypothesis import strategies as st
from laws import LAW
from scikit_flc import TABLE_1, TABLE_2, triangles

RANGE_M, SPEED = 0.1, 1.0
FLC = FuzzyLaw(RANGE_M, SPEED)

# Errors well inside, at and beyond the ends of the input range.
errors = st.tuples(st.floats(-0.15, 0.15), st.floats(-0.15, 0.15))


@LAW
@given(st.floats(-1, 1))
def test_the_sets_are_the_triangles_of_figure_5(value: float) -> None:
    """The degrees of membership are those of five triangular sets, and sum to one everywhere."""
    # scikit-fuzzy divides by the side's length, here it is multiplied: one rounding.
    np.testing.assert_allclose(memberships(value), triangles(np.array([value]))[:, 0], rtol=0, atol=1e-15)
    assert memberships(value).sum() == pytest.approx(1, abs=1e-15)


def test_the_surface_is_exact() -> None:
    """The rules of tables 1 and 2, evaluated plainly in rational numbers: on, between and beyond the peaks."""
    rules = [
        ({"e_x": LABELS[x], "e_y": LABELS[y]}, {"v_x": TABLE_1[y].split()[x], "v_y": TABLE_2[y].split()[x]})
        for x in range(5)
        for y in range(5)
    ]
    grid = [(x / 16, y / 24) for x in range(-17, 18, 4) for y in range(-25, 26, 3)]
    exact = [reference.evaluate(ENGINE.inputs, ENGINE.outputs, rules, list(map(Fraction, error))) for error in grid]
    # Some roundings of numbers of size 1.
    np.testing.assert_allclose(FuzzyLaw(1, 1)(grid), np.array(exact, float), rtol=0, atol=1e-15)


@pytest.mark.filterwarnings("ignore:Passing more than 2 positional arguments")  # of scikit-fuzzy 0.5 to numpy
def test_the_controller_agrees_with_scikit_fuzzy() -> None:
    """The same sets and 25 rules, on a grid from beyond one end of the range to beyond the other."""
    axis = np.linspace(-0.11, 0.11, 25)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    expected = scikit_flc.velocities(scikit_flc.controller(801, RANGE_M, SPEED), grid)
    # A step of 1/400 misplaces each of at most 12 corners by an area of at most 2 / 400^2 / 4, 4e-5 in all, of 0.19
    # and more; the corners' errors partly cancel.
    np.testing.assert_allclose(FLC(grid), expected, rtol=0, atol=1e-4)


@LAW
@given(errors)
def test_mirrored_errors_give_mirrored_velocities(error: tuple[float, float]) -> None:
    """The rules treat left and right, forth and back alike: v(-e) = -v(e), and each axis by itself."""
    x, y = error
    vx, vy = FLC(error)
    # Sums in the opposite order: a few roundings of numbers of size 1, divided by an area of 0.2 and more.
    np.testing.assert_allclose(FLC([-x, -y]), [-vx, -vy], rtol=0, atol=1e-14)
    np.testing.assert_allclose(FLC([-x, y]), [-vx, vy], rtol=0, atol=1e-14)


@LAW
@given(errors)
def test_the_correction_points_back_to_the_reference(error: tuple[float, float]) -> None:
    """Each velocity has the sign of its own error, and is zero without one, whatever the other error is."""
    for e, v in zip(error, FLC(error), strict=True):
        # Below 1e-9 m the velocity may be lost in the roundings of sums of size 1.
        assert v * e > 0 if abs(e) > 1e-9 else abs(v) < 1e-6


@LAW
@given(errors, st.floats(1e-3, 0.1))
def test_a_larger_error_is_never_corrected_more_slowly(error: tuple[float, float], more: float) -> None:
    """The velocity of an axis does not fall while its own error grows and the other stays."""
    # At saturation both sides are the same number but for roundings.
    assert FLC([error[0] + more, error[1]])[0] >= FLC(error)[0] - 1e-14


@LAW
@given(errors)
def test_velocities_saturate_at_five_sixths_of_the_range(error: tuple[float, float]) -> None:
    """The outermost set is a half triangle of width 1/2, whose centre of gravity lies 1/6 from its peak at the end."""
    # Roundings of numbers of size 1.
    assert np.abs(FLC(error)).max() <= 5 / 6 + 1e-14


@LAW
@given(errors, st.floats(0.01, 1), st.floats(0.1, 4))
def test_the_ranges_only_scale_the_axes(error: tuple[float, float], range_m: float, speed: float) -> None:
    """Velocity over its range is one function of error over its range."""
    scaled = FuzzyLaw(range_m, speed)(np.multiply(error, range_m / RANGE_M))
    # One rounding of the scaled error times the steepest slope of the controller, 2 * 15 / 10 of the ranges' ratio.
    np.testing.assert_allclose(scaled, speed / SPEED * FLC(error), rtol=0, atol=1e-14 * speed)


def test_the_papers_example() -> None:
    """If e_x is NB and e_y is PS, then v_x is NB and v_y is PS (text below table 2): -5/6 and the peak of PS, 1/2."""
    # Roundings of numbers of size 1.
    np.testing.assert_allclose(FLC([-RANGE_M, RANGE_M / 2]), [-5 / 6, 1 / 2], rtol=0, atol=1e-15)


def test_an_error_that_is_not_a_number_is_refused() -> None:
    """A lost position must not become a velocity."""
    for error in [[np.nan, 0.0], [0.0, np.nan], [[0.0, 0.0], [np.nan, 0.01]]]:
        with pytest.raises(OmniError, match="not a number"):
            FLC(error)
