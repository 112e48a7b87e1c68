"""Matching of another computer's clock with ours, from the time stamps of packets and when they arrive."""

from collections import deque

import numpy as np

BUCKET_S = 0.25  # of whose packets the one counts that took the shortest
BUCKETS = 80  # remembered: 20 s
FITTED_FROM = 3  # buckets from which on the rate is fitted; until then clocks are taken to go alike
RESTART_S = 0.5  # by which stamps go back, or ahead of what can be, when a peer was started anew
LATE_S = 0.02  # by which all packets of LATE_BUCKETS are late when the peer's clock was held, or goes at another rate
LATE_BUCKETS = 3


class Clock:
    """Offset and rate between a peer's clock and ours.

    Packets take a while, some longer, none shorter than the least; so that the least delays lie on a straight line,
    arrival = a + b stamp, on which those that were held up do not count: of each quarter of a second the one packet
    that took the shortest does (minimal-delay filtering, as in D. L. Mills, RFC 5905, section 10). The least delay
    itself cannot be known, and counts as none.

    Attributes:
        restarts: how often the peer's clock began anew.
    """

    def __init__(self) -> None:
        self.restarts = 0
        self._newest: float | None = None
        self._forget()

    @property
    def rate(self) -> float:
        """Seconds of the peer's clock per second of ours."""
        return 1 / self._slope

    def ours(self, stamp: float) -> float:
        """Our time, s, of a time of the peer's; of a packet's stamp when it arrived at the earliest."""
        return self._arrival + self._slope * (stamp - self._stamp)

    def theirs(self, time: float) -> float:
        """The peer's time, s, of a time of ours."""
        return self._stamp + (time - self._arrival) / self._slope

    def add(self, stamp: float, arrival: float) -> bool:
        """Learn that a packet with a `stamp` arrived, s of each clock; say whether the peer's clock began anew."""
        restarted = self._newest is not None and (
            stamp < self._newest - RESTART_S or self.ours(stamp) - arrival > RESTART_S
        )
        if restarted:
            self.restarts += 1
            self._forget()
        if self._newest is None:
            self._stamp, self._arrival, self._began = stamp, arrival, arrival
            self._least = stamp, arrival
        self._newest = stamp
        if arrival - self._began >= BUCKET_S:
            self._close()
            self._began, self._least = arrival, (stamp, arrival)
        elif arrival - self.ours(stamp) < self._least[1] - self.ours(self._least[0]):
            self._least = stamp, arrival
        if self.ours(stamp) > arrival:  # faster than any before
            self._arrival -= self.ours(stamp) - arrival
        return restarted

    def _forget(self) -> None:
        self._stamp = self._arrival = self._began = 0.0
        self._slope = 1.0
        self._newest = None
        self._least = 0.0, 0.0
        self._buckets: deque[tuple[float, float]] = deque(maxlen=BUCKETS)
        self._guessed = FITTED_FROM  # first buckets of which packets were chosen before the rate was known

    def _close(self) -> None:
        """End a bucket, and fit the line anew."""
        self._buckets.append(self._least)
        if len(self._buckets) == 2 * self._guessed:
            self._keep(len(self._buckets) - self._guessed)
            self._guessed = 0
        stamps, arrivals = np.array(self._buckets).T
        late = arrivals - self._arrival - self._slope * (stamps - self._stamp)
        if len(late) > LATE_BUCKETS and (late[-LATE_BUCKETS:] > LATE_S).all():
            self._keep(LATE_BUCKETS)
            self._guessed = LATE_BUCKETS
            stamps, arrivals = stamps[-LATE_BUCKETS:], arrivals[-LATE_BUCKETS:]
        x, y = stamps - stamps[-1], arrivals - arrivals[-1]
        if len(x) >= FITTED_FROM and np.ptp(x) > 0:
            slope = float(np.polyfit(x, y, 1)[0])
            self._slope = slope if slope > 0 else self._slope
        self._stamp = float(stamps[-1])
        self._arrival = float(arrivals[-1] + (y - self._slope * x).min())

    def _keep(self, newest: int) -> None:
        """Forget all buckets but the newest."""
        self._buckets = deque(list(self._buckets)[-newest:], maxlen=BUCKETS)
