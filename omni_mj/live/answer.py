"""How late and how well robots answer commands, by least squares: to a pulse, and over a whole run.

Where a robot is should be its gain times the integral of what was sent a latency before; the integral is piecewise
linear, for a latency that is no whole number of frames.
"""

from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array
from omni_mj.live.drive import Live
from omni_mj.scenarios.settings import PERIOD_S

TURN_RAD_S = 3.0  # to one side for TURN_FRAMES, then to the other
TURN_FRAMES = 12
WAIT_FRAMES = 42  # after it, for the latest answer that is looked for, LONGEST_FRAMES
LONGEST_FRAMES = 30.0
STEP_FRAMES = 0.02  # of the latencies that are tried
LEAST_GAIN = 0.3  # of a robot that answers at all
WINDOW_FRAMES = 6  # over which displacements are compared in a run, in which creep and pushes add up
LEAST_MOVED_M = 0.05  # in the whole run, root of the sum of squares: of a robot that moved at all


class Answer(NamedTuple):
    """How a robot answers: how many frames later, and with what share of what it is told; not a number if unknown."""

    latency: float
    gain: float

    @property
    def any(self) -> bool:
        """Whether it answers."""
        return self.gain >= LEAST_GAIN


def pulse(live: Live) -> list[Answer]:
    """Turn all robots to and fro by some 35 degrees, at a rest; the answer of each."""
    n = len(live.rows)
    turn = np.concatenate([np.full(TURN_FRAMES, TURN_RAD_S), np.full(TURN_FRAMES, -TURN_RAD_S), np.zeros(WAIT_FRAMES)])
    for rate in turn:
        live.step(np.tile([0.0, 0.0, rate], (n, 1)))
    sent, seen = live.log.channel("command")[..., 2], live.log.channel("vision")[..., 2]
    return [turning(sent[:, row], seen[:, row]) for row in range(n)]


def run(live: Live) -> list[Answer]:
    """The answers over what was recorded, of driving along the field."""
    sent, seen = live.log.channel("applied")[..., :2], live.log.channel("vision")[..., :2]
    return [driving(sent[:, row], seen[:, row]) for row in range(len(live.rows))]


def turning(sent: Array, heading: Array) -> Answer:
    """The answer of headings (frames,) rad, not a number where none was seen, to turn rates (frames,) rad/s."""
    known = np.flatnonzero(~np.isnan(heading))
    if len(known) < 3:
        return Answer(np.nan, 0.0)
    headings = np.unwrap(heading[known])
    expected = _delayed(sent, known)
    expected = expected - expected.mean(1, keepdims=True)
    return _best(expected, headings - headings.mean())


def driving(sent: Array, position: Array) -> Answer:
    """The answer of positions (frames, 2) m, not a number where none was seen, to velocities (frames, 2) m/s.

    Compared are displacements over a tenth of a second: where a robot is in the end depends on all that happened.
    """
    window, frames = WINDOW_FRAMES, np.arange(len(sent))
    moved = position[window:] - position[:-window]
    known = ~np.isnan(moved[:, 0])
    if np.sqrt((moved[known] ** 2).sum()) < LEAST_MOVED_M:
        return Answer(np.nan, np.nan)
    paths = [_delayed(sent[:, axis], frames) for axis in (0, 1)]
    expected = np.concatenate([(path[:, window:] - path[:, :-window])[:, known] for path in paths], axis=1)
    return _best(expected, moved[known].T.ravel())


def _delayed(sent: Array, frames: np.ndarray) -> Array:
    """The integral of what was sent, at frames (k,), a latency before: (latencies, k)."""
    path = np.concatenate([[0.0], np.cumsum(sent)]) * PERIOD_S
    return np.interp(frames - _tried()[:, None], np.arange(len(path)), path)


def _tried() -> Array:
    return np.arange(0.0, LONGEST_FRAMES, STEP_FRAMES)


def _best(expected: Array, found: Array) -> Answer:
    """The latency, and the gain, with which what is expected (latencies, k) comes nearest to what was found (k,)."""
    power = np.maximum((expected**2).sum(1), 1e-12)
    gains = expected @ found / power
    left = (found**2).sum() - gains**2 * power
    best = int(np.where(gains > 0, left, np.inf).argmin())
    return Answer(float(_tried()[best]), float(gains[best]))
