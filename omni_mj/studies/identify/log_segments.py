"""Cut logs into short segments, whose motions are predicted separately.

All logs are put one after another on a common time axis. One spline then holds the integral of the
inputs of all logs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.studies.identify.robot_logs import (
    MAX_GAP_PERIODS,
    RobotLog,
    has_pose,
    integrate_inputs,
)

SEGMENT_S = 0.75  # duration of a segment
MIN_SEGMENTS = 4  # of all logs together
MIN_SAMPLES = 8  # of a segment
SKIPPED_S = 0.3  # skipped at the start of a log and after a gap: earlier commands are unknown
INITIAL_FIT_S = 0.25  # first part of a segment, to which its initial state is fitted
MIN_FIT_SAMPLES = 6  # of this part
# Poses closer than this are thinned: noise of interpolated poses is not white.
MIN_SAMPLE_PERIOD_S = 0.01
LOG_SPACING_S = 10.0  # between logs on the common time axis


@dataclass(frozen=True, eq=False)
class LogSegments:
    """S segments of m samples.

    Attributes:
        source: "wheels", whose inputs are speeds in rad/s, or "commands", twists in m/s and rad/s.
        period: Median time between samples, s.
        input_integral: Integral of the inputs of all logs, (K,), as a function of time.
        time: Times of the samples on the common time axis, (S, m) s.
        pose: Measured poses, world frame, (S, m, 3).
        in_body: Whether twists are in the body frame, (S,).
        noise_floor: Standard deviation by the steps of measured poses, m, m and rad, (3,).
    """

    source: str
    period: float
    input_integral: BSpline
    time: Array
    pose: Array
    in_body: np.ndarray
    noise_floor: Array

    def __len__(self) -> int:
        return len(self.time)

    def select(self, mask: np.ndarray) -> "LogSegments":
        """Return the segments that a boolean mask (S,) selects."""
        return replace(self, time=self.time[mask], pose=self.pose[mask], in_body=self.in_body[mask])

    def compute_mean_inputs(self, delay: Array, substeps: int) -> tuple[Array, Array]:
        """Return the mean inputs and durations of all integration steps.

        Args:
            delay: Delays of the inputs, (P,) s.
            substeps: Integration steps from one sample to the next.

        Returns:
            Mean inputs of q = substeps (m - 1) steps, (S, P, q, K), and durations of the steps,
            (S, q) s.
        """
        m = self.time.shape[1]
        step_indices = np.linspace(0, m - 1, substeps * (m - 1) + 1)
        step_times = make_interp_spline(np.arange(m), self.time.T, k=1)(step_indices).T
        duration = np.diff(step_times)
        input_times = step_times[:, None] - delay[:, None]
        # Inputs before the first log are unknown and taken as zero.
        integral = self.input_integral(np.maximum(input_times, 0.0))
        return np.diff(integral, axis=2) / duration[:, None, :, None], duration

    def estimate_initial_states(self) -> Array:
        """Return pose, velocity and acceleration at the first sample, by a parabola, (S, 3, 3)."""
        n = max(MIN_FIT_SAMPLES, round(INITIAL_FIT_S / self.period))
        time = self.time[:, :n] - self.time[:, :1]
        coefficients = [
            np.polyfit(t, pose, 2)[::-1] for t, pose in zip(time, self.pose[:, :n], strict=True)
        ]
        # The acceleration of a parabola is twice its last coefficient.
        return np.array(coefficients) * [[1], [1], [2]]


def cut_segments(logs: Sequence[RobotLog], source: str) -> LogSegments:
    """Cut logs into segments without gaps.

    Args:
        logs: Logs with poses; at least one.
        source: Source of the inputs, "wheels" or "commands".

    Raises:
        OmniError: There are too few segments.
    """
    pose_lines = []
    for log in logs:
        lines = np.flatnonzero(has_pose(log.pose))
        pose_lines.append(
            lines[:: max(1, int(MIN_SAMPLE_PERIOD_S / np.median(np.diff(log.time[lines]))))]
        )
    intervals = [np.diff(log.time[lines]) for log, lines in zip(logs, pose_lines, strict=True)]
    period = float(np.median(np.concatenate(intervals)))
    m = max(MIN_SAMPLES, round(SEGMENT_S / period))
    times = list[Array]()
    segments = list[tuple[Array, Array, bool]]()
    for log, lines in zip(logs, pose_lines, strict=True):
        start = times[-1][-1] + LOG_SPACING_S if times else 0.0
        time = log.time - log.time[0] + start
        times.append(time)
        gaps = np.flatnonzero(np.diff(time[lines]) > MAX_GAP_PERIODS * period)
        for piece in np.split(lines, gaps + 1):
            usable = piece[time[piece] >= time[piece[0]] + SKIPPED_S]
            for i in range(0, len(usable) - m + 1, m):
                samples = usable[i : i + m]
                if np.ptp(log.pose[samples], axis=0).any():  # a rest without noise tells nothing
                    segments.append((time[samples], log.pose[samples], log.in_body))
    if len(segments) < MIN_SEGMENTS:
        raise OmniError(
            f"{len(segments)} segments of {SEGMENT_S:g} s without a gap are too few to identify "
            f"anything; at least {MIN_SEGMENTS} are needed"
        )
    inputs = np.concatenate([log.inputs[source] for log in logs])
    integral = integrate_inputs(np.concatenate(times), inputs)
    time, pose, in_body = map(np.array, zip(*segments, strict=True))
    # Errors of rounding are equally distributed over a step.
    noise_floor = np.max([log.pose_steps for log in logs], axis=0) / 12**0.5
    return LogSegments(source, period, integral, time, pose, in_body, noise_floor)
