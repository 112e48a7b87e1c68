"""Outlier gate for camera measurements of robot poses.

A camera may confuse two robots or read a pattern backwards. Such an error is not noise: a Kalman
filter that takes it for noise is corrupted, with everything that learns from it. The gate compares
measurements with earlier measurements, not with the prediction of a filter. Its decision therefore
does not depend on the state of any filter.

**Positions.** A robot that moves at speed v leaves a collision with at most 2 v, if the other
object is as fast and much heavier. Two measurements t seconds apart are therefore at most 2 v t
apart, plus noise. Two different robots are at least 0.18 m apart, which at 60 frames per second and
3.7 m/s (the league's simulators) is more than that. Two measurements of one position with standard
deviation s are more than r apart with probability exp(-r^2 / 4 s^2). The margin for noise is the r
at which this probability is `FALSE_ALARM`.

**Headings.** A heading that changed by more than 90 degrees, in a time in which the robot cannot
turn that far, is a pattern read backwards. The gate turns it by 180 degrees.

**Frozen images.** A repeated measurement is accepted as a robot at standstill, unless the apparent
speed before was above `STANDSTILL_SPEED_M_S`, by motion or by noise. Then only a robot that stops
dead, measured without any noise, could repeat a measurement bit for bit. The repeated measurement
is then rejected until it has come `MAX_REPEATS` times, 5 s at 60 Hz. The next different measurement
may be as far away as the robot can have driven since the frozen one was captured.

**Recovery.** Robots are carried away, and an accepted measurement may have been the wrong one. A
position far away is accepted when it has come `MAX_REJECTIONS` times in a row. If a fraction q of
all measurements is wrong, independently, a wrong one is accepted once in
1 / ((1 - q) q^MAX_REJECTIONS) frames: once in 67 minutes for q = 0.3.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omni_control.kinematics import Array, wrap_angle
from omni_control.reference import MotionLimits

Mask = NDArray[np.bool_]

SIMULATOR_LIMITS = 3.7, 26.0  # m/s and rad/s, robots in the league's simulators
STANDSTILL_SPEED_M_S = 0.01  # apparent speed up to which a robot may be standing
COLLISION_SPEED_RATIO = 2.0  # speed after a collision over the speed before
FALSE_ALARM = 1e-9  # probability per measurement that noise alone exceeds the margin
MAX_REJECTIONS = 10  # measurements in a row, the last of which is accepted
MAX_REPEATS = 300  # same, for a robot that cannot have stopped dead
# Distance that noise alone causes between two measurements, in standard deviations.
NOISE_MARGIN = 2 * math.sqrt(-math.log(FALSE_ALARM))


class OutlierGate:
    """Outlier gate for the measured poses of n robots.

    Args:
        noise: Standard deviation of measured poses, (n, 3), m and rad.
        limits: Command limits of each robot. Other robots may be faster: the gate assumes at least
            `SIMULATOR_LIMITS`.
        period: Length of a frame, s.
    """

    def __init__(self, noise: Array, limits: Sequence[MotionLimits], period: float) -> None:
        n = len(noise)
        self._period, self._zeros = period, np.zeros(n)
        own_limits = [[limit.speed, limit.turn_rate] for limit in limits]
        speed, self._max_turn_rate = np.maximum(SIMULATOR_LIMITS, own_limits).T
        self._max_speed = COLLISION_SPEED_RATIO * speed
        self._noise_margin = NOISE_MARGIN * noise[:, 0]
        self._last_measured, self._last_accepted = np.full((2, n, 3), np.nan)
        # Of the last accepted measurement: its age when it came (s), the time since then (s), and
        # the apparent speed that led to it (m/s).
        self._accepted_age, self._elapsed, self._apparent_speed = np.zeros((3, n))
        # Measurements in a row that were too far away, read backwards, repeated.
        self._far_count, self._reversed_count, self._repeat_count = np.zeros((3, n))

    def reject_outliers(self, measured_pose: Array, age: Array | None = None) -> Array:
        """Return the accepted poses (n, 3), headings in (-pi, pi]; NaN where there is none.

        Args:
            measured_pose: Measured poses (n, 3), NaN where a robot was not seen.
            age: Time from the capture of each measurement to this frame, (n,) s. Default: 0.
        """
        age = self._zeros if age is None else age
        self._elapsed = self._elapsed + self._period
        # At least one frame, whatever the clocks of the cameras say.
        interval = self._elapsed + np.abs(age - self._accepted_age)
        change = measured_pose - self._last_accepted
        distance = np.hypot(change[:, 0], change[:, 1])
        max_distance = self._max_speed * interval + self._noise_margin
        plausible = (distance > 0) & (distance <= max_distance) & (np.abs(change[:, 2]) < np.pi / 2)
        if np.count_nonzero(plausible) < len(plausible):
            return self._check_all(measured_pose, age, interval, change, distance > max_distance)
        # The usual case: the full check takes as long as an update of the filter.
        self._last_measured = self._last_accepted = measured_pose
        self._accepted_age, self._elapsed = age, self._zeros
        self._apparent_speed = distance / interval
        self._far_count = self._reversed_count = self._repeat_count = self._zeros
        return measured_pose

    def _check_all(
        self, measured_pose: Array, age: Array, interval: Array, change: Array, is_far: Mask
    ) -> Array:
        """Return the accepted poses (n, 3) after every check of the module's docstring.

        Args:
            measured_pose: Measured poses (n, 3), NaN where a robot was not seen.
            age: Age of the measurements, (n,) s.
            interval: Time since the capture of the last accepted measurement, (n,) s.
            change: Difference to the last accepted poses, (n, 3).
            is_far: Whether its translation is more than a robot can have moved, (n,).
        """
        is_repeated = (measured_pose == self._last_measured).all(1)
        is_visible = ~np.isnan(measured_pose[:, 0])
        is_far = is_visible & is_far
        self._far_count = _count_in_a_row(self._far_count, is_far, is_visible)
        is_confirmed = self._far_count >= MAX_REJECTIONS
        self._far_count = self._far_count * ~is_confirmed
        # A new image, not the last one sent again.
        is_new = self._elapsed - (age - self._accepted_age) > self._period / 2
        is_suspicious = is_repeated & is_new & (self._apparent_speed > STANDSTILL_SPEED_M_S)
        self._repeat_count = _count_in_a_row(self._repeat_count, is_suspicious, is_visible)
        is_live = (self._repeat_count == 0) | (self._repeat_count >= MAX_REPEATS)
        is_accepted = is_visible & (~is_far | is_confirmed) & is_live
        is_flipped = np.abs(wrap_angle(change[:, 2])) > np.pi / 2
        cannot_turn = self._max_turn_rate * interval < np.pi / 2
        is_reversed = is_accepted & ~is_far & is_flipped & cannot_turn
        self._reversed_count = _count_in_a_row(self._reversed_count, is_reversed, is_accepted)
        is_reversed &= self._reversed_count < MAX_REJECTIONS

        accepted = np.where(is_accepted[:, None], measured_pose, np.nan)
        accepted[is_reversed, 2] = wrap_angle(accepted[is_reversed, 2] + np.pi)
        self._last_measured = np.where(is_visible[:, None], measured_pose, self._last_measured)
        self._last_accepted = np.where(is_accepted[:, None], accepted, self._last_accepted)
        is_fresh = is_accepted & ~is_repeated
        distance = np.hypot(change[:, 0], change[:, 1])
        self._apparent_speed = np.where(is_fresh, distance / interval, self._apparent_speed)
        self._accepted_age = np.where(is_fresh, age, self._accepted_age)
        self._elapsed = self._elapsed * ~is_fresh
        return accepted


def _count_in_a_row(count: Array, event: Mask, is_checked: Mask) -> Array:
    """Return how often in a row (n,) an event happened to the robots that are checked now."""
    return np.where(is_checked, (count + 1) * event, count)
