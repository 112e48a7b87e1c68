"""Online estimate of the motor correction factor alpha (equation 8 of the paper)."""

from collections import deque

import numpy as np

from omni_control.delay_compensation import CommandHistory
from omni_control.kinematics import Array

# Commanded displacement at which the new ratio and the old estimate have equal weights, m. It is
# well above the noise of vision.
EQUAL_WEIGHT_M = 0.02
MIN_ALPHA, MAX_ALPHA = 0.5, 1.1  # of the estimate


class AlphaEstimator:
    """Ratio of achieved to commanded displacement in a sliding window, per robot and world axis.

    The paper assumes alpha, the ratio of achieved to commanded velocity, in [0.7, 1] (equation 7).
    Equation 8 sums the ratios of n_0 single frames and divides by T = 1/60 s. As printed, the
    result is n_0 / T = 60 n_0 times as large as alpha, and at rest it divides by zero. The ratio of
    the displacements in the window is used instead:

        alpha = (dx dx_d + rho alpha_old) / (dx_d^2 + rho)

    Here dx is the displacement in the window by the filtered positions, and dx_d the displacement
    by the commands that acted in the window. The regularization rho = EQUAL_WEIGHT_M^2 keeps the
    old estimate at standstill. Each frame multiplies the weight of earlier estimates by
    rho / (dx_d^2 + rho).

    Args:
        n: Number of robots.
        window_frames: Length of the window n_0, frames.
        delay_frames: Dead time k_d, frames.
        period: Length of a frame T, s.
    """

    def __init__(self, n: int, window_frames: int, delay_frames: float, period: float) -> None:
        self._alpha = np.ones((n, 2))
        self._delay_frames, self._period = delay_frames, period
        self._positions: deque[Array] = deque(maxlen=window_frames + 1)

    def update(self, position: Array, sent: CommandHistory) -> Array:
        """Return the new estimate of alpha along the world's x and y axes, (n, 2).

        Args:
            position: Filtered positions (n, 2), world frame, m.
            sent: Commands sent before this frame.
        """
        self._positions.append(position.copy())
        achieved = position - self._positions[0]
        window_frames = len(self._positions) - 1  # shorter at the start of the run
        whole_frames, fraction = int(self._delay_frames), self._delay_frames % 1
        commands = sent.get_latest(window_frames, skip=whole_frames)[..., :2]
        if fraction:
            older = sent.get_latest(window_frames, skip=whole_frames + 1)[..., :2]
            commands = commands + fraction * (older - commands)
        commanded = commands.sum(0) * self._period
        rho = EQUAL_WEIGHT_M**2
        alpha = (achieved * commanded + rho * self._alpha) / (commanded * commanded + rho)
        self._alpha = alpha.clip(MIN_ALPHA, MAX_ALPHA)
        return self._alpha
