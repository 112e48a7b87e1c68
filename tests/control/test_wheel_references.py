"""Laws of references that stay within what wheels can do at once, and are as fast as that allows."""

import math
from dataclasses import replace

import numpy as np
import pytest
from benches.control import Array
from hypothesis import given, settings
from hypothesis import strategies as st
from random_motion import (
    TIGERS,
    T,
    compute_drag,
    compute_loads,
    limits,
    paths,
    smooth_limits,
    wheels,
)
from scipy.optimize import linprog

from omni_control import CURVES, CurveReference, MotionLimits, TimedReference, WheelLimits

# --- references within it ---


def differences(poses: Array) -> tuple[Array, Array, Array]:
    """Rims' speeds (frames, wheels) per rim, and body accelerations and mean travel (frames, 3), of sampled poses."""
    velocity = np.pad(np.diff(poses, axis=0) / T, ((1, 1), (0, 0)))
    turned = np.exp(-1j * poses[:, 2])

    def body(rows: Array, by: Array) -> Array:
        z = (rows[:, 0] + 1j * rows[:, 1]) * by
        return np.stack([z.real, z.imag, rows[:, 2]], axis=1)

    halfway = np.exp(-0.5j * (poses[1:, 2] + poses[:-1, 2]))
    rolling = body(velocity[1:-1], halfway)
    return (
        rolling,
        body(np.diff(velocity, axis=0) / T, turned),
        body((velocity[1:] + velocity[:-1]) / 2, turned),
    )


def assert_within(robot: WheelLimits, poses: Array) -> None:
    rolling, asked, travel = differences(poses)
    # A snap of a nm at a way-point is 4e-6 m/s^2, of 3 at least that friction gives.
    assert robot.compute_friction_utilization(asked, travel).max() <= 1 + 1e-5
    rims = rolling @ [
        -np.sin(robot.kinematics.azimuths),
        np.cos(robot.kinematics.azimuths),
        [robot.kinematics.arm] * 4,
    ]
    assert np.abs(rims).max(initial=0) <= robot.max_rim_speed * (1 + 1e-6)


@settings(max_examples=12)
@given(paths, limits | smooth_limits, wheels, st.integers(0, 2))
def test_a_way_stays_within_what_wheels_can(
    path: list[tuple[float, ...]], limit: MotionLimits, robot: WheelLimits, dwell: int
) -> None:
    """And within all other limits, of which none is given up for it."""
    reference = TimedReference(path, replace(limit, wheels=robot), T, dwell)
    assert_within(robot, reference.poses)
    assert limit.compute_time_scale(reference.poses, T) <= 1 + 1e-5


@settings(max_examples=12)
@given(
    st.sampled_from(list(CURVES)), st.floats(0.7, 1), limits | smooth_limits, wheels, st.booleans()
)
def test_a_curve_stays_within_what_wheels_can(
    shape: str, length: float, limit: MotionLimits, robot: WheelLimits, tangent: bool
) -> None:
    reference = CurveReference(
        CURVES[shape](length, 1.0), replace(limit, wheels=robot), T, 1, tangent
    )
    assert_within(robot, reference.poses)
    assert limit.compute_time_scale(reference.poses, T) <= 1 + 1e-8


# --- as fast as that allows ---


def most_along(
    robot: WheelLimits, gain: Array, offset: Array, travel: Array, top: Array, worth: Array
) -> Array:
    """What x (n,), from 0 to `top`, is worth most, if body accelerations of each cell come from forces of its wheels.

    These are [ax, ay, b] = gain (cells, 3, n) times x, plus offset (cells, 3).
    """
    cells, scale = len(gain), np.array([1, 1, robot.gyration_radius**2])
    (standing, shifting), spoke = compute_loads(robot), np.exp(1j * robot.kinematics.azimuths)
    grip = math.sqrt(robot.friction**2 - robot.roller_friction**2)
    gives = np.array([(1j * spoke).real, (1j * spoke).imag, np.full(4, robot.kinematics.arm)])
    drags = np.array(
        [compute_drag(robot, way) if np.abs(way).max() > 1e-9 else np.zeros(3) for way in travel]
    )
    n = gain.shape[-1]
    shifts = -grip * np.einsum("wx,cxn->cwn", shifting, gain[:, :2]).reshape(4 * cells, n)
    borne = np.tile(grip * (standing + offset[:, :2] @ shifting.T).ravel(), 2)
    found = linprog(
        np.concatenate([np.zeros(4 * cells), -worth]),
        np.block([[sign * np.eye(4 * cells), shifts] for sign in (1, -1)]),
        borne,
        np.hstack([np.kron(np.eye(cells), gives), -(gain * scale[:, None]).reshape(3 * cells, n)]),
        (offset * scale - drags).ravel(),
        bounds=[(None, None)] * (4 * cells) + [(0, each) for each in top],
    )
    return found.x[4 * cells :] if found.success else np.zeros(n)


@pytest.mark.parametrize(("tangent", "slower"), [(True, 0.006), (False, 0.015)])
def test_a_curve_takes_the_time_of_a_linear_program(tangent: bool, slower: float) -> None:
    """In z = v^2 forces and accelerations are linear; the most z everywhere is the least time. Cells of 1/150 lap."""
    eight, cells = CURVES["figure-eight"](2.0, 1.0), 150
    u = np.linspace(0, 2 * np.pi, cells + 1)
    middle = (u[1:] + u[:-1]) / 2

    def derivative(at: Array, order: int) -> Array:
        return eight(at, order) @ [1, 1j]

    def curvature(at: Array) -> Array:
        first = derivative(at, 1)
        return (first.conj() * derivative(at, 2)).imag / np.abs(first) ** 3

    first = derivative(middle, 1)
    step, bend, growth = np.abs(first) * u[1], curvature(middle), np.diff(curvature(u))
    ahead = np.ones(cells) + 0j if tangent else first / np.abs(first)
    mean = (np.eye(cells, cells + 1) + np.eye(cells, cells + 1, 1)) / 2
    along = np.diff(np.eye(cells + 1), axis=0) / (2 * step[:, None])  # z'/2
    across = bend[:, None] * mean
    turn = (bend[:, None] * along + (growth / step)[:, None] * mean) * tangent
    x, y = ahead.real[:, None], ahead.imag[:, None]
    gain = np.stack([x * along - y * across, y * along + x * across, turn], axis=1)
    travel = np.stack([ahead.real, ahead.imag, bend * tangent], axis=1)
    top = np.full(cells + 1, 9.0)
    top[[0, -1]] = 0
    z = most_along(TIGERS, gain, np.zeros((cells, 3)), travel, top, np.ones(cells + 1))
    fastest = (2 * step / (np.sqrt(z[1:]) + np.sqrt(z[:-1]))).sum() / T
    limit = MotionLimits(3.0, 8.0, 20.0, 200.0, wheels=TIGERS)
    frames = CurveReference(eight, limit, T, 1, tangent).frames - 1
    # What rollers' bearings drag jumps where a path crosses an axle, and is taken as the worse one
    # nearby.
    assert fastest * (1 - 0.003) <= frames <= fastest * (1 + slower) + 2
