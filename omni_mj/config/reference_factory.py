"""The references that a scenario's settings ask for."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.reference import (
    CURVES,
    CurveReference,
    IteratedReference,
    MotionLimits,
    SampledReference,
    TimedReference,
)
from omni_control.traction import GRAVITY, WheelLimits
from omni_mj.config.settings import (
    FRAME_RATE_HZ,
    PERIOD_S,
    ControlSettings,
    ReferenceSettings,
    Settings,
)

Where = tuple[float, float, float]
ORIGIN: Where = (0.0, 0.0, 0.0)


def build_timed_reference(settings: Settings, where: Where = ORIGIN) -> SampledReference:
    """Return the reference that is known in advance, against which errors are measured; equal ones are the same object.

    Args:
        settings: What is to be driven, and by what robot.
        where: Pose [x, y, heading] in m and rad by which all of it is displaced.

    Raises:
        OmniError: On a carpet as slippery as `reference.assumed_friction` says, nobody can drive it.
    """
    return _planned(settings.reference, build_reference_limits(settings), where)


def build_iterated_reference(
    settings: Settings, n: int, where: Where = ORIGIN
) -> IteratedReference:
    """The reference that is planned anew in every frame for `n` robots; for way-points only.

    Raises:
        OmniError: as `timed`.
    """
    points, rest = list_waypoints(settings.reference, where), _lead_frames(settings.reference)
    return IteratedReference(
        points.tolist(), build_reference_limits(settings), PERIOD_S, n, rest_frames=rest
    )


def list_waypoints(task: ReferenceSettings, where: Where = ORIGIN) -> Array:
    """The poses (points, 3) that a reference visits one after the other, on all its laps; of a curve none.

    Raises:
        OmniError: as `timed`.
    """
    return (
        np.zeros((0, 3))
        if task.shape in CURVES
        else displace_poses(np.array(_visits(task), float), where)
    )


def displace_poses(poses: Array, where: Where) -> Array:
    """Poses (frames, 3) as seen from `where`, in the frame that `where` is given in."""
    if where == ORIGIN:
        return poses
    x, y, heading = where
    c, s = math.cos(heading), math.sin(heading)
    rotated = np.stack(
        [c * poses[:, 0] - s * poses[:, 1], s * poses[:, 0] + c * poses[:, 1], poses[:, 2]], axis=1
    )
    return rotated + np.array([x, y, heading])


def build_motion_limits(s: ReferenceSettings | ControlSettings) -> MotionLimits:
    """The limits that the reference keeps whatever the robot, or those of what may be commanded."""
    limits = MotionLimits(
        s.max_speed_m_s,
        s.max_acceleration_m_s2,
        s.max_turn_rate_rad_s,
        s.max_turn_acceleration_rad_s2,
    )
    if isinstance(s, ControlSettings):
        return limits
    return replace(
        limits,
        side_acceleration=s.max_sideways_acceleration_m_s2 or None,
        jerk=s.max_jerk_m_s3 or None,
        turn_jerk=s.max_turn_jerk_rad_s3 or None,
    )


@lru_cache(maxsize=4096)
def build_reference_limits(settings: Settings) -> MotionLimits:
    """All limits that the reference keeps: those of its settings, and what they let the robot's wheels do at once.

    Raises:
        OmniError: on a carpet of the friction believed, the robot's wheels cannot drive it.
    """
    return replace(build_motion_limits(settings.reference), wheels=_wheels(settings))


def _wheels(settings: Settings) -> WheelLimits | None:
    """What may be asked of wheels on a carpet of the friction believed, the rest being as the robot's settings say."""
    friction, share, body = (
        settings.reference.assumed_friction,
        settings.reference.wheel_utilization,
        settings.body,
    )
    if not friction:
        return None
    try:
        return WheelLimits(
            settings.wheels.kinematics,
            share * friction,
            math.sqrt(body.yaw_inertia_kg_m2 / body.mass_kg),
            body.com_height_m,
            settings.carpet.rolling_resistance,
            settings.drivetrain.roller_friction,
            share * _rim_speed(settings),
        )
    except OmniError as error:
        raise OmniError(
            f"reference.assumed_friction = {friction:g} (0: wheels not regarded), wheel_utilization = {share:g}: {error}"
        ) from None


def _rim_speed(settings: Settings) -> float:
    """Up to where the nominal battery drives the current that a wheel's share of friction takes; at least half way."""
    motor, volts = settings.motor, settings.firmware.nominal_voltage_v
    push = (
        settings.reference.assumed_friction
        * settings.body.mass_kg
        * GRAVITY
        / len(settings.wheels.azimuths_deg)
    )
    current = motor.no_load_current_a + push * settings.wheels.radius_m / (
        motor.gear_ratio * motor.torque_constant_nm_a
    )
    back_emf = max(volts - motor.resistance_ohm * current, volts / 2)
    return back_emf / (motor.torque_constant_nm_a * motor.gear_ratio) * settings.wheels.radius_m


@lru_cache(maxsize=4096)
def _planned(task: ReferenceSettings, limits: MotionLimits, where: Where) -> SampledReference:
    settle_frames = round(task.settle_s * FRAME_RATE_HZ)
    if task.shape in CURVES:
        curve = CURVES[task.shape](task.length_m, task.width_m)
        moving: SampledReference = CurveReference(
            curve, limits, PERIOD_S, task.laps, task.heading == "tangent", settle_frames
        )
    else:
        dwell_frames = round(task.dwell_s * FRAME_RATE_HZ)
        moving = TimedReference(_visits(task), limits, PERIOD_S, dwell_frames, settle_frames)
    reference = moving.with_initial_rest(_lead_frames(task))
    return (
        reference
        if where == ORIGIN
        else SampledReference(displace_poses(reference.poses, where), PERIOD_S)
    )


def _lead_frames(settings: ReferenceSettings) -> int:
    return round(settings.initial_rest_s * FRAME_RATE_HZ)


def _visits(settings: ReferenceSettings) -> Sequence[Sequence[float]]:
    points = _random_waypoints(settings) if settings.shape == "random" else settings.waypoints
    return points[:1] + points[1:] * settings.laps


def _random_waypoints(settings: ReferenceSettings) -> tuple[tuple[float, ...], ...]:
    """Poses drawn uniformly; from each to the next the robot turns the shorter way."""
    half = np.array([settings.length_m / 2, settings.width_m / 2, np.pi])
    poses = np.random.default_rng(settings.seed).uniform(-half, half, (settings.waypoint_count, 3))
    poses[:, 2] = np.unwrap(poses[:, 2])
    return tuple(map(tuple, poses.tolist()))
