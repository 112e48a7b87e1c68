"""Rise time, overshoot, settling time and steady-state error of a step response."""

from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config.settings import FRAME_RATE_HZ, PERIOD_S

COARSE_BAND_M, FINE_BAND = 0.005, 0.02  # settling bands: distance, and fraction of the step
STEADY_FRAMES = FRAME_RATE_HZ // 2  # at the end, for the steady-state error


class StepMetrics(NamedTuple):
    """Metrics of a step response; NaN for an event that does not occur in the record.

    Attributes:
        rise_time_s: Time from 10 % to 90 % of the step.
        overshoot: Largest excess over the step, fraction of the step.
        settling_5_mm_s: Time from which on the error stays below 5 mm.
        settling_2_percent_s: Time from which on the error stays below 2 % of the step.
        steady_state_error_m: Mean error of the last half second.
    """

    rise_time_s: float = np.nan
    overshoot: float = np.nan
    settling_5_mm_s: float = np.nan
    settling_2_percent_s: float = np.nan
    steady_state_error_m: float = np.nan


def compute_step_metrics(response: Array, step: float) -> StepMetrics:
    """Return the metrics of a step response.

    Args:
        response: Displacement since the step, (frames,) m; the reference steps in the first frame.
        step: Size of the step, m.
    """
    if not np.isfinite(response).all():
        return StepMetrics()
    fraction, error = response / step, np.abs(response - step)
    return StepMetrics(
        rise_time_s=_crossing_time(fraction, 0.9) - _crossing_time(fraction, 0.1),
        overshoot=max(float(fraction.max()) - 1, 0.0),
        settling_5_mm_s=_settling_time(error, COARSE_BAND_M),
        settling_2_percent_s=_settling_time(error, FINE_BAND * abs(step)),
        steady_state_error_m=float(step - response[-STEADY_FRAMES:].mean()),
    )


def _crossing_time(fraction: Array, level: float) -> float:
    """Return the time of the first crossing of a level, interpolated between frames, s."""
    above = np.flatnonzero(fraction >= level)
    if not above.size:
        return np.nan
    frame = int(above[0])
    if frame == 0:
        return 0.0
    excess = float((fraction[frame] - level) / (fraction[frame] - fraction[frame - 1]))
    return PERIOD_S * (frame - excess)


def _settling_time(error: Array, band: float) -> float:
    """Return the time from which on the error stays within a band, s; NaN if it does not."""
    outside = np.flatnonzero(error > band)
    frame = int(outside[-1]) + 1 if outside.size else 0
    return PERIOD_S * frame if frame < len(error) else np.nan
