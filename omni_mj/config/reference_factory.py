"""Build reference trajectories from the settings of a scenario."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, body_to_world
from omni_control.reference import (
    CURVES,
    CurveReference,
    IteratedReference,
    MotionLimits,
    SampledReference,
    TimedReference,
)
from omni_control.traction_limits import GRAVITY, WheelLimits
from omni_mj.config import FRAME_RATE_HZ, PERIOD_S
from omni_mj.config.rows import Row
from omni_mj.config.settings import Settings
from omni_mj.config.team_settings import ControlSettings, ReferenceSettings

StartPose = tuple[float, float, float]  # [x, y, heading], m and rad
ORIGIN: StartPose = (0.0, 0.0, 0.0)


def build_timed_reference(settings: Settings, start_pose: StartPose = ORIGIN) -> SampledReference:
    """Return the reference that is planned in advance. Errors are measured against it.

    Equal arguments return the same object from a cache.

    Args:
        settings: Settings of reference and robot.
        start_pose: Offset of the whole reference, `Row.start_pose`.

    Raises:
        OmniError: With `reference.assumed_friction`, the wheels cannot follow any reference.
    """
    limits = build_reference_limits(settings)
    return _plan_timed_reference(settings.reference, limits, start_pose)


def build_timed_references(rows: Sequence[Row]) -> list[SampledReference]:
    """Return the timed reference of each row; see `build_timed_reference`."""
    return [build_timed_reference(row.settings, row.start_pose) for row in rows]


def build_iterated_reference(
    settings: Settings, n_robots: int, start_pose: StartPose
) -> IteratedReference:
    """Return the reference between waypoints that is replanned in every frame.

    Args:
        settings: Settings of reference and robots.
        n_robots: Number of robots that follow it, each with its own plan.
        start_pose: Offset of the waypoints, `Row.start_pose`.

    Raises:
        OmniError: As `build_timed_reference`.
    """
    waypoints = _displace_poses(np.array(_list_waypoints(settings.reference), float), start_pose)
    rest_frames = _count_frames(settings.reference.initial_rest_s)
    limits = build_reference_limits(settings)
    return IteratedReference(
        waypoints.tolist(), limits, PERIOD_S, n_robots, rest_frames=rest_frames
    )


def build_motion_limits(settings: ReferenceSettings | ControlSettings) -> MotionLimits:
    """Return the limits that the settings of references and of commands have in common."""
    return MotionLimits(
        settings.max_speed_m_s,
        settings.max_acceleration_m_s2,
        settings.max_turn_rate_rad_s,
        settings.max_turn_acceleration_rad_s2,
    )


@lru_cache(maxsize=4096)
def build_reference_limits(settings: Settings) -> MotionLimits:
    """Return all limits of the reference: those of its settings and those of the robot's wheels.

    Raises:
        OmniError: With `reference.assumed_friction`, the wheels cannot follow any reference.
    """
    reference = settings.reference
    return replace(
        build_motion_limits(reference),
        side_acceleration=reference.max_sideways_acceleration_m_s2 or None,
        jerk=reference.max_jerk_m_s3 or None,
        turn_jerk=reference.max_turn_jerk_rad_s3 or None,
        wheels=_build_wheel_limits(settings),
    )


def _build_wheel_limits(settings: Settings) -> WheelLimits | None:
    """Return the limits of wheels for the assumed friction, or None if it is 0 (ignored)."""
    friction = settings.reference.assumed_friction
    utilization = settings.reference.wheel_utilization
    body = settings.body
    if not friction:
        return None
    gyration_radius = math.sqrt(body.yaw_inertia_kg_m2 / body.mass_kg)
    try:
        return WheelLimits(
            settings.wheels.kinematics,
            utilization * friction,
            gyration_radius,
            body.com_height_m,
            settings.carpet.rolling_resistance,
            settings.drivetrain.roller_friction,
            utilization * _compute_max_rim_speed(settings),
            body.com_x_m,
        )
    except OmniError as error:
        raise OmniError(
            f"reference.assumed_friction = {friction:g} (0: ignore the limits of wheels), "
            f"reference.wheel_utilization = {utilization:g}: {error}"
        ) from None


def _compute_max_rim_speed(settings: Settings) -> float:
    """Return the rim speed at which the nominal voltage still drives full traction, m/s.

    Full traction F is friction times an equal normal force on all wheels. With the wheel radius r,
    the gear ratio n, the torque constant k and the no-load current I_0,

        speed = (V - R I) r / (n k),        I = I_0 + F r / (n k).

    The back-EMF V - R I is taken as at least half of the nominal voltage V.
    """
    motor, nominal_voltage = settings.motor, settings.firmware.nominal_voltage_v
    radius = settings.wheels.radius_m
    traction = (
        settings.reference.assumed_friction
        * settings.body.mass_kg
        * GRAVITY
        / len(settings.wheels.azimuths_deg)
    )
    current = motor.no_load_current_a + traction * radius / motor.wheel_back_emf_v_s
    back_emf = max(nominal_voltage - motor.resistance_ohm * current, nominal_voltage / 2)
    return back_emf / motor.wheel_back_emf_v_s * radius


@lru_cache(maxsize=4096)
def _plan_timed_reference(
    settings: ReferenceSettings, limits: MotionLimits, start_pose: StartPose
) -> SampledReference:
    """Return the reference with rests at both ends, displaced by a start pose."""
    if settings.shape in CURVES:
        curve = CURVES[settings.shape](settings.length_m, settings.width_m)
        faces_along_path = settings.heading == "tangent"
        moving_reference: SampledReference = CurveReference(
            curve, limits, PERIOD_S, settings.laps, faces_along_path
        )
    else:
        dwell_frames = _count_frames(settings.dwell_s)
        waypoints = _list_waypoints(settings)
        moving_reference = TimedReference(waypoints, limits, PERIOD_S, dwell_frames)
    reference = moving_reference.with_rest(
        _count_frames(settings.initial_rest_s), _count_frames(settings.settle_s)
    )
    if start_pose == ORIGIN:
        return reference
    return SampledReference(_displace_poses(reference.poses, start_pose), PERIOD_S)


def _count_frames(duration_s: float) -> int:
    """Return the number of frames nearest to a duration."""
    return round(duration_s * FRAME_RATE_HZ)


def _displace_poses(poses: Array, start_pose: StartPose) -> Array:
    """Transform poses (n, 3) from the coordinate frame of a start pose to the world frame."""
    return body_to_world(poses, start_pose[2]) + np.array(start_pose)


def _list_waypoints(settings: ReferenceSettings) -> tuple[tuple[float, ...], ...]:
    """Return the poses to visit on all laps. Laps after the first begin at the second waypoint."""
    is_random = settings.shape == "random"
    waypoints = _draw_waypoints(settings) if is_random else settings.waypoints
    return waypoints[:1] + waypoints[1:] * settings.laps


def _draw_waypoints(settings: ReferenceSettings) -> tuple[tuple[float, ...], ...]:
    """Return random poses, uniformly distributed. Consecutive headings differ by at most pi."""
    half_range = np.array([settings.length_m / 2, settings.width_m / 2, np.pi])
    random = np.random.default_rng(settings.seed)
    poses = random.uniform(-half_range, half_range, (settings.waypoint_count, 3))
    poses[:, 2] = np.unwrap(poses[:, 2])
    return tuple(map(tuple, poses.tolist()))
