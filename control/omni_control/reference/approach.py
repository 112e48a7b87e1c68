"""Fastest approach of a set-point within limits of speed and acceleration (section 3-A).

A point moves towards its set-point as fast as the limits allow and stops there exactly, in whole
frames. The rule needs the present velocity only, so that it also recovers from disturbances.
"""

import numpy as np

from omni_control.kinematics import Array
from omni_control.reference.motion_limits import MotionLimits


def approach_pose(
    pose: Array, twist: Array, target: Array, limits: MotionLimits, period: float
) -> Array:
    """Return the twists (n, 3) of the next frame for poses that shall stop at target poses.

    Position and heading are approached independently, each within its own limits. Braking is
    planned with the lowest limit of acceleration among the headings still to come. That limit rises
    as these become fewer, so that the plan can always be kept. It is exact for a robot that does
    not turn, and careful for one that does. The change of velocity in a frame is limited at the
    robot's heading in that frame.

    Args:
        pose: Poses (n, 3); headings count full turns.
        twist: Twists of the last frame (n, 3), world frame.
        target: Target poses (n, 3).
        limits: Limits of speed and acceleration.
        period: Length of a frame, s.
    """
    offset = target - pose
    offset_xy, velocity, heading = offset[:, :2], twist[:, :2], pose[:, 2]
    braking = limits.compute_min_acceleration(offset_xy, heading, target[:, 2])
    stopping_speed = compute_stopping_speed(_norm(offset_xy), braking, period)
    max_gain = limits.compute_max_component(offset_xy, heading) * period
    speed = np.minimum(limits.speed, stopping_speed)
    change = _compute_velocity_change(offset_xy, velocity, speed, max_gain)
    step = limits.acceleration * period
    norm = _norm(limits.to_isotropic(change, heading))
    velocity = velocity + change * (step / np.maximum(norm, step))
    turn_rate = approach_setpoint(
        offset[:, 2:], twist[:, 2:], limits.turn_rate, limits.turn_acceleration, period
    )
    return np.concatenate([velocity, turn_rate], axis=1)


def approach_setpoint(
    offset: Array, velocity: Array, speed: float, acceleration: float, period: float
) -> Array:
    """Return the velocity of the next frame for a point that shall stop at its set-point.

    Args:
        offset: Set-point minus position, (n, d) m, d = 1 or 2.
        velocity: Velocity of the last frame, (n, d) m/s.
        speed: Highest speed, m/s.
        acceleration: Highest change of velocity per second, m/s^2.
        period: Length of a frame, s.

    Returns:
        Velocities (n, d), no faster than `speed` and changed by at most `acceleration * period`.
        The change is shared between braking the part that leads past the set-point and gaining
        speed towards it; the gain counts for no more than that of one frame.
    """
    step = acceleration * period
    stopping_speed = compute_stopping_speed(_norm(offset), acceleration, period)
    change = _compute_velocity_change(offset, velocity, np.minimum(speed, stopping_speed), step)
    return velocity + change * (step / np.maximum(_norm(change), step))


def compute_stopping_speed(distance: Array, acceleration: float | Array, period: float) -> Array:
    """Return the highest speed from which a point can stop after exactly a given distance.

    A point that moves s, s - 1, s - 2, ... units of a T^2 in successive frames of length T covers
    m (m + 1) / 2 units in m frames. Between these distances the speed is linear, so that it falls
    by exactly one unit in each frame but the last.

    Args:
        distance: Distances (n, 1), at least 0, m.
        acceleration: Highest deceleration, one or (n, 1), m/s^2.
        period: Length of a frame, s.

    Returns:
        Speeds (n, 1), m/s.
    """
    unit = acceleration * period**2
    units = np.asarray(distance, float) / unit
    frames = np.floor(np.sqrt(0.25 + 2 * units) - 0.5)
    remainder = units - frames * (frames + 1) / 2
    return (frames + remainder / (frames + 1)) * unit / period


def _compute_velocity_change(
    offset: Array, velocity: Array, speed: Array, max_gain: float | Array
) -> Array:
    """Return the desired change of velocity (n, d) in a frame, before it is limited.

    Args:
        offset: Set-point minus position, (n, d) m.
        velocity: Velocity of the last frame, (n, d) m/s.
        speed: Desired speed towards the set-point, (n, 1) m/s.
        max_gain: Highest gain of that speed in a frame, m/s. It must be at least the largest change
            that the limits allow. Otherwise a robot that could stop in this frame would not, if its
            offset, and with it the direction, is a rounding error.
    """
    distance = _norm(offset)
    direction = np.divide(offset, distance, out=np.zeros_like(offset), where=distance > 0)
    closing_speed = _sum_columns(velocity * direction)
    lateral_velocity = velocity - closing_speed * direction
    return np.minimum(speed - closing_speed, max_gain) * direction - lateral_velocity


def _norm(vector: Array) -> Array:
    return np.sqrt(_sum_columns(vector * vector))


def _sum_columns(vector: Array) -> Array:
    """Return the sum of one or two columns, (n, 1); `np.sum` takes longer than all else here."""
    return vector[:, :1] + vector[:, 1:] if vector.shape[1] == 2 else vector
