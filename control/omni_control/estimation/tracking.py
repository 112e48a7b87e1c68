"""Where robots are in a frame, by vision of whatever age and the commands that have acted."""

import math

import numpy as np

from omni_control.delay import CommandsInFlight, acted
from omni_control.estimation.kalman import KalmanFilter
from omni_control.estimation.late import Clock, Late
from omni_control.kinematics import Array


class Tracker:
    """The filter of vision, and what commands have done since the frame where it is.

    Args:
        filter: of vision, at the start.
        latency: from a command to its effect, (n, 1) frames.
        period: length of a frame, s.

    Attributes:
        longest: commands that may have acted in the frame just past.
        pose, twist: at this frame, (n, 3).
        steps: those that filters made in it; none where they are at the present.
    """

    def __init__(self, filter: KalmanFilter, latency: Array, period: float) -> None:
        self._filter, self._latency, self._period = filter, latency, period
        self._clock = Clock(len(latency), period)
        self.longest = math.ceil(latency.max()) + 1
        self._shares = acted(latency, self.longest)  # of commands, in the frame just past
        self.pose, self.twist = filter.pose, filter.twist
        self.steps: tuple[Late, ...] = ()

    def update(self, measured: Array, age: Array | None, sent: CommandsInFlight) -> None:
        """Take in a frame.

        Args:
            measured: poses seen by vision (n, 3), not a number where a robot was not seen.
            age: how long before this frame that was, (n,) s. [in it]
            sent: commands up to the frame before, `late.MOST_FRAMES` more of them than `longest`.
        """
        if age is None and not np.count_nonzero(self._clock.behind):
            displacement = np.add.reduce(self._shares * sent.last(self.longest)) * self._period
            self._filter.update(measured, displacement)
            self.pose, self.twist, self.steps = self._filter.pose, self._filter.twist, ()
            return
        steps = self._clock.steps(np.zeros(len(measured)) if age is None else age, ~np.isnan(measured[:, 0]))
        for late in steps:
            behind, share = late.behind[:, None], late.after[:, None] / self._period
            displacement = self._displacement(sent, self._latency + behind)
            onward = share * self._displacement(sent, self._latency + np.maximum(behind - 1, 0.0))
            seen = measured if late is steps[-1] else np.full_like(measured, np.nan)
            self._filter.update(seen, displacement, late, onward)
        behind, drift, now = self._clock.behind[:, None], self._filter.drift, self._latency
        since = ((sent.ahead(now + behind) - sent.ahead(now)) * sent.last(sent.length)).sum(0)
        self.pose = self._filter.pose + (since + behind * drift) * self._period
        self.twist, self.steps = self._displacement(sent, now) / self._period + drift, tuple(steps)

    def _displacement(self, sent: CommandsInFlight, latency: Array) -> Array:
        """What commands should have caused (n, 3) in a frame, for a latency (n, 1) that ends with it."""
        longest = min(self.longest + math.ceil((latency - self._latency).max()), sent.length)
        return sent.of(slice(None), longest).felt(latency) * self._period
