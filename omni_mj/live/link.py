"""The ticks of a live loop, and what is seen at each: vision's packets, in step with its frames or our own clock."""

import math
import time
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.live.cameras import OLDEST_S, Camera, leading
from omni_mj.live.listen import Listener
from omni_mj.live.sockets import Receiver
from omni_mj.live.vision import Vision
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S

Pace = Literal["auto", "60", "vision"]

SILENT_S = 0.5  # without any frame, after which vision is lost
GRACE_S = 0.001  # for which the other cameras' frames are waited for after that of the leading one
PATIENCE_S = 0.05  # same, where cameras look at one time and go on when commands have come: a simulation that waits
OVERDUE = 1.6  # periods after a tick at which a frame is taken to be lost
SHORTEST_S = 0.0125  # of a period, where a simulation goes faster than time: it waits for commands anyway
SAME_RATE = 0.03  # by which frames may differ from 60 a second of their own clock, for the loop to go with them
SETTLE_S = 0.05  # in which frames arrive that were on their way
CHECK_S = 0.05  # how often it is looked whether to stop, while nothing comes


class VisionLostError(Exception):
    """No camera has sent anything for half a second."""


class Link:
    """Vision's end of a live loop.

    Args:
        receiver: of vision's packets.
        vision: what is made of them.
        check: called now and then; what it raises ends whatever goes on.
        heard: what remembers all detections.

    Attributes:
        pace: as asked: "60", ticks of our own clock; "vision", with each frame of a camera, and only then; "auto", with
            each frame and in the place of those that are lost, if a camera sends 60 in a second of its clock.
        with_frames: whether it goes with frames.
        leader: number of the camera that gives the ticks, or None.
        skipped: frames that went by before the last tick: this computer was busy; `late` is the sum.
        answers: how long after each tick commands left, s: after the frame came, or after the tick of our own clock.
        missing: ticks without a frame of the camera that gives them.
    """

    def __init__(
        self,
        receiver: Receiver,
        vision: Vision,
        check: Callable[[], None] = lambda: None,
        heard: Listener | None = None,
    ) -> None:
        self.vision, self._receiver, self._check = vision, receiver, check
        self.heard = Listener() if heard is None else heard
        self.pace: Pace = "auto"
        self.with_frames = False
        self.leader: int | None = None
        self.late = self.missing = self.skipped = 0
        self.answers: list[float] = []
        self._due = -math.inf  # since when the tick waits to be answered
        self._seeing: set[int] = set()
        self._tick = self._woken = self._left = -math.inf
        self._beginning = -1, 0

    def listen(self, seconds: float) -> None:
        """Take in what comes for a while."""
        until = time.monotonic() + seconds
        while (now := time.monotonic()) < until:
            self._check()
            self._take(min(until, now + CHECK_S))

    def choose(self, pace: Pace) -> None:
        """Choose what gives the ticks, by what has come so far.

        Raises:
            OmniError: frames shall, but there are not about 60 of them in a second of their own clock. Of a simulation
                that waits for commands that is not known.
        """
        self.leader = leading(self.vision.cameras, self._seeing, time.monotonic(), SILENT_S)
        rate = math.nan if self.leader is None else self.vision.cameras[self.leader].usual_hz
        fits = abs(rate / FRAME_RATE_HZ - 1) < SAME_RATE
        if pace == "vision" and not fits and not math.isnan(rate):
            raise OmniError(
                f"vision sends {rate:.1f} frames a second, and the loop needs {FRAME_RATE_HZ} to go with them;"
                " --rate 60 goes by the clock of this computer"
            )
        self.pace, self.with_frames = pace, pace == "vision" or (pace == "auto" and fits)

    @property
    def timing(self) -> dict[str, float]:
        """How old what is seen may be at a tick, by its setting; nothing before a camera leads."""
        if self.leader is None:
            return {}
        camera = self.vision.cameras[self.leader]
        waiting = 0.0 if self.with_frames else 1 / camera.received_hz
        return {"vision.delay_s": round(min(camera.age_s + waiting, OLDEST_S), 4)}

    def tick(self, twist: Array) -> tuple[Array, np.ndarray]:
        """Wait for the next tick; see `Vision.at`.

        Args:
            twist: of the robots since the tick before (n, 3).

        Raises:
            VisionLostError: no camera has sent anything for half a second.
        """
        before, clock = self._tick, self._beginning
        if not math.isfinite(before):
            self._take(time.monotonic())  # what came since `restart`
        self._tick = self._of_frame() if self.with_frames else self._of_clock()
        self._woken = time.monotonic()
        elapsed = self._tick - before if self._beginning == clock else PERIOD_S
        elapsed = elapsed if math.isfinite(elapsed) else PERIOD_S
        self.skipped = max(round(elapsed / PERIOD_S) - 1, 0)
        self.late += self.skipped
        return self.vision.at(self._tick, elapsed, twist, self.leader if self.with_frames else None)

    def answered(self) -> None:
        """Commands have left."""
        self._left = time.monotonic()
        self.answers.append(self._left - self._due)

    def now(self) -> Array:
        """Where the robots are (n, 3), which rest; not a number for those that are not seen. See `Vision.at`."""
        poses, _ = self.vision.at(time.monotonic(), PERIOD_S, np.zeros((len(self.vision.ids), 3)))
        return poses

    def find(self, seconds: float) -> Array:
        """Look for the robots anew, which rest, for some seconds; where they are (n, 3)."""
        self.heard.forget()
        self.listen(seconds)
        return self.believe()

    def believe(self) -> Array:
        """Where the robots rest, by all that was heard (n, 3); from now on they are taken to be there."""
        vision = self.vision
        poses = self.heard.poses(vision.colour, vision.ids)
        vision.follow(vision.ids)
        vision.believe(poses)
        self.restart()
        return poses

    def restart(self) -> None:
        """Begin ticks anew, after a while without, with the newest frame."""
        self.listen(SETTLE_S)
        self._tick = -math.inf  # s of the leading camera's clock, or of ours
        self._beginning = -1, 0  # which camera's, and how often that began anew
        self._woken = -math.inf  # when the tick was answered, s of our clock

    def _of_clock(self) -> float:
        """The next 60th of a second."""
        now = time.monotonic()
        tick = self._tick + PERIOD_S
        if tick < now - PERIOD_S:
            tick = now
        while time.monotonic() < tick:
            self._alive()
            self._take(min(tick, time.monotonic() + CHECK_S))
        self._due = tick
        return tick

    def _of_frame(self) -> float:
        """When the leading camera sent its next frame, by its clock; a period after the tick before if it is lost."""
        self._choose_leader()
        assert self.leader is not None
        camera = self.vision.cameras[self.leader]
        if self._beginning != (self.leader, camera.clock.restarts):
            self._beginning, self._tick = (self.leader, camera.clock.restarts), -math.inf
        period = max(PERIOD_S / camera.clock.rate, SHORTEST_S)  # of our clock
        overdue = self._woken + OVERDUE * period if self.pace == "auto" and math.isfinite(self._woken) else math.inf
        together = [each for each in self.vision.cameras.values() if self.pace == "vision" and _together(each, camera)]
        while camera.last[0] <= self._tick + PERIOD_S / 2 and camera.clock.restarts == self._beginning[1]:
            if time.monotonic() >= overdue:
                self._alive()
                self.missing += 1
                self._due = overdue
                return self._tick + PERIOD_S
            self._alive()
            self._take(min(overdue, time.monotonic() + CHECK_S))
        self._others(together)
        self._due = camera.last[1] if math.isfinite(self._woken) else time.monotonic()
        return camera.last[0]

    def _others(self, together: Sequence[Camera]) -> None:
        """Take in the other cameras' frames; those that look at one time with the leading one are waited for."""
        begun = time.monotonic()
        while (now := time.monotonic()) < begun + GRACE_S:
            self._take(begun + GRACE_S)
        while now < begun + PATIENCE_S and any(each.last[1] <= self._woken for each in together):
            self._take(begun + PATIENCE_S)
            now = time.monotonic()

    def _take(self, until: float) -> None:
        """Take in what comes first before our clock says `until`."""
        if self._receiver.wait(until):
            for data, arrival, source in self._receiver.packets():
                if (found := self.vision.add(data, arrival, source)) is not None:
                    number, detection = found
                    if detection.robots_blue or detection.robots_yellow:
                        self._seeing.add(number)
                    self.heard(number, detection)

    def _choose_leader(self) -> None:
        """Another camera leads when the one that did has fallen silent."""
        cameras, now = self.vision.cameras, time.monotonic()
        if self.leader is None or now - cameras[self.leader].heard > SILENT_S / 2:
            other = leading(cameras, self._seeing, now, SILENT_S / 2)
            self.leader = self.leader if other is None else other
        if self.leader is None:
            raise VisionLostError

    def _alive(self) -> None:
        self._check()
        # Since when a simulation may have waited for us.
        asked = max(self._woken, self._left) if self.pace == "vision" else -math.inf
        if time.monotonic() - max(self.vision.heard, asked) > SILENT_S:
            self._take(time.monotonic())  # what came while this computer did something else
            if time.monotonic() - self.vision.heard > SILENT_S:
                raise VisionLostError


def _together(one: Camera, other: Camera) -> bool:
    """Whether two cameras took their newest images at one time, by their clocks."""
    return one.newest is not None and other.newest is not None and abs(one.newest[1] - other.newest[1]) < PERIOD_S / 4
