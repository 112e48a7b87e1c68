"""Timing of a live loop: its frames follow a camera, or the clock of this computer at 60 Hz."""

import math
import time
from collections.abc import Callable
from typing import Literal

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config import FRAME_RATE_HZ, PERIOD_S
from omni_mj.live.sockets import Receiver
from omni_mj.live.ssl_vision import RESTART_S, SslVision, VisionCamera

Pace = Literal["auto", "60", "vision"]

SILENT_S = 0.5  # without a frame, after which robots are commanded to stop
LOST_S = 3.0  # without a frame, after which the loop follows the clock of this computer
# Time to wait for frames of the other cameras after a frame of the leading camera, s.
GRACE_S = 0.001
# Largest relative difference from 60 Hz at which a camera can lead.
RATE_TOLERANCE = 0.03
SETTLE_S = 0.05  # in which frames in flight arrive
CHECK_S = 0.05  # between checks for a stop request while no packet arrives


class FrameClock:
    """Receives vision packets and times the frames of a live loop.

    Args:
        receiver: Socket that receives vision packets.
        vision: Collects the detections in them.
        check: Called at least every 0.05 s. An exception that it raises ends the loop.

    Attributes:
        vision: As passed.
        leader: Number of the camera whose frames the loop follows. None if it follows the clock of
            this computer.
        skipped: Number of frames without a step of the loop, because this computer was busy or
            packets were lost.
    """

    def __init__(self, receiver: Receiver, vision: SslVision, check: Callable[[], None]) -> None:
        self.vision, self._receiver, self._check = vision, receiver, check
        self.leader: int | None = None
        self.skipped, self._tick = 0, -math.inf  # s of the leading camera's clock, or of ours

    def listen_for(self, seconds: float) -> None:
        """Receive packets for some seconds."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self._receive(until)

    def choose_source(self, pace: Pace) -> None:
        """Choose the source of frames from the packets received so far.

        Args:
            pace: "vision" for a camera, "60" for the clock of this computer, "auto" for a camera
                that sends about 60 frames per second, otherwise the clock.

        Raises:
            OmniError: `pace` is "vision", but the camera is known not to send about 60 frames per
                second.
        """
        active_cameras = {camera for _, _, camera in self.vision.sightings}
        leader = min(self.vision.cameras, key=lambda number: (number not in active_cameras, number))
        rate_hz = self.vision.cameras[leader].rate_hz
        is_60_hz = abs(rate_hz / FRAME_RATE_HZ - 1) < RATE_TOLERANCE
        # The rate is 0 (unknown) if a simulator waits for commands.
        if pace == "vision" and rate_hz and not is_60_hz:
            raise OmniError(
                f"vision sends {rate_hz:.1f} frames per second, --clock vision needs"
                f" {FRAME_RATE_HZ}. Use --clock 60 to follow the clock of this computer"
            )
        self.leader = leader if pace == "vision" or (pace == "auto" and is_60_hz) else None

    def restart(self) -> None:
        """Forget the last frame, and count skipped frames from 0. Call it after `choose_source`."""
        self.listen_for(SETTLE_S)
        self.skipped, self._tick = 0, -math.inf

    def wait_for_frame(
        self, expected: Array, on_silence: Callable[[], None]
    ) -> tuple[Array, Array, int]:
        """Wait for the next frame.

        Args:
            expected: Expected poses of the robots, shape (n, 3), m and rad.
            on_silence: Called every 0.5 s without a frame of the leading camera. It is not called
                while the loop follows the clock of this computer.

        Returns:
            Measured poses and their ages, see `SslVision.measurements`. Number of frames that were
            skipped since the last call.
        """
        previous_tick, rate = self._tick, 1.0
        if self.leader is None:
            now = previous_tick + PERIOD_S
            self._tick = now = time.monotonic() if now < time.monotonic() - PERIOD_S else now
            self._receive(now)
            while time.monotonic() < now:
                self._receive(now)
        else:
            camera = self.vision.cameras[self.leader]
            if self._await_frame(camera, on_silence):
                now = camera.clock.local_time(camera.sent_s)
                rate = camera.clock.rate
                self._tick = camera.sent_s
            else:
                # The camera is lost: follow the clock of this computer from now on.
                self.leader, now = None, time.monotonic()
                previous_tick, self._tick = now - LOST_S, now
        elapsed = (
            min(self._tick - previous_tick, LOST_S) if math.isfinite(previous_tick) else PERIOD_S
        )
        skipped = max(round(elapsed / PERIOD_S) - 1, 0)
        self.skipped += skipped
        return *self.vision.measurements(now, rate, expected), skipped

    def _await_frame(self, camera: VisionCamera, on_silence: Callable[[], None]) -> bool:
        """Wait for the next frame of the leading camera, then briefly for the other cameras.

        Returns:
            Whether it came. If not, the camera is lost.
        """
        began = time.monotonic()
        silent_at = began + SILENT_S
        # A time stamp far below that of the last frame is one of a camera that was restarted.
        while self._tick - RESTART_S <= camera.sent_s <= self._tick + PERIOD_S / 2:
            self._receive(silent_at)
            if time.monotonic() > silent_at:
                on_silence()
                silent_at += SILENT_S
            if silent_at > began + LOST_S + SILENT_S:
                return False
        self.listen_for(GRACE_S)
        return True

    def _receive(self, until: float) -> None:
        """Receive packets until the first arrives, `until` is reached, or a check is due."""
        self._check()
        if self._receiver.wait(min(until, time.monotonic() + CHECK_S)):
            for data, arrival, sender in self._receiver.packets():
                self.vision.add(data, arrival, sender)
