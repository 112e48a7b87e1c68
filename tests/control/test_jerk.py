"""Laws of references with a limit of jerk: kept everywhere, and hardly slower than the fastest there is."""

import math
from dataclasses import replace

import numpy as np
import pytest
from benches.control import Array, OmniError
from hypothesis import given
from hypothesis import strategies as st
from laws import FEW, LAW
from routes import T, paths, poses
from ruckig import InputParameter, Ruckig, Trajectory

from omni_control import CURVES, CurveReference, IteratedReference, MotionLimits, TimedReference

jerks = st.floats(2, 200)
limits = st.builds(
    MotionLimits,
    st.floats(0.3, 4),
    st.floats(0.3, 6),
    st.floats(1, 10),
    st.floats(3, 40),
    st.none() | st.floats(0.3, 6),
    jerks,
    st.none() | st.floats(20, 2000),
)
curves = st.builds(lambda name, *size: CURVES[name](*size), st.sampled_from(list(CURVES)), *[st.floats(0.5, 6)] * 2)


def assert_keeps(poses: Array, limit: MotionLimits) -> None:
    """First, second and third differences of poses (frames, 3), rest before and after them, are within the limits."""
    velocity = np.pad(np.diff(poses, axis=0) / T, ((2, 2), (0, 0)))
    acceleration = np.diff(velocity, axis=0) / T
    jerk = np.diff(acceleration, axis=0) / T
    body = (acceleration[:, 0] + 1j * acceleration[:, 1]) * np.exp(-1j * np.pad(poses[:, 2], 1, mode="edge"))
    side = limit.side_acceleration or limit.acceleration
    # Third differences of poses of size 10 round at 1e-15 / T^3 = 2e-10, against 2 m/s^3.
    assert np.hypot(velocity[:, 0], velocity[:, 1]).max() <= limit.speed * (1 + 1e-8)
    assert np.hypot(body.real / limit.acceleration, body.imag / side).max() <= 1 + 1e-8
    assert np.hypot(jerk[:, 0], jerk[:, 1]).max() <= (limit.jerk or np.inf) * (1 + 1e-8)
    turn_limits = limit.turn_rate, limit.turn_acceleration, limit.turn_jerk or np.inf
    for turn, most in zip((velocity, acceleration, jerk), turn_limits, strict=True):
        assert np.abs(turn[:, 2]).max() <= most * (1 + 1e-8)


# --- way-points ---


@LAW
@given(paths, limits, st.integers(0, 3))
def test_a_way_keeps_all_limits(path: list[tuple[float, ...]], limit: MotionLimits, dwell: int) -> None:
    """At way-points as well, where one leg's jerk ends and the next one's begins; turning or not."""
    assert_keeps(TimedReference(path, limit, T, dwell).poses, limit)


def duration(distances: list[float], speeds: list[float], accelerations: list[float], jerks: list[float]) -> float:
    """The least time, s, from rest to rest along axes that do not wait for each other, by ruckig."""
    given, found = InputParameter(len(distances)), Trajectory(len(distances))
    given.target_position = distances
    given.max_velocity, given.max_acceleration, given.max_jerk = speeds, accelerations, jerks
    Ruckig(len(distances)).calculate(given, found)
    return float(found.duration)


@LAW
@given(poses, poses, limits, st.floats(20, 2000))
def test_a_leg_takes_ruckigs_time(
    start: tuple[float, ...], end: tuple[float, ...], limit: MotionLimits, turn_jerk: float
) -> None:
    """Along a straight line vectors are numbers, and so a leg is one axis, its heading another that has to be there."""
    limit = replace(limit, turn_jerk=turn_jerk, side_acceleration=None)
    distance, turn = math.dist(start[:2], end[:2]), abs(end[2] - start[2])
    fastest = duration(
        [distance, turn],
        [limit.speed, limit.turn_rate],
        [limit.acceleration, limit.turn_acceleration],
        [limit.jerk or 0, turn_jerk],
    )
    frames = TimedReference([start, end], limit, T).frames - 1
    # Never less, but for the snap. Three lengths are rounded up to whole frames, each by less than one, and not all
    # three are as unlucky: up to 2.2 were found in 300 legs. Without a way to go, no frame is spent.
    assert fastest / T - 1e-3 <= frames <= fastest / T + 3


# --- curves ---


@FEW
@given(curves, limits, st.integers(1, 3), st.booleans())
def test_a_curve_keeps_all_limits(curve: object, limit: MotionLimits, laps: int, tangent: bool) -> None:
    """Along and across the path, with the ellipse and without, facing ahead or along it."""
    assert_keeps(CurveReference(curve, limit, T, laps, tangent).poses, limit)  # type: ignore[arg-type]


# --- what cannot be ---


def test_who_plans_anew_refuses_a_limit_of_jerk() -> None:
    for limit in (MotionLimits(jerk=5.0), MotionLimits(turn_jerk=5.0)):
        with pytest.raises(OmniError, match="cannot limit jerk"):
            IteratedReference([[0, 0, 0], [1, 0, 0]], limit, T, n=1)
