"""How late and how well robots respond to commands, by least squares: to a pulse, and over a whole run.

A robot's position should be its gain times the integral of the commands a latency before. The integral is piecewise
linear, which gives latencies that are no whole number of frames a meaning.
"""

from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.live.drive import Live
from omni_mj.scenarios.settings import PERIOD_S

LATENCIES = np.arange(0.0, 30.0, 0.02)  # that are tried, frames
TURN_RATE_RAD_S, TURN_FRAMES = 3.0, 12  # of a pulse, to each side
WAIT_FRAMES = 42  # after it, for the latest response
MIN_GAIN = 0.3  # of a robot that responds at all
WINDOW_FRAMES = 6  # over which displacements are compared: creep and pushes add up in a run
MIN_MOTION = 0.05  # of a robot that moved, root of the sum of squares, m or rad


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
    return _fit_rows(live, "command", slice(2, 3))


def measure_run(live: Live) -> list[Response]:
    """Return the responses over what was recorded of driving along the field."""
    return _fit_rows(live, "applied", slice(2))


def _fit_rows(live: Live, channel: str, axes: slice) -> list[Response]:
    """Fit what vision saw of each robot along some axes to commands."""
    sent, seen = live.log.channel(channel)[..., axes], live.log.channel("vision")[..., axes]
    return [fit(sent[:, row], seen[:, row], is_angle=axes.start == 2) for row in range(len(live.rows))]


def fit(velocities: Array, positions: Array, *, is_angle: bool = False) -> Response:
    """Fit displacements over a tenth of a second to velocities, of which they are integrals a latency before.

    Args:
        velocities: Commanded, shape (frames, k), m/s or rad/s.
        positions: Shape (frames, k), m or rad; NaN where none was seen.
        is_angle: Whether positions are angles.
    """
    moved = positions[WINDOW_FRAMES:] - positions[:-WINDOW_FRAMES]
    moved = wrap_angle(moved) if is_angle else moved
    seen = ~np.isnan(moved[:, 0])
    if np.linalg.norm(moved[seen]) < MIN_MOTION:
        return Response(np.nan, np.nan)
    frames = np.arange(len(velocities)) - LATENCIES[:, None]
    paths = [
        np.interp(frames, np.arange(len(axis) + 1), np.concatenate([[0.0], np.cumsum(axis)]) * PERIOD_S)
        for axis in velocities.T
    ]
    expected = np.hstack([(path[:, WINDOW_FRAMES:] - path[:, :-WINDOW_FRAMES])[:, seen] for path in paths])
    observed = moved[seen].T.ravel()
    power = np.maximum((expected**2).sum(1), 1e-12)
    gains = expected @ observed / power
    explained = np.where(gains > 0, gains**2 * power, -np.inf)
    best = int(explained.argmax())
    return Response(float(LATENCIES[best]), float(gains[best]))
