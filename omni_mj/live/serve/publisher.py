"""What `serve` sends unasked: what cameras saw, when it is due, and now and then the geometry."""

import heapq
import math
import socket
import time
from collections import Counter, deque

from omni_mj.live.notes import Notes
from omni_mj.live.serve.cameras import Image
from omni_mj.live.serve.pace import Pace
from omni_mj.live.serve.pitch import Pitch
from omni_mj.live.sockets import Address, sender
from omni_mj.live.wire import encode
from omni_mj.live.wire.vision import Detection, VisionPacket
from omni_mj.scenarios.settings import CYCLE_RATE_HZ

GEOMETRY_CYCLES = CYCLE_RATE_HZ  # from one packet of the geometry to the next
REMEMBERED = 10_000  # sendings whose lateness is kept


class Publisher:
    """Sends to one address, from `begin` on.

    Args:
        pitch: what is seen.
        to: where it is sent.
        interface: by which.
        pace: when cycles are due.
        notes: told what cannot be sent.
        counts: of packets, counted on.

    Attributes:
        to: as given.
        lateness: of detections that were sent, s of our time after they were due.
        detections: a list to which those that are sent are added, or None.

    Raises:
        OmniError: there is no such interface.
    """

    def __init__(
        self, pitch: Pitch, to: Address, interface: str, pace: Pace, notes: Notes, counts: Counter[str]
    ) -> None:
        self._pitch, self.to, self._pace, self._notes, self._counts = pitch, to, pace, notes, counts
        self._socket: socket.socket = sender(interface)
        self._epoch: float | None = None  # in stamps, of the simulated time 0
        self.lateness = deque[float](maxlen=REMEMBERED)
        self.detections: list[Detection] | None = None
        self._outbox: list[tuple[float, int, Image]] = []
        self._images, self._newest = 0, dict[int, bytes]()
        self._geometry_due = 0
        self._geometry: bytes | None = None

    @property
    def due(self) -> int | None:
        """The cycle before which something must be sent; None if nothing waits."""
        return math.ceil(self._outbox[0][0] * CYCLE_RATE_HZ - 1e-6) if self._outbox else None

    def begin(self, epoch: float) -> None:
        """Send from now on, with stamps that say `epoch` (s) at the simulated time 0."""
        self._epoch = epoch
        self.send()

    def look(self) -> None:
        """Take the images that are due, and send what is."""
        for image in self._pitch.look():
            self._images += 1
            if math.isinf(image.sent):
                self._counts["packets of cameras lost"] += 1
            else:
                heapq.heappush(self._outbox, (image.sent, self._images, image))
        self.send()

    def send(self) -> None:
        """Send what is due."""
        if self._epoch is None:
            return
        while self._outbox and self._outbox[0][0] <= self._pitch.time_s + 1e-9:
            due, _, image = heapq.heappop(self._outbox)
            detection = self._pitch.detection(image, self._epoch)
            self._newest[image.camera] = encode(VisionPacket(detection))
            self._send(self._newest[image.camera])
            if self.detections is not None:
                self.detections.append(detection)
            self.lateness.append(time.monotonic() - self._pace.when(due * CYCLE_RATE_HZ))
        if self._pitch.cycle >= self._geometry_due:
            self._send_geometry()

    def again(self) -> None:
        """Send once more what cameras saw last, and the geometry."""
        self._send_geometry()
        for data in self._newest.values():
            self._send(data)

    def resized(self) -> None:
        """Send another geometry at the next opportunity."""
        self._geometry_due, self._geometry = self._pitch.cycle, None

    def close(self) -> None:
        """Free the port."""
        self._socket.close()

    def _send_geometry(self) -> None:
        self._geometry_due = self._pitch.cycle + GEOMETRY_CYCLES
        if self._geometry is None:
            self._geometry = encode(VisionPacket(geometry=self._pitch.geometry()))
        self._send(self._geometry)

    def _send(self, data: bytes) -> None:
        try:
            self._socket.sendto(data, self.to)
            self._counts["vision packets sent"] += 1
        except OSError as error:
            self._notes.add("vision not sent", f"cannot send to {self.to}: {error.strerror}")
