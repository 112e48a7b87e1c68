"""Alpha over time: ratio of achieved to commanded displacement in sliding windows.

This is the paper's motor correction factor, equation 8, computed from true poses.
"""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config import PERIOD_S
from omni_mj.simulation.log import Log

ALPHA_AXES = ("x", "y")
ALPHA_WINDOW_FRAMES = 15  # 0.25 s
ALPHA_START_FRAMES = 9  # 0.15 s, during which lag and creep of the wheels delay the response
ALPHA_MIN_SPEED_M_S = 0.1  # at lower mean commanded speeds, noise dominates the ratio
ALPHA_PERCENTILES = (5, 50, 95)


def alpha_windows(position: Array, command: Array) -> Array:
    """Return the ratio of achieved to commanded displacement in every window of 15 frames.

    Args:
        position: True positions, shape (frames, ..., axes), m.
        command: Velocities commanded from each frame to the next, same shape, m/s.

    Returns:
        Shape (frames - 15, ..., axes). NaN where the mean command is at most 0.1 m/s.
    """
    n = ALPHA_WINDOW_FRAMES
    integral = np.cumsum(np.concatenate([np.zeros_like(command[:1]), command]), axis=0) * PERIOD_S
    achieved = position[n:] - position[:-n]
    commanded = integral[n : len(position)] - integral[: len(position) - n]
    is_moving = np.abs(commanded) > ALPHA_MIN_SPEED_M_S * n * PERIOD_S
    return np.divide(achieved, commanded, out=np.full_like(achieved, np.nan), where=is_moving)


def driven_alpha(position: Array, command: Array) -> Array:
    """Return `alpha_windows` with NaN near standstill, where lag lowers the ratio as well.

    A window counts if all commands in it and in the 0.15 s before it exceed 0.1 m/s.
    """
    n_frames = ALPHA_START_FRAMES + ALPHA_WINDOW_FRAMES
    padding = [(ALPHA_START_FRAMES, 0)] + [(0, 0)] * (command.ndim - 1)
    is_driven = np.pad(np.abs(command) > ALPHA_MIN_SPEED_M_S, padding)
    windows = np.lib.stride_tricks.sliding_window_view(is_driven, n_frames, axis=0)
    is_driven_throughout = np.asarray(windows.all(-1))
    alpha = alpha_windows(position, command)
    return np.where(is_driven_throughout[: len(alpha)], alpha, np.nan)


def alpha_percentiles(log: Log, rows: np.ndarray) -> dict[str, dict[str, float | None]] | None:
    """Return the percentiles of `alpha_windows` over some rows for each axis.

    Args:
        log: The log.
        rows: Indices of the rows.

    Returns:
        Axis -> "p5", "p50" or "p95" -> value, which is None if no robot moves along the axis. None
            if the log is shorter than a window.
    """
    if log.length <= ALPHA_WINDOW_FRAMES:
        return None
    percentiles: dict[str, dict[str, float | None]] = {}
    for j, axis in enumerate(ALPHA_AXES):
        ratios = [np.empty(0)]
        for row in rows[log.lengths[rows] > ALPHA_WINDOW_FRAMES].tolist():
            position, command = (
                log.channel_of_row(name, row)[:, j] for name in ("pose", "applied")
            )
            ratio = alpha_windows(position, command)
            ratios.append(ratio[~np.isnan(ratio)])
        values = np.concatenate(ratios)
        percentiles[axis] = {
            f"p{p}": float(np.percentile(values, p)) if values.size else None
            for p in ALPHA_PERCENTILES
        }
    return percentiles
