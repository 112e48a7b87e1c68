"""How late and how well robots respond to commands, by least squares: to a pulse, and over a whole run.

A robot's position should be its gain times the integral of the commands a latency before. The integral is piecewise
linear, which gives latencies that are no whole number of frames a meaning.
"""

from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array
from omni_mj.live.drive import Live
from omni_mj.scenarios.settings import PERIOD_S

LATENCIES = np.arange(0.0, 30.0, 0.02)  # that are tried, frames
TURN_RATE_RAD_S, TURN_FRAMES = 3.0, 12  # of a pulse, to each side
WAIT_FRAMES = 42  # after it, for the latest response
MIN_GAIN = 0.3  # of a robot that responds at all
WINDOW_FRAMES = 6  # over which displacements are compared: creep and pushes add up in a run
MIN_MOTION_M = 0.05  # of a robot that moved, root of the sum of squares


class Response(NamedTuple):
    """How a robot responds.

    Attributes:
        latency: Frames; NaN if unknown.
        gain: Share of the command that it reaches; NaN if unknown.
    """

    latency: float
    gain: float


def measure_pulse(live: Live) -> list[Response]:
    """Turn all robots to and fro by some 35 degrees at rest, and return their responses."""
    turn = np.repeat([TURN_RATE_RAD_S, -TURN_RATE_RAD_S, 0.0], [TURN_FRAMES, TURN_FRAMES, WAIT_FRAMES])
    for rate in turn:
        live.step(np.tile([0.0, 0.0, rate], (len(live.rows), 1)))
    sent, seen = live.log.channel("command")[..., 2], live.log.channel("vision")[..., 2]
    return [fit_turning(sent[:, row], seen[:, row]) for row in range(len(live.rows))]


def measure_run(live: Live) -> list[Response]:
    """Return the responses over what was recorded of driving along the field."""
    sent, seen = live.log.channel("applied")[..., :2], live.log.channel("vision")[..., :2]
    return [fit_driving(sent[:, row], seen[:, row]) for row in range(len(live.rows))]


def fit_turning(rates: Array, headings: Array) -> Response:
    """Fit headings, shape (frames,), rad, NaN where none was seen, to turn rates, shape (frames,), rad/s."""
    frames = np.flatnonzero(~np.isnan(headings))
    if len(frames) < 3:
        return Response(np.nan, 0.0)
    observed, expected = np.unwrap(headings[frames]), _integrals(rates, frames)
    return _fit(expected - expected.mean(1, keepdims=True), observed - observed.mean())


def fit_driving(velocities: Array, positions: Array) -> Response:
    """Fit displacements over a tenth of a second to velocities.

    Args:
        velocities: Commanded, shape (frames, 2), m/s.
        positions: Shape (frames, 2), m; NaN where none was seen.
    """
    moved = positions[WINDOW_FRAMES:] - positions[:-WINDOW_FRAMES]
    seen = ~np.isnan(moved[:, 0])
    if np.linalg.norm(moved[seen]) < MIN_MOTION_M:
        return Response(np.nan, np.nan)
    paths = [_integrals(axis, np.arange(len(velocities))) for axis in velocities.T]
    expected = [(path[:, WINDOW_FRAMES:] - path[:, :-WINDOW_FRAMES])[:, seen] for path in paths]
    return _fit(np.hstack(expected), moved[seen].T.ravel())


def _integrals(rates: Array, frames: np.ndarray) -> Array:
    """Return the integral of `rates` at frames, shape (k,), each latency before: shape (latencies, k)."""
    path = np.concatenate([[0.0], np.cumsum(rates)]) * PERIOD_S
    return np.interp(frames - LATENCIES[:, None], np.arange(len(path)), path)


def _fit(expected: Array, observed: Array) -> Response:
    """Return latency and gain with which `expected`, shape (latencies, k), is nearest to `observed`, shape (k,)."""
    power = np.maximum((expected**2).sum(1), 1e-12)
    gains = expected @ observed / power
    explained = np.where(gains > 0, gains**2 * power, -np.inf)
    best = int(explained.argmax())
    return Response(float(LATENCIES[best]), float(gains[best]))
