"""What the tests of the vision filter share: robots as the filter believes them to be, and all that it says of them."""

import numpy as np
from closed_loop import NOISE, T

from omni_control.estimation.tracking import KalmanFilter
from omni_control.kinematics import Array

GAIN_ERROR, DRIFT, DRIFT_TIME_S = 0.06, (0.1, 0.1, 0.5), 0.5


def driven(seed: int, frames: int, n: int, scale: float = 1.0, missed: float = 0.02) -> tuple[Array, Array, Array]:
    """True poses, poses seen and commanded displacements (frames, n, 3).

    The process noise has `scale` times the variance that the filter states; of the poses a share `missed` is not seen.
    """
    rng = np.random.default_rng(seed)
    # Speeds that change slowly, as under a limit of acceleration.
    phase, rate = rng.uniform(0, 2 * np.pi, (2, 1, n, 3))
    displacement = T * np.array([1.0, 1.0, 2.0]) * np.sin(phase + T * rate * np.arange(frames)[:, None, None])
    pose, drift, poses = rng.uniform(-1, 1, (n, 3)), np.zeros((n, 3)), []
    for q in displacement:
        pose = pose + q + T * drift + np.sqrt(scale) * GAIN_ERROR * np.abs(q) * rng.standard_normal((n, 3))
        drift = drift * np.exp(-T / DRIFT_TIME_S) + np.sqrt(scale * T) * np.array(DRIFT) * rng.standard_normal((n, 3))
        poses.append(pose)
    true = np.array(poses)
    measured = true + np.array(NOISE) * rng.standard_normal(true.shape)
    measured[rng.random((frames, n)) < missed] = np.nan
    return true, measured, displacement


def filtered(measured: Array, displacement: Array, start: Array) -> dict[str, Array]:
    """What the filter says in each frame, (frames, n, 3) each, by the names of its attributes."""
    kalman = KalmanFilter(start, T, NOISE)
    said: dict[str, list[Array]] = {name: [] for name in ("pose", "twist", "drift", "sigma", "normalised")}
    for m, q in zip(measured, displacement, strict=True):
        kalman.update(m, q)
        for name, values in said.items():
            values.append(getattr(kalman, name).copy())
    return {name: np.array(values) for name, values in said.items()}
