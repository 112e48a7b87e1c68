"""Logs cut into short stretches that are predicted one by one, all on one time line."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.studies.identify.logs import GAP, Log

STRETCH_S = 0.75
LEAST, LEAST_POSES = 4, 8  # stretches, and poses in each
SETTLED_S = 0.3  # after the start of a log and each gap: commands sent before it are unknown
FIRST_S = 0.25  # from which the first pose and twist of a stretch are estimated
APART_S = 10.0  # between logs on the common time line


@dataclass(frozen=True, eq=False)
class Stretches:
    """S stretches of m samples.

    Attributes:
        clock: time of all lines, (F,) s; total: integral of the inputs over it, a line from each to the next.
        are_wheels: whether inputs are wheel speeds in rad/s, else twists in m/s and rad/s.
        in_body: whether twists are along the body's axes, (S,).
        lines: line of each sample, (S, m); all have a pose.
        pose: measured, world frame, (S, m, 3).
        log: number of the log, (S,); name: of the logs.
        begin, middle: times of each log's first line, and of its middle, s.
        period: median time between samples, s.
    """

    clock: Array
    total: BSpline
    are_wheels: bool
    in_body: np.ndarray
    lines: np.ndarray
    pose: Array
    log: np.ndarray
    name: tuple[str, ...]
    begin: Array
    middle: Array
    period: float

    def __len__(self) -> int:
        return len(self.lines)

    @property
    def time(self) -> Array:
        """Time of each sample, (S, m) s."""
        return self.clock[self.lines]

    def where(self) -> list[str]:
        """Return the log and the time since its first line at which each stretch begins."""
        return [f"{self.name[i]} at {t - self.begin[i]:.1f} s" for i, t in zip(self.log, self.time[:, 0], strict=True)]

    def some(self, chosen: np.ndarray) -> "Stretches":
        """Return the stretches of a mask (S,)."""
        fields = ("in_body", "lines", "pose", "log")
        return replace(self, **{name: getattr(self, name)[chosen] for name in fields})

    def means(self, late: Array, drift: Array, parts: int) -> tuple[Array, Array]:
        """Return the mean input of each step (S, P, q, K) and its duration (S, q) in s.

        Args:
            late: delay of the inputs, (P,) s.
            drift: growth of the delay per second since the middle of the log, (P, 1).
            parts: steps from a sample to the next.
        """
        m = self.lines.shape[1]
        edges = make_interp_spline(np.arange(m), self.time.T, k=1)(np.linspace(0, m - 1, parts * (m - 1) + 1)).T
        at = edges[:, None] - late[:, None] - drift * (edges - self.middle[self.log][:, None])[:, None]
        duration = np.diff(edges)
        moved = np.diff(self.total(np.maximum(at, self.clock[0])), axis=2)
        return moved / duration[:, None, :, None], duration

    def first(self) -> Array:
        """Return pose, velocity and acceleration at the first sample, by a parabola through 1/4 s, (S, 3, 3)."""
        near = max(6, round(FIRST_S / self.period))
        time = self.time[:, :near] - self.time[:, :1]
        fits = [np.polyfit(t, pose, 2)[::-1] for t, pose in zip(time, self.pose[:, :near], strict=True)]
        return np.array(fits) * [[1], [1], [2]]


def cut(logs: Sequence[Log], inputs: Sequence[Array], in_body: Sequence[bool], are_wheels: bool) -> Stretches:
    """Cut logs into stretches.

    Args:
        logs: at least one.
        inputs: of each log, each acts until the next line, (F, K): twists, or wheel speeds.
        in_body: whether the twists of each log are along the body's axes.
        are_wheels: whether inputs are wheel speeds.

    Raises:
        OmniError: there are too few.
    """
    valid = [np.flatnonzero(np.isfinite(log.pose).all(1)) for log in logs]
    steps = np.concatenate([np.diff(log.time[of_log]) for log, of_log in zip(logs, valid, strict=True)])
    period = float(np.median(steps)) if steps.size else STRETCH_S
    count = max(LEAST_POSES, round(STRETCH_S / period))
    clock, lines, numbers = list[Array](), list[np.ndarray](), list[int]()
    for number, (log, of_log) in enumerate(zip(logs, valid, strict=True)):
        offset, start = sum(map(len, clock)), clock[-1][-1] + APART_S if clock else 0.0
        clock.append(log.time - log.time[0] + start)
        for piece in np.split(of_log, np.flatnonzero(np.diff(log.time[of_log]) > GAP * period) + 1):
            settled = piece[log.time[piece] >= log.time[piece[:1]] + SETTLED_S]
            blocks = settled[: len(settled) // count * count].reshape(-1, count)
            lines += list(offset + blocks)
            numbers += [number] * len(blocks)
    if len(lines) < LEAST:
        raise OmniError(
            f"{len(lines)} stretches of {STRETCH_S:g} s without a gap are too few to identify anything, "
            f"at least {LEAST} are needed"
        )
    pose, acting, when = np.concatenate([log.pose for log in logs]), np.concatenate(inputs), np.concatenate(clock)
    ends = np.append(when, when[-1] + 1)
    total = np.concatenate([np.zeros((1, acting.shape[1])), np.cumsum(np.diff(ends)[:, None] * acting, 0)])
    return Stretches(
        clock=when,
        total=make_interp_spline(ends, total, k=1),
        are_wheels=are_wheels,
        in_body=np.array(in_body, bool)[numbers],
        lines=np.array(lines),
        pose=pose[lines],
        log=np.array(numbers),
        name=tuple(log.name for log in logs),
        begin=np.array([times[0] for times in clock]),
        middle=np.array([(times[0] + times[-1]) / 2 for times in clock]),
        period=period,
    )
