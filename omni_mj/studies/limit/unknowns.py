"""What nobody can know before a run: how much of it, and what of it a scenario's settings say."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import PERIOD_S, Settings

TUNED = ("speed", "turn", "drift", "turn_drift", "compass")  # what a plant does beside any linear model of it
LEAST_M, LEAST_RAD = 2e-6, 2e-6  # that a camera tells apart, for filters that would otherwise divide by zero


@dataclass(frozen=True)
class Unknowns:
    """Standard deviations of what the filter reckons with, per frame unless told otherwise; a number or (n, 1) each.

    The first five are what a plant does beside any linear model of it: rolling on rollers, sliding, counting. Defaults
    are what made the poses of `tigers-v2016` on `rect` best predicted; practice changes them.

    Attributes:
        speed, turn: of the speed, gone in the next frame, m/s and rad/s.
        drift, turn_drift: of a change of speed that lasts, m/s and rad/s.
        compass: of the firmware's heading, rad.
        gain: of the share by which speeds differ from commands, in the first frame and for as long as `gain_frames`.
        jolt: the same, new in every frame.
        gain_frames: how long a gain lasts, frames.
    """

    speed: float | Array = 5e-4
    turn: float | Array = 2e-3
    drift: float | Array = 2e-5
    turn_drift: float | Array = 4e-5
    compass: float | Array = 2.5e-4
    gain: float = 0.0
    jolt: float = 0.0
    gain_frames: float = np.inf

    @classmethod
    def of(cls, settings: Settings, plant: str) -> Self:
        """Those that settings tell of, beside the defaults."""
        disturbance, kinematic = settings.disturbance, settings.kinematic
        if plant != "kinematic":
            pushed = disturbance.force_n / settings.body.mass_kg * PERIOD_S
            return cls(speed=float(np.hypot(cls.speed, pushed / np.sqrt(3))))
        middle = (kinematic.alpha_low + kinematic.alpha_high) / 2
        spread = (kinematic.alpha_high - kinematic.alpha_low) / np.sqrt(12) / max(middle, 1e-3)
        lasts = kinematic.alpha_time_s / PERIOD_S
        exact = cls(*[1e-9] * 5)  # it does nothing beside its equation
        pushed = max(disturbance.velocity_m_s / np.sqrt(3), 1e-9)
        return replace(exact, speed=pushed, **({"gain": spread, "gain_frames": lasts} if lasts else {"jolt": spread}))

    @classmethod
    def stacked(cls, several: Sequence[Self], each: int) -> Self:
        """Several, for as many rows each, one after the other."""
        values: dict[str, Any] = {field.name: getattr(several[0], field.name) for field in fields(cls)}
        for name in TUNED:
            values[name] = np.repeat([getattr(one, name) for one in several], each)[:, None]
        return cls(**values)


def seen_with(settings: Settings) -> Array:
    """Standard deviations (3,) of the pose that vision reports."""
    vision = settings.vision
    position = max(vision.position_noise_m, LEAST_M)
    return np.array([position, position, max(vision.heading_noise_rad, LEAST_RAD)])
