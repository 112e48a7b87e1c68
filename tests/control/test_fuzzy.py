"""Laws of the fuzzy controller, against rational numbers, brute force, scikit-fuzzy, and geometry done by hand."""

from fractions import Fraction

import mamdani_reference as reference
import numpy as np
import pytest
import scikit_flc
from hypothesis import assume, example, given
from hypothesis import strategies as st
from laws import LAW
from scikit_flc import TABLE_1, TABLE_2, triangles

from omni_control.errors import OmniError
from omni_control.fuzzy.mamdani import Mamdani
from omni_control.fuzzy.rules import ENGINE, LABELS, RULES, FuzzyLaw, memberships

RANGE_M, SPEED = 0.1, 1.0
FLC = FuzzyLaw(RANGE_M, SPEED)

# Errors well inside, at and beyond the ends of the input range.
errors = st.tuples(st.floats(-0.15, 0.15), st.floats(-0.15, 0.15))
degrees = st.floats(0, 1)


@LAW
@given(st.tuples(*[degrees] * 5))
@example((0.0, 0.0, 1.0, 0.0, 0.0))
@example((1.0, 0.0, 0.0, 0.0, 1.0))
@example((0.0, 0.9, 0.8, 0.0, 0.0))
@example((1.0, 1.0, 1.0, 1.0, 1.0))
def test_centroid_is_the_centre_of_gravity_of_the_clipped_sets(heights: tuple[float, ...]) -> None:
    """Definition: integral of z mu(z) over that of mu(z), with mu the maximum of the sets clipped at the heights."""
    assume(max(heights) >= 0.05)
    z = np.linspace(-1, 1, 20001)
    mu = np.minimum(np.array(heights)[:, None], triangles(z)).max(0)
    expected = np.trapezoid(z * mu, z) / np.trapezoid(mu, z)
    # Steps of 1e-4 misplace each of at most 12 corners by an area below 2e-4 * 1e-4 / 4; the smallest area is 0.024.
    assert ENGINE.defuzzify(np.array([heights * 2]).T)[:, 0] == pytest.approx(expected, abs=3e-6)


@LAW
@given(st.floats(-1, 1))
def test_the_sets_are_the_triangles_of_figure_5(value: float) -> None:
    """The degrees of membership are those of five triangular sets, and sum to one everywhere."""
    # scikit-fuzzy divides by the side's length, here it is multiplied: one rounding.
    np.testing.assert_allclose(memberships(value), triangles(np.array([value]))[:, 0], rtol=0, atol=1e-15)
    assert memberships(value).sum() == pytest.approx(1, abs=1e-15)


def test_neighbouring_sets_cross_at_half_height() -> None:
    """Half-way between two peaks a value belongs to either by one half, and to no other set."""
    expected = [np.roll([0.5, 0.5, 0, 0, 0], i) for i in range(4)]
    np.testing.assert_array_equal(memberships([-0.75, -0.25, 0.25, 0.75]), expected)


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
def test_swapping_the_axes_swaps_the_velocities(error: tuple[float, float]) -> None:
    """Table 2 is table 1 transposed, and everything else is the same for x and y: equal bit for bit."""
    assert np.array_equal(FLC(error[::-1]), FLC(error)[::-1])


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


def test_the_gain_ripples_but_is_never_negative() -> None:
    """Along a fine grid of its own error the velocity never falls: the slope's ripples stay above zero."""
    for other in [0.0, 0.003, 0.0125, 0.025, 0.04, 0.05]:
        axis = np.linspace(-0.12, 0.12, 4801)
        velocity = FLC(np.stack([axis, np.full_like(axis, other)], axis=-1))[:, 0]
        # Roundings of numbers of size 1.
        assert np.diff(velocity).min() >= -1e-15


def test_the_ripples_of_the_gain() -> None:
    """The slope in 1/s to either side of where it changes, by the areas that a small change of the error moves."""
    for error, side, gain in [
        # ZO has area 1/2. PS, clipped at h = 2 de / 0.1, adds a strip of width 1/2 about 3/4: dv = 3/8 h / (1/2).
        (0.0, 1, 15),
        # Both clipped at 1/2: area 5/8. PS grows, ZO shrinks by h at their tops, both 1/2 wide, 1/2 apart: h/4 / (5/8).
        (0.025, 1, 8),
        # PS full, ZO vanishing: the first case mirrored.
        (0.05, -1, 15),
        # PB's base [1/2, 1] lies within that of PS, [0, 1]: what it adds is of second order, like what PS loses.
        (0.05, 1, 0),
        # PB, area 1/4 about 5/6, is full; PS, vanishing, adds a strip of width 1/2 about 1/4: h/2 (5/6 - 1/4) / (1/4).
        (0.1, -1, 70 / 3),
        (0.1, 1, 0),
    ]:
        step = side * 1e-8
        slope = (FLC([error + step, 0])[0] - FLC([error, 0])[0]) / step
        # The curvature, below 1e4 / (m s), times the step; roundings of 1 over the step.
        assert slope == pytest.approx(gain, abs=1e-4)


