"""Figures of a loop: its step response, the gain around it, and the margins that this leaves.

With d added behind the controller, which wants u, the robot is sent u + d. In a linear loop of controller C and robot
P, u = -C P (u + d), so that L = C P = -u / (u + d) at each frequency, and what comes of d is 1 / (1 + L) of it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S
from omni_mj.studies.loop.motion import FREQUENCIES, PERIOD_FRAMES, TONES

Gains = NDArray[np.complex128]
_FINE = 2000  # frequencies between the lowest and the highest, where margins are looked for
RISE = 0.1, 0.9  # of the step
WITHIN_M, WITHIN = 0.005, 0.02  # it has settled, coarsely; and finely, a share of the step
STEADY = FRAME_RATE_HZ // 2  # frames at the end whose mean is what it comes to


@dataclass(frozen=True)
class Step:
    """The figures of a step response; not a number for what does not happen while it is watched.

    Attributes:
        rise: from a tenth to nine tenths, s.
        overshoot: how far beyond, share of the step.
        within_5_mm, within_2_percent: time after which the error stays so small, s.
        left: error at the end, mean of the last half second, m.
    """

    rise: float
    overshoot: float
    within_5_mm: float
    within_2_percent: float
    left: float


def measure(moved: Array, step: float) -> Step:
    """Find them.

    Args:
        moved: way in answer to it in each frame, the first being that in which the reference jumps, (frames,) m.
        step: by which it jumps, m.
    """
    if not np.isfinite(moved).all():
        return Step(*[float("nan")] * 5)
    share, error = moved / step, np.abs(moved - step)
    start, end = (_reaches(share, each) for each in RISE)
    return Step(
        rise=end - start,
        overshoot=max(float(share.max()) - 1, 0.0),
        within_5_mm=_stays(error, WITHIN_M),
        within_2_percent=_stays(error, WITHIN * abs(step)),
        left=float(step - moved[-STEADY:].mean()),
    )


def _reaches(share: Array, level: float) -> float:
    """When it does first, between frames, s; the first frame is below."""
    above = np.flatnonzero(share >= level)
    if not above.size:
        return float("nan")
    after = int(above[0])
    return PERIOD_S * (after - float((share[after] - level) / (share[after] - share[after - 1]))) if after else 0.0


def _stays(error: Array, bound: float) -> float:
    """When it begins to stay within the bound, s."""
    beyond = np.flatnonzero(error > bound)
    after = int(beyond[-1]) + 1 if beyond.size else 0
    return PERIOD_S * after if after < len(error) else float("nan")


@dataclass(frozen=True)
class Margins:
    """How far a loop is from the edge of stability; not a number for what there is none of.

    Attributes:
        crossover: lowest frequency at which the gain falls through one, rad/s.
        phase: what the phase may lag more at such a frequency, the least of them, degrees.
        delay: what the dead time may be longer, the least of them, s.
        gain: factor by which the gain may be higher.
        sensitivity: Ms, largest |1 / (1 + L)|: how much the loop amplifies the disturbances that it amplifies most.
    """

    crossover: float
    phase: float
    delay: float
    gain: float
    sensitivity: float


def loop_gain(command: Array, disturbance: Array) -> Gains:
    """L at `FREQUENCIES`, complex, (tones,): by spectra crossed with the disturbance's, summed over periods and seeds.

    Args:
        command: what the controller wants, whole periods, (frames, seeds) m/s.
        disturbance: what is added to it, of the same shape.
    """
    wanted, added = _spectra(command), _spectra(disturbance)
    crossed = (wanted * added.conj()).sum((0, 1)), ((wanted + added) * added.conj()).sum((0, 1))
    with np.errstate(invalid="ignore"):  # of rows that failed
        gain: Gains = -crossed[0] / crossed[1]
    return gain


def _spectra(values: Array) -> Gains:
    """Of each period, (periods, seeds, tones)."""
    periods = values.reshape(-1, PERIOD_FRAMES, values.shape[-1])
    found: Gains = np.fft.rfft(periods, axis=1)[:, TONES].swapaxes(1, 2)
    return found


def curve(frequency: Array, gain: Gains) -> tuple[Array, Gains]:
    """L at frequencies in between (m,): log |L| is linear over log w and the phase over w, as of integrator and delay.

    Args:
        frequency: rising, rad/s (f,).
        gain: complex, (f,).
    """
    fine = np.geomspace(frequency[0], frequency[-1], _FINE)
    size = np.exp(np.interp(np.log(fine), np.log(frequency), np.log(np.abs(gain))))
    return fine, size * np.exp(1j * np.interp(fine, frequency, np.unwrap(np.angle(gain))))


def margins(gain: Gains, frequency: Array = FREQUENCIES) -> Margins:
    """Those of a loop of which complex gains (f,) are known at frequencies (f,), rad/s, in between interpolated."""
    nan = float("nan")
    if not np.isfinite(gain).all():
        return Margins(nan, nan, nan, nan, nan)
    fine, found = curve(frequency, gain)
    size, lag = np.abs(found), np.unwrap(np.angle(found))
    falls = np.flatnonzero((size[:-1] >= 1) & (size[1:] < 1))
    phase = np.angle(-found[falls])  # from -180 degrees on
    turns = np.floor((lag / np.pi + 1) / 2)
    opposed = np.flatnonzero((turns[:-1] != turns[1:]) & (size[:-1] < 1))
    return Margins(
        crossover=float(fine[falls[0]]) if falls.size else nan,
        phase=float(np.degrees(phase.min())) if falls.size else nan,
        delay=float((phase / fine[falls]).min()) if falls.size else nan,
        gain=float((1 / size[opposed]).min()) if opposed.size else nan,
        sensitivity=float((1 / np.abs(1 + found)).max()),
    )


def differs(gain: Gains, other: Gains) -> float:
    """By how much two gains (tones,) of a loop differ: root mean square of the change of 1 + L, over 1 + L."""
    with np.errstate(invalid="ignore"):
        return float(np.sqrt((np.abs((other - gain) / (1 + gain)) ** 2).mean()))
