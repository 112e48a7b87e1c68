"""Bench of vision's end of `omni-mj drive`: packets by hand as poses, clocks and sockets."""

from collections.abc import Sequence

import numpy as np
from serving import vision

from omni_mj.live import sockets
from omni_mj.live.cameras import VisionCamera as VisionCamera
from omni_mj.live.clock import Clock as Clock
from omni_mj.live.notes import Notes
from omni_mj.live.sockets import Address as Address
from omni_mj.live.sockets import Receiver as Receiver
from omni_mj.live.vision import Vision

PERIOD_S = 1 / 60
Robot = tuple[int, float, float, float]
sender = sockets.sender


class Camera:
    """What is made of packets, one camera's or several's, that see robots of the blue team."""

    def __init__(self, *ids: int, colour: str = "blue") -> None:
        self.said: list[str] = []
        self.notes = Notes(self.said.append)
        self.vision = Vision(colour, ids, self.notes)  # type: ignore[arg-type]

    def packet(
        self, frame: int, robots: Sequence[Robot], *, camera: int = 0, age: float = 0.0, offset: float = 0.0
    ) -> bytes:
        sent = offset + frame * PERIOD_S
        return vision(frame, robots, camera=camera, captured=sent - age, sent=sent)

    def see(self, frame: int, robots: Sequence[Robot], sender: str = "", at: float | None = None, **how: float) -> bool:
        """Take in a packet; whether it counts."""
        packet = self.packet(frame, robots, **how)  # type: ignore[arg-type]
        return self.vision.add(packet, frame * PERIOD_S if at is None else at, sender) is not None

    def at(self, time: float, twist: np.ndarray | None = None, leader: int | None = None) -> np.ndarray:
        """Poses at a tick."""
        twist = np.zeros((len(self.vision.ids), 3)) if twist is None else twist
        poses, self.seen = self.vision.at(time, PERIOD_S, twist, leader)
        return poses