def test_the_other_error_moves_a_velocity_by_less_than_a_twentieth_of_the_range() -> None:
    """On a peak of e_y one rule fires fully, as with e_y zero; between two peaks none does, and v_x moves a little."""
    e_x, e_y = np.meshgrid(np.linspace(0, 0.1, 161), np.linspace(0, 0.1, 81), indexing="ij")
    ripple = FLC(np.stack([e_x, e_y], axis=-1))[..., 0] - FLC(np.stack([e_x, 0 * e_y], axis=-1))[..., 0]
    # Roundings of numbers of size 1.
    assert np.abs(ripple[:, [40, 80]]).max() <= 1e-15
    assert 0.04 < np.abs(ripple).max() < 0.05


@LAW
@given(errors)
def test_velocities_saturate_at_five_sixths_of_the_range(error: tuple[float, float]) -> None:
    """The outermost set is a half triangle of width 1/2, whose centre of gravity lies 1/6 from its peak at the end."""
    # Roundings of numbers of size 1.
    assert np.abs(FLC(error)).max() <= 5 / 6 + 1e-14


def test_saturation_is_reached_when_one_rule_fires_alone() -> None:
    """At the end of the range, with the other error on a peak, PB is not clipped and nothing else is there."""
    for other in [-0.1, -0.05, 0.0, 0.05, 0.1]:
        # Roundings of numbers of size 1.
        assert FLC([RANGE_M, other])[0] == pytest.approx(5 / 6 * SPEED, abs=1e-15)


@LAW
@given(errors, st.floats(1, 1e6))
def test_errors_beyond_the_range_count_as_its_end(error: tuple[float, float], factor: float) -> None:
    """Clipping an error to the range first changes nothing, be it as large as it may."""
    far = np.multiply(error, factor)
    assert np.array_equal(FLC(far), FLC(np.clip(far, -RANGE_M, RANGE_M)))


def test_an_infinite_error_counts_as_the_end_of_the_range() -> None:
    """A robot infinitely far off is called back at the highest speed, not at an undefined one."""
    # As above: 5/6 with one rounding.
    np.testing.assert_allclose(FLC([np.inf, -np.inf]), [5 / 6, -5 / 6], rtol=0, atol=1e-15)


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


def test_the_tables_as_printed_leave_errors_without_a_rule() -> None:
    """Printed, rows of table 1 and columns of table 2 read NB NS ZO NS NB: nothing fires for an e_y or e_x of PB."""
    printed = dict(zip(LABELS, ("NB", "NS", "ZO", "NS", "NB"), strict=True))
    misprinted = {"v_x": "e_y", "v_y": "e_x"}
    for output, misread in misprinted.items():
        rules = [
            ({**conditions, misread: printed[conditions[misread]]}, {output: conclusions[output]})
            for conditions, conclusions in RULES
        ]
        outputs = [v for v in ENGINE.outputs if v.name == output]
        with pytest.raises(OmniError, match=f"no rule gives {output} at .*{misread} = 0.5"):
            Mamdani(ENGINE.inputs, outputs, rules)


def test_an_error_that_is_not_a_number_is_refused() -> None:
    """A lost position must not become a velocity."""
    for error in [[np.nan, 0.0], [0.0, np.nan], [[0.0, 0.0], [np.nan, 0.01]]]:
        with pytest.raises(OmniError, match="not a number"):
            FLC(error)


def test_a_row_of_a_batch_is_what_it_is_alone() -> None:
    """A robot's velocity does not depend, in its last bit, on how many others are computed with it."""
    error = np.random.default_rng(0).uniform(-0.12, 0.12, (37, 2))
    batch = FLC(error)
    assert all(np.array_equal(FLC(error[i : i + 1])[0], batch[i]) for i in range(37))
    assert all(np.array_equal(FLC(error[i]), batch[i]) for i in range(37))
