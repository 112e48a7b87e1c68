"""Cut logs into short segments that are predicted separately, on one common time axis."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.studies.identify.robot_logs import MAX_GAP_PERIODS, RobotLog, integrate_inputs

SEGMENT_S = 0.75  # duration of a segment
MIN_SEGMENTS, MIN_POSES = 4, 8  # of all logs; of a segment
SKIPPED_S = 0.3  # left out after the start of a log and after a gap, where commands are unknown
INITIAL_FIT_S = 0.25  # of a segment, from which its initial state is estimated
LOG_SPACING_S = 10.0  # between logs on the common time axis


@dataclass(frozen=True, eq=False)
class LogSegments:
    """S segments of m samples.

    Attributes:
        are_wheels: Whether inputs are wheel speeds in rad/s, otherwise twists in m/s and rad/s.
        period: Median time between samples, s.
        integral: Integral of the inputs of all logs, as a function of time.
        time: Times of the samples on the common time axis, (S, m) s.
        pose: Measured poses, world frame, (S, m, 3).
        in_body: Whether twists are in the body frame, (S,).
    """

    are_wheels: bool
    period: float
    integral: BSpline
    time: Array
    pose: Array
    in_body: np.ndarray

    def __len__(self) -> int:
        return len(self.time)

    def select(self, mask: np.ndarray) -> "LogSegments":
        """Return the segments that a boolean mask (S,) selects."""
        return replace(self, time=self.time[mask], pose=self.pose[mask], in_body=self.in_body[mask])

    def mean_inputs(self, delay: Array, substeps: int) -> tuple[Array, Array]:
        """Return the mean inputs and durations of all integration steps.

        Args:
            delay: Delays of the inputs, (P,) s.
            substeps: Integration steps from one sample to the next.

        Returns:
            Mean inputs of q steps, (S, P, q, K), and durations of the steps, (S, q) s.
        """
        m = self.time.shape[1]
        edge_indices = np.linspace(0, m - 1, substeps * (m - 1) + 1)
        edges = make_interp_spline(np.arange(m), self.time.T, k=1)(edge_indices).T
        duration = np.diff(edges)
        delayed_edges = edges[:, None] - delay[:, None]
        change = np.diff(self.integral(np.maximum(delayed_edges, 0.0)), axis=2)
        return change / duration[:, None, :, None], duration

    def estimate_initial_states(self) -> Array:
        """Return pose, velocity and acceleration at the first sample, by a parabola, (S, 3, 3)."""
        n = max(6, round(INITIAL_FIT_S / self.period))
        time = self.time[:, :n] - self.time[:, :1]
        coefficients = [
            np.polyfit(t, pose, 2)[::-1] for t, pose in zip(time, self.pose[:, :n], strict=True)
        ]
        return np.array(coefficients) * [[1], [1], [2]]


def cut_segments(
    logs: Sequence[RobotLog], inputs: Sequence[Array], are_wheels: bool
) -> LogSegments:
    """Cut logs into segments without gaps.

    Args:
        logs: At least one log.
        inputs: Twists or wheel speeds of each log, (F, K). Each acts until the next line.
        are_wheels: Whether inputs are wheel speeds.

    Raises:
        OmniError: There are too few segments.
    """
    visible_lines = [np.flatnonzero(np.isfinite(log.pose).all(1)) for log in logs]
    intervals = [np.diff(log.time[i]) for log, i in zip(logs, visible_lines, strict=True)]
    period = float(np.median(np.concatenate(intervals)))
    length = max(MIN_POSES, round(SEGMENT_S / period))
    times, segments = list[Array](), list[tuple[Array, Array, bool]]()
    for log, lines in zip(logs, visible_lines, strict=True):
        start = times[-1][-1] + LOG_SPACING_S if times else 0.0
        time = log.time - log.time[0] + start
        times.append(time)
        gaps = np.flatnonzero(np.diff(time[lines]) > MAX_GAP_PERIODS * period)
        for piece in np.split(lines, gaps + 1):
            usable = piece[time[piece] >= time[piece[:1]] + SKIPPED_S]
            for block in usable[: len(usable) // length * length].reshape(-1, length):
                segments.append((time[block], log.pose[block], log.in_body))
    if len(segments) < MIN_SEGMENTS:
        raise OmniError(
            f"{len(segments)} segments of {SEGMENT_S:g} s without a gap are too few to identify "
            f"anything; at least {MIN_SEGMENTS} are needed"
        )
    integral = integrate_inputs(np.concatenate(times), np.concatenate(inputs))
    time, pose, in_body = map(np.array, zip(*segments, strict=True))
    return LogSegments(are_wheels, period, integral, time, pose, in_body)
