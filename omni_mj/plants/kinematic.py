"""The paper's own plant: equation 7, with scripted alpha and an additive disturbance."""

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from omni_control.kinematics import Array
from omni_mj.plants import Telemetry
from omni_mj.randomness import Stream, draw
from omni_mj.settings import PERIOD_S, Settings, column

_SINGLE = ("voltage_peak", "current_peak", "battery")  # one value per robot, not per wheel


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
        self._alpha = low + (high - low) * draw(seeds, Stream.ALPHA, lambda rng: rng.random((frames, 3)))
        noise = draw(seeds, Stream.DISTURBANCE, lambda rng: rng.uniform(-1, 1, (frames, 2)))
        amplitude = column([s.disturbance for s in settings], "velocity_m_s")
        self._disturbance = np.pad(amplitude * noise, ((0, 0), (0, 0), (0, 1)))
        self._pose = np.array(start, float)

    def pose(self) -> Array:
        """See `Plant`."""
        return self._pose

    def advance(self, frame: int, command: Array, heading: Array) -> None:
        """See `Plant`; what it moves in are world coordinates, whatever the heading."""
        self._pose = self._pose + PERIOD_S * (self._alpha[frame] * command + self._disturbance[frame])

    def telemetry(self) -> Telemetry:
        """See `Plant`: there are no wheels."""
        nothing = np.full((len(self._pose), 4), np.nan)
        return Telemetry(**{f.name: nothing[:, 0] if f.name in _SINGLE else nothing for f in fields(Telemetry)})
