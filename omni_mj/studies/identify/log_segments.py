"""Logs cut into short stretches that are predicted one by one, all on one time line."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.studies.identify.robot_logs import GAP, RobotLog, integrate

STRETCH_S = 0.75
LEAST, LEAST_POSES = 4, 8  # stretches, and poses in each
SETTLED_S = 0.3  # after the start of a log and each gap: commands sent before it are unknown
FIRST_S = 0.25  # from which the first pose and twist of a stretch are estimated
APART_S = 10.0  # between logs on the common time line


@dataclass(frozen=True, eq=False)
class Stretches:
    """S stretches of m samples.

    Attributes:
        are_wheels: Whether inputs are wheel speeds in rad/s, else twists in m/s and rad/s.
        period: Median time between samples, s.
        total: Integral of the inputs over time, which begins at 0.
        time: Of each sample, (S, m) s.
        pose: Measured, world frame, (S, m, 3).
        in_body: Whether twists are along the body's axes, (S,).
    """

    are_wheels: bool
    period: float
    total: BSpline
    time: Array
    pose: Array
    in_body: np.ndarray

    def __len__(self) -> int:
        return len(self.time)

    def select(self, mask: np.ndarray) -> "Stretches":
        """Return the stretches of a mask (S,)."""
        return replace(self, time=self.time[mask], pose=self.pose[mask], in_body=self.in_body[mask])

    def mean_inputs(self, late: Array, parts: int) -> tuple[Array, Array]:
        """Return the mean input of each step (S, P, q, K) and its duration (S, q) in s.

        Args:
            late: Delay of the inputs, (P,) s.
            parts: Steps from a sample to the next.
        """
        m = self.time.shape[1]
        edges = make_interp_spline(np.arange(m), self.time.T, k=1)(
            np.linspace(0, m - 1, parts * (m - 1) + 1)
        ).T
        duration, at = np.diff(edges), edges[:, None] - late[:, None]
        return np.diff(self.total(np.maximum(at, 0.0)), axis=2) / duration[
            :, None, :, None
        ], duration

    def estimate_first(self) -> Array:
        """Return pose, velocity and acceleration at the first sample, by a parabola, (S, 3, 3)."""
        near = max(6, round(FIRST_S / self.period))
        time = self.time[:, :near] - self.time[:, :1]
        fits = [
            np.polyfit(t, pose, 2)[::-1] for t, pose in zip(time, self.pose[:, :near], strict=True)
        ]
        return np.array(fits) * [[1], [1], [2]]


def cut(logs: Sequence[RobotLog], inputs: Sequence[Array], are_wheels: bool) -> Stretches:
    """Cut logs into stretches.

    Args:
        logs: At least one.
        inputs: Twists or wheel speeds of each log; each acts until the next line, (F, K).
        are_wheels: Whether inputs are wheel speeds.

    Raises:
        OmniError: There are too few.
    """
    seen = [np.flatnonzero(np.isfinite(log.pose).all(1)) for log in logs]
    period = float(
        np.median(np.concatenate([np.diff(log.time[s]) for log, s in zip(logs, seen, strict=True)]))
    )
    count = max(LEAST_POSES, round(STRETCH_S / period))
    clocks, rows = list[Array](), list[tuple[Array, Array, bool]]()
    for log, lines in zip(logs, seen, strict=True):
        clock = log.time - log.time[0] + (clocks[-1][-1] + APART_S if clocks else 0.0)
        clocks.append(clock)
        for piece in np.split(lines, np.flatnonzero(np.diff(clock[lines]) > GAP * period) + 1):
            settled = piece[clock[piece] >= clock[piece[:1]] + SETTLED_S]
            for block in settled[: len(settled) // count * count].reshape(-1, count):
                rows.append((clock[block], log.pose[block], log.in_body))
    if len(rows) < LEAST:
        raise OmniError(
            f"{len(rows)} stretches of {STRETCH_S:g} s without a gap are too few to identify anything, "
            f"at least {LEAST} are needed"
        )
    total = integrate(np.concatenate(clocks), np.concatenate(inputs))
    return Stretches(are_wheels, period, total, *map(np.array, zip(*rows, strict=True)))
