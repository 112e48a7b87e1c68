"""The ticks of a live loop: frames of a camera, or 60ths of a second of our clock."""

import math
import time
from collections.abc import Callable
from typing import Literal

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config.settings import FRAME_RATE_HZ, PERIOD_S
from omni_mj.live.sockets import Receiver
from omni_mj.live.ssl_vision import Vision, VisionCamera

Pace = Literal["auto", "60", "vision"]

SILENT_S = 0.5  # without a frame, after which robots are told to stop
LOST_S = 3.0  # same, after which vision is not waited for any more
# For which frames of the other cameras are waited for after that of the leading one
GRACE_S = 0.001
# By which frames may differ from 60 per second of their own clock to give the ticks
RATE_TOLERANCE = 0.03
SETTLE_S = 0.05  # in which frames arrive that were on their way
CHECK_S = 0.05  # between checks whether to stop, while nothing comes


class Link:
    """Vision's end of a live loop.

    Args:
        receiver: Of vision's packets.
        vision: What is made of them.
        check: Called now and then; what it raises ends whatever goes on.

    Attributes:
        vision: As given.
        leader: Number of the camera whose frames are ticks; None if ticks are those of our clock.
        skipped: Frames that went by without a tick, as this computer was busy or frames were lost.
    """

    def __init__(
        self, receiver: Receiver, vision: Vision, check: Callable[[], None] = lambda: None
    ) -> None:
        self.vision, self._receiver, self._check = vision, receiver, check
        self.leader: int | None = None
        self.skipped, self._tick = 0, -math.inf  # s of the leading camera's clock, or of ours

    def listen(self, seconds: float) -> None:
        """Take in what comes for a while."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self._receive(until)

    def choose_ticks(self, pace: Pace) -> None:
        """Choose what gives the ticks by what has come so far.

        Raises:
            OmniError: Frames shall, but there are not about 60 of them per second of their own
                clock.
        """
        seeing = {camera for _, _, camera in self.vision.sightings}
        leader = min(self.vision.cameras, key=lambda number: (number not in seeing, number))
        rate_hz = self.vision.cameras[leader].rate_hz
        fits = abs(rate_hz / FRAME_RATE_HZ - 1) < RATE_TOLERANCE
        if (
            pace == "vision" and rate_hz and not fits
        ):  # unknown of a simulation that waits for commands
            raise OmniError(
                f"vision sends {rate_hz:.1f} frames a second, and the loop needs {FRAME_RATE_HZ} to go with them;"
                " --rate 60 goes by the clock of this computer"
            )
        self.leader = leader if pace == "vision" or (pace == "auto" and fits) else None

    def restart(self) -> None:
        """Begin ticks anew with the newest frame."""
        self.listen(SETTLE_S)
        self.skipped, self._tick = 0, -math.inf

    def tick(self, expected: Array, on_silence: Callable[[], None]) -> tuple[Array, Array, int]:
        """Wait for the next tick.

        Args:
            expected: Poses of the robots, shape (n, 3).
            on_silence: Called now and then while vision is silent.

        Returns:
            What vision saw, and its age; see `Vision.at`. How many frames went by since the last
            tick.
        """
        before, rate = self._tick, 1.0
        if self.leader is None:
            now = before + PERIOD_S
            self._tick = now = time.monotonic() if now < time.monotonic() - PERIOD_S else now
            self._receive(now)
            while time.monotonic() < now:
                self._receive(now)
        else:
            camera = self.vision.cameras[self.leader]
            self._await_frame(camera, on_silence)
            if camera.sent_s > before:
                now, rate, self._tick = (
                    camera.clock.ours(camera.sent_s),
                    camera.clock.rate,
                    camera.sent_s,
                )
            else:
                self.leader, now = None, time.monotonic()
                before, self._tick = now - LOST_S, now
        elapsed = min(self._tick - before, LOST_S) if math.isfinite(before) else PERIOD_S
        skipped = max(round(elapsed / PERIOD_S) - 1, 0)
        self.skipped += skipped
        return *self.vision.at(now, rate, expected), skipped

    def _await_frame(self, camera: VisionCamera, on_silence: Callable[[], None]) -> None:
        """Wait for the leading camera's next frame, and for those of the others, unless it is lost."""
        began = time.monotonic()
        silent_at = began + SILENT_S
        while camera.sent_s <= self._tick + PERIOD_S / 2:
            self._receive(silent_at)
            if time.monotonic() > silent_at:
                on_silence()
                silent_at += SILENT_S
            if silent_at > began + LOST_S + SILENT_S:
                return
        self.listen(GRACE_S)

    def _receive(self, until: float) -> None:
        """Take in what comes first before our clock says `until`, or a check is due."""
        self._check()
        if self._receiver.wait(min(until, time.monotonic() + CHECK_S)):
            for data, arrival, sender in self._receiver.packets():
                self.vision.add(data, arrival, sender)
