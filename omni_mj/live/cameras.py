"""Cameras: what each sends, how often, how old, and by how much one sees robots elsewhere than the others do."""

from collections import Counter, deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.live.clock import Clock
from omni_mj.live.wire.vision import Detection

OLDEST_S = 0.5  # between capture and sending that a peer can mean; more, or less than none, is of two clocks
MOST_LOST = 1000  # frames between two; more are of another count
INTERVALS = 120  # between frames, of which the usual one is known
LEAST_GAIN = 0.02  # with which differences between cameras are learned in the end


@dataclass
class Camera:
    """One camera.

    Attributes:
        clock: of its time stamps when they are sent.
        frames: received; `lost` are missing between them by their numbers, `late` came after newer ones.
        bias: by how much it sees robots elsewhere than the others do, (3,) m, m, rad; see `Biases`.
        ages: between capture and sending, summed over the frames, s.
        heard: when something came of it, though it had come before, s of our clock.
    """

    clock: Clock = field(default_factory=Clock)
    frames: int = 0
    lost: int = 0
    late: int = 0
    bias: Array = field(default_factory=lambda: np.zeros(3))
    ages: float = 0.0
    heard: float = 0.0
    first: tuple[float, float] = (0.0, 0.0)  # stamp and arrival of the first frame since the clock began
    last: tuple[float, float] = (0.0, 0.0)
    since: int = 0  # frames since then, with those that were lost, without the first
    newest: tuple[int, float] | None = None  # number and time of capture
    intervals: deque[float] = field(default_factory=lambda: deque(maxlen=INTERVALS))  # of its stamps, newest last, s

    def add(self, detection: Detection, arrival: float) -> bool:
        """Take a frame in, and say whether it is new: neither late nor here before."""
        self.heard, captured = arrival, detection.t_capture
        age = detection.t_sent - captured
        sent = detection.t_sent if 0 <= age <= OLDEST_S else captured
        if self.clock.add(sent, arrival):
            self.newest = None
        if self.newest is not None:
            number, before = self.newest
            if captured <= before:
                self.late += 1
                return False
            step = detection.frame_number - number
            step = step if 1 < step < MOST_LOST else 1  # not all number their frames
            self.lost += step - 1
            self.since += step
            self.intervals.append((sent - self.last[0]) / step)
        else:
            self.first, self.since = (sent, arrival), 0
        self.newest, self.last = (detection.frame_number, captured), (sent, arrival)
        self.frames += 1
        self.ages += sent - captured
        return True

    @property
    def age_s(self) -> float:
        """Mean time between capture and sending, s."""
        return self.ages / max(self.frames, 1)

    @property
    def stamped_hz(self) -> float:
        """Frames that it sends a second of its own clock; not a number before the second."""
        return self._rate(0)

    @property
    def received_hz(self) -> float:
        """Frames a second of ours."""
        return self._rate(1)

    @property
    def usual_hz(self) -> float:
        """Frames a second of its own clock as most of the last ones came, whatever stalled between; or not a number."""
        usual = float(np.median(self.intervals)) if self.intervals else 0.0
        return 1 / usual if usual > 0 else np.nan

    def _rate(self, clock: int) -> float:
        span = self.last[clock] - self.first[clock]
        return self.since / span if span > 0 else np.nan


class Biases:
    """Learns by how much cameras differ, where several see a robot at a time.

    Of a difference the camera takes the greater part that was of less use so far, so that nothing jumps when a robot
    comes into the view of another camera.
    """

    def __init__(self) -> None:
        self._compared: Counter[tuple[int, int]] = Counter()
        self._used: Counter[int] = Counter()

    def learn(self, cameras: Mapping[int, Camera], poses: Mapping[int, Array]) -> None:
        """Compare what cameras say of one robot at one time.

        Args:
            cameras: by number.
            poses: camera's number -> pose (3,) as it sees it.
        """
        self._used.update(poses.keys())
        for one, other in combinations(sorted(poses), 2):
            self._compared[one, other] += 1
            difference = poses[one] - cameras[one].bias - poses[other] + cameras[other].bias
            difference[2] = wrap_angle(difference[2])
            difference *= max(1 / self._compared[one, other], LEAST_GAIN)
            share = self._used[other] / (self._used[one] + self._used[other])
            cameras[one].bias = cameras[one].bias + share * difference
            cameras[other].bias = cameras[other].bias - (1 - share) * difference


def leading(cameras: Mapping[int, Camera], seeing: Iterable[int], now: float, silent_s: float) -> int | None:
    """The camera after which to go: the first of those that see robots, or else of all, that is not silent."""
    alive = [number for number, camera in sorted(cameras.items()) if now - camera.heard < silent_s]
    return next((number for number in alive if number in set(seeing)), alive[0] if alive else None)
