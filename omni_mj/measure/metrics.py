"""What is measured of each row: errors, effort, settling, peaks, causes, recovery; and the motor correction factor."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from omni_control.kinematics import Array
from omni_mj.measure import causes, recovery
from omni_mj.measure.errors import AXES, UNITS, errors
from omni_mj.measure.running import Effort, ErrorStatistics
from omni_mj.measure.way import Way
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.simulate.log import FIRST_FRAMES, Log

if TYPE_CHECKING:
    from omni_mj.simulate.simulation import Failure

BLOCK_FRAMES = FIRST_FRAMES  # that are measured at once: a log grows no more
PEAKS = {"peak_voltage_v": "voltage_peak", "peak_current_a": "current_peak", "peak_winding_c": "winding"}
ALPHA_AXES = ("x", "y")
ALPHA_WINDOW_FRAMES = 15  # 0.25 s
ALPHA_MIN_SPEED_M_S = 0.1  # below this mean commanded speed a window's ratio is mostly noise
ALPHA_PERCENTILES = (5, 50, 95)
ALPHA_START_FRAMES = 9  # 0.15 s: the lag of a robot's wheels and their creep, in which it has not answered yet
SETTLED_M = 0.01


class Tally:
    """What is measured of rows whose frames come in blocks: the same numbers, to the bit, however they are cut.

    It holds a few numbers a row, of the errors the largest 1 %, and the ways, but no frames.

    Args:
        rows: one per robot.
        ways: the timed reference of each row; of those that share one, the same object.
    """

    def __init__(self, rows: Sequence[Row], ways: Sequence[Way]) -> None:
        n, frames = len(rows), max((way.frames for way in ways), default=0)
        self.frames = 0
        self._ways = ways
        shared = {id(way): way for way in ways if way.frames}
        self._travel = [(way, [row for row, each in enumerate(ways) if each is way]) for way in shared.values()]
        self._lengths = np.zeros(n, int)
        self._errors = {axis: ErrorStatistics(n, frames) for axis in AXES}
        self._effort = Effort((n, 2))
        self._near = np.zeros(n, int)  # the frame after the last one that is not near
        self._peaks = {name: np.full(n, np.nan) for name in PEAKS}
        self._shares, self._recoveries = causes.Shares(rows), recovery.Recoveries(rows)

    def add(self, block: Log) -> None:
        """Go on with the frames that follow those so far, a log of these alone."""
        if not block.length:
            return
        error = errors(block, self._direction(block.length))
        for axis, statistics in self._errors.items():
            statistics.add(error[axis], self.frames)
        self._effort.add(block.channel("command")[..., :2])
        number = self.frames + np.arange(1, block.length + 1)[:, None]
        far = np.where(error["distance"] >= SETTLED_M, number, 0)
        self._near = np.maximum(self._near, far.max(0))
        for name, channel in PEAKS.items():
            peak = np.fmax.reduce(block.channel(channel), axis=(0, 2))
            self._peaks[name] = np.fmax(self._peaks[name], peak)
        self._shares.add(block)
        self._recoveries.add(error["distance"], self.frames)
        self._lengths += block.lengths
        self.frames += block.length

    def row_metrics(self, failures: "Iterable[Failure]" = ()) -> dict[str, Array]:
        """Each row in single numbers, name -> (n,), once all frames are there; see `row_metrics`.

        Args:
            failures: of rows that were stopped before their end.
        """
        failed = [failure.row for failure in failures]
        found = {
            f"{axis}_{statistic}_{UNITS[axis]}": values
            for axis, statistics in self._errors.items()
            for statistic, values in statistics.value.items()
        }
        found["effort_m_s2"] = self._effort.value
        found["excess_effort_m_s2"] = self._excess_effort()
        found["settle_s"] = self._settling_times()
        unbounded = set(found)
        found["greatest_at_s"] = self._errors["distance"].greatest_at_s
        found |= {name: peak.copy() for name, peak in self._peaks.items()} | self._shares.value
        for name, values in found.items():
            values[self._lengths == 0] = np.nan
            values[failed] = np.inf if name in unbounded else np.nan
        return found | self._recoveries.value(failed)

    def _direction(self, frames: int) -> Array:
        """In which the references travel in the next frames, (frames, n, 2); any for rows that have none any more."""
        direction = np.zeros((frames, len(self._ways), 2))
        number = np.arange(self.frames, self.frames + frames)
        for way, rows in self._travel:
            direction[:, rows] = way.direction.take(number, axis=0, mode="clip")[:, None]
        return direction

    def _excess_effort(self) -> Array:
        """What the effort is above that of the reference's own velocities, as a root of the squares' difference, m/s^2.

        Squares, since that of a command is the reference's plus that of all that is added to it, as far as the two are
        unrelated. It compares no frame with another, so that it is the same however early a controller sends what the
        reference needs; a difference frame by frame would depend on a dead time and a lag that controllers believe in
        each their own way. Who asks for less than the reference has none: zero for the reference's own velocities,
        whenever they are sent.
        """
        own = np.array([way.effort_square for way in self._ways])
        excess: Array = np.sqrt(np.maximum(self._effort.square - own, 0.0))
        return excess

    def _settling_times(self) -> Array:
        """Time from the end of the reference's last move until the error in the plane stays below 1 cm, (n,) s.

        Zero for a robot that is that near from the end of the move on, infinite for one that is not in its last frame:
        it never settles.
        """
        rest = np.array([way.rest for way in self._ways], int)
        return np.where(self._near < self._lengths, np.maximum(self._near - rest, 0) * PERIOD_S, np.inf)


def row_metrics(log: Log, failures: "Iterable[Failure]" = ()) -> dict[str, Array]:
    """Each row in single numbers, name -> (n,).

    `x_max_m`, `distance_mean_m`, `across_p99_m`, `heading_rms_rad` and the like, `effort_m_s2`, `excess_effort_m_s2`,
    `settle_s`, `greatest_at_s` (when the error in the plane is greatest), the peaks, the shares of `causes` and what
    `recovery` tells of faults. A row that failed has errors, efforts and a time to settle without bound, so that no
    average gets better by failing; when its error was greatest, its peaks and its shares are not comparable: not a
    number, as for a row without any frame.
    """
    reference = log.channel("ref")
    tally = Tally(log.rows, [Way(reference[:length, row]) for row, length in enumerate(log.lengths)])
    for first in range(0, log.length, BLOCK_FRAMES):
        tally.add(log.part(first, first + BLOCK_FRAMES))
    return tally.row_metrics(failures)


def alpha_windows(position: Array, command: Array) -> Array:
    """Displacement achieved over displacement commanded, in every window of 15 frames.

    Args:
        position: true positions (frames, ..., axes), m.
        command: the commands that acted from each frame to the next, same shape, m/s.

    Returns:
        (frames - 15, ..., axes); not a number where less than 0.1 m/s was commanded on average.
    """
    w = ALPHA_WINDOW_FRAMES
    travelled = np.cumsum(np.concatenate([np.zeros_like(command[:1]), command]), axis=0) * PERIOD_S
    achieved = position[w:] - position[:-w]
    commanded = travelled[w : len(position)] - travelled[: len(position) - w]
    moving = np.abs(commanded) > ALPHA_MIN_SPEED_M_S * w * PERIOD_S
    return np.divide(achieved, commanded, out=np.full_like(achieved, np.nan), where=moving)


def driven_alpha(position: Array, command: Array) -> Array:
    """`alpha_windows` where a robot is driven: not a number near standstill, where what is missing is lag, not gain.

    That is where, in the window or the 0.15 s before it, 0.1 m/s or less was commanded.
    """
    w, before = ALPHA_WINDOW_FRAMES, ALPHA_START_FRAMES
    driven = np.pad(np.abs(command) > ALPHA_MIN_SPEED_M_S, [(before, 0)] + [(0, 0)] * (command.ndim - 1))
    throughout = np.asarray(np.lib.stride_tricks.sliding_window_view(driven, before + w, axis=0).all(-1))
    alpha = alpha_windows(position, command)
    return np.where(throughout[: len(alpha)], alpha, np.nan)


def alpha_percentiles(log: Log, rows: np.ndarray) -> dict[str, dict[str, float | None]] | None:
    """Per axis the percentiles of `alpha_windows` over some rows; None where nothing moved, or for a short log."""
    if log.length <= ALPHA_WINDOW_FRAMES:
        return None
    alpha = alpha_windows(log.channel("pose")[:, rows, :2], log.channel("applied")[:, rows, :2])
    axes: dict[str, dict[str, float | None]] = {}
    for j, axis in enumerate(ALPHA_AXES):
        values = alpha[..., j][~np.isnan(alpha[..., j])]
        axes[axis] = {f"p{p}": float(np.percentile(values, p)) if values.size else None for p in ALPHA_PERCENTILES}
    return axes
