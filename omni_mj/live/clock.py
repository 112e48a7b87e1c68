"""Matching of another computer's clock with ours, from the time stamps and arrivals of packets."""

from collections import deque

import numpy as np

BUCKET_S = 0.25  # of whose packets the one that took the shortest counts
WINDOW_S = 20.0
MIN_BUCKETS = 3  # from which on the rate is fitted; until then clocks run alike
RESTART_S = 0.5  # by which stamps go back, or ahead of the possible, if a peer was started anew
HELD_S, HELD_FOR_S = 0.02, 0.75  # if all packets for so long are so late, the peer's clock was held or changed its rate


class Clock:
    """Offset and rate between a peer's clock and ours.

    Packets take a while, but none takes less than the least delay. The fastest packets lie on a straight line,
    arrival = a + b stamp. It is fitted to the fastest packet of each quarter of a second (minimal-delay filtering, as
    in D. L. Mills, RFC 5905, section 10). The least delay itself cannot be observed, and counts as none.

    Attributes:
        restarts: How often the peer's clock began anew.
    """

    def __init__(self) -> None:
        self.restarts = 0
        self._reset()

    @property
    def rate(self) -> float:
        """Seconds of the peer's clock per second of ours."""
        return 1 / self._slope

    def ours(self, stamp: float) -> float:
        """Return our time, s, of a time of the peer's."""
        return self._arrival + self._slope * (stamp - self._stamp)

    def theirs(self, time: float) -> float:
        """Return the peer's time, s, of a time of ours."""
        return self._stamp + (time - self._arrival) / self._slope

    def add(self, stamp: float, arrival: float) -> bool:
        """Add a packet, s of each clock. Return whether the peer's clock began anew."""
        packets = self._packets
        restarted = bool(packets) and (stamp < packets[-1][0] - RESTART_S or self.ours(stamp) - arrival > RESTART_S)
        if restarted:
            self.restarts += 1
            self._reset()
            packets = self._packets
        if not packets:
            self._stamp, self._arrival = stamp, arrival
        elif arrival // BUCKET_S > packets[-1][1] // BUCKET_S:
            self._fit()
        self._packets.append((stamp, arrival))
        while arrival - self._packets[0][1] > WINDOW_S:
            self._packets.popleft()
        self._arrival -= max(self.ours(stamp) - arrival, 0.0)  # faster than any before
        return restarted

    def _reset(self) -> None:
        self._packets = deque[tuple[float, float]]()
        self._slope, self._stamp, self._arrival = 1.0, 0.0, 0.0

    def _fit(self) -> None:
        packets = np.array(self._packets)
        recent = packets[packets[:, 1] > packets[-1, 1] - HELD_FOR_S]
        if len(recent) < len(packets) and (recent[:, 1] - self.ours(recent[:, 0]) > HELD_S).all():
            packets = recent
            self._packets = deque(map(tuple, recent.tolist()))
        starts = np.unique(packets[:, 1] // BUCKET_S, return_index=True)[1]
        buckets = np.split(packets, starts[1:])
        fastest = [bucket[(bucket[:, 1] - self._slope * bucket[:, 0]).argmin()] for bucket in buckets]
        stamps, arrivals = (np.array(fastest) - packets[-1]).T
        if len(fastest) >= MIN_BUCKETS and np.ptp(stamps) > 0:
            slope = float(np.polyfit(stamps, arrivals, 1)[0])
            self._slope = slope if slope > 0 else self._slope
        self._stamp = float(packets[-1, 0])
        self._arrival = float(packets[-1, 1] + (arrivals - self._slope * stamps).min())
