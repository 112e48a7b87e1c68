"""The paper's own plant: equation 7, with scripted alpha and an additive disturbance."""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.plants import Telemetry
from omni_mj.randomness import Stream, draw
from omni_mj.settings import PERIOD_S, Settings


class KinematicPlant:
    """x(k+1) = x(k) + T (alpha u(k) + w(k)) per axis, the dead time being the radio's.

    Args:
        settings: sections kinematic and disturbance.
        start: poses at the start, (n, 3).
        seeds: one per robot.
        frames: frames of the run.
    """

    def __init__(self, settings: Settings, start: Array, seeds: list[int], frames: int) -> None:
        low, high = settings.kinematic.alpha_low, settings.kinematic.alpha_high
        self._alpha = draw(seeds, Stream.ALPHA, lambda rng: rng.uniform(low, high, (frames, 3)))
        noise = draw(seeds, Stream.DISTURBANCE, lambda rng: rng.uniform(-1, 1, (frames, 2)))
        self._disturbance = np.pad(settings.disturbance.velocity_m_s * noise, ((0, 0), (0, 0), (0, 1)))
        self._pose = np.array(start, float)

    def pose(self) -> Array:
        """See `Plant`."""
        return self._pose

    def advance(self, frame: int, command: Array) -> None:
        """See `Plant`."""
        self._pose = self._pose + PERIOD_S * (self._alpha[frame] * command + self._disturbance[frame])

    def telemetry(self) -> Telemetry:
        """See `Plant`: there are no wheels."""
        n = len(self._pose)
        return Telemetry(*(np.full((n, 4), np.nan) for _ in range(4)), *(np.full(n, np.nan) for _ in range(2)))
