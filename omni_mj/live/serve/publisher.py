"""Simulated time against ours, and packets that `serve` sends when they are due: detections and the geometry."""

import math
import time
from collections import Counter, deque

from omni_mj.live.serve.cameras import Image
from omni_mj.live.serve.pitch import Pitch
from omni_mj.live.sockets import Address, reason, sender
from omni_mj.live.wire.vision_pb2 import Detection, VisionPacket
from omni_mj.scenarios.settings import CYCLE_RATE_HZ

GEOMETRY_CYCLES = CYCLE_RATE_HZ  # from one packet of the geometry to the next
EARLY_S = 1e-9  # by which rounding may have a packet leave

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


class Publisher:
    """Sends vision to one address.

    Args:
        pitch: The robots and cameras.
        to: Where it is sent.
        interface: Address of the network interface.
        pace: When cycles are due.

    Attributes:
        to: As given.
        counts: Of packets.
        lateness: Of the last detections, s of our time after they were due.

    Raises:
        OmniError: There is no such interface.
    """

    def __init__(self, pitch: Pitch, to: Address, interface: str, pace: Pace) -> None:
        self._pitch, self.to, self._pace = pitch, to, pace
        self._socket = sender(interface)
        self.counts, self.lateness = Counter[str](), deque[float](maxlen=10_000)
        self._outbox: list[Image] = []
        self._newest: dict[int, bytes] = {}  # camera -> packet
        self._geometry_due = 0

    @property
    def due(self) -> float:
        """Cycle before which something must be sent or an image taken."""
        sending = math.ceil(self._outbox[0].sent_s * CYCLE_RATE_HZ - 1e-6) if self._outbox else math.inf
        return min(sending, self._pitch.next_image)

    def update(self) -> list[Detection]:
        """Take images and send what is due. Return the detections that were sent."""
        for image in self._pitch.take_images():
            if math.isinf(image.sent_s):
                self.counts["packets of cameras lost"] += 1
            else:
                self._outbox.append(image)
        self._outbox.sort(key=lambda image: image.sent_s)
        detections = []
        while self._outbox and self._outbox[0].sent_s <= self._pitch.time_s + EARLY_S:
            image = self._outbox.pop(0)
            self._pitch.publish(image)
            packet = VisionPacket(detection=image.detection).SerializeToString()
            self._newest[image.detection.camera_id] = packet
            self._send(packet)
            self.lateness.append(time.monotonic() - self._pace.time_of(image.sent_s * CYCLE_RATE_HZ))
            detections.append(image.detection)
        if self._pitch.cycle >= self._geometry_due:
            self.send_geometry()
        return detections

    def repeat(self) -> None:
        """Send the geometry and the last detection of each camera once more."""
        self.send_geometry()
        for packet in self._newest.values():
            self._send(packet)

    def send_geometry(self) -> None:
        """Send the geometry now, and again after a second of simulated time."""
        self._geometry_due = self._pitch.cycle + GEOMETRY_CYCLES
        self._send(VisionPacket(geometry=self._pitch.geometry()).SerializeToString())

    def close(self) -> None:
        """Free the port."""
        self._socket.close()

    def _send(self, packet: bytes) -> None:
        try:
            self._socket.sendto(packet, self.to)
            self.counts["vision packets sent"] += 1
        except OSError as error:
            self._pitch.notes.add("vision not sent", f"cannot send to {self.to}: {reason(error)}")
