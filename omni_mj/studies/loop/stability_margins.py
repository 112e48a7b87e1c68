"""Figures of a loop: its step response, the gain around it, and the margins that this leaves.

With d added behind the controller, which wants u, the robot is sent u + d. In a linear loop of controller C and robot
P, u = -C P (u + d), so that L = C P = -u / (u + d) at each frequency, and what comes of d is 1 / (1 + L) of it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_control.kinematics import Array
from omni_mj.config.settings import FRAME_RATE_HZ, PERIOD_S
from omni_mj.studies.loop.loop_experiment import FREQUENCIES, PERIOD_FRAMES, TONES

Gains = NDArray[np.complex128]
_FINE = 2000  # frequencies between the lowest and the highest, where margins are looked for
WITHIN_M, WITHIN = 0.005, 0.02  # it has settled, coarsely; and finely, a share of the step
STEADY = FRAME_RATE_HZ // 2  # frames at the end whose mean is what it comes to


class StepFigures(NamedTuple):
    """The figures of a step response; NaN for what does not happen while it is watched.

    Attributes:
        rise: From a tenth to nine tenths, s.
        overshoot: How far beyond, share of the step.
        within_5_mm: Time after which the error stays so small, s.
        within_2_percent: The same, s.
        left: Error at the end, mean of the last half second, m.
    """

    rise: float = np.nan
    overshoot: float = np.nan
    within_5_mm: float = np.nan
    within_2_percent: float = np.nan
    left: float = np.nan


class Margins(NamedTuple):
    """How far a loop is from the edge of stability; NaN for what there is none of.

    Attributes:
        crossover: Lowest frequency at which the gain falls through one, rad/s.
        phase: What the phase may lag more at such a frequency, the least of them, degrees.
        delay: What the dead time may be longer, the least of them, s.
        gain: Factor by which the gain may be higher.
        sensitivity: Ms, largest |1 / (1 + L)|: how much the loop amplifies the disturbances that it
            amplifies most.
    """

    crossover: float = np.nan
    phase: float = np.nan
    delay: float = np.nan
    gain: float = np.nan
    sensitivity: float = np.nan


def measure_step(moved: Array, step: float) -> StepFigures:
    """Return the figures of a step response.

    Args:
        moved: Way in answer to it in each frame, the first being that in which the reference jumps,
            (frames,) m.
        step: By which it jumps, m.
    """
    if not np.isfinite(moved).all():
        return StepFigures()
    share, error = moved / step, np.abs(moved - step)
    return StepFigures(
        rise=_reaches(share, 0.9) - _reaches(share, 0.1),
        overshoot=max(float(share.max()) - 1, 0.0),
        within_5_mm=_stays(error, WITHIN_M),
        within_2_percent=_stays(error, WITHIN * abs(step)),
        left=float(step - moved[-STEADY:].mean()),
    )


def _reaches(share: Array, level: float) -> float:
    """Return when it does first, between frames, s; the first frame is below."""
    above = np.flatnonzero(share >= level)
    if not above.size:
        return np.nan
    after = int(above[0])
    return (
        PERIOD_S * (after - float((share[after] - level) / (share[after] - share[after - 1])))
        if after
        else 0.0
    )


def _stays(error: Array, bound: float) -> float:
    """Return when it begins to stay within the bound, s."""
    beyond = np.flatnonzero(error > bound)
    after = int(beyond[-1]) + 1 if beyond.size else 0
    return PERIOD_S * after if after < len(error) else np.nan


def loop_gain(command: Array, disturbance: Array) -> Gains:
    """Return L at `FREQUENCIES`, (tones,): spectra times the disturbance's, summed over periods and seeds.

    Args:
        command: What the controller wants, whole periods, (frames, seeds) m/s.
        disturbance: What is added to it, of the same shape.
    """
    periods = (
        values.reshape(-1, PERIOD_FRAMES, values.shape[-1]) for values in (command, disturbance)
    )
    wanted, added = (np.fft.rfft(values, axis=1)[:, TONES] for values in periods)
    with np.errstate(invalid="ignore"):  # of rows that failed
        gain: Gains = -(wanted * added.conj()).sum((0, 2)) / ((wanted + added) * added.conj()).sum(
            (0, 2)
        )
    return gain


def interpolate(frequency: Array, gain: Gains) -> tuple[Array, Gains]:
    """Return frequencies in between (m,) and L there: log |L| is linear over log w, the phase over w.

    Args:
        frequency: Rising, rad/s (f,).
        gain: Complex, (f,).
    """
    fine = np.geomspace(frequency[0], frequency[-1], _FINE)
    size = np.exp(np.interp(np.log(fine), np.log(frequency), np.log(np.abs(gain))))
    return fine, size * np.exp(1j * np.interp(fine, frequency, np.unwrap(np.angle(gain))))


def find_margins(gain: Gains) -> Margins:
    """Return those of a loop whose complex gains (tones,) are known at `FREQUENCIES`, in between interpolated."""
    if not np.isfinite(gain).all():
        return Margins()
    fine, curve = interpolate(FREQUENCIES, gain)
    size, turns = np.abs(curve), np.floor((np.unwrap(np.angle(curve)) / np.pi + 1) / 2)
    falls = np.flatnonzero((size[:-1] >= 1) & (size[1:] < 1))
    phase = np.angle(-curve[falls])  # from -180 degrees on
    opposed = np.flatnonzero((turns[:-1] != turns[1:]) & (size[:-1] < 1))
    return Margins(
        crossover=_least(fine[falls]),
        phase=_least(np.degrees(phase)),
        delay=_least(phase / fine[falls]),
        gain=_least(1 / size[opposed]),
        sensitivity=float((1 / np.abs(1 + curve)).max()),
    )


def _least(values: Array) -> float:
    return float(values.min()) if values.size else np.nan
