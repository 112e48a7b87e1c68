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

**Repeats.** A camera may be frozen. What it shows is believed, as that of a robot that stands, unless that one was
faster before than any wheels could brake away in a frame (friction 1). Where it ends, that image counts as being as old
as it is.

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
BLOW = 2.0  # times its own speed, that a robot may have after a blow
FALSE_ALARM = 1e-9  # of noise alone, in an image
BRAKING_M_S2 = 9.81  # that no wheels exceed
DOUBTED = 10  # images in a row, of which the last is believed


def of_noise(chance: float) -> float:
    """How far noise alone leads two images apart with this chance, in its standard deviations."""
    return 2 * math.sqrt(-math.log(chance))


NOISE = of_noise(FALSE_ALARM)


class Gate:
    """What may be believed of the images of n robots.

    Args:
        noise: standard deviation of what vision reports, (n, 3), m and rad.
        limits: of what each of them may be commanded; blows of others are of `OTHERS` at least.
        period: length of a frame, s.
    """

    def __init__(self, noise: Array, limits: Sequence[MotionLimits], period: float) -> None:
        n = len(noise)
        self._period, self._noise = period, NOISE * noise[:, 0]
        speed, turn_rate = np.maximum(OTHERS, [[limit.speed, limit.turn_rate] for limit in limits]).T
        self._speed, self._turn_rate = BLOW * speed, turn_rate
        self._shown, self._believed = np.full((2, n, 3), np.nan)  # the last image, and the last that was believed
        self._age, self._since = np.zeros((2, n))  # of that, s: when it came, and for how long it has been the last
        self._elsewhere, self._backwards, self._frozen, self._no_age = np.zeros((4, n))  # images in a row
        self._pace, self._braked = np.zeros(n), BRAKING_M_S2 * period  # m/s: before the last image, and lost in a frame

    def __call__(self, measured: Array, age: Array | None = None) -> Array:
        """Return poses (n, 3) to believe, headings in (-pi, pi]; not a number where there is none.

        Args:
            measured: poses seen (n, 3), not a number where a robot was not seen.
            age: for how long robots had been where they were seen, (n,) s. [none]
        """
        moved = measured - self._believed
        self._since += self._period
        age = self._no_age if age is None else age
        between = self._since + np.abs(age - self._age)  # at least a frame, whatever cameras' clocks say
        x, y, turned = moved.T
        distance, allowed = np.hypot(x, y), self._speed * between + self._noise
        usual = (distance > 0) & (distance <= allowed) & (np.abs(turned) < np.pi / 2)
        if np.count_nonzero(usual) == len(usual):
            self._elsewhere[:] = self._backwards[:] = self._frozen[:] = self._since[:] = 0.0
            self._pace = distance / between
            self._shown = self._believed = measured.copy()
            self._age = age
            return measured
        return self._judged(measured, age, between, moved, distance, distance > allowed)

    def _judged(self, measured: Array, age: Array, between: Array, moved: Array, distance: Array, away: Flags) -> Array:
        """See `__call__`; `between` images (n,) s, they have `moved` (n, 3), a `distance` (n,), some too far `away`."""
        repeated, new = (measured == self._shown).all(1), ~np.isnan(measured[:, 0])
        far = new & away
        self._elsewhere = np.where(new, np.where(far, self._elsewhere + 1, 0.0), self._elsewhere)
        found = self._elsewhere >= DOUBTED
        self._elsewhere[found] = 0.0
        later = self._since - (age - self._age) > self._period / 2  # and not the same one, told once more
        stopped = repeated & later & (self._pace > self._braked)
        self._frozen = np.where(new, np.where(stopped, self._frozen + 1, 0.0), self._frozen)
        taken = new & (~far | found) & ((self._frozen == 0) | (self._frozen >= DOUBTED))

        turned = np.abs(wrap_angle(moved[:, 2])) > np.pi / 2
        back = taken & ~far & turned & (self._turn_rate * between < np.pi / 2)
        self._backwards = np.where(taken, np.where(back, self._backwards + 1, 0.0), self._backwards)
        back &= self._backwards < DOUBTED

        believed = np.where(taken[:, None], measured, np.nan)
        believed[back, 2] = wrap_angle(believed[back, 2] + np.pi)
        self._shown = np.where(new[:, None], measured, self._shown)
        self._believed = np.where(taken[:, None], believed, self._believed)
        fresh = taken & ~repeated
        self._pace = np.where(fresh, distance / between, self._pace)
        self._age, self._since = np.where(fresh, age, self._age), np.where(fresh, 0.0, self._since)
        return believed
