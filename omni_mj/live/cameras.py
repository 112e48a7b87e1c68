"""Cameras as `drive` sees them: rates, ages and losses of their frames, and the differences between them."""

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.live.clock import Clock
from omni_mj.live.wire.vision_pb2 import Detection

MAX_AGE_S = 0.5  # between capture and sending; more, or less than none, is of two clocks
MAX_LOST = 1000  # frames between two; more are of another count
MIN_LEARNING_GAIN = 0.02  # of differences between cameras


@dataclass
class VisionCamera:
    """Statistics of one camera.

    Attributes:
        clock: Of its time stamps.
        frames: Received; `lost` are missing between them by their numbers, `late` came after newer ones.
        bias_m_m_rad: By how much it sees robots elsewhere than the others do, shape (3,), m, m, rad.
        total_age_s: Time between capture and sending, summed over the frames, s.
        heard_s: When something of it came last (`time.monotonic`), s.
        sent_s: Stamp of the newest frame, s of its clock.
        arrived_s: When it came, s of our clock.
    """

    clock: Clock = field(default_factory=Clock)
    frames: int = 0
    lost: int = 0
    late: int = 0
    bias_m_m_rad: Array = field(default_factory=lambda: np.zeros(3))
    total_age_s: float = 0.0
    heard_s: float = 0.0
    sent_s: float = 0.0
    arrived_s: float = 0.0
    _number: int = 0  # of the newest frame
    _captured_s: float = 0.0
    _intervals: deque[float] = field(default_factory=lambda: deque(maxlen=120))

    def add(self, detection: Detection, arrival: float) -> bool:
        """Add a frame. Return whether it is new: neither late nor a repetition."""
        self.heard_s, captured = arrival, detection.t_capture
        age = detection.t_sent - captured
        sent = detection.t_sent if 0 <= age <= MAX_AGE_S else captured
        if not self.clock.add(sent, arrival) and self.frames:
            if captured <= self._captured_s:
                self.late += 1
                return False
            step = detection.frame_number - self._number
            step = step if 1 < step < MAX_LOST else 1  # not all number their frames
            self.lost += step - 1
            self._intervals.append((sent - self.sent_s) / step)
        self._number, self._captured_s = detection.frame_number, captured
        self.sent_s, self.arrived_s = sent, arrival
        self.frames += 1
        self.total_age_s += sent - captured
        return True

    @property
    def restarts(self) -> int:
        """How often its clock began anew."""
        return self.clock.restarts

    @property
    def mean_age_s(self) -> float:
        """Mean time between capture and sending, s."""
        return self.total_age_s / max(self.frames, 1)

    @property
    def received_hz(self) -> float:
        """Frames per second of our clock, or NaN."""
        return self.stamped_hz * self.clock.rate

    @property
    def stamped_hz(self) -> float:
        """Frames per second of its own clock by the median interval, whatever stalled in between; or NaN."""
        usual = float(np.median(self._intervals)) if self._intervals else 0.0
        return 1 / usual if usual > 0 else np.nan


class BiasLearner:
    """Learns by how much cameras differ, where several see a robot at the same time.

    Of a difference, the camera that was of less use so far takes the greater part: nothing jumps when a robot comes
    into the view of another camera.
    """

    def __init__(self) -> None:
        self._compared: Counter[tuple[int, int]] = Counter()
        self._used: Counter[int] = Counter()

    def update(self, cameras: Mapping[int, VisionCamera], poses: Mapping[int, Array]) -> None:
        """Compare the poses, shape (3,), that cameras see of one robot at one time."""
        self._used.update(poses.keys())
        for one, other in combinations(sorted(poses), 2):
            self._compared[one, other] += 1
            difference = poses[one] - cameras[one].bias_m_m_rad - poses[other] + cameras[other].bias_m_m_rad
            difference[2] = wrap_angle(difference[2])
            difference *= max(1 / self._compared[one, other], MIN_LEARNING_GAIN)
            share = self._used[other] / (self._used[one] + self._used[other])
            cameras[one].bias_m_m_rad = cameras[one].bias_m_m_rad + share * difference
            cameras[other].bias_m_m_rad = cameras[other].bias_m_m_rad - (1 - share) * difference
