"""The paper's fuzzy controller (section 3-C): 25 rules on the Mamdani engine.

Both inputs and both outputs have five triangular sets, whose peaks lie at -1, -1/2, 0, 1/2, 1 of the range and which
cross at half height (figures 5 and 6); the outermost are cut off at the ends of the range.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from omni_control.errors import OmniError
from omni_control.fuzzy.mamdani import Mamdani, Rule, Variable, triangle
from omni_control.kinematics import Array

LABELS = ("NB", "NS", "ZO", "PS", "PB")

# Rows are the sets of e_y, columns those of e_x, in the order of LABELS; entries are the sets of the velocity.
# The paper prints NB NS ZO NS NB beside the rows of table 1 and above the columns of table 2. That is a misprint for
# NB NS ZO PS PB: the paper's example, "if e_x is NB and e_y is PS, then v_x is NB and v_y is PS", needs a row PS in
# table 1, and as printed no rule would give v_x at a large positive e_y, nor v_y at a large positive e_x. The entries
# are the printed ones.
TABLE_1_VX = """
    NB NS ZO PS PB
    NB NS ZO PS PB
    NB NS ZO PS PB
    NB NS ZO PS PB
    NB NS ZO PS PB
"""
TABLE_2_VY = """
    NB NB NB NB NB
    NS NS NS NS NS
    ZO ZO ZO ZO ZO
    PS PS PS PS PS
    PB PB PB PB PB
"""
RULES: list[Rule] = [
    ({"e_x": e_x, "e_y": e_y}, {"v_x": v_x, "v_y": v_y})
    for (e_y, e_x), v_x, v_y in zip(product(LABELS, LABELS), TABLE_1_VX.split(), TABLE_2_VY.split(), strict=True)
]
SETS = {
    label: triangle(peak - 0.5, peak, peak + 0.5)
    for label, peak in zip(LABELS, (-1.0, -0.5, 0.0, 0.5, 1.0), strict=True)
}


def _over_range(name: str) -> Variable:
    return Variable(name, -1.0, 1.0, SETS)


ENGINE = Mamdani([_over_range("e_x"), _over_range("e_y")], [_over_range("v_x"), _over_range("v_y")], RULES)


def memberships(value: ArrayLike) -> Array:
    """Return the degrees (..., 5) to which errors over their range (...) belong to the sets in the order of LABELS."""
    value = np.asarray(value, float)
    degrees = ENGINE.fuzzify(np.stack([value.ravel()] * 2))[: len(LABELS)]
    return np.clip(degrees, 0.0, 1.0).T.reshape(*value.shape, len(LABELS))


@dataclass(frozen=True)
class FuzzyLaw:
    """The FLC: position errors in, correcting velocities out.

    A velocity never falls while its own error grows, but its gain has the ripples of a Mamdani controller with few
    sets. With the default ranges, and the other error on a peak, it is 15/s at zero, 8/s half-way to the peak of PS,
    15/s just before this peak, 0 just after it, where the base of PB lies within that of PS and adds next to nothing to
    the union, and 23/s at the end of the range. The other error matters only between two peaks, where no rule fires
    fully; it changes a velocity by less than 0.05 of the range.

    Args:
        error_range_m: inputs are clipped to plus or minus this (epsilon of the paper), m.
        speed_range_m_s: outputs lie in the universe plus or minus this (delta), m/s; since the outermost sets are
            half triangles, the largest output is 5/6 of it.
    """

    error_range_m: float = 0.1
    speed_range_m_s: float = 1.0

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            OmniError: a range is not a positive number.
        """
        if not (0 < self.error_range_m < np.inf and 0 < self.speed_range_m_s < np.inf):
            raise OmniError("the ranges of the fuzzy controller must be positive numbers")

    @property
    def ranges(self) -> tuple[float, float]:
        """Of errors and speeds, m and m/s."""
        return self.error_range_m, self.speed_range_m_s

    @property
    def stiffness(self) -> float:
        """Velocity per error at no error, 1/s.

        Per range e of its small error PS fires 2 e, and adds 2 e times the half of the universe that ZO does not reach
        into: a moment of 2 e x 3/8 to ZO's area of 1/2.
        """
        return 1.5 * self.speed_range_m_s / self.error_range_m

    def __call__(self, error: ArrayLike) -> Array:
        """Return velocities [vx, vy] (..., 2) in m/s for position errors [ex, ey] (..., 2) in m.

        Raises:
            OmniError: an error is not a number.
        """
        return self.speed_range_m_s * ENGINE(np.asarray(error, float) / self.error_range_m)
