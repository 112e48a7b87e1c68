"""Bench of vision's end of `omni-mj drive`: packets by hand as poses, clocks and sockets."""

from collections.abc import Sequence

import numpy as np
from serve_client import RobotSeen, vision

from omni_mj.live import sockets
from omni_mj.live.sockets import Address as Address
from omni_mj.live.sockets import MessageCounter
from omni_mj.live.sockets import Receiver as Receiver
from omni_mj.live.ssl_vision import PeerClock as PeerClock
from omni_mj.live.ssl_vision import SslVision

PERIOD_S = 1 / 60
sender = sockets.open_sender


class Camera:
    """What is made of packets, one camera's or several's, that see robots of the blue team."""

    def __init__(self, *ids: int, color: str = "blue") -> None:
        self.said: list[str] = []
        self.vision = SslVision(color, MessageCounter(self.said.append))  # type: ignore[arg-type]
        self.vision.ids = list(ids)

    def see(
        self,
        frame: int,
        robots: Sequence[RobotSeen],
        *,
        camera: int = 0,
        age: float = 0.0,
        offset: float = 0.0,
        at: float | None = None,
    ) -> bool:
        """Take in a packet; whether it counts."""
        sent = offset + frame * PERIOD_S
        packet = vision(frame, robots, camera=camera, captured=sent - age, sent=sent)
        return self.vision.add(packet, frame * PERIOD_S if at is None else at, "somebody")

    def at(
        self, time: float, *expected: Sequence[float], rate: float = 1.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """What was seen at a tick of robots that are expected at these poses, and its age."""
        return self.vision.measurements(
            time, rate, np.array(expected or np.zeros((len(self.vision.ids), 3)))
        )
