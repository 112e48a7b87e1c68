"""The references that a scenario's settings ask for."""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from omni_control.kinematics import Array
from omni_control.reference import (
    CURVES,
    CurveReference,
    IteratedReference,
    MotionLimits,
    SampledReference,
    TimedReference,
)
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S, ControlSettings, ReferenceSettings

Where = tuple[float, float, float]
ORIGIN: Where = (0.0, 0.0, 0.0)


@lru_cache(maxsize=256)
def timed(settings: ReferenceSettings, where: Where = ORIGIN) -> SampledReference:
    """The reference that is known in advance, against which errors are measured.

    Args:
        settings: what is to be driven.
        where: pose [x, y, heading] in m and rad by which all of it is displaced.
    """
    reference = _moving(settings).after_rest(_lead_frames(settings))
    return reference if where == ORIGIN else SampledReference(displaced(reference.poses, where), PERIOD_S)


def iterated(settings: ReferenceSettings, n: int, where: Where = ORIGIN) -> IteratedReference:
    """The reference that is planned anew in every frame for `n` robots; for way-points only."""
    visits = displaced(np.array(_visits(settings)), where)
    return IteratedReference(visits.tolist(), motion_limits(settings), PERIOD_S, n, rest_frames=_lead_frames(settings))


def displaced(poses: Array, where: Where) -> Array:
    """Poses (frames, 3) as seen from `where`, in the frame that `where` is given in."""
    if where == ORIGIN:
        return poses
    x, y, heading = where
    c, s = math.cos(heading), math.sin(heading)
    rotated = np.stack([c * poses[:, 0] - s * poses[:, 1], s * poses[:, 0] + c * poses[:, 1], poses[:, 2]], axis=1)
    return rotated + np.array([x, y, heading])


def motion_limits(s: ReferenceSettings | ControlSettings) -> MotionLimits:
    """The limits that the reference keeps, or those of what may be commanded."""
    aside = s.max_side_acceleration_m_s2 or None if isinstance(s, ReferenceSettings) else None
    return MotionLimits(
        s.max_speed_m_s, s.max_acceleration_m_s2, s.max_turn_rate_rad_s, s.max_turn_acceleration_rad_s2, aside
    )


def _moving(settings: ReferenceSettings) -> SampledReference:
    limits, settle_frames = motion_limits(settings), round(settings.settle_s * FRAME_RATE_HZ)
    if settings.shape in CURVES:
        curve = CURVES[settings.shape](settings.length_m, settings.width_m)
        return CurveReference(curve, limits, PERIOD_S, settings.laps, settings.heading == "tangent", settle_frames)
    return TimedReference(_visits(settings), limits, PERIOD_S, round(settings.dwell_s * FRAME_RATE_HZ), settle_frames)


def _lead_frames(settings: ReferenceSettings) -> int:
    return round(settings.lead_s * FRAME_RATE_HZ)


def _visits(settings: ReferenceSettings) -> Sequence[Sequence[float]]:
    points = _random_waypoints(settings) if settings.shape == "random" else settings.waypoints
    return points[:1] + points[1:] * settings.laps


def _random_waypoints(settings: ReferenceSettings) -> tuple[tuple[float, ...], ...]:
    """Poses drawn uniformly; from each to the next the robot turns the shorter way."""
    half = np.array([settings.length_m / 2, settings.width_m / 2, np.pi])
    poses = np.random.default_rng(settings.seed).uniform(-half, half, (settings.count, 3))
    poses[:, 2] = np.unwrap(poses[:, 2])
    return tuple(map(tuple, poses.tolist()))
