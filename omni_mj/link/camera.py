"""The 60 Hz camera that stands in for SSL-Vision: poses with noise, now and then none."""

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.link.noise import Stream, draw
from omni_mj.scenarios.settings import VisionSettings


class Camera:
    """Called once a frame with the true poses, returns what vision reports.

    Args:
        settings: noise and misses.
        seeds: one per robot; robots with the same seed see the same noise.
        frames: frames of the run.
    """

    def __init__(self, settings: VisionSettings, seeds: list[int], frames: int) -> None:
        sigma = np.array([settings.position_noise_m, settings.position_noise_m, settings.heading_noise_rad])
        self._noise = sigma * draw(seeds, Stream.VISION_NOISE, lambda rng: rng.standard_normal((frames, 3)))
        misses = draw(seeds, Stream.VISION_MISSES, lambda rng: rng.random((frames, 1)))
        misses[0] = 1.0  # a robot is placed where the camera sees it
        begins = np.cumsum(misses[:, :, 0] < settings.miss_probability, axis=0)
        before = np.concatenate([np.zeros((settings.miss_frames, len(seeds)), int), begins])[:frames]
        self._seen = begins == before  # no gap began in the last `miss_frames` frames

    def __call__(self, frame: int, pose: Array) -> tuple[Array, np.ndarray]:
        """Return the poses seen (n, 3), not a number where a robot was missed, and whether each was seen (n,)."""
        seen = self._seen[frame]
        measured = pose + self._noise[frame]
        measured[:, 2] = wrap_angle(measured[:, 2])
        measured[~seen] = np.nan
        return measured, seen
