"""Outlier gate for camera measurements of robot poses.

A camera may confuse two robots or read a pattern backwards. A Kalman filter treats such an error as
noise, and it corrupts the estimates. The gate compares measurements with earlier measurements, not
with the prediction of a filter. Its decision therefore does not depend on the state of any filter.

**Positions.** A robot that drives at the speed v leaves a collision with a speed of at most 2 v, if
the other object is as fast and much heavier. Two measurements at an interval t are therefore at
most 2 v t apart, plus noise. With the highest speed in the league's simulators, 3.7 m/s, this is
0.12 m per frame at 60 Hz. Two different robots are at least 0.18 m apart. Two measurements of the
same position, with standard deviation s, are more than r apart with probability
exp(-r^2 / (4 s^2)). The margin for noise is the r at which this is `FALSE_ALARM_PROBABILITY`.

**Headings.** If the heading changed by more than 90 degrees, and the robot cannot turn that far in
this time, the camera has read the pattern backwards. The gate turns the heading by 180 degrees.

**Frozen images.** A repeated measurement is accepted if the robot may be at standstill: if its
apparent speed, by motion or noise, was at most `STANDSTILL_SPEED_M_S`, and the commands since then
would have moved it by at most `FROZEN_DISTANCE_M`. Otherwise it is rejected, however often it
arrives. Only without such commands, number `REPEATS_TO_ACCEPT` is accepted, 5 s at 60 Hz: a robot
may have stopped within a frame, measured without noise. The next different measurement may be as
far away as the robot can drive in the time since the frozen measurement was captured.

**Recovery.** A robot may be carried away, and the accepted measurement may have been the wrong one.
Of measurements in a row that are too far away, number n = `OUTLIERS_TO_ACCEPT` is therefore
accepted. The same holds for headings that are not reversed exactly, or whose position has jumped.
If a fraction q of all measurements is wrong, independently of each other, a wrong one is accepted
once in 1 / ((1 - q) q^n) frames: once in 67 minutes for q = 0.3.

**Reversed for long.** Commands are sent relative to the robot's heading. A robot that was turned
around by hand therefore moves against its commands as long as its heading is corrected. It is then
believed. If it moves along its commands, its pattern or the camera is wrong: `is_reversed`.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omni_control.controllers.base import COMMAND_LIMITS
from omni_control.kinematics import Array, wrap_angle
from omni_control.reference import MotionLimits

Mask = NDArray[np.bool_]

# Highest speed and turn rate of robots in the league's simulators, m/s and rad/s.
SIMULATOR_LIMITS = COMMAND_LIMITS.speed, COMMAND_LIMITS.turn_rate
STANDSTILL_SPEED_M_S = 0.01  # apparent speed up to which a robot may be standing
COLLISION_SPEED_RATIO = 2.0  # speed after a collision over the speed before
FALSE_ALARM_PROBABILITY = 1e-9  # per measurement: noise alone exceeds the margin
OUTLIERS_TO_ACCEPT = 10  # in a row, until one is accepted
REPEATS_TO_ACCEPT = 300  # of a measurement of a robot that was moving, until one is accepted
FROZEN_DISTANCE_M = 0.05  # commanded since a measurement, beyond which it does not repeat
MOVING_SPEED_M_S = 0.1  # commanded speed that moves a robot in spite of dry friction
ARM_M = 0.08  # distance from the center to the rim of a robot, to compare turns and translations
# Largest difference of a reversal from 180 degrees, with the robot's own turn, and largest jump of
# the position with it. Beyond, the robot was carried.
MAX_REVERSAL_ERROR, MAX_REVERSAL_JUMP_M = math.radians(20), 0.03
TURNED_DISTANCE_M = 0.05  # driven against commands, after which a reversed heading is believed
# Headings in a row, and distance driven along commands with them, after which the pattern is wrong.
REVERSED_TO_FAIL, REVERSED_DISTANCE_M = 120, 0.2
# Largest distance between two measurements that noise alone explains, in standard deviations.
NOISE_MARGIN = 2 * math.sqrt(-math.log(FALSE_ALARM_PROBABILITY))


class OutlierGate:
    """Outlier gate for the measured poses of n robots.

    Args:
        noise: Standard deviation of measured poses, (n, 3), m and rad.
        limits: Command limits of each robot. Other robots may be faster: the gate assumes at least
            `SIMULATOR_LIMITS`.
        period: Length of a frame, s.

    Attributes:
        is_reversed: Robots whose heading is reported reversed while they follow their commands,
            (n,).
    """

    def __init__(self, noise: Array, limits: Sequence[MotionLimits], period: float) -> None:
        n = len(noise)
        self._period = period
        self.change_margins(noise, limits)
        self._last_measured, self._last_accepted = np.full((2, n, 3), np.nan)
        # Of the last accepted measurement: its age on arrival, s; the time since its arrival, s;
        # and the distance to the one before over the time between them, m/s.
        self._accepted_age, self._elapsed, self._apparent_speed = np.zeros((3, n))
        # Numbers of measurements in a row that were too far away, reversed, or repeated.
        self._far_count, self._reversed_count, self._repeat_count = np.zeros((3, n))
        # Commanded distance since the last fresh measurement, and distance driven along the
        # commands since the heading is reversed, m.
        self._commanded_distance, self._driven_distance = np.zeros((2, n))
        self._was_carried, self.is_reversed = np.zeros((2, n), bool)

    def change_margins(self, noise: Array, limits: Sequence[MotionLimits]) -> None:
        """Change noise and limits from now on; see the constructor."""
        own_limits = [[limit.speed, limit.turn_rate] for limit in limits]
        speed, self._max_turn_rate = np.maximum(SIMULATOR_LIMITS, own_limits).T
        self._max_speed = COLLISION_SPEED_RATIO * speed
        self._noise_margin = NOISE_MARGIN * noise[:, 0]

    def reject_outliers(self, measured_pose: Array, age: Array, displacement: Array) -> Array:
        """Return the accepted poses (n, 3), headings in (-pi, pi]; NaN for rejected ones.

        Args:
            measured_pose: Measured poses (n, 3), NaN without a measurement.
            age: Time from the capture of each measurement to this frame, (n,) s.
            displacement: Commanded displacement since the previous frame, (n, 3), m and rad.
        """
        self._elapsed = self._elapsed + self._period
        # Not below the time between the captures, nor, since the clocks of cameras may be wrong,
        # the time between the arrivals.
        interval = self._elapsed + np.abs(age - self._accepted_age)
        change = measured_pose - self._last_accepted
        distance = np.hypot(change[:, 0], change[:, 1])
        max_distance = self._max_speed * interval + self._noise_margin
        commanded = np.hypot(displacement[:, 0], displacement[:, 1])
        commanded += ARM_M * np.abs(displacement[:, 2])
        is_moved = commanded > MOVING_SPEED_M_S * self._period
        self._commanded_distance = self._commanded_distance + is_moved * commanded
        # Part of the change along the commanded displacement, m
        along = is_moved * (change * displacement)[:, :2].sum(1) / np.maximum(commanded, 1e-9)
        is_repeated = (measured_pose == self._last_measured).all(1)
        is_visible = ~np.isnan(measured_pose[:, 0])
        is_far = is_visible & (distance > max_distance)
        self._far_count = _count_in_a_row(self._far_count, is_far, is_visible)
        is_confirmed = self._far_count >= OUTLIERS_TO_ACCEPT
        self._far_count = self._far_count * ~is_confirmed
        # The image was captured after the last accepted one: it is not the same image sent again.
        is_new = self._elapsed - (age - self._accepted_age) > self._period / 2
        is_frozen = is_repeated & is_new & (self._apparent_speed > STANDSTILL_SPEED_M_S)
        self._repeat_count = _count_in_a_row(self._repeat_count, is_frozen, is_visible)
        is_frozen &= self._repeat_count < REPEATS_TO_ACCEPT
        is_frozen |= is_repeated & is_new & (self._commanded_distance > FROZEN_DISTANCE_M)
        is_accepted = is_visible & (~is_far | is_confirmed) & ~is_frozen
        turn = np.abs(wrap_angle(change[:, 2]))
        cannot_turn = self._max_turn_rate * interval < np.pi / 2
        is_reversed = is_accepted & ~is_far & (turn > np.pi / 2) & cannot_turn
        self._reversed_count = _count_in_a_row(self._reversed_count, is_reversed, is_accepted)
        # Not a product: the first change is NaN.
        driven = np.where(is_reversed, self._driven_distance + along, 0.0)
        self._driven_distance = np.where(is_accepted, driven, self._driven_distance)
        is_turned = self._driven_distance < -TURNED_DISTANCE_M
        is_jump = distance > COLLISION_SPEED_RATIO * self._apparent_speed * interval
        is_jump &= distance > MAX_REVERSAL_JUMP_M
        is_carried = is_jump | (turn < np.pi - MAX_REVERSAL_ERROR)
        # Only the first change shows it: the last accepted heading is then a corrected one.
        self._was_carried = np.where(self._reversed_count > 1, self._was_carried, is_carried)
        is_turned |= self._was_carried
        is_reversed &= ~is_turned | (self._reversed_count < OUTLIERS_TO_ACCEPT)
        self.is_reversed = is_reversed & (self._reversed_count >= REVERSED_TO_FAIL)
        self.is_reversed &= self._driven_distance > REVERSED_DISTANCE_M

        accepted = np.where(is_accepted[:, None], measured_pose, np.nan)
        accepted[is_reversed, 2] = wrap_angle(accepted[is_reversed, 2] + np.pi)
        self._last_measured = np.where(is_visible[:, None], measured_pose, self._last_measured)
        self._last_accepted = np.where(is_accepted[:, None], accepted, self._last_accepted)
        is_fresh = is_accepted & ~is_repeated
        self._apparent_speed = np.where(is_fresh, distance / interval, self._apparent_speed)
        self._accepted_age = np.where(is_fresh, age, self._accepted_age)
        self._elapsed = self._elapsed * ~is_fresh
        self._commanded_distance = self._commanded_distance * ~is_fresh
        return accepted


def _count_in_a_row(count: Array, event: Mask, is_checked: Mask) -> Array:
    """Return updated counters (n,) of successive events; robots not checked keep their count."""
    return np.where(is_checked, (count + 1) * event, count)
