"""The paper's own plant: equation 7, with scripted alpha and an additive disturbance."""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array, Kinematics
from omni_mj.config.faults import Alpha, Kidnap
from omni_mj.config.rows import Row
from omni_mj.config.settings import PERIOD_S, gather
from omni_mj.network.fault_schedule import FaultSchedule
from omni_mj.network.radio import ReceivedCommand
from omni_mj.network.random_streams import Noise, Seed, Stream
from omni_mj.plants import Telemetry


class KinematicPlant:
    """x(k+1) = x(k) + T (alpha u(k) + w(k)) per axis, the dead time being the radio's.

    Args:
        rows: one per robot; they do not meet.
        start: poses at the start, (n, 3).
    """

    geometry: Kinematics | None = None

    def __init__(self, rows: Sequence[Row], start: Array) -> None:
        seeds = [row.noise_seed for row in rows]
        self._low, self._high = (
            gather(rows, f"settings.kinematic.alpha_{end}")[:, None] for end in ("low", "high")
        )
        self._quantile = _AlphaQuantiles(
            gather(rows, "settings.kinematic.alpha_time_s")[:, None], seeds
        )
        self._noise = Noise(
            seeds, Stream.DISTURBANCE, lambda rng, count: rng.uniform(-1, 1, (count, 2))
        )
        self._amplitude = gather(rows, "settings.disturbance.velocity_m_s")[:, None]
        self._pose = np.array(start, float)
        self._twist, self._disturbance = np.zeros((2, *self._pose.shape))
        self._schedule, self._frame = FaultSchedule([row.faults for row in rows], Alpha, Kidnap), 0
        # Alpha where a fault gives it, otherwise not a number, (n, 1)
        self._given: Array | None = None
        self._telemetry = Telemetry.of_no_wheels(
            len(rows), len(rows[0].settings.wheels.azimuths_deg)
        )

    def pose(self) -> Array:
        """See `Plant`."""
        return self._pose

    def twist(self) -> Array:
        """See `Plant`: that of the frame just past."""
        return self._twist

    def advance(self, received: ReceivedCommand) -> dict[int, str]:
        """See `Plant`; what it moves in are world coordinates, whatever the heading."""
        alpha = np.clip(
            self._low + (self._high - self._low) * self._quantile.next(), self._low, self._high
        )
        if (active := self._schedule.update(self._frame)) is not None:
            self._given = np.full((len(alpha), 1), np.nan)
            for row, fault in active.of_kind(Alpha):
                self._given[row] = fault.alpha
            for row, kidnap in active.started(Kidnap):
                self._pose = self._pose.copy()
                self._pose[row] += kidnap.moved
        if self._given is not None:
            alpha = np.where(np.isnan(self._given), alpha, self._given)
        self._frame += 1
        self._disturbance[:, :2] = self._amplitude * self._noise.next()
        self._twist = alpha * received.command + self._disturbance
        self._pose = self._pose + PERIOD_S * self._twist
        return {}

    def telemetry(self) -> Telemetry:
        """See `Plant`: there are no wheels."""
        return self._telemetry


class _AlphaQuantiles:
    """Random numbers (n, 3) a frame, each uniform in [0, 1], with a memory of `time_s` (n, 1) per row.

    Without one, every frame is drawn anew. With one, normal numbers that follow an autoregressive
    process of first order from its stationary distribution on are mapped to uniform ones by their
    distribution function.
    """

    def __init__(self, time_s: Array, seeds: Sequence[Seed]) -> None:
        self._white = Noise(seeds, Stream.ALPHA, lambda rng, count: rng.random((count, 3)))
        self._fresh = Noise(seeds, Stream.ALPHA, lambda rng, count: rng.standard_normal((count, 3)))
        self._slow = time_s > 0
        self._kept = np.exp(-PERIOD_S / np.maximum(time_s, 1e-6))  # nothing, far below a frame
        self._normal: Array | None = None

    def next(self) -> Array:
        """Those of the next frame."""
        white = self._white.next()
        if not self._slow.any():
            return white
        from scipy.special import ndtr

        fresh = self._fresh.next()
        before, self._normal = self._normal, fresh
        if before is not None:
            self._normal = self._kept * before + np.sqrt(1 - self._kept**2) * fresh
        return np.where(self._slow, ndtr(self._normal), white)
