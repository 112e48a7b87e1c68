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
DOUBTED = 10  # images in a row, of which the last is believed
REPEATED = 300  # same, of a robot that cannot have stopped like that

# What is known of each robot: how fast it may go, m/s, and how far noise leads, m; of the last image that was believed
# its age when it came and for how long it has been the last, s; speed before the last image, m/s; images in a row.
SPEED, NOISY, AGE, SINCE, PACE, ELSEWHERE, BACKWARDS, FROZEN = range(8)
SHOWN, BELIEVED = range(2)  # the last image, and the last that was believed


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

    Attributes:
        known: of robots, (8, n).
        images: (2, n, 3).
    """

    def __init__(self, noise: Array, limits: Sequence[MotionLimits], period: float) -> None:
        n = len(noise)
        self._period, self._no_age = period, np.zeros(n)
        self.known, self.images = np.zeros((8, n)), np.full((2, n, 3), np.nan)
        speed, self._turn_rate = np.maximum(OTHERS, [[limit.speed, limit.turn_rate] for limit in limits]).T
        self.known[SPEED], self.known[NOISY] = BLOW * speed, NOISE * noise[:, 0]

    def __call__(self, measured: Array, age: Array | None = None) -> Array:
        """Return poses (n, 3) to believe, headings in (-pi, pi]; not a number where there is none.

        Args:
            measured: poses seen (n, 3), not a number where a robot was not seen.
            age: for how long robots had been where they were seen, (n,) s. [none]
        """
        k, moved = self.known, measured - self.images[BELIEVED]
        k[SINCE] += self._period
        age = self._no_age if age is None else age
        between = k[SINCE] + np.abs(age - k[AGE])  # at least a frame, whatever cameras' clocks say
        x, y, turned = moved.T
        distance, allowed = np.hypot(x, y), k[SPEED] * between + k[NOISY]
        fits = (distance > 0) & (distance <= allowed) & (np.abs(turned) < np.pi / 2)
        if np.count_nonzero(fits) == len(fits):
            k[SINCE], k[ELSEWHERE:] = 0.0, 0.0
            k[PACE], k[AGE], self.images[:] = distance / between, age, measured
            return measured
        return self._judged(measured, age, between, moved, distance, distance > allowed)

    def _judged(self, measured: Array, age: Array, between: Array, moved: Array, distance: Array, away: Flags) -> Array:
        """See `__call__`; `between` images (n,) s, they have `moved` (n, 3), a `distance` (n,), some too far `away`."""
        k, (shown, last) = self.known, self.images
        repeated, new = (measured == shown).all(1), ~np.isnan(measured[:, 0])
        far = new & away
        k[ELSEWHERE] = np.where(new, np.where(far, k[ELSEWHERE] + 1, 0.0), k[ELSEWHERE])
        found = k[ELSEWHERE] >= DOUBTED
        k[ELSEWHERE, found] = 0.0
        later = k[SINCE] - (age - k[AGE]) > self._period / 2  # and not the same one, told once more
        stopped = repeated & later & (k[PACE] > STILL_M_S)
        k[FROZEN] = np.where(new, np.where(stopped, k[FROZEN] + 1, 0.0), k[FROZEN])
        taken = new & (~far | found) & ((k[FROZEN] == 0) | (k[FROZEN] >= REPEATED))

        turned = np.abs(wrap_angle(moved[:, 2])) > np.pi / 2
        back = taken & ~far & turned & (self._turn_rate * between < np.pi / 2)
        k[BACKWARDS] = np.where(taken, np.where(back, k[BACKWARDS] + 1, 0.0), k[BACKWARDS])
        back &= k[BACKWARDS] < DOUBTED

        believed = np.where(taken[:, None], measured, np.nan)
        believed[back, 2] = wrap_angle(believed[back, 2] + np.pi)
        np.copyto(shown, measured, where=new[:, None])
        np.copyto(last, believed, where=taken[:, None])
        fresh = taken & ~repeated
        k[PACE] = np.where(fresh, distance / between, k[PACE])
        k[AGE], k[SINCE] = np.where(fresh, age, k[AGE]), np.where(fresh, 0.0, k[SINCE])
        return believed
