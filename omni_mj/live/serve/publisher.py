"""Packets that `serve` sends by itself: detections when they are due, and now and then the geometry."""

import math
import time
from collections import Counter, deque

from omni_mj.live.serve.cameras import Image
from omni_mj.live.serve.pace import Pace
from omni_mj.live.serve.pitch import Pitch
from omni_mj.live.sockets import Address, reason, sender
from omni_mj.live.wire.vision_pb2 import Detection, VisionPacket
from omni_mj.scenarios.settings import CYCLE_RATE_HZ

GEOMETRY_CYCLES = CYCLE_RATE_HZ  # from one packet of the geometry to the next
EARLY_S = 1e-9  # by which rounding may have a packet leave


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
