"""How far a robot does what is asked of it, and how much its commands then show: for single numbers and arrays alike.

Loops over robots that are compiled (`by_robot`) reckon with these laws too.
"""

from typing import Any

import numpy as np

from omni_control.kinematics import Number

Truth = Any  # a bool, or an array of bools

ACCELERATION_M_S2 = 0.35  # standard deviation of what the law does not know of v'
UNKNOWN_SHARE = 0.3  # same, of the acceleration that it asks for; all of it where wheels slide
NOISE_FRAMES, ROUGHEST = 60.0, 25.0  # over which the noise of vision is averaged; of a frame, relative
SURPRISE_FRAMES, LARGEST = 10, 50.0  # over which it is averaged; of a frame
MOST_SURPRISED = 30.0
BRAKING_M_S2 = 9.81  # that no wheels exceed
SURPRISING = 1.5  # from which on parameters count on less
SPREAD_FRAMES = 0.5, 2.0  # of latencies, over which the change of commands is taken
EVIDENT_M_S = 0.1  # below it a robot may be held by dry friction and shows nothing of its parameters
SLIDING_FRAMES = 8  # over which accelerations asked for and missing are averaged
ASKED_M_S2, MISSING_M_S2, MISSING_SHARE = 1.0, 0.5, 0.3  # of them, from which on wheels are taken to slide
IDLE_SHARE = 0.7  # of what is asked, acceleration and speed: a robot without it obeys nothing
BEGINS_FRAMES = 4.0  # in which that is believed
PASSES_S, SHRINKS = 1.03, 4.0  # how long it may last, and by how much faster than it grew that time shrinks


def evident(speed: Number) -> Number:
    """How much a robot that drives at a speed, m/s, shows of its parameters: 0 nothing, 1 all."""
    return np.minimum(speed / EVIDENT_M_S, 1.0) ** 2


def obeys(shown: Number, sliding: Number, surprise: Number) -> Number:
    """How much of what is `shown` counts, of a robot that slides so far and surprises so much."""
    return shown * (1 - sliding) * np.minimum(SURPRISING / surprise, 1.0) ** 2


def learned(sliding: Number, surprise: Number) -> Number:
    """How much of what headings show is learned, of a robot that slides so far and surprises so much.

    In proportion to the inverse of that mean square and not of its square, as what a robot turns by is told by nothing
    else: one whose alpha is far from what is believed surprises until it is learned.
    """
    return (1 - sliding) * np.minimum(SURPRISING / surprise, 1.0)


def surprised(surprise: Number, now: Number) -> Number:
    """The mean square of innovations over what was expected, with that of `now`."""
    return surprise + (np.minimum(now, LARGEST) - surprise) / SURPRISE_FRAMES


def carried(surprise: Number, far: Number, period: float) -> Truth:
    """Whether a robot was put where it is seen, `far` from where it was expected, m: by what is no motion.

    Noise does that once in e^50 images, and wheels lead less far in a frame. Nor does a blow of less than 1 m/s.
    """
    return (surprise > LARGEST) & (far > BRAKING_M_S2 * period**2)


def restless(surprise: Number) -> Number:
    """How many times more than usual states wander, by that mean."""
    return np.minimum(np.maximum(surprise, 1.0), MOST_SURPRISED)


def doubted(sliding: Number, change: Number) -> Number:
    """Standard deviation of what the law does not know of an acceleration `change`, m/s^2, over that without any."""
    return (UNKNOWN_SHARE + sliding) / ACCELERATION_M_S2 * change


def spread(variance: Number) -> Number:
    """Frames over which commands are compared, for a latency of that variance."""
    least, most = SPREAD_FRAMES
    return np.sqrt(np.minimum(np.maximum(variance, least**2), most**2))


def noisier(noise: Number, rough: Number) -> Number:
    """The change of the variance of vision's noise by that of a frame; not a number where that is none."""
    return (np.minimum(rough, ROUGHEST * noise) - noise) / NOISE_FRAMES


def lacking(lacks: Number, now: Number) -> Number:
    """The mean over a few frames of accelerations, with those of now."""
    return lacks + (now - lacks) / SLIDING_FRAMES


def slides(asked: Number, missing: Number) -> Truth:
    """Whether an acceleration that was asked for stays away, both vectors of the plane, m/s^2."""
    size, along = _asked(asked, missing)
    return along > np.maximum(MISSING_M_S2, MISSING_SHARE * size)


def idles(asked: Number, missing: Number, command: Number, seen: Number) -> Truth:
    """Whether nearly all of it stays away, and speed too: of a robot that hears nothing, is held, or is switched off.

    A weaker one, which lacks acceleration as long as it is not known to be that, is seen to drive.
    """
    size, along = _asked(asked, missing)
    stands = (seen * command.conjugate()).real <= (1 - IDLE_SHARE) * np.abs(command) ** 2
    return (along > IDLE_SHARE * size) & stands


def creeps(shown: Number, speed: Number, idle: Truth) -> Number:
    """Speed, m/s, by which a robot that shows so much shows its creep, sliding or not; none, where it obeys nothing."""
    return shown * speed * (1.0 - idle * 1.0)


def lasting(lasts: Number, now: Truth, idle: Truth, period: float) -> Number:
    """For how long it has, s; time in which a robot is idle tells nothing of what it has become, and does not count."""
    return np.maximum(lasts + (now * (1.0 + SHRINKS) - SHRINKS - (now & idle) * 1.0) * period, 0.0)


def believed(sliding: Number, now: Truth, lasts: Number, ends: float) -> Number:
    """How far wheels are believed to slide after a frame in which they seem to or not; `ends` is what is forgotten."""
    passing = now & (lasts < PASSES_S)
    return sliding + (passing - sliding) * (passing * (1 / BEGINS_FRAMES) + (1 - passing) * ends)


def _asked(asked: Number, missing: Number) -> tuple[Number, Number]:
    """The size of an acceleration that was asked for, and what is missing along it, m/s^2."""
    size = np.maximum(np.abs(asked), ASKED_M_S2)
    return size, (missing * asked.conjugate()).real / size
