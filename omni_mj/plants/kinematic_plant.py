"""The plant `kinematic`: equation 7 of the paper, with random alpha and disturbance."""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array, Kinematics
from omni_mj.config import PERIOD_S
from omni_mj.config.faults import Alpha, Kidnap
from omni_mj.config.rows import Row
from omni_mj.config.settings import gather
from omni_mj.network.fault_schedule import FaultSchedule
from omni_mj.network.radio import ReceivedCommand
from omni_mj.network.random_streams import Noise, Seed, Stream
from omni_mj.plants.telemetry import Telemetry


class KinematicPlant:
    """Robots that move by x(k+1) = x(k) + T (alpha u(k) + w(k)) per axis, equation 7 of the paper.

    x is the pose, T the frame of 1/60 s, u the received command, alpha the ratio of achieved to
    commanded velocity, and w a velocity disturbance. The radio adds the dead time. Alpha is random
    within its limits unless a fault sets it.

    Args:
        rows: One per robot; robots do not collide.
        start_poses: Poses at the start, world frame, (n, 3) m, m, rad.
    """

    geometry: Kinematics | None = None

    def __init__(self, rows: Sequence[Row], start_poses: Array) -> None:
        seeds = [row.noise_seed for row in rows]
        self._quantiles = _AlphaQuantiles(
            gather(rows, "settings.kinematic.alpha_correlation_time_s")[:, None], seeds
        )
        self._disturbance_noise = Noise(seeds, Stream.DISTURBANCE, 2)
        self._pose = np.array(start_poses, float)
        self._twist = np.zeros(self._pose.shape)
        self._disturbance = np.zeros(self._pose.shape)
        self._frame = 0
        self.change_rows(rows)
        # Alpha that faults set, (n, 1), NaN for rows without such a fault
        self._fault_alpha = np.full((len(rows), 1), np.nan)
        n_wheels = len(rows[0].settings.wheels.azimuths_deg)
        self._telemetry = Telemetry.without_wheels(len(rows), n_wheels)

    def change_rows(self, rows: Sequence[Row]) -> None:
        """Change bounds of alpha, disturbance and faults from the next frame on."""
        self._alpha_low, self._alpha_high = (
            gather(rows, f"settings.kinematic.alpha_{end}")[:, None] for end in ("low", "high")
        )
        self._amplitude = gather(rows, "settings.disturbance.velocity_m_s")[:, None]
        self._schedule = FaultSchedule([row.faults for row in rows])

    def pose(self) -> Array:
        """See `Plant`."""
        return self._pose

    def twist(self) -> Array:
        """See `Plant`. The twist is that of the latest frame."""
        return self._twist

    def advance(self, received: ReceivedCommand) -> dict[int, str]:
        """See `Plant`. Commands are velocities in the world frame, independent of the heading."""
        alpha_range = self._alpha_high - self._alpha_low
        alpha = np.clip(
            self._alpha_low + alpha_range * self._quantiles.draw(),
            self._alpha_low,
            self._alpha_high,
        )
        self._apply_faults()
        alpha = np.where(np.isnan(self._fault_alpha), alpha, self._fault_alpha)
        self._disturbance[:, :2] = self._amplitude * (2 * self._disturbance_noise.next() - 1)
        self._twist = alpha * received.command + self._disturbance
        self._pose = self._pose + PERIOD_S * self._twist
        self._frame += 1
        return {}

    def telemetry(self) -> Telemetry:
        """See `Plant`. All quantities are NaN, because there are no wheels."""
        return self._telemetry

    def _apply_faults(self) -> None:
        """Set alpha and displace robots by the faults that begin or end in this frame."""
        if not self._schedule.advance(self._frame):
            return
        self._fault_alpha[:] = np.nan
        for row, fault in self._schedule.list_active(Alpha):
            self._fault_alpha[row] = fault.alpha
        for row, kidnap in self._schedule.list_active(Kidnap):
            if kidnap.frame_span[0] == self._frame:
                self._pose = self._pose.copy()
                self._pose[row] += kidnap.displacement


class _AlphaQuantiles:
    """Random numbers, each uniform in [0, 1], with a correlation time per row.

    If the correlation time is zero, the numbers of each frame are independent. Otherwise normal
    numbers follow the stationary autoregressive process z(k+1) = c z(k) + sqrt(1 - c^2) e(k) with
    the correlation c from frame to frame. Their distribution function maps them to uniform ones.

    Args:
        correlation_time_s: Time in which the correlation falls to 1 / e, (n, 1) s.
        seeds: One per row.
    """

    def __init__(self, correlation_time_s: Array, seeds: Sequence[Seed]) -> None:
        self._uniform = Noise(seeds, Stream.ALPHA, 3)
        self._normal = Noise(seeds, Stream.ALPHA, 3, "standard_normal")
        self._is_correlated = correlation_time_s > 0
        # Correlation from frame to frame, 1; 0 for correlation times far below a frame
        self._correlation = np.exp(-PERIOD_S / np.maximum(correlation_time_s, 1e-6))
        self._process = self._normal.next()

    def draw(self) -> Array:
        """Return the numbers of the next frame, (n, 3)."""
        uniform = self._uniform.next()
        if not self._is_correlated.any():
            return uniform
        from scipy.special import ndtr

        quantiles = np.where(self._is_correlated, ndtr(self._process), uniform)
        innovation = np.sqrt(1 - self._correlation**2) * self._normal.next()
        self._process = self._correlation * self._process + innovation
        return quantiles
