"""Which images of vision are believed: those of where a robot can be, by where it was seen before.

A camera may take another robot for this one, or read its pattern backwards. That is no noise, and a filter that takes
it for noise is led astray, with all that learns from it. The gate compares images with images, not with what a filter
expects: whatever state a filter is in, what it is shown does not depend on it.

**Places.** A robot that drives at v can be made to go at 2 v by a blow, if what hits it as fast is much heavier. Images
that are t apart are no farther from each other than 2 v t, but for the noise of both; two robots stand 0.18 m apart at
least, which at 60 images a second and the 3.7 m/s of the league's simulators is more. The noise is exceeded once in
1 / `FALSE_ALARM` images: of a plane, a distance r of two images with standard deviation s each, with exp(-r^2 / 4 s^2).

**Headings.** What looks turned by more than a right angle, in a time in which the robot cannot turn that far, is a
pattern read backwards, and is turned back.

**Repeats.** A camera may be frozen. What it shows is believed, as that of a robot that stands, unless the images
before differed by more than `STILL_M_S`, by motion or by noise. Then nothing but a robot that stops dead, seen without
any noise, shows the same to the bit: it is believed after `REPEATED` images, 5 s at 60 Hz. Where it ends, that
image counts as being as old as it is.

**Doubt ends.** Robots are carried off, and images that were believed may have been the wrong ones. What is seen in
`DOUBTED` images in a row is so. If q of all images were wrong, and each by itself, that would happen by mistake once
in 1 / ((1 - q) q^DOUBTED) images: with q = 0.3 once in 67 minutes.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omni_control.kinematics import Array, wrap_angle
from omni_control.reference import MotionLimits

Flags = NDArray[np.bool_]

OTHERS = 3.7, 26.0  # m/s and rad/s of robots in the league's simulators (ssl-simulation-setup)
STILL_M_S = 0.01  # speed between images, up to which a robot may be standing
BLOW = 2.0  # times its own speed, that a robot may have after a blow
FALSE_ALARM = 1e-9  # of noise alone, in an image
MAX_REJECTIONS = 10  # images in a row, of which the last is believed
MAX_REPEATS = 300  # same, of a robot that cannot have stopped like that

NOISE = 2 * math.sqrt(
    -math.log(FALSE_ALARM)
)  # how far noise alone leads two images apart, standard deviations


class OutlierGate:
    """What may be believed of the images of n robots.

    Args:
        noise: standard deviation of what vision reports, (n, 3), m and rad.
        limits: of what each of them may be commanded; blows of others are of `OTHERS` at least.
        period: length of a frame, s.
    """

    def __init__(self, noise: Array, limits: Sequence[MotionLimits], period: float) -> None:
        n = len(noise)
        self._period, self._no_age = period, np.zeros(n)
        speed, self._turn_rate = np.maximum(
            OTHERS, [[limit.speed, limit.turn_rate] for limit in limits]
        ).T
        self._speed, self._noise = BLOW * speed, NOISE * noise[:, 0]
        self._shown, self._believed = np.full(
            (2, n, 3), np.nan
        )  # the last image, the last that was believed
        self._age, self._since, self._pace = np.zeros(
            (3, n)
        )  # of the latter: s, how long ago it came s, speed m/s
        self._elsewhere, self._backwards, self._repeated = np.zeros((3, n))  # images in a row

    def __call__(self, measured: Array, age: Array | None = None) -> Array:
        """Return poses (n, 3) to believe, headings in (-pi, pi]; not a number where there is none.

        Args:
            measured: poses seen (n, 3), not a number where a robot was not seen.
            age: for how long robots had been where they were seen, (n,) s. [none]
        """
        age, moved = self._no_age if age is None else age, measured - self._believed
        self._since = self._since + self._period
        between = self._since + np.abs(
            age - self._age
        )  # at least a frame, whatever cameras' clocks say
        distance, allowed = np.hypot(moved[:, 0], moved[:, 1]), self._speed * between + self._noise
        fits = (distance > 0) & (distance <= allowed) & (np.abs(moved[:, 2]) < np.pi / 2)
        if np.count_nonzero(fits) == len(fits):  # nearly always: the rest takes as long as a filter
            self._shown = self._believed = measured
            self._age, self._since, self._pace = age, self._no_age, distance / between
            self._elsewhere = self._backwards = self._repeated = self._since
            return measured

        repeated, seen = (measured == self._shown).all(1), ~np.isnan(measured[:, 0])
        far = seen & (distance > allowed)
        self._elsewhere = _counted(self._elsewhere, far, seen)
        found = self._elsewhere >= MAX_REJECTIONS
        self._elsewhere = np.where(found, 0.0, self._elsewhere)
        # And not the same one, told once more
        later = self._since - (age - self._age) > self._period / 2
        self._repeated = _counted(self._repeated, repeated & later & (self._pace > STILL_M_S), seen)
        taken = seen & (~far | found) & ((self._repeated == 0) | (self._repeated >= MAX_REPEATS))
        turned = np.abs(wrap_angle(moved[:, 2])) > np.pi / 2
        back = taken & ~far & turned & (self._turn_rate * between < np.pi / 2)
        self._backwards = _counted(self._backwards, back, taken)
        back &= self._backwards < MAX_REJECTIONS

        believed = np.where(taken[:, None], measured, np.nan)
        believed[back, 2] = wrap_angle(believed[back, 2] + np.pi)
        self._shown = np.where(seen[:, None], measured, self._shown)
        self._believed = np.where(taken[:, None], believed, self._believed)
        fresh = taken & ~repeated
        self._pace = np.where(fresh, distance / between, self._pace)
        self._age, self._since = np.where(fresh, age, self._age), np.where(fresh, 0.0, self._since)
        return believed


def _counted(count: Array, event: Flags, judged: Flags) -> Array:
    """Return how often in a row (n,) an event happened, of robots that are judged now."""
    return np.where(judged, (count + 1) * event, count)
