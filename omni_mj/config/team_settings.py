"""Settings of the team's computer: reference, assumptions about robots, controllers and limits."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Literal

from omni_control.reference.curve_reference import CURVES
from omni_mj.config.validation import (
    FROM_ROBOT,
    Number,
    Poses,
    SettingsModel,
    find_degrees,
    setting,
)

# Limits of `ReferenceSettings` that may be 0, which means none, and their smallest other value.
OPTIONAL_LIMITS = ("max_sideways_acceleration_m_s2", "max_jerk_m_s3", "max_turn_jerk_rad_s3")
MIN_LIMIT = 0.01


class ReferenceSettings(SettingsModel):
    """The reference trajectory: waypoints or a curve, and the limits of the planned motion.

    The limits of commands have the same names, in `ControlSettings`.
    """

    shape: Literal["waypoints", "random", *CURVES] = setting(  # type: ignore[valid-type]
        "waypoints", "path: the given waypoints, random waypoints, or a curve"
    )
    waypoints: Poses = setting(
        ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
        "poses [x, y, heading in rad] to visit; the first is the start",
        "m, m, rad",
        min_length=2,
    )
    length_m: float = setting(
        2.0, "curve, random: extent in x, centered on the field", "m", low=0.1, high=20
    )
    width_m: float = setting(2.0, "curve, random: extent in y", "m", low=0.1, high=20)
    heading: Literal["fixed", "tangent"] = setting(
        "fixed", "curve: heading 0 (fixed) or along the path (tangent)"
    )
    waypoint_count: int = setting(
        10, "random: number of waypoints, including the start", low=2, high=1000
    )
    seed: int = setting(
        0, "random: seed of the waypoints, the same for all seeds of a run", low=0, high=1_000_000
    )
    laps: int = setting(1, "number of laps", low=1, high=1000)
    mode: Literal["timed", "iterated"] = setting(
        "timed",
        "planned once in advance (timed), or anew in every frame from the robot's pose (iterated; "
        "paper, section 3-A; not for curves)",
    )
    max_speed_m_s: float = setting(
        3.159, "limit of the planned speed (paper, section 2)", "m/s", low=0.01, high=10
    )
    max_acceleration_m_s2: float = setting(
        0.826, "limit of the planned acceleration (paper, section 2)", "m/s^2", low=0.01, high=20
    )
    max_sideways_acceleration_m_s2: float = setting(
        0.0,
        "limit of the planned acceleration along the body's y axis; 0: as along its x axis",
        "m/s^2",
        low=0,
        high=20,
    )
    max_turn_rate_rad_s: float = setting(
        6.0, "limit of the planned turn rate", "rad/s", low=0.01, high=30
    )
    max_turn_acceleration_rad_s2: float = setting(
        12.0, "limit of the planned angular acceleration", "rad/s^2", low=0.01, high=200
    )
    max_jerk_m_s3: float = setting(
        0.0,
        "limit of the planned jerk; 0: unlimited. Not for mode iterated",
        "m/s^3",
        low=0,
        high=1e4,
    )
    max_turn_jerk_rad_s3: float = setting(
        0.0,
        "limit of the planned angular jerk; 0: unlimited. Not for mode iterated",
        "rad/s^3",
        low=0,
        high=1e5,
    )
    assumed_friction: float = setting(
        0.8,
        "friction coefficient that the planner assumes to limit accelerations to the traction of "
        "the wheels, and motion models for the softening of rubber; 0: no such limit",
        low=0,
        high=5,
    )
    wheel_utilization: float = setting(
        0.85, "fraction of the wheels' traction and speed that the planner uses", low=0.1, high=1
    )
    initial_rest_s: float = setting(
        0.25,
        "rest before the first move; the first commands arrive after the dead time",
        "s",
        low=0,
        high=60,
    )
    dwell_s: float = setting(0.0, "rest at each waypoint", "s", low=0, high=60)
    settle_s: float = setting(1.0, "rest at the end", "s", low=0, high=60)

    def find_contradictions(self) -> Iterator[str]:
        """Yield a message for headings in degrees, and for limits that are not supported."""
        for name in OPTIONAL_LIMITS:
            if 0 < getattr(self, name) < MIN_LIMIT:  # its plan would have millions of frames
                yield f"reference.{name} must be 0 or at least {MIN_LIMIT}"
        headings = [0.0, *(heading for _, _, heading in self.waypoints)]
        yield from find_degrees("reference.waypoints", (b - a for a, b in pairwise(headings)))
        if self.mode != "iterated":
            return
        if self.shape in CURVES:
            yield (
                "reference.mode = iterated plans between waypoints, and a curve has none: "
                f"reference.shape = {self.shape} needs reference.mode = timed"
            )
        if self.max_jerk_m_s3 or self.max_turn_jerk_rad_s3:
            yield (
                "reference.max_jerk_m_s3 and max_turn_jerk_rad_s3 need reference.mode = timed: "
                "mode iterated replans in every frame, and the planned velocity may jump"
            )


class ControlSettings(SettingsModel):
    """The team's computer: its assumptions about robots, its controllers, and command limits.

    Assumptions that the robot's file does not give are derived from its hardware
    (`omni_mj.config.nominal_model`).
    """

    # Assumptions about the robots
    delay_error_frames: Number = setting(
        0, "assumed dead time minus true dead time", "frames", low=-600, high=600
    )
    assumed_lag_s: float = setting(
        FROM_ROBOT,
        "wheeled plants: assumed lag of the wheel loops; default: from their gains; 0: unknown",
        "s",
        low=0,
        high=1,
    )
    assumed_friction_loss_m_s: float = setting(
        FROM_ROBOT,
        "wheeled plants: assumed speed loss by dry friction; default: from these gains; 0: unknown",
        "m/s",
        low=0,
        high=1,
    )
    assumed_creep_s2_m: float = setting(
        FROM_ROBOT,
        "wheeled plants: assumed creep coefficient T, forward; default: from the creep stiffness; "
        "0: unknown",
        "s^2/m",
        low=0,
        high=1,
    )
    assumed_creep_sideways_s2_m: float = setting(
        FROM_ROBOT,
        "wheeled plants: assumed creep coefficient T, sideways; default: from the creep stiffness; "
        "0: from T forward",
        "s^2/m",
        low=0,
        high=1,
    )
    assumed_alpha_forward: float = setting(
        FROM_ROBOT,
        "wheeled plants: assumed alpha forward: achieved over commanded velocity in steady motion; "
        "default: from the creep law; 0: unknown",
        low=0,
        high=2,
    )
    assumed_alpha_sideways: float = setting(
        FROM_ROBOT,
        "wheeled plants: assumed alpha sideways; default: from the creep law; 0: unknown",
        low=0,
        high=2,
    )

    # Controllers
    error_range_m: float = setting(
        0.1,
        "fuzzy controller: input range of the position error (paper, section 4)",
        "m",
        low=1e-6,
        high=10,
    )
    speed_range_m_s: float = setting(
        1.0,
        "fuzzy controller: output range of the velocity (paper, section 4)",
        "m/s",
        low=1e-6,
        high=10,
    )
    heading_gain: float = setting(
        3.0,
        "proportional gain of the heading control: turn rate per heading error",
        "1/s",
        low=0,
        high=60,
    )
    alpha_window_frames: int = setting(
        15, "window n_0 of the estimator of alpha (equation 8)", "frames", low=1, high=600
    )

    # Limits of commands
    max_speed_m_s: float = setting(
        3.7, "limit of the commanded speed (ssl-simulation-setup)", "m/s", low=0.01, high=20
    )
    max_acceleration_m_s2: float = setting(
        4.7,
        "slew-rate limit of the commanded velocity (ssl-simulation-setup)",
        "m/s^2",
        low=0.01,
        high=1e3,
    )
    max_turn_rate_rad_s: float = setting(
        26.0, "limit of the commanded turn rate (ssl-simulation-setup)", "rad/s", low=0.01, high=100
    )
    max_turn_acceleration_rad_s2: float = setting(
        50.8,
        "slew-rate limit of the commanded turn rate (ssl-simulation-setup)",
        "rad/s^2",
        low=0.01,
        high=1e4,
    )
