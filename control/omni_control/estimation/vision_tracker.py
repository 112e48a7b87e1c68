"""Track robots by vision of any age: an outlier gate, and a Kalman filter that knows the commands.

Per axis the state is the position x and a drift b, the speed at which a robot departs from its commands:

    x(k+1) = x(k) + q(k) + T b(k) + noise of GAIN_ERROR |q|
    b(k+1) = b(k) exp(-T / DRIFT_TIME_S) + noise

with q the commanded displacement. How much a robot departs differs between plants, so the process
noise is scaled until the normalized innovations squared average 1.

Where images are late, the filter stays at the last frame that was over when vision saw a robot. From there to the
present robots are predicted by the commands, as over the dead time. To correct the present by the past would need the
velocity that is to be corrected, and take for evidence what came upon it since.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_control.delay_compensation import CommandHistory, Rows
from omni_control.estimation.outlier_gate import OutlierGate
from omni_control.kinematics import Array, wrap_angle

GAIN_ERROR = 0.06  # standard deviation of a frame's displacement over the commanded one
DRIFT_M_S1_5, DRIFT_RAD_S1_5 = (
    0.1,
    0.5,
)  # random walk of the drift, m/s and rad/s per square root of a second
DRIFT_TIME_S = 0.5
SCALE_MEMORY, MAX_SQUARED_INNOVATION = 0.97, 9.0  # of the process noise's scale; of 3 sigma
SCALE_BOUNDS = 0.1, 100.0
RESOLUTION = 1e-5, 1e-5, 1e-4  # of a camera, m and rad
MAX_FRAMES_BEHIND = (
    15  # that filters may be behind; of what is older they are told that it is no older
)
_ROUNDING = 1e-6  # of a frame


class FilterStep(NamedTuple):
    """A step of filters of n robots, which ends at this frame, or at one in the past.

    Attributes:
        behind: by how many frames its end lies before the present, (n,); of no meaning for a filter
            that is held.
        held: filters that do not move in this step, (n,).
        after: time from its end to when vision saw the robot, (n,) s, negative if before; 0 but for
            the last step.
    """

    frames_behind: Array
    frozen: NDArray[np.bool_]
    capture_offset: Array

    @classmethod
    def to_present(cls, n: int) -> "FilterStep":
        """Return the step to this frame of filters that were at the one before, to be read only: filters keep it."""
        return cls(np.broadcast_to(0.0, n), np.broadcast_to(False, n), np.broadcast_to(0.0, n))

    def select(self, rows: Rows) -> "FilterStep":
        """Return the same of some robots."""
        return FilterStep(self.frames_behind[rows], self.frozen[rows], self.capture_offset[rows])


class FilterSchedule:
    """Where filters of n robots are: `behind` frames (n,) before the present.

    Args:
        n: robots.
        period: length of a frame, s.
    """

    def __init__(self, n: int, period: float) -> None:
        self._period, self.frames_behind = period, np.zeros(n)

    def steps(self, age: Array, seen: Array) -> list[FilterStep]:
        """The steps of this frame, of which the last has what vision reports: of this age (n,) s, of robots seen (n,).

        If an image is older than the frame where a robot's filter is, as after a frame without an
        image of it, the filter is held, `after` is negative, and the image is compared with where
        the robot was then.
        """
        frames = np.minimum(age / self._period, MAX_FRAMES_BEHIND)
        wanted = np.where(seen, np.ceil(frames - _ROUNDING), self.frames_behind)
        behind = np.minimum(wanted, self.frames_behind + 1)
        steps = self.frames_behind + 1 - behind
        after = np.where(seen, (behind - frames) * self._period, 0.0)
        self.frames_behind = behind
        left = range(max(int(steps.max()), 1) - 1, -1, -1)
        return [
            FilterStep(behind + more, steps <= more, after if more == 0 else 0 * after)
            for more in left
        ]


class KalmanFilter:
    """Poses of n robots from vision, given the displacement that their commands should have caused.

    Args:
        pose: poses at the start, (n, 3).
        period: time between frames, s.
        noise: standard deviation of vision, per axis (3,) or per robot and axis (n, 3), m and rad.

    Attributes:
        pose: filtered poses (n, 3); headings count full turns.
        drift: the part of the twist that commands do not explain, (n, 3).
        twist: filtered twists (n, 3).
    """

    def __init__(self, pose: Array, period: float, noise: ArrayLike) -> None:
        self._period, self._now = period, FilterStep.to_present(len(pose))
        self._noise = np.maximum(np.broadcast_to(noise, pose.shape), RESOLUTION) ** 2
        self._kept = math.exp(-period / DRIFT_TIME_S)  # of a drift, in a frame
        self._wander = np.array([DRIFT_M_S1_5, DRIFT_M_S1_5, DRIFT_RAD_S1_5]) ** 2 * period
        self.pose, self.drift, self.twist = pose.copy(), np.zeros_like(pose), np.zeros_like(pose)
        # Variances of pose and drift, and their covariance: each axis by itself, so that a table of
        # each is enough.
        self._pose_variance = self._noise.copy()
        self._covariance, self._drift_variance = np.zeros((2, *pose.shape))
        self._scale = np.ones_like(pose)  # of the process noise
        self._innovation, self._expected_square = np.full((2, *pose.shape), np.nan)

    @property
    def sigma(self) -> Array:
        """Standard deviation of the pose, (n, 3)."""
        return np.sqrt(self._pose_variance)

    @property
    def normalized_innovation(self) -> Array:
        """Innovations over their standard deviations (n, 3); not a number for robots that were not seen."""
        return self._innovation / np.sqrt(self._expected_square)

    def update(
        self,
        measured: Array,
        displacement: Array,
        step: FilterStep | None = None,
        onward: Array | float = 0.0,
    ) -> Array:
        """Return the filtered poses (n, 3).

        Args:
            measured: poses seen (n, 3); not a number where a robot was not seen.
            displacement: what commands should have caused since the last frame, (n, 3), m and rad.
            step: that of the filter. [to the next frame, in which robots were seen]
            onward: what commands should have caused until robots were seen, (n, 3).
        """
        period, kept = self._period, self._kept
        held, after = (
            (step or self._now).frozen[:, None],
            (step or self._now).capture_offset[:, None],
        )
        moving = self._scale * (GAIN_ERROR * displacement) ** 2
        ahead = self._covariance + period * self._drift_variance
        pose, drift = self.pose + period * self.drift + displacement, kept * self.drift
        pose_variance = self._pose_variance + period * (self._covariance + ahead) + moving
        covariance, drift_variance = (
            kept * ahead,
            kept**2 * self._drift_variance + self._scale * self._wander,
        )
        if np.count_nonzero(held):
            pose, drift = np.where(held, self.pose, pose), np.where(held, self.drift, drift)
            pose_variance = np.where(held, self._pose_variance, pose_variance)
            covariance = np.where(held, self._covariance, covariance)
            drift_variance = np.where(held, self._drift_variance, drift_variance)
        # Vision sees robots `after` the step ends: covariances of pose and drift with what it
        # should see then.
        expected, with_pose, with_drift = pose, pose_variance, covariance
        square = pose_variance + self._noise
        if np.count_nonzero(after):
            expected = pose + onward + after * drift
            with_pose, with_drift = (
                pose_variance + after * covariance,
                covariance + after * drift_variance,
            )
            square = (
                with_pose
                + after * with_drift
                + self._noise
                + np.maximum(after / period, 0.0) * moving
            )
        innovation = measured - expected
        innovation[:, 2] = wrap_angle(innovation[:, 2])
        self._innovation, self._expected_square = innovation, square
        ratio = innovation**2 / square
        pose_gain, drift_gain = with_pose / square, with_drift / square
        missed = np.isnan(innovation)
        if np.count_nonzero(missed):
            innovation, ratio = np.where(missed, 0.0, innovation), np.where(missed, 1.0, ratio)
            pose_gain[missed], drift_gain[missed] = 0.0, 0.0
        self.pose, self.drift = pose + pose_gain * innovation, drift + drift_gain * innovation
        self._pose_variance = pose_variance - pose_gain * with_pose
        self._covariance = covariance - pose_gain * with_drift
        self._drift_variance = drift_variance - drift_gain * with_drift
        growth = np.exp((1 - SCALE_MEMORY) * (np.minimum(ratio, MAX_SQUARED_INNOVATION) - 1))
        self._scale = np.minimum(np.maximum(self._scale * growth, SCALE_BOUNDS[0]), SCALE_BOUNDS[1])
        self.twist = displacement / period + self.drift
        return self.pose


class VisionTracker:
    """Filter and gate of n robots, and what commands have done since the frame where the filter is.

    Args:
        pose: poses at the start, (n, 3).
        noise: standard deviation of vision, (n, 3), m and rad.
        latency: from a command to its effect, (n, 1) frames.
        period: length of a frame, s.
        gate: of images.

    Attributes:
        filter: behind the present where images are late.
        memory_frames: number of commands that may have acted in the frame just past.
        pose, twist: at this frame, (n, 3).
        steps: those that the filter made in it.
    """

    def __init__(
        self, pose: Array, noise: Array, latency: Array, period: float, gate: OutlierGate
    ) -> None:
        self.filter, self._gate = KalmanFilter(pose, period, noise), gate
        self._latency, self._period = latency, period
        self._usual = float(latency[0, 0]) if np.ptp(latency) == 0 else latency
        self._clock, self._now = (
            FilterSchedule(len(latency), period),
            FilterStep.to_present(len(latency)),
        )
        self.memory_frames = math.ceil(latency.max()) + 1
        self.pose, self.twist = self.filter.pose, self.filter.twist
        self.steps: tuple[FilterStep, ...] = (self._now,)

    def update(self, measured: Array, age: Array, sent: CommandHistory) -> Array:
        """Take in a frame; return the poses (n, 3) that the gate lets pass.

        Args:
            measured: poses seen by vision (n, 3), not a number where a robot was not seen.
            age: how long before this frame that was, (n,) s.
            sent: commands up to the frame before, `MOST_FRAMES` more than `longest`.
        """
        measured = self._gate(measured, age)
        if np.count_nonzero(age) or np.count_nonzero(self._clock.frames_behind):
            self._update_late(measured, age, sent)
        else:
            self.pose = self.filter.update(measured, sent.get_delayed(self._usual) * self._period)
            self.twist, self.steps = self.filter.twist, (self._now,)
        return measured

    def _update_late(self, measured: Array, age: Array, sent: CommandHistory) -> None:
        """Take in a frame where robots were seen a while ago, or the filter is behind for that."""
        latency, self.steps = (
            self._latency,
            tuple(self._clock.steps(age, ~np.isnan(measured[:, 0]))),
        )
        for step in self.steps:
            behind, share = step.frames_behind[:, None], step.capture_offset[:, None] / self._period
            displacement = sent.get_delayed(latency + behind) * self._period
            onward = share * sent.get_delayed(latency + np.maximum(behind - 1, 0.0)) * self._period
            seen = measured if step is self.steps[-1] else np.full_like(measured, np.nan)
            self.filter.update(seen, displacement, step, onward)
        behind, drift = self._clock.frames_behind[:, None], self.filter.drift
        shares = sent.get_pending_fractions(latency + behind) - sent.get_pending_fractions(latency)
        since = (shares * sent.get_latest(sent.length)).sum(0)
        self.pose = self.filter.pose + (since + behind * drift) * self._period
        self.twist = sent.get_delayed(latency) + drift
