"""Filtering of vision by a Kalman filter that knows the commands in flight."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from omni_control.estimation.evidence import Number
from omni_control.estimation.late import Late
from omni_control.kinematics import FEW, Array, wrap_angle

GAIN_ERROR = 0.06  # standard deviation of what a robot does in a frame, over what its commands say
DRIFT_M_S2, DRIFT_RAD_S2 = 0.1, 0.5  # change per square root of a second of what it does besides
DRIFT_TIME_S = 0.5  # after which that is forgotten
SCALE_MEMORY, LARGEST = 0.97, 9.0  # of the innovations by which the process noise is scaled; of one, squared
SCALE_BOUNDS = (0.1, 100.0)


class KalmanFilter:
    """Poses of n robots from what vision reports, given the displacement that their commands should have caused.

    Per axis the state is the position and a drift, the speed at which the robot departs from its commands:

        x(k+1) = x(k) + q(k) + T b(k) + noise of GAIN_ERROR |q|,   b(k+1) = b(k) exp(-T / DRIFT_TIME_S) + noise

    with q the commanded displacement. How much a robot departs differs between plants, so that the process noise is
    scaled until the innovations are as large as the filter says: the normalised innovations squared average 1.

    Args:
        pose: poses at the start, (n, 3).
        period: time between frames, s.
        noise: standard deviation of what vision reports, per axis (3,) or per robot and axis (n, 3), m and rad.

    Attributes:
        pose: filtered poses (n, 3); headings count full turns.
        twist: filtered twists (n, 3).
        drift: the part of the twist that commands do not explain, (n, 3).
        sigma: standard deviation of the pose, (n, 3).
        normalised: innovation over its standard deviation (n, 3); not a number for a robot that was not seen.
    """

    def __init__(self, pose: Array, period: float, noise: ArrayLike) -> None:
        self.pose = np.array(pose, float)
        self.twist, self.drift = np.zeros((2, *self.pose.shape))
        self._period = period
        self._noise = np.maximum(np.asarray(noise, float), (1e-5, 1e-5, 1e-4)) ** 2  # a camera resolves no less
        keep = np.exp(-period / DRIFT_TIME_S)
        self._law = period, float(keep), period**2, float(keep**2)
        self._wander = np.array([DRIFT_M_S2, DRIFT_M_S2, DRIFT_RAD_S2]) ** 2 * period
        self._xx = np.broadcast_to(self._noise, self.pose.shape).copy()
        self._xb, self._bb = np.zeros((2, *self.pose.shape))
        self._scale = np.ones_like(self.pose)
        each = np.broadcast_arrays(self._wander, self._noise, self.pose)[:2]
        self._each = list(zip(*(values.ravel().tolist() for values in each), strict=True))  # axis of each robot
        self._innovation, self._variance = np.full_like(self.pose, np.nan), np.ones_like(self.pose)

    @property
    def sigma(self) -> Array:
        """See the class."""
        return np.sqrt(self._xx)

    @property
    def normalised(self) -> Array:
        """See the class."""
        return np.asarray(self._innovation / np.sqrt(self._variance))

    def update(
        self, measured: Array, displacement: Array, late: Late | None = None, onward: Array | float = 0.0
    ) -> Array:
        """Return the filtered poses (n, 3).

        Args:
            measured: poses seen by vision (n, 3), not a number where a robot was not seen: its pose is carried on.
            displacement: what the commands that acted since the last frame should have caused, (n, 3), m and rad.
            late: which robots stay in the frame where they are, and how much later they were seen. [none, and at once]
            onward: what commands should have caused until then, (n, 3).
        """
        if late is None and len(measured) <= FEW:
            return self._update_few(measured, displacement)
        t, known = self._period, (self.pose, self.drift, self._xx, self._xb, self._bb)
        pose, drift, xx, xb, bb, noise = _carried(self._law, known, displacement, self._scale, self._wander)

        expected, with_x, with_b, variance = pose, xx, xb, xx + self._noise  # of the pose that is seen
        if late is not None:
            held, after = late.held[:, None], late.after[:, None]
            pose, drift = np.where(held, self.pose, pose), np.where(held, self.drift, drift)
            xx, xb, bb = np.where(held, self._xx, xx), np.where(held, self._xb, xb), np.where(held, self._bb, bb)
            expected, with_x, with_b = pose + onward + after * drift, xx + after * xb, xb + after * bb
            variance = with_x + after * with_b + np.maximum(after / t, 0.0) * noise + self._noise
        innovation = measured - expected
        innovation[:, 2] = wrap_angle(innovation[:, 2])
        surprise, gain_x, gain_b = innovation, with_x / variance, with_b / variance
        missed = np.isnan(innovation)
        if misses := np.count_nonzero(missed):
            surprise = np.where(missed, 0.0, innovation)
            gain_x[missed] = gain_b[missed] = 0.0
        corrected = _corrected(pose, drift, xx, xb, bb, surprise, gain_x, gain_b)
        self.pose, self.drift, self._xx, self._xb, self._bb = corrected
        if late is not None:
            self._xx, self._xb = self._xx - gain_x * after * xb, self._xb - gain_x * after * bb
            self._bb = self._bb - gain_b * after * bb
        self.twist = displacement / t + self.drift
        self._innovation, self._variance = innovation, variance
        ratio = np.minimum(surprise**2 / variance, LARGEST)
        if misses:
            ratio[missed] = 1.0
        self._rescale((1 - SCALE_MEMORY) * (ratio - 1))
        return self.pose

    def _update_few(self, measured: Array, displacement: Array) -> Array:
        """The same number by number, to the same bits."""
        state = self.pose, self.drift, self._xx, self._xb, self._bb, displacement, self._scale, measured
        table = np.concatenate(state).reshape(len(state), -1).T.tolist()
        found = []
        for axis, (known, (wander, noise)) in enumerate(zip(table, self._each, strict=True)):
            displaced, scale, seen = known[5:]
            pose, drift, xx, xb, bb, _ = _carried(self._law, known[:5], displaced, scale, wander)
            innovation, variance = seen - pose, xx + noise
            if axis % 3 == 2 and not abs(innovation) < np.pi:
                innovation = float(wrap_angle(innovation))
            missed = innovation != innovation  # not a number
            surprise, gains = (0.0, (0.0, 0.0)) if missed else (innovation, (xx / variance, xb / variance))
            ratio = 1.0 if missed else min(surprise * surprise / variance, LARGEST)
            corrected = _corrected(pose, drift, xx, xb, bb, surprise, *gains)
            twist = displaced / self._period + corrected[1]
            found.append((*corrected, twist, innovation, variance, (1 - SCALE_MEMORY) * (ratio - 1)))
        columns = np.array(found).T.reshape(len(found[0]), *measured.shape)
        self.pose, self.drift, self._xx, self._xb, self._bb, self.twist, self._innovation, self._variance, log = columns
        self._rescale(log)
        return self.pose

    def _rescale(self, log: Array) -> None:
        """Scale the process noise by the exponentials of numbers (n, 3)."""
        least, most = SCALE_BOUNDS
        self._scale = np.minimum(np.maximum(self._scale * np.exp(log), least), most)


def _carried(
    law: tuple[float, ...], known: Sequence[Number], displacement: Number, scale: Number, wander: Number
) -> tuple[Number, ...]:
    """The state after a frame, its variances, and what the displacement adds to them; numbers or arrays alike."""
    pose, drift, xx, xb, bb = known
    t, keep, t_2, keep_2 = law
    uncertain = GAIN_ERROR * displacement
    noise = scale * (uncertain * uncertain)
    ahead = pose + displacement + t * drift
    of_pose = xx + 2 * t * xb + t_2 * bb + noise
    return ahead, keep * drift, of_pose, keep * (xb + t * bb), keep_2 * bb + scale * wander, noise


def _corrected(
    pose: Number, drift: Number, xx: Number, xb: Number, bb: Number, surprise: Number, gain_x: Number, gain_b: Number
) -> tuple[Number, ...]:
    """The state and its variances after a correction."""
    left = 1 - gain_x
    return pose + gain_x * surprise, drift + gain_b * surprise, left * xx, left * xb, bb - gain_b * xb
