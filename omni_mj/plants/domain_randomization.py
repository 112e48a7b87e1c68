"""What sets one robot apart from another of its kind, and what happens to it by chance: drawn from its seed.

Friction, magnets and mass are drawn as factors, the centre of mass as a shift: normal numbers, cut at 3 deviations, so
that no wheel gets nonsense. Wear only takes away, and rings are changed when they are worn: at any time a wheel may be
anywhere between new and due, so that what it has lost is uniform.

Wear takes rubber from the rollers. The axle is set as much lower, so that all wheels carry what they carried when new.
With axles where they were, two wheels across from each other that have lost 0.13 mm would carry nothing, for the spring
between roller and carpet gives way by 0.07 mm (`omni_mj.mjcf.contact_parameters`); a real pile, a guess, by a millimetre or so.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config.rows import Row
from omni_mj.config.settings import gather
from omni_mj.network.random_streams import Noise, Stream

CUT = 3.0  # deviations


@dataclass(frozen=True, eq=False)
class Drawn:
    """What is peculiar to each of n robots with W wheels.

    Attributes:
        friction: of each wheel beside the carpet's, a factor, (n, W).
        wear: what each wheel has lost of its radius, (n, W) m.
        strength: of each motor's magnets beside the datasheet's, a factor, (n, W).
        mass: of what the wheels carry beside the settings', a factor, (n, 1).
        centre: of its mass, shift ahead and aside, (n, 2) m.
    """

    friction: Array
    wear: Array
    strength: Array
    mass: Array
    centre: Array

    @classmethod
    def of(cls, rows: Sequence[Row]) -> "Drawn":
        """What the seeds of these rows, which have as many wheels each, draw for them."""
        fields = "friction", "wear_m", "motor_constant", "mass", "centre_m"
        varied = {name: gather(rows, f"settings.variation.{name}")[:, None] for name in fields}
        wheels = len(rows[0].settings.wheels.azimuths_deg)
        seeds = [row.noise_seed for row in rows]
        uniform = Noise(
            seeds, Stream.VARIATION, lambda rng, count: rng.random((count, 3 + 3 * wheels))
        ).next()
        normal = _normal(uniform) if np.any(list(varied.values())) else np.zeros_like(uniform)
        body, friction, motors, wear = np.split(
            np.arange(3 + 3 * wheels), 3 + wheels * np.arange(3)
        )
        return cls(
            friction=1 + varied["friction"] * normal[:, friction],
            wear=varied["wear_m"] * uniform[:, wear],
            strength=1 + varied["motor_constant"] * normal[:, motors],
            mass=1 + varied["mass"] * normal[:, body[:1]],
            centre=varied["centre_m"] * normal[:, body[1:]],
        )

    def columns(self) -> dict[str, Array]:
        """Numbers of each row, name -> (n,); none if robots are all alike."""
        numbers, usual = (
            (self.friction, self.wear, self.strength, self.mass, self.centre),
            (1, 0, 1, 1, 0),
        )
        if all((values == usual).all() for values, usual in zip(numbers, usual, strict=True)):
            return {}
        return {
            **{f"friction_{wheel}": values for wheel, values in enumerate(self.friction.T, 1)},
            **{f"wear_{wheel}_m": values for wheel, values in enumerate(self.wear.T, 1)},
            **{
                f"motor_constant_{wheel}": values for wheel, values in enumerate(self.strength.T, 1)
            },
            "mass": self.mass[:, 0],
            "centre_x_m": self.centre[:, 0],
            "centre_y_m": self.centre[:, 1],
        }


def _normal(uniform: Array) -> Array:
    """Normal numbers, cut, from uniform ones."""
    # Late: it takes longer to import than a world of robots that are alike
    from scipy.special import (
        ndtr,
        ndtri,
    )

    tail = ndtr(-CUT)
    numbers: Array = ndtri(tail + (1 - 2 * tail) * uniform)
    return numbers


class Chance:
    """Random forces and gyro errors of n robots, drawn frame by frame.

    Args:
        rows: of the robots.

    Attributes:
        force: greatest push along each axis, (n, 1) N; zero for a robot that nothing pushes any
            more.
        gyro_bias: of the gyros, (n, 1) rad/s.
    """

    def __init__(self, rows: Sequence[Row]) -> None:
        seeds = [row.noise_seed for row in rows]
        self.force = gather(rows, "settings.disturbance.force_n")[:, None]
        self._pushed = bool(self.force.any())
        self._pushes = Noise(
            seeds, Stream.DISTURBANCE, lambda rng, count: rng.uniform(-1, 1, (count, 2))
        )
        bias = Noise(
            seeds, Stream.GYRO_BIAS, lambda rng, count: rng.standard_normal((count, 1))
        ).next()
        self.gyro_bias: Array = gather(rows, "settings.sensors.gyro_bias_rad_s")[:, None] * bias
        self._gyro_sigma = gather(rows, "settings.sensors.gyro_noise_rad_s")[:, None]
        self._gyro_noise = Noise(
            seeds, Stream.GYRO_NOISE, lambda rng, count: rng.standard_normal((count, 1))
        )

    def push(self) -> Array:
        """The next frame's forces on the chassis, (n, 2) N."""
        return (
            np.asarray(self.force * self._pushes.next())
            if self._pushed
            else np.zeros((len(self.force), 2))
        )

    def gyro_error(self, bias: Array) -> Array:
        """What gyros show too much in the next frame, (n,) rad/s, with a `bias` (n, 1) in rad/s."""
        return np.asarray(bias + self._gyro_sigma * self._gyro_noise.next())[:, 0]
