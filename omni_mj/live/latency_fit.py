"""Least-squares estimates of latency and gain, from a pulse of turn rates or from a whole run.

In the model, a robot's displacement is the gain times the integral of the commands, delayed by the
latency. The integral is piecewise linear, so the latency need not be a whole number of frames.
"""

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pydantic_core

from omni_control.kinematics import Array, wrap_angle
from omni_mj.config.settings import FRAME_RATE_HZ, PERIOD_S
from omni_mj.live.live_loop import Live

LATENCIES = np.arange(0.0, 30.0, 0.02)  # candidates, frames
# Turn rates of a pulse, rad/s, one per frame. They add up to no turn, even if the robot follows
# them with a lag. The frames at the end wait for the response.
PULSE = np.repeat([3.0, -3.0, 3.0, 0.0], [8, 16, 8, 42])
# Displacements are compared over this window. Over longer times, disturbances would add up.
WINDOW_FRAMES = 6
# Smallest root of the sum of squared displacements of a robot that moves, m or rad
MIN_MOTION = 0.05
CAMERA_FIGURES = "frames", "rate_hz", "mean_age_s"


class LatencyFit(NamedTuple):
    """Response of a robot to commands.

    Attributes:
        latency: Latency, frames; NaN if the robot hardly moved.
        gain: Achieved over commanded velocity; NaN if the robot hardly moved.
    """

    latency: float
    gain: float


def measure_pulse(live: Live) -> list[LatencyFit]:
    """Turn all robots by about 20 degrees to both sides, and return their responses."""
    for rate in PULSE:
        live.step(np.tile([0.0, 0.0, rate], (len(live.rows), 1)))
    return _fit_rows(live, slice(2, 3))


def measure_run(live: Live) -> list[LatencyFit]:
    """Return the responses of all robots, fitted to the translation in the recorded run."""
    return _fit_rows(live, slice(2))


def fit_latency(velocities: Array, positions: Array, *, is_angle: bool = False) -> LatencyFit:
    """Fit displacements over 0.1 s to the integral of earlier velocity commands.

    Args:
        velocities: Velocity commands, shape (frames, k), m/s or rad/s.
        positions: Measured positions, shape (frames, k), m or rad; NaN where not measured.
        is_angle: Whether positions are angles.

    Returns:
        Latency and gain that explain the most of the displacements.
    """
    displacement = positions[WINDOW_FRAMES:] - positions[:-WINDOW_FRAMES]
    displacement = wrap_angle(displacement) if is_angle else displacement
    is_visible = ~np.isnan(displacement[:, 0])
    if np.linalg.norm(displacement[is_visible]) < MIN_MOTION:
        return LatencyFit(np.nan, np.nan)
    frames = np.arange(len(velocities)) - LATENCIES[:, None]
    paths = [
        np.interp(
            frames, np.arange(len(axis) + 1), np.concatenate([[0.0], np.cumsum(axis)]) * PERIOD_S
        )
        for axis in velocities.T
    ]
    expected = np.hstack(
        [(path[:, WINDOW_FRAMES:] - path[:, :-WINDOW_FRAMES])[:, is_visible] for path in paths]
    )
    observed = displacement[is_visible].T.ravel()
    power = np.maximum((expected**2).sum(1), 1e-12)
    gains = expected @ observed / power
    explained = np.where(gains > 0, gains**2 * power, -np.inf)
    best = int(explained.argmax())
    return LatencyFit(float(LATENCIES[best]), float(gains[best]))


def summarize(live: Live) -> dict[str, Any]:
    """Return the content of link.json: cameras, frames, robots and messages."""
    frame_clock, team, robots = live.frame_clock, live.team, []
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
            for number, camera in sorted(frame_clock.vision.cameras.items())
        },
        "frames": {"camera": frame_clock.leader, "skipped": frame_clock.skipped},
        "robots": robots,
        "messages": dict(live.messages),
    }
    text = pydantic_core.to_json(summary, inf_nan_mode="null", fallback=np.ndarray.tolist)
    return dict(json.loads(text))


def describe(summary: Mapping[str, Any]) -> list[str]:
    """Return a line of text for each robot in a summary."""
    lines = []
    for robot in summary["robots"]:
        phrases = []
        fitted, identified = robot["fitted"], robot["identified"]
        if (latency := fitted["latency_frames"]) is not None:
            ms = 1e3 * latency / FRAME_RATE_HZ
            phrases.append(
                f"latency {latency:.2f} frames ({ms:.0f} ms), alpha {fitted['alpha']:.2f}"
            )
        if identified is not None:
            latencies, alphas = (
                " ".join(f"{value:.2f}" for value in values) for values in identified.values()
            )
            phrases.append(
                f"identified latency {latencies} frames, alpha {alphas} (forward, sideways, turn)"
            )
        lines.append(f"robot {robot['id']}: {'; '.join(phrases) or 'did not move'}")
    return lines


def _fit_rows(live: Live, axes: slice) -> list[LatencyFit]:
    """Fit the measured poses of each robot along some axes to the commands."""
    sent, measured = (live.log.channel(name)[..., axes] for name in ("applied", "vision"))
    return [
        fit_latency(sent[:, row], measured[:, row], is_angle=axes.start == 2)
        for row in range(len(live.rows))
    ]
