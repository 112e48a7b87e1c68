"""The paper's fuzzy controller: 25 Mamdani rules, min-max inference, centre of gravity (section 3-C).

Both inputs and both outputs have five triangular sets NB, NS, ZO, PS, PB, whose peaks lie at -1, -1/2, 0, 1/2, 1 of
the range and which cross at half height (figures 5 and 6). The printed tables 1 and 2 label the last two columns and
rows NS and NB; the example below them (e_x NB and e_y PS give v_x NB and v_y PS) shows that PS and PB are meant.

Between two neighbouring peaks only two clipped triangles are non-zero, so the aggregated set's area and moment there
have a closed form, and the centre of gravity is exact: nothing is sampled.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from omni_control.errors import OmniError
from omni_control.kinematics import Array

LABELS = ("NB", "NS", "ZO", "PS", "PB")
PEAKS = np.linspace(-1.0, 1.0, 5)
NB, NS, ZO, PS, PB = range(5)
# Rows are the sets of e_y, columns those of e_x, entries the set of the output.
RULES_VX = np.array([[NB, NS, ZO, PS, PB]] * 5)
RULES_VY = RULES_VX.T.copy()


def memberships(value: ArrayLike) -> Array:
    """Degrees (..., 5) to which `value` (...), clipped to [-1, 1], belongs to the five sets."""
    clipped = np.clip(np.asarray(value, float), -1.0, 1.0)
    return np.maximum(0.0, 1.0 - np.abs(clipped[..., None] - PEAKS) / (PEAKS[1] - PEAKS[0]))


def centroid(heights: Array) -> Array:
    """Centre of gravity, in [-1, 1], of the maximum of the five output sets clipped at `heights` (..., 5).

    In the local coordinate u of an interval between two peaks, the left set is min(a, 1 - u), the right one min(b, u).
    The integral of their maximum is the sum of their integrals less that of their minimum, min(u, 1 - u, m) with
    m = min(a, b, 1/2), an area m (1 - m) that is symmetric about u = 1/2.
    """
    a, b = heights[..., :-1], heights[..., 1:]
    m = np.minimum(np.minimum(a, b), 0.5)
    left, right, common = a - a**2 / 2, b - b**2 / 2, m * (1 - m)
    area = left + right - common
    moment = left - (a / 2 - a**3 / 6) + (b / 2 - b**3 / 6) - common / 2
    spacing = PEAKS[1] - PEAKS[0]
    return (PEAKS[:-1] * area + spacing * moment).sum(-1) / area.sum(-1)


@dataclass(frozen=True)
class FuzzyController:
    """The FLC: position errors in, correcting velocities out.

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

    def __call__(self, error: ArrayLike) -> Array:
        """Return velocities [vx, vy] (..., 2) in m/s for position errors [ex, ey] (..., 2) in m.

        Raises:
            OmniError: an error is not a number.
        """
        error = np.asarray(error, float)
        if np.isnan(error).any():
            raise OmniError("the fuzzy controller got a position error that is not a number")
        degrees = memberships(error / self.error_range_m)
        firing = np.minimum(degrees[..., 1, :, None], degrees[..., 0, None, :])
        heights = [
            np.stack([np.where(rules == label, firing, 0.0).max((-2, -1)) for label in range(5)], axis=-1)
            for rules in (RULES_VX, RULES_VY)
        ]
        return self.speed_range_m_s * np.stack([centroid(h) for h in heights], axis=-1)
