"""Least-squares estimates of latency and alpha of external robots, and the content of link.json.

In the model, a robot's displacement is alpha times the integral of the commands, delayed by the
latency. The integral is piecewise linear, so the latency need not be a whole number of frames.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.config import FRAME_RATE_HZ, PERIOD_S
from omni_mj.io.printable_text import format_count
from omni_mj.live.live_loop import Live

LATENCIES = np.arange(0.0, 30.0, 0.02)  # candidates, frames
# Turn rates of a pulse, rad/s, one per frame. They add up to no turn, even if the robot follows
# them with a lag. The frames at the end wait for the response.
PULSE = np.repeat([3.0, -3.0, 3.0, 0.0], [8, 16, 8, 42])
# Displacements are compared over this window. Over longer times, disturbances would add up.
WINDOW_FRAMES = 6
# Smallest root of the sum of squared displacements of a robot that moves, m or rad
MIN_MOTION = 0.05


class LatencyFit(NamedTuple):
    """Response of a robot to commands.

    Attributes:
        latency_frames: Time from a command to its effect, frames.
        alpha: Achieved over commanded velocity.
    """

    latency_frames: float
    alpha: float


def measure_pulse(live: Live) -> list[LatencyFit | None]:
    """Turn all robots by about 20 degrees to both sides, and return the fits of their turns."""
    for turn_rate in PULSE:
        live.step(np.tile([0.0, 0.0, turn_rate], (len(live.rows), 1)))
    return _fit_robots(live, is_turn=True)


def fit_latency(
    velocities: Array, positions: Array, ages_s: Array, *, is_angle: bool
) -> LatencyFit | None:
    """Fit displacements over 0.1 s to the integral of earlier velocity commands.

    Args:
        velocities: Velocity commands, shape (frames, k), m/s or rad/s.
        positions: Measured positions, shape (frames, k), m or rad; NaN where not measured.
        ages_s: Time since the positions were measured, shape (frames,), s.
        is_angle: Whether positions are angles.

    Returns:
        Latency and positive alpha that explain the displacements best. None if the robot hardly
        moves, or only against its commands.
    """
    displacements = positions[WINDOW_FRAMES:] - positions[:-WINDOW_FRAMES]
    if is_angle:
        displacements = wrap_angle(displacements)
    is_visible = ~np.isnan(displacements[:, 0])
    measured = displacements[is_visible].T.ravel()
    if np.linalg.norm(measured) < MIN_MOTION:
        return None
    capture_frames = np.arange(len(velocities)) - FRAME_RATE_HZ * ages_s
    delayed_frames = capture_frames - LATENCIES[:, None]
    integrals = np.cumsum(velocities, axis=0).T * PERIOD_S
    paths = [
        np.interp(delayed_frames, np.arange(len(velocities) + 1), [0.0, *integral])
        for integral in integrals
    ]
    # Displacements for alpha = 1, a row for each latency
    expected = np.hstack(
        [(path[:, WINDOW_FRAMES:] - path[:, :-WINDOW_FRAMES])[:, is_visible] for path in paths]
    )
    power = np.maximum((expected**2).sum(1), 1e-12)
    alphas = expected @ measured / power
    explained_power = np.where(alphas > 0, alphas**2 * power, -np.inf)
    if (alphas <= 0).all():
        return None
    best = int(explained_power.argmax())
    return LatencyFit(float(LATENCIES[best]), float(alphas[best]))


def summarize(live: Live) -> dict[str, Any]:
    """Return the content of link.json: cameras, frames, robots and messages.

    The latency of a robot is fitted to its translation. Controllers that adapt also identify it.
    """
    frame_clock = live.frame_clock
    team = live.team
    robots = []
    for number, fit, latency, alpha in zip(
        live.ids,
        _fit_robots(live, is_turn=False),
        team.latency_hat.tolist(),
        team.alpha_hat.tolist(),
        strict=True,
    ):
        identified = {"latency_frames": latency, "alpha": alpha}
        robots.append(
            {
                "id": number,
                "identified": identified if np.isfinite([latency, alpha]).all() else None,
                "fitted": fit and fit._asdict(),
            }
        )
    return {
        "cameras": {
            str(number): {
                "frames": camera.frames,
                "rate_hz": camera.rate_hz,
                "mean_age_s": camera.mean_age_s,
            }
            for number, camera in sorted(frame_clock.vision.cameras.items())
        },
        "frames": {"camera": frame_clock.leader, "skipped": frame_clock.skipped},
        "robots": robots,
        "messages": dict(live.messages),
    }


def describe(summary: Mapping[str, Any]) -> list[str]:
    """Return a line of text for each robot in a summary, and one for skipped frames."""
    lines = []
    for robot in summary["robots"]:
        name = f"robot {robot['id']}:"
        if fitted := robot["fitted"]:
            lines.append(
                f"{name} fitted latency {format_latency(fitted['latency_frames'])},"
                f" alpha {fitted['alpha']:.2f}"
            )
        else:
            lines.append(f"{name} did not move as commanded")
        if identified := robot["identified"]:
            latencies, alphas = (
                " ".join(f"{value:.2f}" for value in identified[quantity])
                for quantity in ("latency_frames", "alpha")
            )
            lines.append(
                f"{name} identified latency {latencies} frames,"
                f" alpha {alphas} (forward, sideways, turn)"
            )
    if skipped := summary["frames"]["skipped"]:
        n_skipped = format_count(skipped, "frame")
        lines.append(f"{n_skipped} skipped: this computer was busy, or packets were lost")
    return lines


def format_latency(frames: float) -> str:
    """Return a latency in frames and in ms."""
    return f"{frames:.2f} frames ({1e3 * frames / FRAME_RATE_HZ:.0f} ms)"


def _fit_robots(live: Live, *, is_turn: bool) -> list[LatencyFit | None]:
    """Fit the measured turn or translation of each robot in the log to its commands.

    Poses extrapolated to the frames would depend on the assumed latency.
    """
    axes = slice(2, 3) if is_turn else slice(2)
    commands = live.log.channel("applied")[..., axes]
    measurements = live.measurements[: len(commands)]
    poses = np.array([pose for pose, _ in measurements])[..., axes]
    ages_s = np.array([age_s for _, age_s in measurements])
    return [
        fit_latency(commands[:, row], poses[:, row], ages_s[:, row], is_angle=is_turn)
        for row in range(len(live.rows))
    ]
