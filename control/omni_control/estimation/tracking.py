"""Where robots are in a frame, by vision of whatever age and the commands that have acted."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from omni_control.delay import CommandsInFlight, acted
from omni_control.estimation import tracking_by_robot
from omni_control.estimation.gate import Gate
from omni_control.estimation.kalman import KalmanFilter
from omni_control.estimation.late import Clock, Late
from omni_control.kinematics import Array


class Tracker:
    """The filter of vision behind its gate, and what commands have done since the frame where it is.

    Args:
        filter: of vision, at the start.
        gate: of what it is shown.
        latency: from a command to its effect, (n, 1) frames.
        period: length of a frame, s.
        compiled: see `Told`.

    Attributes:
        longest: commands that may have acted in the frame just past.
        pose, twist: at this frame, (n, 3).
        steps: those that filters made in it; none where they are at the present.
    """

    def __init__(
        self,
        filter: KalmanFilter,
        gate: Gate,
        latency: Array,
        period: float,
        compiled: Callable[[Callable[..., Any]], Callable[..., Any]] | None = None,
    ) -> None:
        self._filter, self._gate, self._latency, self._period = filter, gate, latency, period
        self._take_in = None if compiled is None else compiled(tracking_by_robot.take_in)
        self._clock = Clock(len(latency), period)
        self.longest = math.ceil(latency.max()) + 1
        self._shares = acted(latency, self.longest)  # of commands, in the frame just past
        self.pose, self.twist = filter.pose, filter.twist
        self.steps: tuple[Late, ...] = ()

    def update(self, measured: Array, age: Array | None, sent: CommandsInFlight) -> Array:
        """Take in a frame.

        Args:
            measured: poses seen by vision (n, 3), not a number where a robot was not seen.
            age: how long before this frame that was, (n,) s. [in it]
            sent: commands up to the frame before, `late.MOST_FRAMES` more of them than `longest`.

        Returns:
            What is believed of what was measured, see `Gate`.
        """
        prompt, filter = age is None and not np.count_nonzero(self._clock.behind), self._filter
        if not (prompt and self._taken_in(measured, sent)):
            measured = self._gate(measured, age)
            if not prompt:
                self._late(measured, age, sent)
                return measured
            displacement = np.add.reduce(self._shares * sent.last(self.longest)) * self._period
            filter.update(measured, displacement)
        self.pose, self.twist, self.steps = filter.pose, filter.twist, ()
        return measured

    def _taken_in(self, measured: Array, sent: CommandsInFlight) -> bool:
        """Take in a frame by the compiled loop, if there is one, and the frame is as usual; whether that was done."""
        if self._take_in is None:
            return False
        filter, gate = self._filter, self._gate
        after, commands = np.empty_like(filter.state), sent.last(self.longest)
        law = filter.axes, filter.law, self._shares, commands
        if self._take_in(gate.known, gate.images, filter.state, *law, measured, after):
            filter.take(after)
            return True
        return False

    def _late(self, measured: Array, age: Array | None, sent: CommandsInFlight) -> None:
        """Take in a frame where robots were seen a while ago, or filters are behind for that."""
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
