"""A Mamdani inference engine: named fuzzy sets, if-then rules, min-max inference, an exact centre of gravity.

    inputs -> fuzzify -> memberships -> infer -> heights -> defuzzify -> outputs

A rule fires as strongly as the weakest of its conditions holds. An output's set is clipped at the strength of the
strongest rule that concludes it, and the output is the centre of gravity of the union of its clipped sets
(E. H. Mamdani and S. Assilian, Int. J. Man-Machine Studies 7, 1975).
"""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_control.errors import OmniError, choose
from omni_control.fuzzy.centroid import CentreOfGravity
from omni_control.kinematics import Array

Rule = tuple[Mapping[str, str], Mapping[str, str]]

BLOCK = 1000  # evaluations at a time, so that their arrays stay in a core's cache
FAINT = 1e-9  # rounding may leave 1e-16 of a strength that is zero


@dataclass(frozen=True)
class Trapezoid:
    """A fuzzy set: membership 1 between the shoulders, 0 beyond the feet, straight from one to the other.

    Args:
        left_foot, left_shoulder, right_shoulder, right_foot: in ascending order, in the variable's unit. Where foot and
            shoulder are equal, the side is vertical.
    """

    left_foot: float
    left_shoulder: float
    right_shoulder: float
    right_foot: float

    def __post_init__(self) -> None:
        """Check the corners.

        Raises:
            OmniError: the corners are not finite, not in ascending order, or all equal.
        """
        corners = (self.left_foot, self.left_shoulder, self.right_shoulder, self.right_foot)
        if not (np.isfinite(corners).all() and list(corners) == sorted(corners) and corners[0] < corners[3]):
            raise OmniError(f"the corners of a fuzzy set must be finite, ascending and not all equal, not {corners}")


def triangle(left: float, peak: float, right: float) -> Trapezoid:
    """Return the set with membership 1 at `peak` and 0 from `left` and `right` on."""
    return Trapezoid(left, peak, peak, right)


@dataclass(frozen=True)
class Variable:
    """An input or output, with the fuzzy sets that rules name.

    Args:
        name: what rules call it.
        low, high: the ends of its universe. Inputs beyond count as the end; sets of an output are cut off there.
        sets: its fuzzy sets by name.
    """

    name: str
    low: float
    high: float
    sets: Mapping[str, Trapezoid]

    def __post_init__(self) -> None:
        """Check the universe and that every set reaches into it.

        Raises:
            OmniError: the universe is not a finite interval, or a set lies outside.
        """
        if not (np.isfinite([self.low, self.high]).all() and self.low < self.high):
            raise OmniError(f"the universe of {self.name} must be a finite interval, not {self.low} to {self.high}")
        for label, s in self.sets.items():
            if s.left_foot >= self.high or s.right_foot <= self.low:
                raise OmniError(f"set {label} of {self.name} lies outside its universe, {self.low} to {self.high}")


