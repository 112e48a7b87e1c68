"""What chance does to robots on wheels: pushes, and the errors of their gyros; each robot's by its own seed."""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array
from omni_mj.link.noise import Noise, Stream
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.settings import column


class Chance:
    """Random forces and gyro errors of n robots, drawn frame by frame.

    Args:
        rows: of the robots.

    Attributes:
        force: greatest push along each axis, (n, 1) N; zero for a robot that nothing pushes any more.
        gyro_bias: of the gyros, (n, 1) rad/s.
    """

    def __init__(self, rows: Sequence[Row]) -> None:
        settings, seeds = [row.settings for row in rows], [row.noise_seed for row in rows]
        self.force = column([s.disturbance for s in settings], "force_n")
        self._pushed = bool(self.force.any())
        self._pushes = Noise(seeds, Stream.DISTURBANCE, lambda rng, count: rng.uniform(-1, 1, (count, 2)))
        sensors = [s.sensors for s in settings]
        bias = Noise(seeds, Stream.GYRO_BIAS, lambda rng, count: rng.standard_normal((count, 1))).next()
        self.gyro_bias: Array = column(sensors, "gyro_bias_rad_s") * bias
        self._gyro_sigma = column(sensors, "gyro_noise_rad_s")
        self._gyro_noise = Noise(seeds, Stream.GYRO_NOISE, lambda rng, count: rng.standard_normal((count, 1)))

    def push(self) -> Array:
        """The next frame's forces on the chassis, (n, 2) N."""
        return np.asarray(self.force * self._pushes.next()) if self._pushed else np.zeros((len(self.force), 2))

    def gyro_error(self, bias: Array) -> Array:
        """What gyros show too much in the next frame, (n,) rad/s, with a `bias` (n, 1) in rad/s."""
        return np.asarray(bias + self._gyro_sigma * self._gyro_noise.next())[:, 0]
