"""Logs cut into short stretches that are predicted one by one, all on one time line."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from omni_control.kinematics import Array
from omni_mj.studies.identify.logs import Log

SEGMENT_S = 0.75
SETTLED_S = 0.3  # after the start of a log and each gap: commands from before it are not known
APART_S = 10.0  # between logs on the common time line
COARSEST_S = 1 / 100  # step in which the law is solved


@dataclass(frozen=True)
class Segments:
    """S stretches of at most m lines, on a time line on which all logs follow each other.

    Attributes:
        clock: of all lines, (F,) s, increasing.
        inputs: that act until the next line, (F, K): speeds of wheels in rad/s, or twists in m/s and rad/s.
        summed: what they add up to from the first line on, (F, K).
        wheels: whether inputs are speeds of wheels.
        in_body: of twists, whether along the body's axes, of each stretch (S,).
        first: of each stretch, the first line whose input is known, (S,).
        lines: line of each sample (S, m), the last repeated where a stretch is shorter.
        there: which of them are samples with a pose, (S, m).
        position: (S, m) complex, m.
        angle: heading as measured, (S, m) rad.
        log: number of the log that each is of, (S,).
        begins: first line of each log.
        middle: time in the middle of each log, s.
        period: the median, s.
    """

    clock: Array
    inputs: Array
    summed: Array
    wheels: bool
    in_body: np.ndarray
    first: np.ndarray
    lines: np.ndarray
    there: np.ndarray
    position: np.ndarray
    angle: Array
    log: np.ndarray
    begins: np.ndarray
    middle: Array
    period: float

    def __len__(self) -> int:
        return len(self.lines)

    @property
    def time(self) -> Array:
        """Of each sample, (S, m) s."""
        return self.clock[self.lines]

    def some(self, which: np.ndarray) -> "Segments":
        """Those that are named by their numbers, or by a mask."""
        kept = {
            name: getattr(self, name)[which]
            for name in ("in_body", "first", "lines", "there", "position", "angle", "log")
        }
        return replace(self, **kept)

    def held_out(self) -> tuple["Segments", "Segments"]:
        """The first three quarters of each log's, and the last, which is not fitted to."""
        last = np.zeros(len(self), bool)
        for log in np.unique(self.log):
            own = np.flatnonzero(self.log == log)
            last[own[len(own) - len(own) // 4 :]] = True
        return self.some(~last), self.some(last)

    def means(self, late: Array, drift: Array, parts: int) -> tuple[Array, Array]:
        """Mean inputs of each step (S, P, q, K), and its duration (S, q) s; a sample has `parts` steps.

        Args:
            late: by how much inputs act late (S, P), s.
            drift: by which share of the time since the middle of the log they do so besides, (P,).
            parts: steps from a sample to the next.
        """
        time, clock = self.time, self.clock
        edges = time
        if parts > 1:
            share = np.arange(1, parts + 1) / parts
            inner = time[:, :-1, None] + np.diff(time)[..., None] * share
            edges = np.concatenate([time[:, :1], inner.reshape(len(time), -1)], 1)
        duration = np.diff(edges)
        middle = self.middle[self.log][:, None]
        found: dict[bytes, Array] = {}
        means = []
        for p in range(late.shape[1]):
            key = late[:, p].tobytes() + drift[p].tobytes()
            if key not in found:
                at = edges - late[:, p, None] - drift[p] * (edges - middle)
                line = np.clip(np.searchsorted(clock, at, side="right") - 1, self.first[:, None], len(clock) - 1)
                total = self.summed[line] + (at - clock[line])[..., None] * self.inputs[line]
                found[key] = np.diff(total, axis=1) / np.maximum(duration, 1e-9)[..., None]
            means.append(found[key])
        return np.stack(means, 1), duration


def cut(logs: Sequence[Log], inputs: Sequence[Array], in_body: Sequence[bool], wheels: bool = False) -> Segments:
    """Segments of logs.

    Args:
        logs: at least one.
        inputs: what is thought to act until the next line, (F, K) of each: twists, or speeds of wheels.
        in_body: whether twists are along the axes of the body, of each.
        wheels: whether inputs are speeds of wheels.
    """
    clock, start = list[Array](), 0.0
    first, lines, whose, offset = list[int](), list[np.ndarray](), list[int](), 0
    for number, log in enumerate(logs):
        clock.append(log.time - log.time[0] + start)
        for piece in log.pieces():
            time = log.time[piece]
            inside = np.flatnonzero(time >= time[0] + SETTLED_S)
            if inside.size < 2:
                continue
            count = max(1, round((time[-1] - time[inside[0]]) / SEGMENT_S))
            edges = time[inside[0]] + np.arange(count + 1) * SEGMENT_S
            for a, b in pairwise(edges):
                own = np.flatnonzero((time >= a - 1e-9) & (time < b - 1e-9))
                poses = np.isfinite(log.pose[piece][own]).all(1).sum()
                if poses >= 8 and time[own[-1]] - time[own[0]] > SEGMENT_S / 2:
                    lines.append(offset + piece.start + own)
                    first.append(offset + piece.start)
                    whose.append(number)
        start, offset = clock[-1][-1] + APART_S, offset + len(log.time)
    longest = max(map(len, lines), default=0)
    padded = np.array([np.append(own, np.full(longest - len(own), own[-1])) for own in lines], int)
    padded = padded.reshape(len(lines), longest)
    pose, acting, when = np.concatenate([log.pose for log in logs]), np.concatenate(inputs), np.concatenate(clock)
    real = np.arange(longest) < np.array([len(own) for own in lines], int)[:, None]
    there = np.isfinite(pose).all(1)[padded] & real
    pose = np.nan_to_num(pose)
    steps = np.append(0.0, np.diff(when))[:, None]
    return Segments(
        when,
        acting,
        np.cumsum(steps * np.concatenate([acting[:1], acting[:-1]]), 0),
        wheels,
        np.array(in_body, bool)[whose],
        np.array(first, int),
        padded,
        there,
        (pose[:, 0] + 1j * pose[:, 1])[padded],
        pose[:, 2][padded],
        np.array(whose, int),
        np.cumsum([0, *(len(log.time) for log in logs[:-1])]),
        np.array([(times[0] + times[-1]) / 2 for times in clock]),
        float(np.median([log.period for log in logs])),
    )
