"""References within the combined limits of wheels: limits kept, and as fast as these allow."""

import math
from dataclasses import replace

import numpy as np
import pytest
from benches.control import Array
from closed_loop import rotate
from hypothesis import given, settings
from hypothesis import strategies as st
from random_motion import (
    TIGERS,
    T,
    compute_drag,
    compute_loads,
    compute_peak_turn_jerk,
    limits,
    paths,
    smooth_limits,
    wheels,
)
from scipy.optimize import linprog

from omni_control import CURVES, CurveReference, MotionLimits, TimedReference, WheelLimits

# --- closed forms ---


@pytest.mark.parametrize("forward", [2.0, -1.0, 0.0])
@pytest.mark.parametrize("turn_rate", [0.0, 5.0, -5.0])
@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_rim_speeds_of_a_reference_have_a_closed_form(
    forward: float, turn_rate: float, heading: float
) -> None:
    """|v sin(azimuth) - arm w| of the fastest rim limits a straight drive that turns.

    The robot drives forward in the middle of the frame. With huge friction nothing else counts.
    """
    robot = replace(TIGERS, friction=1e6, com_height=0.0, max_rim_speed=0.5)
    poses = np.zeros((2, 3))
    poses[:, 2] = heading + T * turn_rate * np.array([-0.5, 0.5])
    poses[1, :2] = forward * T * np.array([np.cos(heading), np.sin(heading)])
    rims = forward * np.sin(robot.kinematics.azimuths) - robot.kinematics.arm * turn_rate
    expected = np.abs(rims).max() / 0.5
    assert robot.compute_peak_utilization(poses, T) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("turn_jerk", [5.0, 40.0])
def test_the_turn_jerk_limits_references_that_turn(turn_jerk: float) -> None:
    """The highest third difference of the heading is near the limit, and not above it."""
    limit = MotionLimits(9.0, 9.0, 90.0, 90.0, turn_jerk=turn_jerk)
    turn = TimedReference([(0, 0, 0), (0.1, 0, 3.0)], limit, T)
    lap = CurveReference(CURVES["circle"](2.0, 2.0), limit, T, faces_along_path=True)
    for reference, lowest in ((turn, 0.8), (lap, 0.5)):
        peak = compute_peak_turn_jerk(reference.poses)
        assert lowest * turn_jerk <= peak <= turn_jerk * (1 + 1e-6)
        half_jerk = replace(limit, turn_jerk=turn_jerk / 8)
        assert half_jerk.compute_time_scale(reference.poses, T) == pytest.approx(
            np.cbrt(8 * peak / turn_jerk), rel=1e-6
        )


# --- limits are kept ---


def assert_keeps_wheel_limits(robot: WheelLimits, poses: Array) -> None:
    """Assert it for differences of poses (frames, 3) with rest at both ends."""
    velocity = np.pad(np.diff(poses, axis=0) / T, ((1, 1), (0, 0)))
    heading = poses[:, 2]
    acceleration = rotate(np.diff(velocity, axis=0) / T, -heading)
    twist = rotate((velocity[1:] + velocity[:-1]) / 2, -heading)
    # A snap of a nm at a way-point is 4e-6 m/s^2, of at least 3 that friction gives.
    assert robot.compute_friction_utilization(acceleration, twist).max() <= 1 + 1e-5
    azimuths, arm = robot.kinematics.azimuths, robot.kinematics.arm
    rims = [-np.sin(azimuths), np.cos(azimuths), [arm] * 4]
    rim_speed = np.abs(rotate(velocity[1:-1], -(heading[1:] + heading[:-1]) / 2) @ rims)
    assert rim_speed.max(initial=0) <= robot.max_rim_speed * (1 + 1e-6)


@settings(max_examples=12)
@given(paths, limits | smooth_limits, wheels, st.integers(0, 2))
def test_a_path_keeps_wheel_limits_and_all_others(
    path: list[tuple[float, ...]], limit: MotionLimits, robot: WheelLimits, dwell: int
) -> None:
    reference = TimedReference(path, replace(limit, wheels=robot), T, dwell)
    assert_keeps_wheel_limits(robot, reference.poses)
    assert limit.compute_time_scale(reference.poses, T) <= 1 + 1e-5


@settings(max_examples=12)
@given(
    st.sampled_from(list(CURVES)), st.floats(0.7, 1), limits | smooth_limits, wheels, st.booleans()
)
def test_a_curve_keeps_wheel_limits_and_all_others(
    shape: str, length: float, limit: MotionLimits, robot: WheelLimits, faces_along_path: bool
) -> None:
    curve = CURVES[shape](length, 1.0)
    reference = CurveReference(curve, replace(limit, wheels=robot), T, 1, faces_along_path)
    assert_keeps_wheel_limits(robot, reference.poses)
    assert limit.compute_time_scale(reference.poses, T) <= 1 + 1e-8


# --- as fast as the limits allow ---


def compute_peak_rim_speed(robot: WheelLimits, poses: Array) -> float:
    """Return the highest speed of a rim, from differences of poses (frames, 3)."""
    middle = (poses[1:, 2] + poses[:-1, 2]) / 2
    twist = rotate(np.diff(poses, axis=0) / T, -middle)
    return float(robot.compute_rim_speeds(twist).max())


