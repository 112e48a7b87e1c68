"""Laws of the Mamdani engine, against a plain evaluation in rational numbers and against closed forms."""

import itertools
from fractions import Fraction

import mamdani_reference as reference
import numpy as np
import pytest
from benches.control import Mamdani, OmniError, Trapezoid, Variable, mamdani, triangle
from hypothesis import given
from hypothesis import strategies as st
from laws import LAW

GRID = 12  # corners lie on a grid of this many steps, so that sides often meet, coincide or are vertical


@st.composite
def trapezoids(draw: st.DrawFn, low: int = -4, high: int = GRID + 4) -> tuple[int, int, int, int]:
    """Corners of a set that reaches into the universe [0, GRID]."""
    corners = st.lists(st.integers(low, high), min_size=4, max_size=4).map(sorted)
    return tuple(draw(corners.filter(lambda c: c[0] < c[3] and c[0] < GRID and c[3] > 0)))


@st.composite
def variables(draw: st.DrawFn, name: str, continuous: bool) -> Variable:
    """An input, with triangles A, B, ... that cover the universe and a set X, or an output with any sets."""
    low, step = draw(st.tuples(st.sampled_from([-1.0, 0.1, 290.0]), st.sampled_from([0.1, 1.0, 1 / 7])))
    if continuous:
        inner = draw(st.lists(st.integers(1, GRID - 1), max_size=2, unique=True).map(sorted))
        peaks = [0, 0, *inner, GRID, GRID]
        shapes = [(a, b, b, c) for a, b, c in zip(peaks, peaks[1:], peaks[2:], strict=False)]
        x = draw(trapezoids().filter(lambda c: (c[0] < c[1] or c[1] <= 0) and (c[2] < c[3] or c[2] >= GRID)))
        named = {**dict(zip("ABCD", shapes, strict=False)), "X": x}
    else:
        named = dict(zip("ABCDE", draw(st.lists(trapezoids(), min_size=1, max_size=5)), strict=False))
    sets = {label: Trapezoid(*(low + step * corner for corner in corners)) for label, corners in named.items()}
    return Variable(name, low, low + step * GRID, sets)


@st.composite
def engines(draw: st.DrawFn) -> Mamdani:
    """Any engine of up to three inputs and two outputs, whose rules cover all inputs, some of them more than once."""
    inputs = [draw(variables(name, True)) for name in ("x", "y", "z")[: draw(st.integers(1, 3))]]
    outputs = [draw(variables(name, False)) for name in ("v", "w")[: draw(st.integers(1, 2))]]
    conclusions = st.fixed_dictionaries({v.name: st.sampled_from(sorted(v.sets)) for v in outputs})
    partial = st.dictionaries(st.sampled_from([v.name for v in inputs]), st.just("X"), min_size=1)
    conditions = [
        dict(zip((v.name for v in inputs), labels, strict=True))
        for labels in itertools.product(*([label for label in v.sets if label != "X"] for v in inputs))
    ]
    conditions += draw(st.lists(partial, max_size=3))
    return Mamdani(inputs, outputs, [(c, draw(conclusions)) for c in conditions])


@LAW
@given(engines(), st.data())
def test_an_output_is_the_centre_of_gravity_of_what_the_rules_clip(engine: Mamdani, data: st.DataObject) -> None:
    """Any sets, rules and inputs, against a plain evaluation in rational numbers, which have no rounding."""
    values = [data.draw(st.floats(v.low - 0.1, v.high + 0.1)) for v in engine.inputs]
    expected = reference.evaluate(engine.inputs, engine.outputs, engine.rules, [Fraction(x) for x in values])
    for v, z, exact in zip(engine.outputs, engine(values), expected, strict=True):
        # Some roundings of inputs and outputs as large as the universe's ends; strengths are 1/2 and more.
        assert z == pytest.approx(float(exact), abs=1e-14 * max(1, abs(v.low)))


def tipper(rules: list[mamdani.Rule] | None = None) -> Mamdani:
    """A small engine with two inputs and one output."""
    fair = {"poor": triangle(-10, 0, 10), "good": triangle(0, 10, 20)}
    tip = {"low": triangle(0, 5, 10), "high": Trapezoid(8, 12, 18, 20)}
    service, food = (Variable(name, 0, 10, fair) for name in ("service", "food"))
    both = [({"service": "poor", "food": "poor"}, {"tip": "low"}), ({"service": "good"}, {"tip": "high"})]
    return Mamdani(
        [service, food], [Variable("tip", 0, 25, tip)], rules or [*both, ({"food": "good"}, {"tip": "high"})]
    )


@LAW
@given(engines())
def test_a_row_of_a_batch_is_what_it_is_alone(engine: Mamdani) -> None:
    """Neither the size of a batch, nor where it is cut into blocks, shows in the last bit."""
    rows = np.random.default_rng(3).uniform(
        *np.array([(v.low, v.high) for v in engine.inputs]).T, (13, len(engine.inputs))
    )
    batch = engine(np.resize(rows, (mamdani.BLOCK + 1, len(engine.inputs))))
    assert np.array_equal(batch, np.resize(batch[:13], batch.shape))
    assert all(
        np.array_equal(engine(row), z) and np.array_equal(engine([row, row])[1], z)
        for row, z in zip(rows, batch, strict=False)
    )


def test_inputs_that_are_no_numbers_or_too_many_are_refused() -> None:
    """A lost measurement must not become an output."""
    for values, message in [
        ([np.nan, 1], "not a number: service"),
        ([[1, 2], [3, np.nan]], "not a number: food"),
        ([1, 2, 3], "service, food"),
        (4, "service, food"),
    ]:
        with pytest.raises(OmniError, match=message):
            tipper()(values)


def test_rules_that_cannot_be_are_refused() -> None:
    """A user learns which rule is wrong, what is allowed, and where no rule would fire, when the engine is built."""
    for rules, message in [
        ([], "at least one rule"),
        ([({"sevice": "poor"}, {"tip": "low"})], "conditions of rule 1 name 'sevice'; did you mean 'service'"),
        ([({"service": "god"}, {"tip": "low"})], "name the set 'god' of service; did you mean 'good'.*poor, good"),
        ([({"service": "good"}, {"food": "poor"})], "conclusions of rule 1 name 'food'; choose from tip"),
        ([({"service": "good"}, {})], "conclusions of rule 1 are empty"),
        ([({"service": "good"}, {"tip": "high"})], "no rule gives tip at service = 0, food = 0"),
    ]:
        sound = tipper()
        with pytest.raises(OmniError, match=message):
            Mamdani(sound.inputs, sound.outputs, rules)
