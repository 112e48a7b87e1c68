"""The paper's fuzzy controller (section 3-C): a Mamdani controller with 25 rules.

Both inputs and both outputs have five triangular sets with peaks at -1, -1/2, 0, 1/2, 1 of the
range. Neighbors cross at half height (figures 5 and 6), and the outermost sets end at the limits
of the range. The strength of a rule is the smaller membership of its two conditions. An output set
is clipped at the strength of its strongest rule. The output is the exact centroid of the union of
the clipped sets (E. H. Mamdani and S. Assilian, Int. J. Man-Machine Studies 7, 1975).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from omni_control.errors import OmniError
from omni_control.kinematics import Array

LABELS = ("NB", "NS", "ZO", "PS", "PB")

# Rows are the sets of e_y, columns those of e_x, in the order of LABELS; entries are the sets of
# the velocity. The paper prints NB NS ZO NS NB next to the rows of table 1 and above the columns of
# table 2. That is a misprint for NB NS ZO PS PB: the paper's example, "if e_x is NB and e_y is PS,
# then v_x is NB and v_y is PS", needs a row PS in table 1, and as printed no rule would give v_x at
# a large positive e_y, nor v_y at a large positive e_x. The entries are the printed ones.
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
_RULE_TABLES = np.array([TABLE_1_VX.split(), TABLE_2_VY.split()])  # (outputs, rules)
# Indices (5, sets, outputs) of the five rules that conclude a set.
_RULES = np.array([[np.flatnonzero(t == s) for s in LABELS] for t in _RULE_TABLES]).T.copy()
PEAKS = np.linspace(-1, 1, 5)[:, None, None]

# Area and first moment of the union. Each set overlaps with its neighbors only, in a triangle of
# height 1/2 at their crossing. The sum over the five sets counts these four triangles twice, so
# that they are subtracted once. Up to a level u, the area of a set is u - u^2 / 2, and that of an
# overlap u / 2 - u^2 / 2. Both are symmetric about their peaks, except for the outermost sets:
# those are half triangles. Their first moment about the peak is (1 - (1 - u)^3) / 24 inwards.
_CROSSINGS = (PEAKS[1:] + PEAKS[:-1]) / 2
# Sets whose smaller height is the level of each triangle: five sets, then four overlaps.
_LEFT_SETS, _RIGHT_SETS = np.r_[0:5, 0:4], np.r_[0:5, 1:5]
_MAX_LEVELS = np.repeat([1.0, 0.5], [5, 4])[:, None, None]
# Coefficients of the polynomials in u, [area, moment] of the nine triangles.
_LINEAR, _QUADRATIC, _CUBIC = np.zeros((3, 2, 9, 1, 1))
_LINEAR[0, :, 0, 0] = [0.5, 1, 1, 1, 0.5, *[-0.5] * 4]
_QUADRATIC[0, :, 0, 0] = [-0.25, -0.5, -0.5, -0.5, -0.25, *[0.5] * 4]
_LINEAR[1], _QUADRATIC[1] = np.concatenate([PEAKS, _CROSSINGS]) * [_LINEAR[0], _QUADRATIC[0]]
for _outermost, _inwards in ((0, 1 / 24), (4, -1 / 24)):
    _LINEAR[1, _outermost] += 3 * _inwards
    _QUADRATIC[1, _outermost] -= 3 * _inwards
    _CUBIC[1, _outermost] = _inwards


def compute_memberships(values: Array) -> Array:
    """Return the degrees of membership (5, k, n) of values (k, n), relative to their range."""
    return np.maximum(1.0 - 2.0 * np.abs(np.minimum(np.maximum(values, -1.0), 1.0) - PEAKS), 0.0)


def compute_centroids(heights: Array) -> Array:
    """Return the centroids (outputs, n) of unions of sets clipped at heights (5, outputs, n)."""
    # numpy sums the rows in order if there are at least two outputs, otherwise pairwise.
    u = np.minimum(
        np.minimum(heights.take(_LEFT_SETS, axis=0), heights.take(_RIGHT_SETS, axis=0)),
        _MAX_LEVELS,
    )
    area, moment = np.add.reduce(((_CUBIC * u + _QUADRATIC) * u + _LINEAR) * u, axis=1)
    return moment / area


@dataclass(frozen=True)
class FuzzyLaw:
    """The FLC: position errors in, correcting velocities out.

    A velocity never decreases with its own error, but its gain has the ripples of a Mamdani
    controller with few sets. With the default ranges, and the other error on a peak, it is 15/s at
    zero, 8/s half-way to the peak of PS, 15/s just before this peak, 0 just after it, where the
    base of PB lies within that of PS and adds next to nothing to the union, and 23/s at the end of
    the range. The other error has an effect only between two peaks, where no rule fires fully. It
    changes a velocity by less than 0.05 of the range.

    Args:
        error_range_m: Inputs are clipped to plus or minus this range (epsilon of the paper), m.
        speed_range_m_s: Outputs lie in the universe plus or minus this range (delta), m/s. Since
            the outermost sets are half triangles, the largest output is 5/6 of it.
    """

    error_range_m: float = 0.1
    speed_range_m_s: float = 1.0

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            OmniError: A range is not a positive number.
        """
        if not (0 < self.error_range_m < np.inf and 0 < self.speed_range_m_s < np.inf):
            raise OmniError("error_range_m and speed_range_m_s must be positive numbers")

    @property
    def gain_at_zero(self) -> float:
        """Velocity per error at zero error, 1/s.

        At a small error e, relative to the range, PS fires with strength 2 e. It adds 2 e times
        the half of the universe outside ZO: a moment of 2 e x 3/8 to ZO's area of 1/2.
        """
        return 1.5 * self.speed_range_m_s / self.error_range_m

    def __call__(self, error: ArrayLike) -> Array:
        """Return velocities [vx, vy] (..., 2) in m/s for position errors [ex, ey] (..., 2) in m.

        Raises:
            OmniError: An error is NaN.
        """
        errors = np.asarray(error, float)
        if np.count_nonzero(np.isnan(errors)):
            raise OmniError("position errors of the fuzzy controller must be numbers, got NaN")
        degrees = compute_memberships(errors.reshape(-1, 2).T / self.error_range_m)
        strengths = np.minimum(degrees[:, None, 1], degrees[:, 0]).reshape(25, -1)
        velocity = compute_centroids(np.maximum.reduce(strengths.take(_RULES, axis=0)))
        return self.speed_range_m_s * velocity.T.reshape(errors.shape)
