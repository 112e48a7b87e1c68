"""Timed references along curves: on the curve, within the limits, and as fast as these allow."""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from benches.control import CURVES, Array, Curve, CurveReference
from hypothesis import given
from hypothesis import strategies as st
from random_motion import (
    T,
    assert_keeps,
    curves,
    limits,
    smooth_limits,
)
from scipy.integrate import quad, solve_ivp

from omni_control import MotionLimits

UNLIMITED = 1e6
shapes = st.sampled_from(list(CURVES))
sizes = st.tuples(st.floats(0.5, 6), st.floats(0.5, 6))


def drive(
    shape: str,
    size: tuple[float, float],
    limit: MotionLimits,
    laps: int = 1,
    faces_along_path: bool = False,
) -> Array:
    """Return the poses (frames, 3) of a reference along a curve."""
    return CurveReference(CURVES[shape](*size), limit, T, laps, faces_along_path).poses


# --- path ---


@given(shapes, sizes, limits, st.integers(1, 3))
def test_every_pose_is_on_the_curve(
    shape: str, size: tuple[float, float], limit: MotionLimits, laps: int
) -> None:
    """The implicit equations hold: of an ellipse, and the quartic of Gerono's lemniscate."""
    poses = drive(shape, size, limit, laps)
    x, y = 2 * poses[:, 0] / size[0], 2 * poses[:, 1] / size[1]
    equation = {"circle": x**2 + y**2 - 1, "figure-eight": y**2 - 4 * x**2 * (1 - x**2)}
    # The parameter of up to three laps rounds at 4e-15, and so do the terms.
    np.testing.assert_allclose(equation[shape], 0, rtol=0, atol=1e-13)


@given(shapes, sizes, limits, st.integers(1, 3))
def test_the_heading_follows_the_path(
    shape: str, size: tuple[float, float], limit: MotionLimits, laps: int
) -> None:
    """It is normal to the gradient of the curve's equation. A lap of a circle turns once."""
    poses = drive(shape, size, limit, laps, faces_along_path=True)
    facing = np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    x, y = 2 * poses[:, 0] / size[0], 2 * poses[:, 1] / size[1]
    gradient = {
        "circle": [x / size[0], y / size[1]],
        "figure-eight": [(8 * x**3 - 4 * x) / size[0], y / size[1]],
    }[shape]
    # As above; the gradient is at most 8 / 0.5, and where the eight crosses itself it is zero.
    np.testing.assert_allclose((np.array(gradient) * facing).sum(0), 0, rtol=0, atol=1e-12)
    assert (np.diff(poses[:, :2], axis=0) * facing.T[:-1]).sum(1).min() > 0
    assert poses[-1, 2] - poses[0, 2] == pytest.approx(
        {"circle": 2 * math.pi * laps, "figure-eight": 0}[shape], abs=1e-12
    )
    assert (drive(shape, size, limit, laps)[:, 2] == 0).all()


# --- timing ---


@given(curves, limits | smooth_limits, st.integers(1, 2), st.booleans())
def test_a_reference_keeps_its_limits(
    curve: Curve, limit: MotionLimits, laps: int, faces_along_path: bool
) -> None:
    """With the ellipse and without, facing forward or along the path, whatever limit is active."""
    assert_keeps(CurveReference(curve, limit, T, laps, faces_along_path).poses, limit)


def assert_takes(poses: Array, seconds: float, tolerance: float) -> None:
    """Assert the fastest possible time, rounded up to whole frames, and one more for the cells."""
    frames = len(poses) - 1
    assert seconds * (1 - tolerance) <= frames * T <= seconds * (1 + tolerance) + 2 * T


