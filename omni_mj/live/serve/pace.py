"""Simulated time against ours: as fast, faster, slower, or paused."""

import math

from omni_mj.scenarios.settings import CYCLE_RATE_HZ

MAX_DELAY_S = 0.1  # of our time, by which the simulation may be late before it gives up catching up


class Pace:
    """When cycles are due.

    Args:
        speed: Simulated seconds per second; 0 pauses.

    Attributes:
        speed: As given.
        lost_s: By how much, in our time, the simulation fell behind because the computer was too slow.
    """

    def __init__(self, speed: float) -> None:
        self.lost_s = 0.0
        self.change(speed, 0.0, 0)

    def change(self, speed: float, now: float, cycle: int) -> None:
        """Go on at a speed from `cycle`, which is due at `now` (`time.monotonic`), s."""
        self.speed, self._now, self._cycle = speed, now, cycle

    def cycle_at(self, now: float) -> int:
        """Return the next cycle if all are done that are due."""
        return self._cycle + math.floor((now - self._now) * self.speed * CYCLE_RATE_HZ)

    def time_of(self, cycle: float) -> float:
        """Return when a cycle is due, s; infinity during a pause."""
        return self._now + (cycle - self._cycle) / (self.speed * CYCLE_RATE_HZ) if self.speed else math.inf

    def skip_delay(self, now: float, cycle: int) -> bool:
        """Give up catching up if the next cycle is too late. Return whether it was."""
        delay = now - self.time_of(cycle)
        if not delay > MAX_DELAY_S:
            return False
        self.lost_s += delay
        self.change(self.speed, now, cycle)
        return True
