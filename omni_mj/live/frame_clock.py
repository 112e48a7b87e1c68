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
# Time without a new image, but with repetitions, after which a simulator waits for commands.
STANDSTILL_S = 0.2
ROUNDING_S = 1e-5  # of time stamps in lockstep
SETTLE_S = 0.05  # in which frames in flight arrive
CHECK_S = 0.05  # between checks for a stop request while no packet arrives


class FrameClock:
    """Receives vision packets and times the frames of a live loop.

    In lockstep, a simulator advances by an image of its first camera per command. Frames are then
    1/60 s of simulated time, and commands and images alternate.

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
        self._commanded_s = -math.inf  # stamp of the newest image when a command was last sent

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
        first = min(self.vision.cameras)
        if pace == "vision" and self.vision.cameras[first].standstill_s > STANDSTILL_S:
            self.leader, self.vision.is_lockstep = first, True
            return
        rate_hz = self.vision.cameras[leader].rate_hz
        is_60_hz = abs(rate_hz / FRAME_RATE_HZ - 1) < RATE_TOLERANCE
        if pace == "vision" and rate_hz and not is_60_hz:
            raise OmniError(
                f"vision sends {rate_hz:.1f} frames per second, --clock vision needs"
                f" {FRAME_RATE_HZ}. Use --clock 60 to follow the clock of this computer"
            )
        self.leader = leader if pace == "vision" or (pace == "auto" and is_60_hz) else None

    def restart(self) -> None:
        """Forget the last frame, and count skipped frames from 0. Call it after `choose_source`."""
        if not self.vision.is_lockstep:
            self.listen_for(SETTLE_S)
        elif self.leader is not None:
            self._await_frame(self.vision.cameras[self.leader], lambda: None)
        self.skipped, self._tick = 0, -math.inf

    def begin_command(self) -> None:
        """In lockstep, wait for the image after the last command. Call it before each command."""
        if self.vision.is_lockstep and self.leader is not None:
            camera = self.vision.cameras[self.leader]
            if not self._await_frame(camera, lambda: None):
                self.leader = None
            self._commanded_s = camera.sent_s

    def wait_for_frame(
        self,
        expected: Array,
        on_silence: Callable[[], None],
        repeat_command: Callable[[], None],
    ) -> tuple[Array, Array, int]:
        """Wait for the next frame.

        Args:
            expected: Expected poses of the robots, shape (n, 3), m and rad.
            on_silence: Called every 0.5 s without a frame of the leading camera. It is not called
                in lockstep, and while the loop follows the clock of this computer.
            repeat_command: Called in lockstep if the next image is not of a later frame.

        Returns:
            Measured poses and their ages, see `SslVision.measurements`. Number of frames that were
            skipped since the last call.
        """
        previous_tick, rate = self._tick, 1.0
        if self.leader is None:
            now, our_time = previous_tick + PERIOD_S, time.monotonic()
            self._tick = now = our_time if now < our_time - PERIOD_S else now
            self._receive(now)
            while time.monotonic() < now:
                self._receive(now)
        else:
            camera = self.vision.cameras[self.leader]
            is_alive = self._await_frame(camera, on_silence)
            while is_alive and self.vision.is_lockstep and self._is_early(camera, ROUNDING_S):
                repeat_command()
                is_alive = self._await_frame(camera, on_silence)
            if not is_alive:
                # The camera is lost: follow the clock of this computer from now on.
                self.leader, now = None, time.monotonic()
                previous_tick, self._tick = now - LOST_S, now
            elif self.vision.is_lockstep:
                self._tick = now = self._next_tick(camera.sent_s)
            else:
                now, rate = camera.clock.local_time(camera.sent_s), camera.clock.rate
                self._tick = camera.sent_s
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
        while self._is_awaited(camera):
            self._receive(silent_at)
            if time.monotonic() > silent_at:
                if not self.vision.is_lockstep:
                    on_silence()
                silent_at += SILENT_S
            if silent_at > began + LOST_S + SILENT_S:
                return False
        self.listen_for(GRACE_S)
        return True

    def _is_awaited(self, camera: VisionCamera) -> bool:
        """Return whether the next frame of the leading camera has not come yet."""
        if self.vision.is_lockstep:
            return camera.sent_s == self._commanded_s
        return self._is_early(camera, PERIOD_S / 2)

    def _next_tick(self, sent_s: float) -> float:
        """Return the first tick of simulated time, every 1/60 s, at which an image was sent, s."""
        frames = (sent_s - self._tick - ROUNDING_S) / PERIOD_S
        return self._tick + math.ceil(frames) * PERIOD_S if 0 < frames < math.inf else sent_s

    def _is_early(self, camera: VisionCamera, tolerance_s: float) -> bool:
        """Return whether the newest frame of a camera is not later than the last tick.

        A time stamp far below that of the last frame is one of a camera that was restarted.
        """
        return self._tick - RESTART_S <= camera.sent_s <= self._tick + tolerance_s

    def _receive(self, until: float) -> None:
        """Receive packets until the first arrives, `until` is reached, or a check is due."""
        self._check()
        if self._receiver.wait(min(until, time.monotonic() + CHECK_S)):
            for data, arrival, sender in self._receiver.packets():
                self.vision.add(data, arrival, sender)
