"""The motor correction factor alpha, estimated from what was commanded and what vision saw (equation 8)."""

import numpy as np

from omni_control.delay import CommandsInFlight
from omni_control.kinematics import Array, Number


class AlphaEstimator:
    """Ratio of the displacement achieved to that commanded, over a sliding window, per robot and axis.

    Equation 8 sums n_0 ratios of single frames and divides by T, whose sum is not in [0.7, 1] but n_0 times 60 as
    large, and divides by zero at rest. The ratio of the window's sums is what it can mean:

        alpha = (dx dx_d + rho alpha_old) / (dx_d^2 + rho)

    with dx the displacement seen by vision in the window and dx_d that of the commands which acted in it. The
    regularisation rho keeps the old value at standstill, when neither means anything; what is left of an old value
    shrinks by rho / (dx_d^2 + rho) each frame.

    Args:
        n: robots.
        window_frames: length of the window n_0, frames.
        delay_frames: dead time k_d, frames.
        period: length of a frame T, s.
        confidence_m: commanded displacement at which the new ratio and the old value weigh the same (sqrt(rho)), m;
            well above the error of a displacement seen by vision.
        bounds: lowest and highest value.

    Attributes:
        value: as estimated last, (n, 2).
        delay_frames: as given.
        law: what `ratio` takes besides: confidence squared and bounds.
    """

    def __init__(
        self,
        n: int,
        window_frames: int,
        delay_frames: int,
        period: float,
        confidence_m: float = 0.02,
        bounds: tuple[float, float] = (0.5, 1.1),
    ) -> None:
        self.value = np.ones((n, 2))
        self._window, self.delay_frames, self._period = window_frames, delay_frames, period
        self.law = confidence_m**2, *bounds
        self._positions: list[Array] = []

    def update(self, position: Array, sent: CommandsInFlight) -> Array:
        """Return alpha (n, 2) for x and y, given the filtered positions (n, 2) and the commands sent so far."""
        first, count = self.begin(position)
        achieved = position - first
        commanded = np.add.reduce(sent.last(count, skip=self.delay_frames)[..., :2]) * self._period
        self.value = ratio(achieved, commanded, self.value, *self.law)
        return self.value

    def begin(self, position: Array) -> tuple[Array, int]:
        """Note the filtered positions (n, 2); return the first of the window, and the number of frames since."""
        self._positions.append(position.copy())
        if len(self._positions) > self._window + 1:
            del self._positions[0]
        return self._positions[0], len(self._positions) - 1


def ratio(achieved: Number, commanded: Number, old: Number, rho: float, low: float, high: float) -> Number:
    """Alpha by the displacements of a window, m, and its old value; see `AlphaEstimator`."""
    found = (achieved * commanded + rho * old) / (commanded * commanded + rho)
    return np.minimum(np.maximum(found, low), high)
