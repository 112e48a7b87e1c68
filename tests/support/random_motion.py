"""Random way-points, curves and limits for hypothesis, and the laws that all references keep."""

import math

import numpy as np
from hypothesis import strategies as st
from scipy.optimize import linprog

from omni_control import CURVES, Kinematics, MotionLimits, WheelLimits
from omni_control.kinematics import Array

T = 1 / 60
# The last frame of a segment is moved to the way-point by at most this distance.
SNAP_M = 1e-9


def micro(limit: float) -> st.SearchStrategy[float]:
    """Return numbers on a grid of 1e-6: way-points coincide or differ by more than the snap."""
    return st.integers(-int(limit * 1e6), int(limit * 1e6)).map(lambda i: i / 1e6)


poses = st.tuples(micro(3), micro(3), micro(7))
paths = st.lists(poses, min_size=2, max_size=4)
positive = st.floats(0.3, 6)
highest = (st.floats(0.3, 4), positive, st.floats(1, 10), st.floats(3, 40), st.none() | positive)
limits = st.builds(MotionLimits, *highest)
smooth_limits = st.builds(
    MotionLimits, *highest, st.floats(2, 200), st.none() | st.floats(20, 2000)
)
curves = st.builds(
    lambda name, *size: CURVES[name](*size), st.sampled_from(list(CURVES)), *[st.floats(0.5, 6)] * 2
)


def compute_ellipse_utilization(change: Array, heading: Array, limit: MotionLimits) -> Array:
    """Return accelerations (n, 2 or 3) at headings (n,) over the ellipse in the body's axes."""
    body = (change[:, 0] + 1j * change[:, 1]) * np.exp(-1j * heading)
    side_acceleration = limit.side_acceleration or limit.acceleration
    return np.hypot(body.real / limit.acceleration, body.imag / side_acceleration)


def assert_keeps(poses: Array, limit: MotionLimits, snap: float = 0.0) -> None:
    """Assert that differences of poses (frames, 3), with rest at both ends, keep the limits."""
    velocity = np.pad(np.diff(poses, axis=0) / T, ((2, 2), (0, 0)))
    acceleration = np.diff(velocity, axis=0) / T
    jerk = np.diff(acceleration, axis=0) / T
    # Third differences of poses of size 10 round at 1e-15 / T^3 = 2e-10, against 2 m/s^3.
    close, steps = 1 + 1e-8, snap / T ** np.arange(1, 3)
    assert np.hypot(velocity[:, 0], velocity[:, 1]).max() <= limit.speed * close + 2 * steps[0]
    assert np.abs(velocity[:, 2]).max() <= limit.turn_rate * close + 2 * steps[0]
    lowest = min(limit.acceleration, limit.side_acceleration or limit.acceleration)
    utilization = compute_ellipse_utilization(
        acceleration, np.pad(poses[:, 2], 1, mode="edge"), limit
    )
    assert utilization.max() <= close + 4 * steps[1] / lowest
    assert np.abs(acceleration[:, 2]).max() <= limit.turn_acceleration * close + 4 * steps[1]
    assert np.hypot(jerk[:, 0], jerk[:, 1]).max() <= (limit.jerk or np.inf) * close
    assert np.abs(jerk[:, 2]).max() <= (limit.turn_jerk or np.inf) * close


def compute_peak_turn_jerk(poses: Array) -> float:
    """Return the highest third difference of headings, with rest at both ends, rad/s^3."""
    velocity = np.pad(np.diff(poses[:, 2]) / T, 2)
    return float(np.abs(np.diff(velocity, 2)).max() / T**2)


def compute_fastest_time(distance: float, speed: float, acceleration: float) -> float:
    """Return the duration (s) of the triangular or trapezoidal profile from rest to rest."""
    if distance <= speed**2 / acceleration:
        return 2 * math.sqrt(distance / acceleration)
    return distance / speed + speed / acceleration