@given(st.floats(0.2, 3), st.floats(0.3, 4), st.floats(0.3, 6), st.integers(1, 3))
def test_a_circle_takes_the_closed_form_time(
    radius: float, speed: float, acceleration: float, laps: int
) -> None:
    """On a circle v^2 = a r sin(2 s / r) up to its limit or that of v, then v is constant."""
    end = math.asin(min(1, speed**2 / (acceleration * radius)))
    integral = quad(lambda angle: math.sin(angle) ** -0.5, 0, end)[0]
    ramp = math.sqrt(radius / acceleration) / 2 * integral
    rest = 2 * math.pi * radius * laps - 2 * radius * end / 2
    top = min(speed, math.sqrt(acceleration * radius))
    # Ramps consist of whole cells of 1/1000 lap. A ramp that ends in its first cell takes up to
    # twice its time.
    poses = drive("circle", (2 * radius, 2 * radius), MotionLimits(speed, acceleration), laps)
    assert_takes(poses, 2 * ramp + rest / top, 2e-3)


def make_geometry(shape: str, size: tuple[float, float]) -> Callable[[Array], tuple[Array, Array]]:
    """Return the function from parameters to meters per parameter and signed curvature (1/m)."""
    a, b = size[0] / 2, size[1] / 2
    m, shift = {"circle": (1, -np.pi / 2), "figure-eight": (2, 0.0)}[shape]

    def measure(u: Array) -> tuple[Array, Array]:
        x1, y1 = a * np.cos(u), m * b * np.cos(m * u + shift)
        x2, y2 = -a * np.sin(u), -m * m * b * np.sin(m * u + shift)
        return np.hypot(x1, y1), (x1 * y2 - y1 * x2) / np.hypot(x1, y1) ** 3

    return measure


@pytest.mark.parametrize(
    ("shape", "size"),
    [
        ("figure-eight", (2.0, 1.0)),
        ("figure-eight", (1.0, 3.0)),
        ("circle", (2.0, 3.0)),
    ],
)
def test_a_curve_takes_the_time_of_the_phase_plane(shape: str, size: tuple[float, float]) -> None:
    """The fastest is the lowest solution of z' = +-2 sqrt(a^2 - k^2 z^2), with curvature k.

    Solutions start from both ends and from every peak of the curvature.
    """
    acceleration = 3.0
    measure = make_geometry(shape, size)

    def steepest(u: float, z: Array) -> Array:
        meters, k = measure(np.array(u))
        return 2 * meters * np.sqrt(np.maximum(acceleration**2 - (k * z) ** 2, 0))

    def solve(start: float, end: float, z: float) -> Callable[[Array], Array]:
        sign = np.sign(end - start)
        solution = solve_ivp(
            lambda u, z: sign * steepest(u, z),
            (start, end),
            [z],
            max_step=0.1,
            rtol=1e-8,
            dense_output=True,
        )
        return lambda u: solution.sol(u)[0]

    grid = np.linspace(0, 2 * np.pi, 20001)
    curvature = np.abs(measure(grid)[1])
    peaks = [
        *([0.0] if curvature[0] > curvature[1] else []),
        *grid[1:-1][(curvature[1:-1] >= curvature[:-2]) & (curvature[1:-1] > curvature[2:])],
    ]
    forwards, backwards = [(0.0, solve(0, 2 * np.pi, 0.0))], [(2 * np.pi, solve(2 * np.pi, 0, 0.0))]
    for peak in peaks:
        top = acceleration / float(np.abs(measure(np.array(peak))[1]))
        if peak > 0:
            forwards.append((peak, solve(peak, 2 * np.pi, top)))
            backwards.append((peak, solve(peak, 0, top)))

    def slowness(u: float) -> float:
        z = [solution(u) for start, solution in forwards if u >= start]
        z += [solution(u) for start, solution in backwards if u <= start]
        return float(measure(np.array(u))[0] / math.sqrt(min(z)))

    corners = np.linspace(0, 2 * np.pi, 33)
    # Ten times finer steps and sums change the result by a fraction of 1e-6.
    fastest = sum(quad(slowness, u, v, epsrel=1e-4)[0] for u, v in pairwise(corners))
    poses = drive(shape, size, MotionLimits(UNLIMITED, acceleration))
    assert_takes(poses, fastest, 1e-3)