@pytest.mark.parametrize("max_rim_speed", [0.4, 1.0])
def test_slow_rims_are_used_up_to_their_speed(max_rim_speed: float) -> None:
    """On a path, on a curve and in place, where nothing else limits the robot."""
    robot = replace(TIGERS, max_rim_speed=max_rim_speed)
    limit = MotionLimits(3.0, 8.0, 20.0, 200.0, wheels=robot)
    references = [
        TimedReference([(0, 0, 0), (3, 1, 1)], limit, T),
        TimedReference([(0, 0, 0), (0, 0, 3)], limit, T),
        CurveReference(CURVES["circle"](2.0, 2.0), limit, T, 1, True),
        CurveReference(CURVES["figure-eight"](2.0, 1.0), limit, T, 1, False),
    ]
    for reference in references:
        peak = compute_peak_rim_speed(robot, reference.poses)
        assert 0.98 * max_rim_speed < peak <= max_rim_speed * (1 + 1e-6)


def test_reduced_limits_leave_rim_speed_for_driving_and_turning_at_once() -> None:
    """A robot drives along a rim while it turns: v + arm w is the speed of that rim."""
    robot = replace(TIGERS, max_rim_speed=1.0)
    limit = MotionLimits(2.0, 1.0, 5.0, 5.0, wheels=robot)
    reduced, arm = limit.reduce_for_wheels(), robot.kinematics.arm
    assert reduced.speed + arm * reduced.turn_rate == pytest.approx(1.0)
    assert reduced.speed / reduced.turn_rate == pytest.approx(limit.speed / limit.turn_rate)
    faster = replace(limit, wheels=replace(robot, max_rim_speed=2.0 + 5.0 * arm))
    unchanged = faster.reduce_for_wheels()
    assert (unchanged.speed, unchanged.turn_rate) == (limit.speed, limit.turn_rate)


def solve_max_sum(robot: WheelLimits, per_z: Array, twist: Array, max_z: Array) -> Array:
    """Return z (n,) with the largest sum, from 0 to `max_z`, that forces of the wheels allow.

    Args:
        robot: Limits of the wheels.
        per_z: Body accelerations [ax, ay, b] in each cell per z, (cells, 3, n).
        twist: Body twists in each cell, (cells, 3).
        max_z: Upper bounds (n,).
    """
    (cells, _, n), scale = per_z.shape, np.array([1, 1, robot.gyration_radius**2])
    (static_load, transfer), axle = compute_loads(robot), np.exp(1j * robot.kinematics.azimuths)
    grip = math.sqrt(robot.friction**2 - robot.roller_friction**2)
    rims = np.array([(1j * axle).real, (1j * axle).imag, np.full(4, robot.kinematics.arm)])
    drag = [compute_drag(robot, v) if np.abs(v).max() > 1e-9 else np.zeros(3) for v in twist]
    gained = -grip * np.einsum("wx,cxn->cwn", transfer, per_z[:, :2]).reshape(4 * cells, n)
    forces = np.kron(np.eye(cells), rims)
    result = linprog(
        np.concatenate([np.zeros(4 * cells), -np.ones(n)]),
        np.block([[sign * np.eye(4 * cells), gained] for sign in (1, -1)]),
        np.tile(grip * static_load, 2 * cells),
        np.hstack([forces, -(per_z * scale[:, None]).reshape(3 * cells, n)]),
        -np.ravel(drag),
        bounds=[(None, None)] * (4 * cells) + [(0, bound) for bound in max_z],
    )
    return result.x[4 * cells :] if result.success else np.zeros(n)


@pytest.mark.parametrize(("faces_along_path", "tolerance"), [(True, 0.006), (False, 0.015)])
def test_a_curve_takes_the_time_of_a_linear_program(
    faces_along_path: bool, tolerance: float
) -> None:
    """Forces and accelerations are linear in z = v^2; the highest z everywhere is the fastest.

    The program has cells of 1/150 lap.
    """
    eight, n = CURVES["figure-eight"](2.0, 1.0), 150
    u = np.linspace(0, 2 * np.pi, n + 1)
    middle = (u[1:] + u[:-1]) / 2

    def differentiate(at: Array, order: int) -> Array:
        return eight(at, order) @ [1, 1j]

    def compute_curvature(at: Array) -> Array:
        velocity = differentiate(at, 1)
        return (velocity.conj() * differentiate(at, 2)).imag / np.abs(velocity) ** 3

    velocity = differentiate(middle, 1)
    step, curvature = np.abs(velocity) * u[1], compute_curvature(middle)[:, None]
    curvature_slope = (np.diff(compute_curvature(u)) / step)[:, None]
    direction = np.ones(n) + 0j if faces_along_path else velocity / np.abs(velocity)
    x, y = direction.real[:, None], direction.imag[:, None]
    mean = (np.eye(n, n + 1) + np.eye(n, n + 1, 1)) / 2
    forward = np.diff(np.eye(n + 1), axis=0) / (2 * step[:, None])  # z'/2
    lateral = curvature * mean
    turning = (curvature * forward + curvature_slope * mean) * faces_along_path
    per_z = np.stack([x * forward - y * lateral, y * forward + x * lateral, turning], axis=1)
    twist = np.hstack([x, y, curvature * faces_along_path])
    max_z = np.full(n + 1, 9.0)
    max_z[[0, -1]] = 0
    z = solve_max_sum(TIGERS, per_z, twist, max_z)
    fastest = (2 * step / (np.sqrt(z[1:]) + np.sqrt(z[:-1]))).sum() / T
    limit = MotionLimits(3.0, 8.0, 20.0, 200.0, wheels=TIGERS)
    frames = CurveReference(eight, limit, T, 1, faces_along_path).frames - 1
    # The friction of the rollers' bearings changes sign where a path crosses an axle. The reference
    # takes the higher drag of neighboring cells.
    assert fastest * (1 - 0.003) <= frames <= fastest * (1 + tolerance) + 2
