"""Way-points, curves and limits at random, and what all drives within limits have in common."""

import math

import numpy as np
from hypothesis import strategies as st
from scipy.optimize import linprog

from omni_control import CURVES, Kinematics, MotionLimits, WheelLimits
from omni_control.kinematics import Array

T = 1 / 60
# A leg's last frame is put on the way-point from at most so far away, a change of velocity of 1e-9
# / T
SNAP_M = 1e-9


def micro(limit: float) -> st.SearchStrategy[float]:
    """Numbers on a grid of 1e-6, so that way-points coincide or are farther apart than a reference's snap."""
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


def ellipse_share(change: Array, heading: Array, limit: MotionLimits) -> Array:
    """Return accelerations (n, 2 or 3) at headings (n,) over what the ellipse in the body's axes allows."""
    body = (change[:, 0] + 1j * change[:, 1]) * np.exp(-1j * heading)
    return np.hypot(
        body.real / limit.acceleration, body.imag / (limit.side_acceleration or limit.acceleration)
    )


def assert_keeps(poses: Array, limit: MotionLimits, snap: float = 0.0) -> None:
    """Differences of poses (frames, 3), with rest before and after them, are within the limits."""
    velocity = np.pad(np.diff(poses, axis=0) / T, ((2, 2), (0, 0)))
    acceleration = np.diff(velocity, axis=0) / T
    jerk = np.diff(acceleration, axis=0) / T
    # Third differences of poses of size 10 round at 1e-15 / T^3 = 2e-10, against 2 m/s^3.
    close, steps = 1 + 1e-8, snap / T ** np.arange(1, 3)
    assert np.hypot(velocity[:, 0], velocity[:, 1]).max() <= limit.speed * close + 2 * steps[0]
    assert np.abs(velocity[:, 2]).max() <= limit.turn_rate * close + 2 * steps[0]
    lowest = min(limit.acceleration, limit.side_acceleration or limit.acceleration)
    share = ellipse_share(acceleration, np.pad(poses[:, 2], 1, mode="edge"), limit)
    assert share.max() <= close + 4 * steps[1] / lowest
    assert np.abs(acceleration[:, 2]).max() <= limit.turn_acceleration * close + 4 * steps[1]
    assert np.hypot(jerk[:, 0], jerk[:, 1]).max() <= (limit.jerk or np.inf) * close
    assert np.abs(jerk[:, 2]).max() <= (limit.turn_jerk or np.inf) * close


def fastest_time(distance: float, speed: float, acceleration: float) -> float:
    """Return the duration of the triangular or trapezoidal velocity profile from rest to rest, s."""
    if distance <= speed**2 / acceleration:
        return 2 * math.sqrt(distance / acceleration)
    return distance / speed + speed / acceleration


G, RADIUS = 9.81, 0.0285
AZIMUTHS = (60.0, 135.0, 225.0, 300.0)
# Wheels at most 15 deg from these azimuths: they stand around the centre. On the worst carpet drag
# takes 2/3 of it.
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
)
vectors = st.tuples(*[st.floats(-1, 1).filter(lambda x: abs(x) > 1e-3)] * 2, st.floats(-20, 20))
TIGERS = WheelLimits(
    Kinematics(np.radians(AZIMUTHS), 0.083, RADIUS), 0.45, 0.0695, 0.045, 0.045, 0.09
)  # v2016


def get_axles(robot: WheelLimits) -> Array:
    """Return unit vectors (wheels, 2) from the centre to the wheels, which are their axles too."""
    azimuths = robot.kinematics.azimuths
    return np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1)


def compute_loads(robot: WheelLimits) -> tuple[Array, Array]:
    """Loads at rest (wheels,) and what accelerations [ax, ay] add to them (wheels, 2), per mass: four springs."""
    balance = np.column_stack([np.ones(4), robot.kinematics.arm * get_axles(robot)])
    loads = np.linalg.pinv(balance).T @ np.diag([G, -robot.centre_height, -robot.centre_height])
    return loads[:, 0], loads[:, 1:]


def compute_drag(robot: WheelLimits, travel: Array) -> Array:
    """Force [x, y] and moment per mass on a body that travels at a twist, wheel by wheel."""
    axle, load = get_axles(robot), compute_loads(robot)[0][:, None]
    arm = robot.kinematics.arm * axle
    v = travel[:2] + travel[2] * np.column_stack([-arm[:, 1], arm[:, 0]])
    across = np.sign((v * axle).sum(axis=1, keepdims=True))
    push = -load * (
        robot.carpet_drag * v / np.linalg.norm(v, axis=1, keepdims=True)
        + robot.roller_friction * across * axle
    )
    return np.append(push.sum(0), (arm[:, 0] * push[:, 1] - arm[:, 1] * push[:, 0]).sum())


def solve_max_scale(robot: WheelLimits, asked: Array, travel: Array) -> float:
    """How many times accelerations [ax, ay, b] can be had at best: forces of the rims, by a linear program."""
    standing, shifting = compute_loads(robot)
    grip = math.sqrt(robot.friction**2 - robot.roller_friction**2)
    q = asked * [1, 1, robot.gyration_radius**2]
    x, y = get_axles(robot).T
    gives = np.array([-y, x, np.full(4, robot.kinematics.arm)])
    shifts = -grip * (shifting @ q[:2])[:, None]
    found = linprog(
        [0, 0, 0, 0, -1],
        np.vstack([np.hstack([sign * np.eye(4), shifts]) for sign in (1, -1)]),
        np.tile(grip * standing, 2),
        np.hstack([gives, -q[:, None]]),
        -compute_drag(robot, travel),
        bounds=(None, None),
    )
    return float(found.x[-1])