G, RADIUS = 9.81, 0.0285
AZIMUTHS = (60.0, 135.0, 225.0, 300.0)
# Wheels at most 15 degrees from these azimuths stand around the center. Drag takes at most 2/3 of
# their friction.
wheels = st.builds(
    lambda shift, arm, *rest: WheelLimits(
        Kinematics(np.radians(np.add(AZIMUTHS, shift)), arm, RADIUS), *rest
    ),
    st.tuples(*[st.floats(-15, 15)] * 4),
    st.floats(0.06, 0.1),
    st.floats(0.3, 1.2),
    st.floats(0.05, 0.1),
    st.floats(0, 0.05),
    st.floats(0, 0.05),
    st.floats(0, 0.05),
    st.floats(0.5, 5),
    st.floats(-0.01, 0.01),
)
vectors = st.tuples(*[st.floats(-1, 1).filter(lambda x: abs(x) > 1e-3)] * 2, st.floats(-20, 20))
TIGERS = WheelLimits(
    Kinematics(np.radians(AZIMUTHS), 0.083, RADIUS), 0.45, 0.0695, 0.045, 0.045, 0.09
)  # v2016


def get_axles(robot: WheelLimits) -> Array:
    """Return unit vectors (wheels, 2) from the center to the wheels, which are also their axles."""
    azimuths = robot.kinematics.azimuths
    return np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1)


def get_contacts(robot: WheelLimits) -> Array:
    """Return positions (wheels, 2) of the contacts relative to the center of mass, m."""
    return robot.kinematics.arm * get_axles(robot) - [robot.com_x, 0.0]


def compute_moments(robot: WheelLimits, forces: Array) -> Array:
    """Return the moments (wheels,) of forces (wheels, 2) about the center of mass."""
    (x, y), (force_x, force_y) = get_contacts(robot).T, forces.T
    return x * force_y - y * force_x


def compute_loads(robot: WheelLimits) -> tuple[Array, Array]:
    """Return loads at rest (wheels,) and per acceleration [ax, ay] (wheels, 2), over the mass.

    The wheels are four equal springs.
    """
    balance = np.column_stack([np.ones(4), get_contacts(robot)])
    loads = np.linalg.pinv(balance).T @ np.diag([G, -robot.com_height, -robot.com_height])
    return loads[:, 0], loads[:, 1:]


def compute_drag(robot: WheelLimits, twist: Array) -> Array:
    """Return drag at a body twist, [x, y, moment] per mass, as a sum over the wheels.

    The moment is that about the center of mass.
    """
    axle, load = get_axles(robot), compute_loads(robot)[0][:, None]
    arm = robot.kinematics.arm * axle
    v = twist[:2] + twist[2] * np.column_stack([-arm[:, 1], arm[:, 0]])
    axle_sign = np.sign((v * axle).sum(axis=1, keepdims=True))
    force = -load * (
        robot.rolling_resistance * v / np.linalg.norm(v, axis=1, keepdims=True)
        + robot.roller_friction * axle_sign * axle
    )
    return np.append(force.sum(0), compute_moments(robot, force).sum())


def solve_max_scale(robot: WheelLimits, acceleration: Array, twist: Array) -> float:
    """Return the largest feasible multiple of an acceleration [ax, ay, b] at a body twist.

    A linear program finds the forces of the rims.
    """
    static_load, transfer = compute_loads(robot)
    grip = math.sqrt(robot.friction**2 - robot.roller_friction**2)
    q = acceleration * [1, 1, robot.gyration_radius**2]
    x, y = get_axles(robot).T
    rims = np.column_stack([-y, x])
    rim_matrix = np.vstack([rims.T, compute_moments(robot, rims)])
    gained = -grip * (transfer @ q[:2])[:, None]
    result = linprog(
        [0, 0, 0, 0, -1],
        np.vstack([np.hstack([sign * np.eye(4), gained]) for sign in (1, -1)]),
        np.tile(grip * static_load, 2),
        np.hstack([rim_matrix, -q[:, None]]),
        -compute_drag(robot, twist),
        bounds=(None, None),
    )
    return float(result.x[-1])
