"""How simulated time goes with ours: as fast, faster, slower, or not at all."""

import math

from omni_mj.scenarios.settings import CYCLE_RATE_HZ

BEHIND_S = 0.1  # of our time, by which a simulation may be late before it gives up catching up


class Pace:
    """When cycles are due.

    Args:
        speed: times as fast as real time; 0: paused.
        now: of our clock (`time.monotonic`), s, when `cycle` is due.
        cycle: the first.

    Attributes:
        lost_s: of our time, by which the simulation came to be late because the computer was too slow.
    """

    def __init__(self, speed: float, now: float, cycle: int = 0) -> None:
        self.lost_s = 0.0
        self.change(speed, now, cycle)

    def change(self, speed: float, now: float, cycle: int) -> None:
        """Go on at another speed from a cycle on."""
        self.speed, self._now, self._cycle = speed, now, cycle

    def due(self, now: float) -> int:
        """The number of the cycle that begins next, if all are done that are due."""
        return self._cycle + math.floor((now - self._now) * self.speed * CYCLE_RATE_HZ)

    def when(self, cycle: float) -> float:
        """When a cycle is due, s of our clock; never, in a pause."""
        return self._now + (cycle - self._cycle) / (self.speed * CYCLE_RATE_HZ) if self.speed else math.inf

    def slip(self, now: float, cycle: int) -> bool:
        """Give up catching up if a cycle that comes next is too late; say whether it was."""
        late = now - self.when(cycle)
        if not late > BEHIND_S:
            return False
        self.lost_s += late
        self.change(self.speed, now, cycle)
        return True
