"""Alpha over time: displacement achieved over displacement commanded, in sliding windows.

This is the motor correction factor of equation 8, measured with the true poses.
"""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config.settings import PERIOD_S
from omni_mj.simulation.log import Log

ALPHA_AXES = ("x", "y")
ALPHA_WINDOW_FRAMES = 15  # 0.25 s
ALPHA_START_FRAMES = 9  # 0.15 s, in which lag and creep of the wheels delay the response
ALPHA_MIN_SPEED_M_S = 0.1  # below this mean commanded speed, noise dominates the ratio
ALPHA_PERCENTILES = (5, 50, 95)


def alpha_windows(position: Array, command: Array) -> Array:
    """Return displacement achieved over displacement commanded in every window of 15 frames.

    Args:
        position: True positions, shape (frames, ..., axes), m.
        command: Commands that act from each frame to the next, same shape, m/s.

    Returns:
        Shape (frames - 15, ..., axes). NaN where the mean command is at most 0.1 m/s.
    """
    w = ALPHA_WINDOW_FRAMES
    travelled = np.cumsum(np.concatenate([np.zeros_like(command[:1]), command]), axis=0) * PERIOD_S
    achieved = position[w:] - position[:-w]
    commanded = travelled[w : len(position)] - travelled[: len(position) - w]
    is_moving = np.abs(commanded) > ALPHA_MIN_SPEED_M_S * w * PERIOD_S
    return np.divide(achieved, commanded, out=np.full_like(achieved, np.nan), where=is_moving)


def driven_alpha(position: Array, command: Array) -> Array:
    """Return `alpha_windows` where the robot is driven, and NaN near standstill.

    Near standstill, lag reduces the ratio, not gain. A window counts if all commands in it and in
    the 0.15 s before it exceed 0.1 m/s.
    """
    n_frames = ALPHA_START_FRAMES + ALPHA_WINDOW_FRAMES
    padding = [(ALPHA_START_FRAMES, 0)] + [(0, 0)] * (command.ndim - 1)
    is_driven = np.pad(np.abs(command) > ALPHA_MIN_SPEED_M_S, padding)
    windows = np.lib.stride_tricks.sliding_window_view(is_driven, n_frames, axis=0)
    is_driven_throughout = np.asarray(windows.all(-1))
    alpha = alpha_windows(position, command)
    return np.where(is_driven_throughout[: len(alpha)], alpha, np.nan)


def alpha_percentiles(log: Log, rows: np.ndarray) -> dict[str, dict[str, float | None]] | None:
    """Return percentiles of `alpha_windows` over some rows, by axis.

    Returns:
        Axis -> "p5", "p50", "p95" -> value, None where nothing moves; None for a log that is
            shorter than a window.
    """
    if log.length <= ALPHA_WINDOW_FRAMES:
        return None
    alpha = alpha_windows(log.channel("pose")[:, rows, :2], log.channel("applied")[:, rows, :2])
    percentiles: dict[str, dict[str, float | None]] = {}
    for j, axis in enumerate(ALPHA_AXES):
        values = alpha[..., j][~np.isnan(alpha[..., j])]
        percentiles[axis] = {
            f"p{p}": float(np.percentile(values, p)) if values.size else None
            for p in ALPHA_PERCENTILES
        }
    return percentiles
