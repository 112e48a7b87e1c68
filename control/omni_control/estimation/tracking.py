"""Track robots by vision of any age: an outlier gate, and a Kalman filter that knows the commands.

Per axis the state is the position and a drift, the speed at which a robot departs from its commands:

    x(k+1) = x(k) + q(k) + T b(k) + noise of GAIN_ERROR |q|
    b(k+1) = b(k) exp(-T / DRIFT_TIME_S) + noise

with q the commanded displacement. How much a robot departs differs between plants, so the process
noise is scaled until the normalized innovations squared average 1.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from omni_control.delay import CommandsInFlight
from omni_control.estimation.gate import Gate
from omni_control.estimation.late import Clock, Late
from omni_control.kinematics import Array, wrap_angle

GAIN_ERROR = 0.06  # standard deviation of a frame's displacement over the commanded one
DRIFT_M_S2, DRIFT_RAD_S2 = 0.1, 0.5  # change of the drift per square root of a second
DRIFT_TIME_S = 0.5
SCALE_MEMORY, MAX_INNOVATION = 0.97, 9.0  # of the process noise's scale; of one, squared
SCALE_BOUNDS = 0.1, 100.0
RESOLUTION = 1e-5, 1e-5, 1e-4  # of a camera, m and rad


class KalmanFilter:
    """Poses of n robots from vision, given the displacement that their commands should have caused.

    Args:
        pose: poses at the start, (n, 3).
        period: time between frames, s.
        noise: standard deviation of vision, per axis (3,) or per robot and axis (n, 3), m and rad.

    Attributes:
        mean: position and drift of each axis, (n, 3, 2).
        covariance: of these, (n, 3, 2, 2).
        twist: filtered twists (n, 3).
        normalised: innovation over its standard deviation (n, 3); not a number if not seen.
    """

    def __init__(self, pose: Array, period: float, noise: ArrayLike) -> None:
        self._period = period
        self._noise = np.maximum(np.broadcast_to(noise, pose.shape), RESOLUTION) ** 2
        keep = math.exp(-period / DRIFT_TIME_S)
        self._transition = np.array([[1.0, period], [0.0, keep]])
        self._wander = np.array([DRIFT_M_S2, DRIFT_M_S2, DRIFT_RAD_S2]) ** 2 * period
        self.mean = np.stack([pose, np.zeros_like(pose)], axis=-1)
        self.covariance = np.zeros((*pose.shape, 2, 2))
        self.covariance[..., 0, 0] = self._noise
        self._scale = np.ones_like(pose)  # of the process noise
        self.twist = np.zeros_like(pose)
        self.normalised = np.full_like(pose, np.nan)

    @property
    def pose(self) -> Array:
        """Filtered poses (n, 3); headings count full turns."""
        return self.mean[..., 0].copy()

    @property
    def drift(self) -> Array:
        """The part of the twist that commands do not explain, (n, 3)."""
        return self.mean[..., 1]

    @property
    def sigma(self) -> Array:
        """Standard deviation of the pose, (n, 3)."""
        return np.sqrt(self.covariance[..., 0, 0])

    def update(
        self,
        measured: Array,
        displacement: Array,
        late: Late | None = None,
        onward: Array | float = 0.0,
    ) -> Array:
        """Return the filtered poses (n, 3).

        Args:
            measured: poses seen (n, 3); not a number where a robot was not seen.
            displacement: what commands should have caused since the last frame, (n, 3), m and rad.
            late: robots that stay in their frame, and how much later they were seen. [none]
            onward: what commands should have caused until then, (n, 3).
        """
        moving = self._scale * (GAIN_ERROR * displacement) ** 2
        mean = (self._transition @ self.mean[..., None])[..., 0]
        mean[..., 0] += displacement
        covariance = self._transition @ self.covariance @ self._transition.T
        covariance[..., 0, 0] += moving
        covariance[..., 1, 1] += self._scale * self._wander
        expected, with_seen = mean[..., 0], covariance[..., 0]  # of what is seen, with the state
        variance = covariance[..., 0, 0] + self._noise
        if late is not None:
            held, after = late.held[:, None, None], late.after[:, None]
            mean = np.where(held, self.mean, mean)
            covariance = np.where(held[..., None], self.covariance, covariance)
            expected = mean[..., 0] + onward + after * mean[..., 1]
            with_seen = covariance[..., 0] + after[..., None] * covariance[..., 1]
            variance = with_seen[..., 0] + after * with_seen[..., 1] + self._noise
            variance += np.maximum(after / self._period, 0.0) * moving
        innovation = measured - expected
        innovation[:, 2] = wrap_angle(innovation[:, 2])
        missed = np.isnan(innovation)
        any_missed = np.count_nonzero(missed)
        gain = with_seen / variance[..., None]
        square = innovation**2 / variance
        self.normalised = innovation / np.sqrt(variance)
        if any_missed:
            innovation, square = np.where(missed, 0.0, innovation), np.where(missed, 1.0, square)
            gain[missed] = 0.0
        self.mean = mean + gain * innovation[..., None]
        self.covariance = covariance - gain[..., :, None] * with_seen[..., None, :]
        growth = np.exp((1 - SCALE_MEMORY) * (np.minimum(square, MAX_INNOVATION) - 1))
        self._scale = np.minimum(np.maximum(self._scale * growth, SCALE_BOUNDS[0]), SCALE_BOUNDS[1])
        self.twist = displacement / self._period + self.mean[..., 1]
        return self.pose


class Tracker:
    """Filter and gate of n robots, and what commands have done since the frame where the filter is.

    Args:
        pose: poses at the start, (n, 3).
        noise: standard deviation of vision, (n, 3), m and rad.
        latency: from a command to its effect, (n, 1) frames.
        period: length of a frame, s.
        gate: of images.

    Attributes:
        filter: behind the present where images are late.
        longest: commands that may have acted in the frame just past.
        pose, twist: at this frame, (n, 3).
        steps: those that the filter made in it; none where it is at the present.
    """

    def __init__(self, pose: Array, noise: Array, latency: Array, period: float, gate: Gate) -> None:
        self.filter, self._gate = KalmanFilter(pose, period, noise), gate
        self._latency, self._period = latency, period
        self._clock = Clock(len(latency), period)
        self.longest = math.ceil(latency.max()) + 1
        self._alike = bool((latency == latency[0]).all())
        self.pose, self.twist = self.filter.pose, self.filter.twist
        self.steps: tuple[Late, ...] = ()

    def update(self, measured: Array, age: Array | None, sent: CommandsInFlight) -> Array:
        """Take in a frame; return the poses (n, 3) that the gate lets pass.

        Args:
            measured: poses seen by vision (n, 3), not a number where a robot was not seen.
            age: how long before this frame that was, (n,) s. [0]
            sent: commands up to the frame before, `late.MOST_FRAMES` more than `longest`.
        """
        measured = self._gate(measured, age)
        if age is not None or np.count_nonzero(self._clock.behind):
            self._late(measured, age, sent)
            return measured
        latency = float(self._latency[0, 0]) if self._alike else self._latency
        self.filter.update(measured, sent.felt(latency) * self._period)
        self.pose, self.twist, self.steps = self.filter.pose, self.filter.twist, ()
        return measured

    def _late(self, measured: Array, age: Array | None, sent: CommandsInFlight) -> None:
        """Take in a frame where robots were seen a while ago, or the filter is behind for that."""
        ages = np.zeros(len(measured)) if age is None else age
        steps = self._clock.steps(ages, ~np.isnan(measured[:, 0]))
        now = self._latency
        for late in steps:
            behind, share = late.behind[:, None], late.after[:, None] / self._period
            displacement = sent.felt(now + behind) * self._period
            onward = share * sent.felt(now + np.maximum(behind - 1, 0.0)) * self._period
            seen = measured if late is steps[-1] else np.full_like(measured, np.nan)
            self.filter.update(seen, displacement, late, onward)
        behind, drift = self._clock.behind[:, None], self.filter.drift
        shares = sent.ahead(now + behind) - sent.ahead(now)
        since = (shares * sent.last(sent.length)).sum(0)
        self.pose = self.filter.pose + (since + behind * drift) * self._period
        self.twist, self.steps = sent.felt(now) + drift, tuple(steps)
