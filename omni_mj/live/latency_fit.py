"""How late and how well robots respond to commands, by least squares: to a pulse, and over a whole run.

A robot's position should be its gain times the integral of the commands a latency before. The integral is piecewise
linear, which gives latencies that are no whole number of frames a meaning.
"""

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pydantic_core

from omni_control.kinematics import Array, wrap_angle
from omni_mj.config.settings import FRAME_RATE_HZ, PERIOD_S
from omni_mj.live.live_loop import Live

LATENCIES = np.arange(0.0, 30.0, 0.02)  # that are tried, frames
# Turn rates of a pulse, rad/s. However slowly they change, none of the turn is left. The latest
# response is awaited.
PULSE = np.repeat([3.0, -3.0, 3.0, 0.0], [8, 16, 8, 42])
WINDOW_FRAMES = 6  # over which displacements are compared: creep and pushes add up in a run
MIN_MOTION = 0.05  # of a robot that moved, root of the sum of squares, m or rad
CAMERA_FIGURES = "frames", "rate_hz", "mean_age_s"


class Response(NamedTuple):
    """How a robot responds.

    Attributes:
        latency: Frames; NaN if unknown.
        gain: Share of the command that it reaches; NaN if unknown.
    """

    latency: float
    gain: float


def measure_pulse(live: Live) -> list[Response]:
    """Turn all robots to and fro by some 20 degrees at rest, and return their responses."""
    for rate in PULSE:
        live.step(np.tile([0.0, 0.0, rate], (len(live.rows), 1)))
    return _fit_rows(live, slice(2, 3))


def measure_run(live: Live) -> list[Response]:
    """Return the responses over what was recorded of driving along the field."""
    return _fit_rows(live, slice(2))


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
        np.interp(
            frames, np.arange(len(axis) + 1), np.concatenate([[0.0], np.cumsum(axis)]) * PERIOD_S
        )
        for axis in velocities.T
    ]
    expected = np.hstack(
        [(path[:, WINDOW_FRAMES:] - path[:, :-WINDOW_FRAMES])[:, seen] for path in paths]
    )
    observed = moved[seen].T.ravel()
    power = np.maximum((expected**2).sum(1), 1e-12)
    gains = expected @ observed / power
    explained = np.where(gains > 0, gains**2 * power, -np.inf)
    best = int(explained.argmax())
    return Response(float(LATENCIES[best]), float(gains[best]))


def summarize(live: Live) -> dict[str, Any]:
    """Return the content of link.json: vision, ticks, what went wrong, and how robots respond."""
    link, team, robots = live.link, live.team, []
    estimates = zip(live.ids, measure_run(live), team.latency_hat, team.alpha_hat, strict=True)
    for number, response, latency, alpha in estimates:
        identified = (
            {"latency_frames": latency, "alpha": alpha} if np.isfinite(latency).all() else None
        )
        fitted = {"latency_frames": response.latency, "alpha": response.gain}
        robots.append({"id": number, "identified": identified, "fitted": fitted})
    summary = {
        "cameras": {
            str(number): {figure: getattr(camera, figure) for figure in CAMERA_FIGURES}
            for number, camera in sorted(link.vision.cameras.items())
        },
        "ticks": {"camera": link.leader, "skipped": link.skipped},
        "robots": robots,
        "notes": dict(live.notes),
    }
    text = pydantic_core.to_json(summary, inf_nan_mode="null", fallback=np.ndarray.tolist)
    return dict(json.loads(text))


def describe(summary: Mapping[str, Any]) -> list[str]:
    """Return a line for each robot at the end."""
    lines = []
    for robot in summary["robots"]:
        parts, fitted, identified = [], robot["fitted"], robot["identified"]
        if (latency := fitted["latency_frames"]) is not None:
            ms = 1e3 * latency / FRAME_RATE_HZ
            parts.append(
                f"answers {latency:.2f} frames ({ms:.0f} ms) later, with {fitted['alpha']:.2f} of it"
            )
        if identified is not None:
            latencies, alphas = (
                " ".join(f"{value:.2f}" for value in values) for values in identified.values()
            )
            parts.append(
                f"identified: latency {latencies} frames, alpha {alphas} (forward, left, turning)"
            )
        lines.append(f"robot {robot['id']}: {'; '.join(parts) or 'did not move'}")
    return lines


def _fit_rows(live: Live, axes: slice) -> list[Response]:
    """Fit what vision saw of each robot along some axes to commands."""
    sent, seen = (live.log.channel(name)[..., axes] for name in ("applied", "vision"))
    return [
        fit(sent[:, row], seen[:, row], is_angle=axes.start == 2) for row in range(len(live.rows))
    ]
