"""The motor correction factor alpha, estimated from what was commanded and what vision saw (equation 8)."""

import numpy as np

from omni_control.delay import CommandsInFlight
from omni_control.kinematics import Array


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
        self._window, self._delay, self._period = window_frames, delay_frames, period
        self._rho, self._bounds = confidence_m**2, bounds
        self._positions: list[Array] = []

    def update(self, position: Array, sent: CommandsInFlight) -> Array:
        """Return alpha (n, 2) for x and y, given the filtered positions (n, 2) and the commands sent so far."""
        self._positions.append(position.copy())
        if len(self._positions) > self._window + 1:
            del self._positions[0]
        achieved = position - self._positions[0]
        count = len(self._positions) - 1
        commanded = np.add.reduce(sent.last(count, skip=self._delay)[..., :2]) * self._period
        rho, (low, high) = self._rho, self._bounds
        ratio = (achieved * commanded + rho * self.value) / (commanded * commanded + rho)
        self.value = np.minimum(np.maximum(ratio, low), high)
        return self.value
