"""The ticks of a live loop, and what is seen at each: in step with vision's frames or with our own clock."""

import math
import time
from collections.abc import Callable
from typing import Literal

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.live.cameras import MAX_AGE_S
from omni_mj.live.listen import RobotSightings
from omni_mj.live.sockets import Receiver
from omni_mj.live.vision import Vision
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S

Pace = Literal["auto", "60", "vision"]

SILENT_S = 0.5  # without any frame, after which vision is lost
GRACE_S = 0.001  # for which frames of the other cameras are waited for after that of the leading one
OVERDUE = 1.6  # periods after a tick at which a frame is taken to be lost
RATE_TOLERANCE = 0.03  # by which frames may differ from 60 per second of their own clock to give the ticks
SETTLE_S = 0.05  # in which frames arrive that were on their way
CHECK_S = 0.05  # between checks whether to stop, while nothing comes


class VisionLostError(Exception):
    """No camera has sent anything for half a second."""


class Link:
    """Vision's end of a live loop.

    Args:
        receiver: Of vision's packets.
        vision: What is made of them.
        check: Called now and then; what it raises ends whatever goes on.

    Attributes:
        sightings: All detections of the last seconds.
        follows_frames: Whether each frame of a camera is a tick, in place of 60ths of a second of our clock.
        leader: Number of the camera whose frames are ticks, or None.
        skipped: Frames that went by before the last tick, as this computer was busy; `late` is the sum.
        missing: Ticks without a frame of the leading camera.
        answers: How long after each tick commands left, s.
    """

    def __init__(self, receiver: Receiver, vision: Vision, check: Callable[[], None] = lambda: None) -> None:
        self.vision, self._receiver, self._check = vision, receiver, check
        self.sightings = RobotSightings()
        self.follows_frames, self._waits_for_frames = False, False
        self.leader: int | None = None
        self.late = self.missing = self.skipped = 0
        self.answers: list[float] = []
        self._tick = self._ticked_at = self._answered_at = self._due = -math.inf
        self._begin_ticks()

    def listen(self, seconds: float) -> None:
        """Take in what comes for a while."""
        until = time.monotonic() + seconds
        while (now := time.monotonic()) < until:
            self._check()
            self._receive(min(until, now + CHECK_S))

    def choose_pace(self, pace: Pace) -> None:
        """Choose what gives the ticks by what has come so far.

        Raises:
            OmniError: Frames shall, but there are not about 60 of them per second of their own clock.
        """
        self._choose_leader(SILENT_S)
        rate = math.nan if self.leader is None else self.vision.cameras[self.leader].stamped_hz
        fits = abs(rate / FRAME_RATE_HZ - 1) < RATE_TOLERANCE
        if pace == "vision" and not fits and not math.isnan(rate):  # unknown of a simulation that waits for commands
            raise OmniError(
                f"vision sends {rate:.1f} frames a second, and the loop needs {FRAME_RATE_HZ} to go with them;"
                " --rate 60 goes by the clock of this computer"
            )
        self._waits_for_frames = pace == "vision"
        self.follows_frames = self._waits_for_frames or (pace == "auto" and fits)

    @property
    def delay_s(self) -> float | None:
        """How old the newest frame may be at a tick, s; None before a camera leads."""
        if self.leader is None:
            return None
        camera = self.vision.cameras[self.leader]
        waiting = 0.0 if self.follows_frames else 1 / camera.received_hz
        return round(min(camera.mean_age_s + waiting, MAX_AGE_S), 4)

    def tick(self, twist: Array) -> tuple[Array, np.ndarray]:
        """Wait for the next tick; see `Vision.at`.

        Args:
            twist: Of the robots since the last tick, shape (n, 3).

        Raises:
            VisionLostError: No camera has sent anything for half a second.
        """
        before, clock = self._tick, self._tick_clock
        if not math.isfinite(before):
            self._receive(time.monotonic())  # what came since `restart`
        self._tick = self._next_frame() if self.follows_frames else self._next_period()
        self._ticked_at = time.monotonic()
        elapsed = self._tick - before if self._tick_clock == clock else PERIOD_S
        elapsed = elapsed if math.isfinite(elapsed) else PERIOD_S
        self.skipped = max(round(elapsed / PERIOD_S) - 1, 0)
        self.late += self.skipped
        return self.vision.at(self._tick, elapsed, twist, self.leader if self.follows_frames else None)

    def note_answer(self) -> None:
        """Note that commands have left."""
        self._answered_at = time.monotonic()
        self.answers.append(self._answered_at - self._due)

    def now(self) -> Array:
        """Return the poses of robots at rest, shape (n, 3); NaN for those that are not seen."""
        return self.vision.at(time.monotonic(), PERIOD_S, np.zeros((len(self.vision.ids), 3)))[0]

    def find(self, seconds: float) -> Array:
        """Look anew for robots at rest for some seconds; see `locate`."""
        self.sightings.clear()
        self.listen(seconds)
        return self.locate()

    def locate(self) -> Array:
        """Return where robots rest by all sightings, shape (n, 3), and expect them there from now on."""
        vision = self.vision
        poses = self.sightings.poses(vision.colour, vision.ids)
        vision.follow(vision.ids, poses)
        self.restart()
        return poses

    def restart(self) -> None:
        """Begin ticks anew with the newest frame."""
        self.listen(SETTLE_S)
        self._begin_ticks()

    def _begin_ticks(self) -> None:
        self._tick = -math.inf  # s of the leading camera's clock, or of ours
        self._tick_clock: tuple[int | None, int] = None, 0  # the leading camera, and how often its clock began anew
        self._ticked_at = self._answered_at = self._due = -math.inf  # s of our clock

    def _next_period(self) -> float:
        """Wait for the next 60th of a second."""
        now, tick = time.monotonic(), self._tick + PERIOD_S
        tick = now if tick < now - PERIOD_S else tick
        while time.monotonic() < tick:
            self._check_vision()
            self._receive(min(tick, time.monotonic() + CHECK_S))
        self._due = tick
        return tick

    def _next_frame(self) -> float:
        """Wait for the leading camera's next frame, or until it is overdue. Return its time by the camera's clock."""
        if self.leader is None or time.monotonic() - self.vision.cameras[self.leader].heard_s > SILENT_S / 2:
            self._choose_leader(SILENT_S / 2)
        if self.leader is None:
            raise VisionLostError
        camera = self.vision.cameras[self.leader]
        if self._tick_clock != (self.leader, camera.restarts):
            self._tick_clock, self._tick = (self.leader, camera.restarts), -math.inf
        period = PERIOD_S / camera.clock.rate  # of our clock
        is_first = not math.isfinite(self._ticked_at)
        overdue = math.inf if self._waits_for_frames or is_first else self._ticked_at + OVERDUE * period
        while camera.sent_s <= self._tick + PERIOD_S / 2 and camera.restarts == self._tick_clock[1]:
            self._check_vision()
            if time.monotonic() >= overdue:
                self.missing += 1
                self._due = overdue
                return self._tick + PERIOD_S
            self._receive(min(overdue, time.monotonic() + CHECK_S))
        until = time.monotonic() + GRACE_S
        while time.monotonic() < until:
            self._receive(until)
        self._due = time.monotonic() if is_first else camera.arrived_s
        return camera.sent_s

    def _receive(self, until: float) -> None:
        """Take in what comes first before our clock says `until`."""
        if self._receiver.wait(until):
            for data, arrival, sender in self._receiver.packets():
                if (detection := self.vision.add(data, arrival, sender)) is not None:
                    self.sightings.add(detection)

    def _choose_leader(self, silent_s: float) -> None:
        """Let the first camera lead that sees robots, or else the first of all, that is not silent."""
        now, seeing = time.monotonic(), self.sightings.cameras
        alive = [number for number, camera in self.vision.cameras.items() if now - camera.heard_s < silent_s]
        if alive:
            self.leader = min(alive, key=lambda number: (number not in seeing, number))

    def _check_vision(self) -> None:
        self._check()
        # Since when a simulation may have waited for us.
        asked = max(self._ticked_at, self._answered_at) if self._waits_for_frames else -math.inf
        if time.monotonic() - max(self.vision.heard_s, asked) > SILENT_S:
            self._receive(time.monotonic())  # what came while this computer did something else
            if time.monotonic() - self.vision.heard_s > SILENT_S:
                raise VisionLostError
