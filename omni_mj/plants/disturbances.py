"""Random disturbances drawn anew in each frame: push forces and errors of the gyros.

Each robot has its own random streams, which depend on its seed only. Push forces are the
disturbance of table 4 in the paper as a force: uniform within an amplitude, per axis and frame.
The error of a gyro is a constant bias, drawn once, and white noise, both normal.
"""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config.rows import Row
from omni_mj.config.settings import gather
from omni_mj.network.random_streams import Noise, Stream


class Disturbances:
    """Push forces and gyro errors of n robots.

    Args:
        rows: Rows of the robots.

    Attributes:
        gyro_bias: Constant error of the gyros, (n, 1) rad/s.
    """

    def __init__(self, rows: Sequence[Row]) -> None:
        seeds = [row.noise_seed for row in rows]
        self._max_force = gather(rows, "settings.disturbance.force_n")[:, None]
        self._has_force = bool(self._max_force.any())
        self._uniform_noise = Noise(
            seeds, Stream.DISTURBANCE, lambda rng, count: rng.uniform(-1, 1, (count, 2))
        )
        bias_noise = Noise(
            seeds, Stream.GYRO_BIAS, lambda rng, count: rng.standard_normal((count, 1))
        )
        bias_sigma = gather(rows, "settings.sensors.gyro_bias_rad_s")[:, None]
        self.gyro_bias: Array = bias_sigma * bias_noise.next()
        self._gyro_sigma = gather(rows, "settings.sensors.gyro_noise_rad_s")[:, None]
        self._gyro_noise = Noise(
            seeds, Stream.GYRO_NOISE, lambda rng, count: rng.standard_normal((count, 1))
        )

    def draw_push_force(self) -> Array:
        """Draw the forces on the chassis in the next frame, world frame, (n, 2) N."""
        if not self._has_force:
            return np.zeros((len(self._max_force), 2))
        return np.asarray(self._max_force * self._uniform_noise.next())

    def draw_gyro_error(self, bias: Array) -> Array:
        """Draw the errors of the gyros in the next frame.

        Args:
            bias: Constant part, (n, 1) rad/s; `gyro_bias` and that of faults.

        Returns:
            Errors, (n,) rad/s.
        """
        return np.asarray(bias + self._gyro_sigma * self._gyro_noise.next())[:, 0]
