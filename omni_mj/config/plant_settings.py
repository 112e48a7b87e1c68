"""Settings of the plant other than the robot: carpet, randomization, disturbance, integration."""

from collections.abc import Iterator
from typing import Literal

from omni_mj.config.validation import FRICTION_RANGE, CarpetPatches, Poses, SettingsModel, setting


class CarpetSettings(SettingsModel):
    """The carpet under the rollers."""

    friction: float = setting(
        0.8, "", "friction coefficient (as in the league's simulators)", *FRICTION_RANGE
    )
    rolling_resistance: float = setting(
        ..., "", "coefficient of rolling resistance of the pile: drag over normal force", 0, 1
    )
    nap: float = setting(
        0.0,
        "",
        "directional nap: drag is rolling_resistance (1 + nap cos(direction - nap_direction_deg))",
        0,
        1,
    )
    nap_direction_deg: float = setting(
        0.0, "deg", "direction of travel straight against the fibers, world frame", -360, 360
    )
    patches: CarpetPatches = setting(
        (),
        "m, m, m, 1",
        "circles [x, y, radius, friction] of other friction; the last one wins where they overlap",
        0,
        50,
    )


class RandomizationSettings(SettingsModel):
    """Domain randomization, drawn per seed and robot. Normal numbers are cut at 3 deviations."""

    wheel_friction_std: float = setting(
        0.0, "", "relative standard deviation of each wheel's friction", 0, 0.3
    )
    max_wear_m: float = setting(
        0.0, "m", "largest loss of each wheel's roller radius, uniformly distributed", 0, 0.001
    )
    torque_constant_std: float = setting(
        0.0, "", "relative standard deviation of each motor's torque constant", 0, 0.3
    )
    mass_std: float = setting(
        0.0, "", "relative standard deviation of the mass on the wheels (batteries, covers)", 0, 0.3
    )
    com_offset_std_m: float = setting(
        0.0, "m", "standard deviation of that mass's center, forward and sideways", 0, 0.01
    )


class DisturbanceSettings(SettingsModel):
    """A disturbance that is uniform within its amplitude, drawn per frame and axis (table 4)."""

    velocity_m_s: float = setting(
        0.0, "m/s", "kinematic plant: amplitude of the velocity added to equation 7", 0, 10
    )
    force_n: float = setting(
        0.0, "N", "wheeled plants: amplitude of the force on the chassis", 0, 1000
    )


class KinematicSettings(SettingsModel):
    """The plant of the paper, equation 7."""

    alpha_low: float = setting(
        0.7, "", "lower bound of alpha, uniformly distributed per axis (paper, section 2)", 0, 2
    )
    alpha_high: float = setting(1.0, "", "upper bound of alpha", 0, 2)
    alpha_correlation_time_s: float = setting(
        0.0, "s", "correlation time of alpha; 0: drawn anew in every frame", 0, 1e6
    )

    def find_contradictions(self) -> Iterator[str]:
        """Yield a message if the bounds of alpha are reversed."""
        if self.alpha_low > self.alpha_high:
            yield "kinematic.alpha_low must not be above kinematic.alpha_high"


class PhysicsSettings(SettingsModel):
    """The integration."""

    substeps: int = setting(1, "", "physics steps per cycle of the wheel loops (1/960 s)", 1, 100)
    backend: Literal["auto", "numpy", "jax"] = setting(
        "auto",
        "",
        "array library of the robots' equations: numpy, or JAX (extra fast), which rounds "
        "differently; auto: the faster",
    )


class WorldSettings(SettingsModel):
    """The world that robots share."""

    start_poses: Poses = setting(
        ((0.0, 0.0, 0.0),),
        "m, m, rad",
        "start poses of the robots, by which their references are displaced",
        1,
        12,
    )