class Mamdani:
    """The engine. It keeps nothing from call to call.

    Args:
        inputs, outputs: the variables, in their order along the last axis of what goes in and what comes out.
        rules: pairs of conditions and conclusions, each a mapping from names of variables to names of their sets, as in
            `({"e_x": "NB", "e_y": "PS"}, {"v_x": "NB"})`. Conditions are joined by "and"; an input that a rule does not
            mention may have any value.

    Raises:
        OmniError: there are no rules, or one is empty or names what does not exist; two variables have the same name;
            an input's set has a vertical side inside its universe, where outputs would jump; or there are inputs for
            which no rule gives some output.
    """

    def __init__(self, inputs: Sequence[Variable], outputs: Sequence[Variable], rules: Iterable[Rule]) -> None:
        self.inputs, self.outputs, self.rules = tuple(inputs), tuple(outputs), tuple(rules)
        _check(self.inputs, self.outputs, self.rules)
        sets = [s for v in self.inputs for s in v.sets.values()]
        corners = np.array([astuple(s) for s in sets], float).T  # (4, sets)
        owner = np.array([i for i, v in enumerate(self.inputs) for _ in v.sets])
        # A side is (z - foot) slope. A vertical one lies at an end of the universe or beyond and bounds no input.
        widths, sign = corners[1:3] - corners[::3], np.array([[1.0], [-1.0]])
        slopes = 1 / np.where(widths == 0, sign, widths)
        feet = np.where(widths == 0, -np.inf * sign, corners[::3])
        ends = np.array([[v.low for v in self.inputs], [v.high for v in self.inputs]], float)

        row = {key: i for i, key in enumerate((v.name, label) for v in self.inputs for label in v.sets)}
        self._conditions = _table([[row[key] for key in conditions.items()] for conditions, _ in self.rules])
        concluded: dict[tuple[int, str], list[int]] = {}
        for o, v in enumerate(self.outputs):
            for label in v.sets:
                if by := [i for i, (_, conclusions) in enumerate(self.rules) if conclusions.get(v.name) == label]:
                    concluded[o, label] = by
        self._centre = CentreOfGravity(
            [
                (np.array([astuple(s) for label, s in v.sets.items() if (o, label) in concluded], float), v.low, v.high)
                for o, v in enumerate(self.outputs)
            ]
        )
        self._rules = _table(list(concluded.values()))
        self._owner, self._ends = owner, tuple(ends[..., None])
        sides = feet[0], slopes[0], feet[1], slopes[1]
        self._sides = tuple(side[:, None] for side in sides)
        self._check_cover(np.array([o for o, _ in concluded]))

    def __call__(self, values: ArrayLike) -> Array:
        """Return the outputs (..., outputs) for inputs (..., inputs), each in the unit of its variable.

        An evaluation's numbers are, bit for bit, the same alone and in any batch.

        Raises:
            OmniError: an input is not a number, or the last axis does not hold the inputs.
        """
        values = np.asarray(values, float)
        if values.shape[-1:] != (len(self.inputs),):
            names = ", ".join(v.name for v in self.inputs)
            raise OmniError(f"the last axis of the inputs must hold {names}; their shape is {values.shape}")
        columns = values.reshape(-1, len(self.inputs)).T
        if np.count_nonzero(np.isnan(columns)):
            lost = ", ".join(v.name for v, c in zip(self.inputs, columns, strict=True) if np.isnan(c).any())
            raise OmniError(f"an input of the fuzzy rules is not a number: {lost}")
        shape = (*values.shape[:-1], len(self.outputs))
        if columns.shape[1] <= BLOCK:
            return np.ascontiguousarray(self._evaluate(columns).T).reshape(shape)
        result = np.empty((columns.shape[1], len(self.outputs)))
        # Once a large array was freed, glibc keeps what is freed later (mallopt(3), M_MMAP_THRESHOLD). Otherwise a
        # block's memory could go back to the system and come again page by page, which costs twice the arithmetic.
        np.empty(1 << 20)
        for start in range(0, len(result), BLOCK):
            block = slice(start, start + BLOCK)
            result[block] = self._evaluate(columns[:, block]).T
        return result.reshape(shape)

    def _evaluate(self, columns: Array) -> Array:
        return self.defuzzify(self.infer(self.fuzzify(columns)))

    def fuzzify(self, values: Array) -> Array:
        """Return the degrees (sets, n) to which inputs (inputs, n) belong to their sets, one by one.

        What is above 1 counts as 1, and below 0 as 0: no region reaches beyond (`centroid`).
        """
        low, high = self._ends
        clipped = np.minimum(np.maximum(values, low), high)
        of_set = clipped.take(self._owner, axis=0)
        foot, slope, other_foot, other_slope = self._sides
        return np.minimum((of_set - foot) * slope, (of_set - other_foot) * other_slope)

    def infer(self, degrees: Array) -> Array:
        """Return the heights (sets, n) of the outputs' sets, output by output, but for those that no rule concludes."""
        strengths = np.minimum.reduce(degrees.take(self._conditions, axis=0))
        return np.maximum.reduce(strengths.take(self._rules, axis=0))

    def defuzzify(self, heights: Array) -> Array:
        """Return the outputs (outputs, n) for the heights (sets, n) that `infer` returns."""
        return self._centre(heights)

    def _check_cover(self, output_of_set: NDArray[np.int64]) -> None:
        """Check that for every output some rule fires all over the inputs' universes.

        Where none fires is a union of boxes with edges at feet of sets, so their corners will do.
        """
        edges = []
        for v in self.inputs:
            feet = {z for s in v.sets.values() for z in (s.left_foot, s.right_foot)}
            edges.append([v.low, *sorted(z for z in feet if v.low < z < v.high), v.high])
        for corner in itertools.product(*edges):
            heights = self.infer(self.fuzzify(np.array(corner)[:, None]))[:, 0]
            for o, output in enumerate(self.outputs):
                if not (heights[output_of_set == o] > FAINT).any():
                    where = ", ".join(f"{v.name} = {z:g}" for v, z in zip(self.inputs, corner, strict=True))
                    raise OmniError(f"no rule gives {output.name} at {where}: add rules, or widen the inputs' sets")


def _check(inputs: Sequence[Variable], outputs: Sequence[Variable], rules: Sequence[Rule]) -> None:
    """Check what rules name, that they give every output, and that no set of an input jumps."""
    if not rules:
        raise OmniError("a fuzzy engine needs at least one rule")
    for kind, variables in (("inputs", inputs), ("outputs", outputs)):
        if len({v.name for v in variables}) < len(variables):
            raise OmniError(f"two {kind} have the same name: {', '.join(v.name for v in variables)}")
    for number, (conditions, conclusions) in enumerate(rules, 1):
        _check_names(f"the conditions of rule {number}", conditions, inputs)
        _check_names(f"the conclusions of rule {number}", conclusions, outputs)
    for v in outputs:
        if not any(v.name in conclusions for _, conclusions in rules):
            raise OmniError(f"no rule gives {v.name}")
    for v in inputs:
        for label, s in v.sets.items():
            if v.low < s.left_foot == s.left_shoulder or s.right_shoulder == s.right_foot < v.high:
                raise OmniError(f"set {label} of input {v.name} has a vertical side inside the universe: slant it")


def _check_names(where: str, named: Mapping[str, str], variables: Sequence[Variable]) -> None:
    """Check that the sets that a rule names exist."""
    if not named:
        raise OmniError(f"{where} are empty")
    sets = {v.name: v.sets for v in variables}
    for name, label in named.items():
        if name not in sets:
            raise OmniError(f"{where} name {name!r}; {choose(name, sets)}")
        if label not in sets[name]:
            raise OmniError(f"{where} name the set {label!r} of {name}; {choose(label, sets[name])}")


def _table(lists: Sequence[Sequence[int]]) -> NDArray[np.int64]:
    """Return lists of rows as columns of one table, the shorter ones filled up with a row of their own."""
    length = max(map(len, lists))
    return np.array([[*rows, *[rows[0]] * (length - len(rows))] for rows in lists]).T.copy()
