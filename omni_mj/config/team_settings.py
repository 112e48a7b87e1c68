"""Settings of the team's computer: the reference, the assumptions about robots, command limits."""

from collections.abc import Iterator
from typing import Literal

from omni_control.reference.curves import CURVES
from omni_mj.config.validation import Poses, SettingsModel, setting


class ReferenceSettings(SettingsModel):
    """The reference trajectory: waypoints or a curve, and the motion limits along it."""

    shape: Literal["waypoints", "random", *CURVES] = setting(  # type: ignore[valid-type]
        "waypoints", "", "path: the given waypoints, random waypoints, or a curve"
    )
    waypoints: Poses = setting(
        ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
        "m, m, rad",
        "poses [x, y, heading] to visit; the first is the start",
        2,
    )
    length_m: float = setting(
        2.0, "m", "curve, random: extent in x, centered on the field", 0.1, 20
    )
    width_m: float = setting(2.0, "m", "curve, random: extent in y", 0.1, 20)
    heading: Literal["fixed", "tangent"] = setting(
        "fixed", "", "curve: fixed: heading 0; tangent: heading along the path"
    )
    waypoint_count: int = setting(
        10, "", "random: number of waypoints, including the start", 2, 1000
    )
    seed: int = setting(
        0, "", "random: seed of the waypoints, the same for all seeds of a run", 0, 1_000_000
    )
    laps: int = setting(1, "", "number of laps", 1, 1000)
    mode: Literal["timed", "iterated"] = setting(
        "timed",
        "",
        "timed: planned in advance; iterated: waypoints only, replanned each frame from the pose",
    )
    max_speed_m_s: float = setting(3.159, "m/s", "speed limit (paper, section 2)", 0.01, 10)
    max_acceleration_m_s2: float = setting(
        0.826, "m/s^2", "acceleration limit (paper, section 2)", 0.01, 20
    )
    max_sideways_acceleration_m_s2: float = setting(
        0.0, "m/s^2", "acceleration limit along the body's y axis; 0: as along its x axis", 0, 20
    )
    max_turn_rate_rad_s: float = setting(6.0, "rad/s", "turn rate limit", 0.01, 30)
    max_turn_acceleration_rad_s2: float = setting(
        12.0, "rad/s^2", "angular acceleration limit", 0.01, 200
    )
    max_jerk_m_s3: float = setting(
        0.0, "m/s^3", "jerk limit; 0: unlimited. Not for mode iterated, which replans", 0, 1e4
    )
    max_turn_jerk_rad_s3: float = setting(
        0.0, "rad/s^3", "angular jerk limit; 0: unlimited. Not for mode iterated", 0, 1e5
    )
    assumed_friction: float = setting(
        0.8,
        "",
        "friction coefficient assumed by the planner, which slows down to keep traction; 0: ignore",
        0,
        5,
    )
    wheel_utilization: float = setting(
        0.85, "", "usable fraction of the wheels' traction and speed", 0.1, 1
    )
    initial_rest_s: float = setting(
        0.25, "s", "rest before the first move; no command acts before the dead time", 0, 60
    )
    dwell_s: float = setting(0.0, "s", "rest at each waypoint", 0, 60)
    settle_s: float = setting(1.0, "s", "rest at the end", 0, 60)

    def find_contradictions(self) -> Iterator[str]:
        """Yield messages about settings that the mode iterated does not support."""
        if self.mode != "iterated":
            return
        if self.shape in CURVES:
            yield (
                "reference.mode = iterated plans between waypoints, and a curve has none; "
                f"reference.shape = {self.shape} needs reference.mode = timed"
            )
        if self.max_jerk_m_s3 or self.max_turn_jerk_rad_s3:
            yield (
                "reference.max_jerk_m_s3 and max_turn_jerk_rad_s3 need reference.mode = timed: "
                "iterated replans each frame from the robot's pose, whose velocity may jump"
            )


class ControlSettings(SettingsModel):
    """The team's computer: its assumptions about robots, its controllers, and command limits.

    Assumptions without a default follow from the robot (`omni_mj.config.nominal_model`).
    """

    delay_error_frames: int = setting(
        0, "frames", "assumed dead time minus true dead time", -600, 600
    )
    assumed_lag_s: float = setting(
        ...,
        "s",
        "wheeled plants: assumed lag of the wheel loops; default: from their gains; 0: unknown",
        0,
        1,
    )
    assumed_friction_loss_m_s: float = setting(
        ...,
        "m/s",
        "wheeled plants: assumed speed loss by dry friction; default: from the gains; 0: unknown",
        0,
        1,
    )
    assumed_creep_s2_m: float = setting(
        ...,
        "s^2/m",
        "wheeled plants: assumed creep coefficient T, forward (TIGERs: 0.038 to 0.06); 0: unknown",
        0,
        1,
    )
    assumed_creep_sideways_s2_m: float = setting(
        ..., "s^2/m", "assumed creep coefficient T, sideways (TIGERs: 0.082 to 0.155)", 0, 1
    )
    assumed_alpha_forward: float = setting(
        ...,
        "",
        "wheeled plants: assumed steady velocity gain alpha, forward; default: from the creep law; "
        "0: unknown",
        0,
        2,
    )
    assumed_alpha_sideways: float = setting(
        ..., "", "assumed steady velocity gain alpha, sideways (TIGERs: 0.79 to 0.97)", 0, 2
    )

    error_range_m: float = setting(
        0.1, "m", "fuzzy controller: input range of the position error (paper, section 4)", 1e-6, 10
    )
    speed_range_m_s: float = setting(
        1.0, "m/s", "fuzzy controller: output range of the velocity (paper, section 4)", 1e-6, 10
    )
    heading_gain: float = setting(
        3.0, "1/s", "proportional gain of the heading hold: turn rate per heading error", 0, 60
    )
    alpha_window_frames: int = setting(
        15, "frames", "window n_0 of the estimator of alpha (equation 8)", 1, 600
    )
    max_speed_m_s: float = setting(
        3.7, "m/s", "limit of the commanded speed (ssl-simulation-setup)", 0.01, 20
    )
    max_acceleration_m_s2: float = setting(
        4.7, "m/s^2", "slew-rate limit of the commanded velocity (ssl-simulation-setup)", 0.01, 1e3
    )
    max_turn_rate_rad_s: float = setting(
        26.0, "rad/s", "limit of the commanded turn rate (ssl-simulation-setup)", 0.01, 100
    )
    max_turn_acceleration_rad_s2: float = setting(
        50.8, "rad/s^2", "slew-rate limit of the turn rate (ssl-simulation-setup)", 0.01, 1e4
    )
