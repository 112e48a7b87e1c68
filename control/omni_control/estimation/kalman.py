"""Filtering of vision by a Kalman filter that knows the commands in flight."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from omni_control.estimation.late import Late
from omni_control.kinematics import FEW, Array, Number, wrap_angle, wrapped

GAIN_ERROR = 0.06  # standard deviation of what a robot does in a frame, over what its commands say
DRIFT_M_S2, DRIFT_RAD_S2 = 0.1, 0.5  # change per square root of a second of what it does besides
DRIFT_TIME_S = 0.5  # after which that is forgotten
SCALE_MEMORY, LARGEST = 0.97, 9.0  # of the innovations by which the process noise is scaled; of one, squared
SCALE_BOUNDS = np.array(0.1), np.array(100.0)  # numpy would have to convert Python's numbers each time

# What is known of each axis of each robot: state, variances, factor of the process noise; what the last frame was like.
POSE, DRIFT, XX, XB, BB, SCALE, TWIST, INNOVATION, VARIANCE = range(9)
WANDER, NOISE = range(2)  # of each axis, for good


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
        state: all that is known, (9, n, 3); another array after each frame.
        axes: what axes are like, (2, n, 3).
        law: numbers of the law, of which the first is the period.
        pose: filtered poses (n, 3); headings count full turns.
        twist: filtered twists (n, 3).
        drift: the part of the twist that commands do not explain, (n, 3).
        sigma: standard deviation of the pose, (n, 3).
        normalised: innovation over its standard deviation (n, 3); not a number for a robot that was not seen.
    """

    def __init__(self, pose: Array, period: float, noise: ArrayLike) -> None:
        state = np.zeros((9, *pose.shape))
        noise = np.maximum(np.asarray(noise, float), (1e-5, 1e-5, 1e-4)) ** 2  # a camera resolves no less
        keep = np.exp(-period / DRIFT_TIME_S)
        self._law = period, float(keep), period**2, float(keep**2)
        self.law = np.array(self._law)
        self.axes = np.empty((2, *pose.shape))
        self.axes[WANDER] = np.array([DRIFT_M_S2, DRIFT_M_S2, DRIFT_RAD_S2]) ** 2 * period
        self.axes[NOISE] = noise
        state[POSE], state[XX], state[SCALE] = pose, noise, 1.0
        state[INNOVATION], state[VARIANCE] = np.nan, 1.0
        self._know(state)
        self._each = self.axes.reshape(2, -1).T.tolist()  # axis of each robot

    @property
    def sigma(self) -> Array:
        """See the class."""
        return np.sqrt(self.state[XX])

    @property
    def normalised(self) -> Array:
        """See the class."""
        return np.asarray(self.state[INNOVATION] / np.sqrt(self.state[VARIANCE]))

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
        t, before, (wander, noise) = self._law[0], self.state, self.axes
        pose, drift, xx, xb, bb, moving = _carried(self._law, before[:SCALE], displacement, before[SCALE], wander)

        expected, with_x, with_b, variance = pose, xx, xb, xx + noise  # of the pose that is seen
        if late is not None:
            held, after = late.held[:, None], late.after[:, None]
            pose, drift, xx, xb, bb = np.where(held, before[:SCALE], (pose, drift, xx, xb, bb))
            expected, with_x, with_b = pose + onward + after * drift, xx + after * xb, xb + after * bb
            variance = with_x + after * with_b + np.maximum(after / t, 0.0) * moving + noise
        innovation = measured - expected
        innovation[:, 2] = wrap_angle(innovation[:, 2])
        surprise, gain_x, gain_b = innovation, with_x / variance, with_b / variance
        missed = np.isnan(innovation)
        if misses := np.count_nonzero(missed):
            surprise = np.where(missed, 0.0, innovation)
            gain_x[missed] = gain_b[missed] = 0.0
        state = np.empty_like(before)
        state[POSE], state[DRIFT], state[XX], state[XB], state[BB] = _corrected(
            pose, drift, xx, xb, bb, surprise, gain_x, gain_b
        )
        if late is not None:
            state[XX] -= gain_x * after * xb
            state[XB] -= gain_x * after * bb
            state[BB] -= gain_b * after * bb
        state[TWIST] = displacement / t + state[DRIFT]
        state[INNOVATION], state[VARIANCE] = innovation, variance
        ratio = np.minimum(surprise**2 / variance, LARGEST)
        if misses:
            ratio[missed] = 1.0
        state[SCALE] = _growth(ratio)
        return self.take(state)

    def _update_few(self, measured: Array, displacement: Array) -> Array:
        """The same number by number, to the same bits."""
        known = *self.state[: SCALE + 1], displacement, measured
        table = np.concatenate(known).reshape(len(known), -1).T.tolist()
        found = [
            filtered(self._law, state, scale, displaced, seen, wander, noise, axis % 3 == 2)
            for axis, ((*state, scale, displaced, seen), (wander, noise)) in enumerate(
                zip(table, self._each, strict=True)
            )
        ]
        return self.take(np.ascontiguousarray(np.array(found).T).reshape(self.state.shape))

    def take(self, state: Array) -> Array:
        """Go on to a `state` (9, n, 3), with the logarithm of its growth in place of the factor of the process noise.

        Returns:
            The filtered poses (n, 3).
        """
        (least, most), scale = SCALE_BOUNDS, state[SCALE]
        np.exp(scale, out=scale)
        scale *= self.state[SCALE]
        np.minimum(np.maximum(scale, least, out=scale), most, out=scale)
        self._know(state)
        return self.pose

    def _know(self, state: Array) -> None:
        """Take the state (9, n, 3) for what is known."""
        self.state = state
        self.pose, self.drift, self.twist = state[POSE], state[DRIFT], state[TWIST]


def filtered(
    law: tuple[float, ...],
    known: Sequence[float],
    scale: float,
    displaced: float,
    seen: float,
    wander: float,
    noise: float,
    turns: bool,
) -> tuple[float, ...]:
    """One axis of one robot after a frame, in the order of `KalmanFilter.state`, for `KalmanFilter.take`.

    Args:
        law: see `KalmanFilter`.
        known: of it before, up to its factor of the process noise.
        scale: that factor.
        displaced: by the commands that acted.
        seen: where, or not a number.
        wander: of its drift.
        noise: variance of what is seen.
        turns: whether it is the heading.
    """
    pose, drift, xx, xb, bb, _ = _carried(law, known, displaced, scale, wander)
    innovation, variance = seen - pose, xx + noise
    if turns and not abs(innovation) < np.pi:
        innovation = float(wrapped(innovation))
    surprise, gain_x, gain_b, ratio = innovation, xx / variance, xb / variance, 1.0
    if innovation != innovation:  # not a number
        surprise = gain_x = gain_b = 0.0
    else:
        ratio = min(surprise * surprise / variance, LARGEST)
    pose, drift, xx, xb, bb = _corrected(pose, drift, xx, xb, bb, surprise, gain_x, gain_b)
    return pose, drift, xx, xb, bb, _growth(ratio), displaced / law[0] + drift, innovation, variance


def _carried(
    law: tuple[float, ...], known: Sequence[Number] | Array, displacement: Number, scale: Number, wander: Number
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


def _growth(ratio: Number) -> Number:
    """Logarithm of how the process noise grows, by innovations over what they should be, squared."""
    return (1 - SCALE_MEMORY) * (ratio - 1)
