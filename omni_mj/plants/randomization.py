"""Randomization of robots with wheels: deviations drawn once, disturbances drawn in each frame.

Each robot has its own random streams, which depend on its seed only.

**Disturbances.** Each frame draws a push force and a gyro error. The push force is the disturbance
of table 4 of the paper as a force: uniform within an amplitude, per axis and frame. The gyro error
is the sum of a constant bias, drawn once, and white noise. Both are normally distributed.

**Domain randomization** draws deviations of a robot from its nominal data. Friction, torque
constants and mass get random factors, the center of mass gets an offset. All are normally
distributed, and truncated at 3 standard deviations to exclude implausible values. Wear of wheels is
uniformly distributed between 0 and a limit: it only reduces radii, and worn rubber is replaced at
the limit.

Wear reduces the radius of the rollers. The axle is lowered by the same amount, so the normal forces
of the wheels do not change. Otherwise two opposite wheels that have lost 0.13 mm would carry
nothing, because the spring between roller and carpet yields by 0.07 mm only
(`omni_mj.mjcf.rollers`). A real carpet yields by about a millimeter (an assumption).
"""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config.rows import Row
from omni_mj.config.settings import gather
from omni_mj.network.random_streams import Noise, Stream

# Deviation at which normal numbers are truncated, in standard deviations
MAX_DEVIATIONS = 3.0


class RobotVariation(NamedTuple):
    """Deviations of n robots with W wheels from their settings.

    Attributes:
        friction_factor: Ratio of each wheel's friction to the carpet's, (n, W).
        wear: Loss of each wheel's radius, (n, W) m.
        magnet_factor: Ratio of each motor's torque constant to the datasheet's, (n, W).
        mass_factor: Ratio of the chassis's mass to the nominal one, (n, 1).
        center_offset: Offset of the chassis's center of mass, forward and sideways, (n, 2) m.
    """

    friction_factor: Array
    wear: Array
    magnet_factor: Array
    mass_factor: Array
    center_offset: Array

    @classmethod
    def draw(cls, rows: Sequence[Row]) -> Self:
        """Draw the deviations of rows with their seeds. All must have the same number of wheels."""
        names = (
            "wheel_friction_std",
            "max_wear_m",
            "torque_constant_std",
            "mass_std",
            "com_offset_std_m",
        )
        deviations = [gather(rows, f"settings.randomization.{name}")[:, None] for name in names]
        friction_std, max_wear, magnet_std, mass_std, center_std = deviations
        n_wheels = len(rows[0].settings.wheels.azimuths_deg)
        n_draws = 3 + 3 * n_wheels
        seeds = [row.noise_seed for row in rows]
        uniform = Noise(seeds, Stream.VARIATION, n_draws).next()
        is_varied = np.any(deviations)
        normal = _to_truncated_normal(uniform) if is_varied else np.zeros_like(uniform)
        body, friction, magnets, _ = np.split(normal, 3 + n_wheels * np.arange(3), axis=1)
        return cls(
            friction_factor=1 + friction_std * friction,
            wear=max_wear * uniform[:, -n_wheels:],
            magnet_factor=1 + magnet_std * magnets,
            mass_factor=1 + mass_std * body[:, :1],
            center_offset=center_std * body[:, 1:],
        )

    def to_columns(self) -> dict[str, Array]:
        """Return a mapping from name to deviations (n,); empty if no robot deviates."""
        factors = self.friction_factor, self.magnet_factor, self.mass_factor
        deviations = *(factor - 1 for factor in factors), self.wear, self.center_offset
        if not any(deviation.any() for deviation in deviations):
            return {}
        columns = dict[str, Array]()
        for name, values in (
            ("friction_factor_{}", self.friction_factor),
            ("wear_{}_m", self.wear),
            ("torque_constant_factor_{}", self.magnet_factor),
        ):
            columns |= {name.format(wheel): column for wheel, column in enumerate(values.T, 1)}
        columns["mass_factor"] = self.mass_factor[:, 0]
        columns["com_offset_x_m"], columns["com_offset_y_m"] = self.center_offset.T
        return columns


class Disturbances:
    """Push forces and gyro errors of n robots.

    Args:
        rows: Rows of the robots.
    """

    def __init__(self, rows: Sequence[Row]) -> None:
        seeds = [row.noise_seed for row in rows]
        self._force_noise = Noise(seeds, Stream.DISTURBANCE, 2)
        self._unit_gyro_bias = Noise(seeds, Stream.GYRO_BIAS, 1, "standard_normal").next()
        self._gyro_noise = Noise(seeds, Stream.GYRO_NOISE, 1, "standard_normal")
        self.change_amplitudes(rows)

    def change_amplitudes(self, rows: Sequence[Row]) -> None:
        """Scale forces and errors by the settings of the rows."""
        self._max_force = gather(rows, "settings.disturbance.force_n")[:, None]
        bias_sigma = gather(rows, "settings.sensors.gyro_bias_rad_s")[:, None]
        self._gyro_bias = bias_sigma * self._unit_gyro_bias
        self._gyro_sigma = gather(rows, "settings.sensors.gyro_noise_rad_s")[:, None]

    def draw_push_force(self) -> Array:
        """Draw the forces on the chassis in the next frame, world frame, (n, 2) N."""
        return self._max_force * (2 * self._force_noise.next() - 1)

    def draw_gyro_error(self, fault_bias: float | Array) -> Array:
        """Draw the errors of the gyros in the next frame.

        Args:
            fault_bias: Bias that faults add, (n, 1) rad/s.

        Returns:
            Errors, (n,) rad/s.
        """
        return (self._gyro_bias + fault_bias + self._gyro_sigma * self._gyro_noise.next())[:, 0]


def _to_truncated_normal(uniform: Array) -> Array:
    """Map uniform numbers in [0, 1] to truncated standard normal numbers, by the inverse CDF.

    With the CDF F, the number is F^-1(F(-3) + (1 - 2 F(-3)) u) for the uniform number u.
    """
    # Imported here, because the import takes longer than to build a world of nominal robots.
    from scipy.special import ndtr, ndtri

    tail = ndtr(-MAX_DEVIATIONS)
    return ndtri(tail + (1 - 2 * tail) * uniform)
