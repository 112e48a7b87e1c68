"""Settings of the plant other than the robot: carpet, randomization, disturbance, integration."""

from collections.abc import Iterator
from typing import Literal

from omni_mj.config.validation import (
    FROM_ROBOT,
    MAX_FRICTION,
    MIN_FRICTION,
    CarpetPatches,
    Poses,
    SettingsModel,
    find_degrees,
    setting,
)


class CarpetSettings(SettingsModel):
    """The carpet under the rollers."""

    friction: float = setting(
        0.8,
        "friction coefficient (as in the league's simulators)",
        low=MIN_FRICTION,
        high=MAX_FRICTION,
    )
    rolling_resistance: float = setting(
        FROM_ROBOT,
        "coefficient of rolling resistance: drag of the pile over normal force",
        low=0,
        high=1,
    )
    nap: float = setting(
        0.0,
        "nap of the pile: rolling_resistance is multiplied by 1 + nap cos(direction of travel - "
        "nap_direction_deg)",
        low=0,
        high=1,
    )
    nap_direction_deg: float = setting(
        0.0,
        "direction of travel of the largest drag (against the fibers), world frame",
        "deg",
        low=-360,
        high=360,
    )
    patches: CarpetPatches = setting(
        (),
        "circles [x, y, radius, friction coefficient]; where they overlap, the last one counts",
        "m, m, m, 1",
        max_length=50,
    )


class RandomizationSettings(SettingsModel):
    """Domain randomization, drawn per seed and robot. Normal numbers are truncated at 3 sigma."""

    wheel_friction_std: float = setting(
        0.0, "relative standard deviation of each wheel's friction", low=0, high=0.3
    )
    max_wear_m: float = setting(
        0.0,
        "largest wear of each wheel's roller radius, uniformly distributed",
        "m",
        low=0,
        high=0.001,
    )
    torque_constant_std: float = setting(
        0.0, "relative standard deviation of each motor's torque constant", low=0, high=0.3
    )
    mass_std: float = setting(
        0.0,
        "relative standard deviation of the chassis's mass (batteries, covers)",
        low=0,
        high=0.3,
    )
    com_offset_std_m: float = setting(
        0.0,
        "standard deviation of the chassis's center of mass, forward and sideways",
        "m",
        low=0,
        high=0.01,
    )


class DisturbanceSettings(SettingsModel):
    """A disturbance, drawn per frame and axis, uniform in [-amplitude, amplitude].

    Paper, table 4.
    """

    velocity_m_s: float = setting(
        0.0,
        "kinematic plant: amplitude of a velocity that is added in equation 7",
        "m/s",
        low=0,
        high=10,
    )
    force_n: float = setting(
        0.0, "wheeled plants: amplitude of a force on the chassis", "N", low=0, high=1000
    )


class KinematicSettings(SettingsModel):
    """The kinematic plant of the paper: velocity = alpha times command (equation 7)."""

    alpha_low: float = setting(
        0.7,
        "lower bound of alpha, which is uniformly distributed, per axis (paper, section 2)",
        low=0,
        high=2,
    )
    alpha_high: float = setting(1.0, "upper bound of alpha", low=0, high=2)
    alpha_correlation_time_s: float = setting(
        0.0, "correlation time of alpha; 0: drawn anew in every frame", "s", low=0, high=1e6
    )

    def find_contradictions(self) -> Iterator[str]:
        """Yield a message if the bounds of alpha are reversed."""
        if self.alpha_low > self.alpha_high:
            yield "kinematic.alpha_low must not be above kinematic.alpha_high"


class PhysicsSettings(SettingsModel):
    """Time integration of the physics, and the library that computes it."""

    substeps: int = setting(
        1, "physics steps per cycle of the wheel loops (1/960 s)", low=1, high=100
    )
    backend: Literal["auto", "numpy", "jax"] = setting(
        "auto",
        "array library for the equations of robots; jax needs the extra `fast` and rounds "
        "differently; auto: the faster one",
    )


class WorldSettings(SettingsModel):
    """The world that robots share."""

    field_length_m: float = setting(
        9.0,
        "length of the field, along x, lines included; division B: 9 x 6 m, division A: 12 x 9 m",
        "m",
        low=1,
        high=30,
    )
    field_width_m: float = setting(6.0, "width of the field, along y", "m", low=1, high=30)
    field_margin_m: float = setting(
        0.7, "distance from the field to the walls, on all sides", "m", low=0, high=5
    )

    start_poses: Poses = setting(
        ((0.0, 0.0, 0.0),),
        "start poses [x, y, heading in rad] of the robots: offsets of their references and "
        "initial poses",
        "m, m, rad",
        min_length=1,
        max_length=12,
    )

    @property
    def carpet_size_m(self) -> tuple[float, float]:
        """Distances between opposite walls along x and y, m."""
        margins_m = 2 * self.field_margin_m
        return self.field_length_m + margins_m, self.field_width_m + margins_m

    def find_contradictions(self) -> Iterator[str]:
        """Yield a message for headings in degrees."""
        yield from find_degrees(
            "world.start_poses", (heading for _, _, heading in self.start_poses)
        )
