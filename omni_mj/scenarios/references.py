"""The references that a scenario's settings ask for."""

from collections.abc import Sequence

import numpy as np

from omni_control.reference.curves import CURVES, CurveReference
from omni_control.reference.timed import IteratedReference, MotionLimits, SampledReference, TimedReference
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S, ReferenceSettings


def timed_reference(settings: ReferenceSettings) -> SampledReference:
    """The reference that is known in advance, against which errors are measured."""
    return _moving(settings).after_rest(_lead_frames(settings))


def _moving(settings: ReferenceSettings) -> SampledReference:
    limits, settle_frames = _limits(settings), round(settings.settle_s * FRAME_RATE_HZ)
    if settings.shape in CURVES:
        curve = CURVES[settings.shape](settings.length_m, settings.width_m)
        return CurveReference(curve, limits, PERIOD_S, settings.laps, settings.heading == "tangent", settle_frames)
    return TimedReference(_visits(settings), limits, PERIOD_S, round(settings.dwell_s * FRAME_RATE_HZ), settle_frames)


def iterated_reference(settings: ReferenceSettings, n: int) -> IteratedReference:
    """The reference that is planned anew in every frame for `n` robots; for way-points only."""
    return IteratedReference(_visits(settings), _limits(settings), PERIOD_S, n, rest_frames=_lead_frames(settings))


def _lead_frames(settings: ReferenceSettings) -> int:
    return round(settings.lead_s * FRAME_RATE_HZ)


def _limits(s: ReferenceSettings) -> MotionLimits:
    return MotionLimits(s.max_speed_m_s, s.max_acceleration_m_s2, s.max_turn_rate_rad_s, s.max_turn_acceleration_rad_s2)


def _visits(settings: ReferenceSettings) -> Sequence[Sequence[float]]:
    points: tuple[tuple[float, ...], ...]
    points = _random_waypoints(settings) if settings.shape == "random" else settings.waypoints
    return points[:1] + points[1:] * settings.laps


def _random_waypoints(settings: ReferenceSettings) -> tuple[tuple[float, ...], ...]:
    """Poses drawn uniformly; from each to the next the robot turns the shorter way."""
    half = np.array([settings.length_m / 2, settings.width_m / 2, np.pi])
    poses = np.random.default_rng(settings.seed).uniform(-half, half, (settings.count, 3))
    poses[:, 2] = np.unwrap(poses[:, 2])
    return tuple(map(tuple, poses.tolist()))
