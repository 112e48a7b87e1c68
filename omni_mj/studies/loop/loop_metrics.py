"""Metrics of a control loop: its step response and its stability margins.

The loop gain is estimated with a disturbance d that is added to the controller's command u, so that
the robot receives u + d. In a linear loop of controller C and plant P, u = -C P (u + d). At each
frequency, the loop gain is L = C P = -u / (u + d), and the robot receives u + d = d / (1 + L).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_control.kinematics import Array
from omni_mj.config import FRAME_RATE_HZ, PERIOD_S
from omni_mj.results.metrics import frames_until_last
from omni_mj.studies.loop.loop_experiment import FREQUENCIES, HARMONICS, PERIOD_FRAMES

Gains = NDArray[np.complex128]
COARSE_BAND_M, FINE_BAND = 0.005, 0.02  # settling bands: distance, and fraction of the step
STEADY_FRAMES = FRAME_RATE_HZ // 2  # last frames, whose mean error is the steady-state error
_N_INTERPOLATED = 2000  # number of frequencies of an interpolated loop gain


class StepMetrics(NamedTuple):
    """Metrics of a step response; NaN for an event that does not occur in the record.

    Attributes:
        rise_time_s: Time from 10 % to 90 % of the step, s.
        overshoot: Largest excess over the step, fraction of the step.
        settling_5_mm_s: Settling time to an error of at most 5 mm, s.
        settling_2_percent_s: Settling time to an error of at most 2 % of the step, s.
        steady_state_error_m: Mean error of the last half second, m.
    """

    rise_time_s: float
    overshoot: float
    settling_5_mm_s: float
    settling_2_percent_s: float
    steady_state_error_m: float


class StabilityMargins(NamedTuple):
    """Stability margins of a loop; NaN for a margin that does not exist.

    Attributes:
        crossover_rad_s: Lowest frequency at which |L| falls below one, rad/s.
        phase_deg: Phase margin: smallest additional phase lag at a crossover that makes the loop
            unstable, degrees.
        delay_s: Delay margin: smallest additional dead time that makes the loop unstable, s.
        gain: Gain margin: smallest factor on the gain that makes the loop unstable.
        sensitivity: Ms, the maximum of |1 / (1 + L)|: largest amplification of a disturbance.
    """

    crossover_rad_s: float
    phase_deg: float
    delay_s: float
    gain: float
    sensitivity: float


def compute_step_metrics(response: Array, step: float) -> StepMetrics:
    """Return the metrics of a step response.

    Args:
        response: Displacement since the step, (frames,) m; the reference steps in the first frame.
        step: Size of the step, m.
    """
    if not np.isfinite(response).all():
        return StepMetrics(*[np.nan] * 5)
    fraction, error = response / step, np.abs(response - step)
    return StepMetrics(
        rise_time_s=_crossing_time(fraction, 0.9) - _crossing_time(fraction, 0.1),
        overshoot=max(float(fraction.max()) - 1, 0.0),
        settling_5_mm_s=_settling_time(error, COARSE_BAND_M),
        settling_2_percent_s=_settling_time(error, FINE_BAND * abs(step)),
        steady_state_error_m=float(step - response[-STEADY_FRAMES:].mean()),
    )


def estimate_loop_gain(command: Array, disturbance: Array) -> Gains:
    """Return L at `FREQUENCIES`, (harmonics,), from cross spectra with the disturbance.

    L = -S_ud / (S_ud + S_dd), with spectra summed over periods and seeds.

    Args:
        command: Command u of the controller over whole periods, (frames, seeds) m/s.
        disturbance: Disturbance d that was added to the command, same shape.
    """
    periods = (
        values.reshape(-1, PERIOD_FRAMES, values.shape[-1]) for values in (command, disturbance)
    )
    u, d = (np.fft.rfft(values, axis=1)[:, HARMONICS] for values in periods)
    with np.errstate(invalid="ignore"):  # NaN of rows that failed
        gains: Gains = -(u * d.conj()).sum((0, 2)) / ((u + d) * d.conj()).sum((0, 2))
    return gains


def interpolate_gains(gains: Gains) -> tuple[Array, Gains]:
    """Interpolate a loop gain on a dense, logarithmic grid of frequencies.

    log |L| is interpolated linearly over log frequency, the phase linearly over frequency.

    Args:
        gains: Loop gain at `FREQUENCIES`, complex, (harmonics,).

    Returns:
        Frequencies (m,) rad/s, and the loop gain at them, (m,).
    """
    fine = np.geomspace(FREQUENCIES[0], FREQUENCIES[-1], _N_INTERPOLATED)
    log_gains = np.log(np.maximum(np.abs(gains), 1e-12))  # a controller may ignore its input
    magnitude = np.exp(np.interp(np.log(fine), np.log(FREQUENCIES), log_gains))
    phase = np.interp(fine, FREQUENCIES, np.unwrap(np.angle(gains)))
    return fine, magnitude * np.exp(1j * phase)


def compute_margins(gains: Gains) -> StabilityMargins:
    """Return the stability margins of a loop with gains (harmonics,) at `FREQUENCIES`."""
    if not np.isfinite(gains).all():
        return StabilityMargins(*[np.nan] * 5)
    fine, curve = interpolate_gains(gains)
    magnitude = np.abs(curve)
    # The number of turns changes where the phase passes -180 degrees plus whole turns.
    turns = np.floor((np.unwrap(np.angle(curve)) / np.pi + 1) / 2)
    crossovers = np.flatnonzero((magnitude[:-1] >= 1) & (magnitude[1:] < 1))
    phase_margins = np.angle(-curve[crossovers])
    at_180_degrees = np.flatnonzero((turns[:-1] != turns[1:]) & (magnitude[:-1] < 1))
    return StabilityMargins(
        crossover_rad_s=_min_or_nan(fine[crossovers]),
        phase_deg=_min_or_nan(np.degrees(phase_margins)),
        delay_s=_min_or_nan(phase_margins / fine[crossovers]),
        gain=_min_or_nan(1 / magnitude[at_180_degrees]),
        sensitivity=float((1 / np.abs(1 + curve)).max()),
    )


def _crossing_time(fraction: Array, level: float) -> float:
    """Return the time of the first crossing of a level, interpolated between frames, s."""
    frame = int(np.argmax(fraction >= level))
    if fraction[frame] < level:
        return np.nan
    if frame == 0:
        return 0.0
    excess = float((fraction[frame] - level) / (fraction[frame] - fraction[frame - 1]))
    return PERIOD_S * (frame - excess)


def _settling_time(error: Array, band: float) -> float:
    """Return the time after which the error stays within a band, s; NaN if it does not."""
    frame = frames_until_last(error > band)
    return PERIOD_S * frame if frame < len(error) else np.nan


def _min_or_nan(values: Array) -> float:
    return float(values.min()) if values.size else np.nan
