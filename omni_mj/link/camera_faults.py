"""What faults do to a camera: what it shows in place of what is there, and when."""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array
from omni_mj.link.noise import Noise, Seed, Stream
from omni_mj.link.schedule import Met, Schedule
from omni_mj.scenarios.clock import PERIOD_S
from omni_mj.scenarios.faults import (
    Fault,
    VisionBias,
    VisionClock,
    VisionDelay,
    VisionFreeze,
    VisionJitter,
    VisionMirrored,
    VisionOut,
    VisionWrongId,
    span,
)


class Sight(Met):
    """What a camera shows of n robots. Biases add up; of several others taken for a robot the last counts.

    Args:
        schedule: of these kinds.
        seeds: one per robot.
    """

    kinds = VisionOut, VisionFreeze, VisionMirrored, VisionWrongId, VisionBias

    def __init__(self, schedule: Schedule, seeds: Sequence[Seed]) -> None:
        n = len(seeds)
        self._schedule = schedule
        # Drawn for each image whatever goes on, so that a fault changes nothing of another.
        self._chance = Noise(seeds, Stream.CAMERA_FAULTS, lambda rng, count: rng.random((count, 2)))
        self._out, self._frozen = np.zeros((2, n), bool)
        self._confused, self._mirrored = np.zeros((2, n))
        self._other, self._bias = np.zeros((2, n, 3))
        self._last = np.full((n, 3), np.nan)

    def look(self, pose: Array, frame: int) -> Array:
        """What there is to see in a frame, but for noise, in place of true poses (n, 3)."""
        if (active := self._schedule.until(frame)) is not None:
            for each in (self._out, self._frozen, self._confused, self._mirrored, self._bias):
                each[:] = 0
            self._out[[row for row, _ in active.of(VisionOut)]] = True
            self._frozen[[row for row, _ in active.of(VisionFreeze)]] = True
            for row, mirrored in active.of(VisionMirrored):
                self._mirrored[row] = mirrored.probability
            for row, other in active.of(VisionWrongId):
                self._confused[row] = other.probability
                self._other[row] = other.x_m, other.y_m, np.radians(other.heading_deg)
            for row, bias in active.of(VisionBias):
                self._bias[row] += bias.x_m, bias.y_m, np.radians(bias.heading_deg)
        confused, mirrored = self._chance.next().T
        shown = np.where((confused < self._confused)[:, None], self._other, pose + self._bias)
        shown[:, 2] += np.pi * (mirrored < self._mirrored)
        return shown

    def show(self, measured: Array) -> np.ndarray:
        """Write over what was measured (n, 3) of robots of which something else is shown; return which are (n,)."""
        measured[self._frozen] = self._last[self._frozen]
        known = ~np.isnan(measured[:, 0])
        self._last[known] = measured[known]
        measured[self._out] = np.nan
        return known & ~self._out


class Timing(Met):
    """When images of n robots arrive, and how old they are said to be. Errors of clocks and jitters add up.

    Args:
        schedule: of these kinds.
        seeds: one per robot.
    """

    kinds = VisionClock, VisionJitter, VisionDelay

    def __init__(self, schedule: Schedule, seeds: Sequence[Seed]) -> None:
        n = len(seeds)
        self._schedule = schedule
        self._chance = Noise(seeds, Stream.CAMERA_LATE, lambda rng, count: rng.random((count, 1)))
        self._delay, self._jitter = np.full(n, np.nan), np.zeros(n)
        self._loses, self._lost = np.zeros((2, n))

    @classmethod
    def matters(cls, faults: Sequence[Fault]) -> bool:
        """Whether any of a robot's faults does."""
        return any(isinstance(fault, cls.kinds) for fault in faults)

    def at(self, frame: int, time: float, delay: Array) -> tuple[Array, Array]:
        """Of an image that is taken in a frame, at a time in s.

        Args:
            frame: number.
            time: from the start of the run, s.
            delay: until the image arrives otherwise, (n,) s.

        Returns:
            Until it arrives, and how much older than it is it is said to be, (n,) s.
        """
        if (active := self._schedule.until(frame)) is not None:
            self._delay[:], self._jitter[:], self._loses[:], self._lost[:] = np.nan, 0.0, 0.0, 0.0
            for row, late in active.of(VisionDelay):
                self._delay[row] = late.to
            for row, jitter in active.of(VisionJitter):
                self._jitter[row] += jitter.s
            for row, clock in active.of(VisionClock):
                self._loses[row] += clock.ms_per_s / 1000
                self._lost[row] -= clock.ms_per_s / 1000 * span(clock)[0] * PERIOD_S
        usual = np.where(np.isnan(self._delay), delay, self._delay)
        return usual + self._jitter * self._chance.next()[:, 0], self._lost + self._loses * time
