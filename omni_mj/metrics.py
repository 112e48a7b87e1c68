"""What is measured of a run: tracking errors and the motor correction factor alpha that came out of it."""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.settings import PERIOD_S
from omni_mj.trajectory import Trajectory

AXES = ("x", "y")
STATISTICS = ("max", "mean", "rms")
ALPHA_WINDOW_FRAMES = 15  # 0.25 s
ALPHA_MIN_SPEED_M_S = 0.1  # below this mean commanded speed a window's ratio is mostly noise
ALPHA_PERCENTILES = (5, 50, 95)


def absolute_errors(trajectory: Trajectory) -> Array:
    """Distance from the true pose to the timed reference, (frames, controllers, seeds, 2) m, axes x and y."""
    error: Array = np.abs(trajectory.channel("pose") - trajectory.channel("ref"))[..., :2]
    return error


def error_statistics(trajectory: Trajectory) -> dict[str, Array]:
    """Maximum, mean and root mean square of the absolute error over the frames, (controllers, seeds, 2) m each."""
    error = absolute_errors(trajectory)
    return {"max": error.max(0), "mean": error.mean(0), "rms": np.sqrt((error**2).mean(0))}


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
