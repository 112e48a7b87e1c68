"""The paper's own plant: equation 7, with scripted alpha and an additive disturbance."""

from collections.abc import Sequence
from dataclasses import fields
from itertools import pairwise

import numpy as np
from scipy.special import ndtr

from omni_control.kinematics import Array
from omni_mj.link.noise import Stream, draw
from omni_mj.link.radio import Received
from omni_mj.plants import Telemetry
from omni_mj.scenarios.settings import PERIOD_S, Settings, column

_SINGLE = ("duty_peak", "voltage_peak", "current_peak", "battery")  # one value per robot, not per wheel


class KinematicPlant:
    """x(k+1) = x(k) + T (alpha u(k) + w(k)) per axis, the dead time being the radio's.

    Args:
        settings: one per robot.
        start: poses at the start, (n, 3).
        seeds: one per robot.
        frames: frames of the run.
    """

    def __init__(self, settings: Sequence[Settings], start: Array, seeds: list[int], frames: int) -> None:
        kinematic = [s.kinematic for s in settings]
        low, high = column(kinematic, "alpha_low"), column(kinematic, "alpha_high")
        quantile = _alpha_quantiles(column(kinematic, "alpha_time_s"), seeds, frames)
        self._alpha = np.clip(low + (high - low) * quantile, low, high)
        noise = draw(seeds, Stream.DISTURBANCE, lambda rng: rng.uniform(-1, 1, (frames, 2)))
        amplitude = column([s.disturbance for s in settings], "velocity_m_s")
        self._disturbance = np.pad(amplitude * noise, ((0, 0), (0, 0), (0, 1)))
        self._pose = np.array(start, float)
        self._twist = np.zeros_like(self._pose)

    def pose(self) -> Array:
        """See `Plant`."""
        return self._pose

    def twist(self) -> Array:
        """See `Plant`: that of the frame just past."""
        return self._twist

    def advance(self, frame: int, received: Received) -> None:
        """See `Plant`; what it moves in are world coordinates, whatever the heading."""
        self._twist = self._alpha[frame] * received.command + self._disturbance[frame]
        self._pose = self._pose + PERIOD_S * self._twist

    def telemetry(self) -> Telemetry:
        """See `Plant`: there are no wheels."""
        nothing = np.full((len(self._pose), 4), np.nan)
        return Telemetry(**{f.name: nothing[:, 0] if f.name in _SINGLE else nothing for f in fields(Telemetry)})


def _alpha_quantiles(time_s: Array, seeds: list[int], frames: int) -> Array:
    """Random numbers (frames, n, 3), each uniform in [0, 1], with a memory of `time_s` (n, 1) per robot.

    Without one, every frame is drawn anew. With one, normal numbers that follow an autoregressive process of first
    order from its stationary distribution on are mapped to uniform ones by their distribution function.
    """
    white = draw(seeds, Stream.ALPHA, lambda rng: rng.random((frames, 3)))
    slow = time_s > 0
    if not slow.any():
        return white
    kept = np.exp(-PERIOD_S / np.maximum(time_s, 1e-6))  # nothing, far below a frame
    fresh = np.sqrt(1 - kept**2)
    normal = draw(seeds, Stream.ALPHA, lambda rng: rng.standard_normal((frames, 3)))
    for before, now in pairwise(normal):
        now[:] = kept * before + fresh * now
    return np.where(slow, ndtr(normal), white)
