"""What is measured of a run: tracking errors, effort, settling, and the motor correction factor alpha that came out."""

import numpy as np
from scipy.special import stdtrit

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.simulate.log import Trajectory

AXES = ("x", "y")
STATISTICS = ("max", "mean", "rms")
ALPHA_WINDOW_FRAMES = 15  # 0.25 s
ALPHA_MIN_SPEED_M_S = 0.1  # below this mean commanded speed a window's ratio is mostly noise
ALPHA_PERCENTILES = (5, 50, 95)
SETTLED_M = 0.01
CONFIDENCE = 0.95


def absolute_errors(trajectory: Trajectory) -> Array:
    """Distance from the true pose to the timed reference, (frames, controllers, seeds, 2) m, axes x and y."""
    error: Array = np.abs(trajectory.channel("pose") - trajectory.channel("ref"))[..., :2]
    return error


def error_statistics(trajectory: Trajectory) -> dict[str, Array]:
    """Maximum, mean and root mean square of the absolute error over the frames, (controllers, seeds, 2) m each."""
    error = absolute_errors(trajectory)
    return {"max": error.max(0), "mean": error.mean(0), "rms": np.sqrt((error**2).mean(0))}


def position_errors(trajectory: Trajectory) -> Array:
    """Distance in the plane from the true position to the timed reference's, (frames, controllers, seeds) m."""
    error = absolute_errors(trajectory)
    distance: Array = np.hypot(error[..., 0], error[..., 1])
    return distance


def control_effort(command: Array) -> Array:
    """Root mean square over the frames of the change of a command per second; smooth driving alone costs some.

    Args:
        command: velocities sent (frames, ..., axes), m/s; before the first frame it is zero.

    Returns:
        (...) m/s^2, of the magnitude over all axes.
    """
    change = np.diff(command, axis=0, prepend=np.zeros_like(command[:1])) / PERIOD_S
    effort: Array = np.sqrt((change**2).sum(-1).mean(0))
    return effort


def settling_times(reference: Array, error: Array) -> Array:
    """Time from the end of the reference's last move until the position error stays below 1 cm up to the last frame.

    Args:
        reference: poses of the timed reference, the same for all robots, (frames, 3).
        error: position errors (frames, ...), m.

    Returns:
        (...) s; zero for a robot that is that near from the end of the move on, not a number for one that is not in
        the last frame.
    """
    moves = np.flatnonzero((np.diff(reference, axis=0) != 0).any(-1))
    rest = moves[-1] + 1 if moves.size else 0
    frames = np.arange(1, len(error) + 1).reshape(-1, *[1] * (error.ndim - 1))
    near_from = np.where(error >= SETTLED_M, frames, 0).max(0)  # the frame after the last that is not near
    return np.where(near_from < len(error), np.maximum(near_from - rest, 0) * PERIOD_S, np.nan)


def confidence(values: Array) -> tuple[Array, Array]:
    """Mean over the last axis, and half the width of its 95 % confidence interval by Student's t.

    Args:
        values: independent samples (..., samples), at least one.

    Returns:
        Two arrays (...); not a number for the half width of a single sample.
    """
    n = values.shape[-1]
    mean: Array = values.mean(-1)
    if n == 1:
        return mean, np.full_like(mean, np.nan)
    return mean, stdtrit(n - 1, (1 + CONFIDENCE) / 2) * values.std(-1, ddof=1) / np.sqrt(n)


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


def alpha_percentiles(trajectory: Trajectory) -> list[dict[str, dict[str, float | None]]]:
    """Per controller and axis the percentiles of `alpha_windows` over all seeds; None where nothing moved."""
    alpha = alpha_windows(trajectory.channel("pose")[..., :2], trajectory.channel("applied")[..., :2])
    result = []
    for i in range(len(trajectory.controllers)):
        axes: dict[str, dict[str, float | None]] = {}
        for j, axis in enumerate(AXES):
            values = alpha[:, i, :, j]
            values = values[~np.isnan(values)]
            axes[axis] = {f"p{p}": float(np.percentile(values, p)) if values.size else None for p in ALPHA_PERCENTILES}
        result.append(axes)
    return result
