"""How late robots answer, measured before anything is believed of it: they turn a little to and fro."""

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


class Answer(NamedTuple):
    """How a robot answers: how many frames later, and with what share of what it is told."""

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
    return [answer(sent[:, row], seen[:, row]) for row in range(n)]


def answer(sent: Array, heading: Array) -> Answer:
    """The latency and gain with which headings follow turn rates, by least squares.

    Headings are gain times the integral of what was sent a latency before, which is piecewise linear for one that is no
    whole number of frames.

    Args:
        sent: turn rates from each frame to the next (frames,), rad/s.
        heading: at each frame (frames,), rad; not a number where none was seen.
    """
    known = np.flatnonzero(~np.isnan(heading))
    if len(known) < 3:
        return Answer(np.nan, 0.0)
    turned = np.concatenate([[0.0], np.cumsum(sent)]) * PERIOD_S
    headings = np.unwrap(heading[known])
    headings -= headings.mean()
    tried = np.arange(0.0, LONGEST_FRAMES, STEP_FRAMES)
    expected = np.interp(known - tried[:, None], np.arange(len(turned)), turned)
    expected -= expected.mean(1, keepdims=True)
    power = np.maximum((expected**2).sum(1), 1e-12)
    gains = expected @ headings / power
    left = (headings**2).sum() - gains**2 * power
    best = int(np.where(gains > 0, left, np.inf).argmin())
    return Answer(float(tried[best]), float(gains[best]))
