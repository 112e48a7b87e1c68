"""Position errors of cameras: where a camera is, and how well it is calibrated.

Errors are fixed to the field: a robot that returns to a point is measured with the same error. Each
camera has errors of its own, so that measured positions jump at the border of two cameras. Teams
observe steps of some centimeters there; ER-Force's simulator assumes a camera position error of 10
cm at a height of 4 m.

The calibration error is a Gaussian process with the covariance variance * exp(-d^2 / (2 length^2))
of two points at a distance d, approximated by random Fourier features (A. Rahimi and B. Recht,
Random features for large-scale kernel machines, 2007).
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config.settings import Settings, gather
from omni_mj.network.random_streams import Seed, Stream

SEED_OFFSET = 1000  # added to a camera's number, so that its seeds differ from those of slots
# Number of cameras -> cameras along x and y.
CAMERA_GRIDS = {1: (1, 1), 2: (2, 1), 3: (3, 1), 4: (2, 2)}
N_FEATURES = 16  # number of waves per axis


class CameraErrors:
    """Position errors of the cameras of n rows. Robots of a world share its cameras.

    Args:
        settings: Settings of each row.
        seeds: Seed of each row.
    """

    def __init__(self, settings: Sequence[Settings], seeds: Sequence[Seed]) -> None:
        sigma = gather(settings, "vision.calibration_error_m")
        offset_sigma = gather(settings, "vision.camera_offset_m")
        has_known_offsets = any(row.vision.camera_offsets_m for row in settings)
        self._is_zero = not (sigma.any() or offset_sigma.any() or has_known_offsets)
        if self._is_zero:
            return
        n_cameras = max(row.vision.cameras for row in settings)
        self._grids = np.array([CAMERA_GRIDS[row.vision.cameras] for row in settings])
        self._carpet_sizes = np.array([row.world.carpet_size_m for row in settings])
        self._offsets = np.zeros((len(seeds), n_cameras, 2))
        # Wave numbers along x and y, and amplitudes of cosine and sine
        self._waves = np.zeros((len(seeds), n_cameras, 2, N_FEATURES, 4))
        for row, number in np.ndindex(len(seeds), n_cameras):
            camera_seed = seeds[row][0], SEED_OFFSET + number
            self._offsets[row, number] = _draw(camera_seed, Stream.CAMERA_CLOCK, (2,))
            waves_shape = self._waves.shape[2:]
            self._waves[row, number] = _draw(camera_seed, Stream.CAMERA_CALIBRATION, waves_shape)
        self._offsets *= offset_sigma[:, None, None]
        for row, row_settings in enumerate(settings):
            for number, offset in enumerate(row_settings.vision.camera_offsets_m):
                self._offsets[row, number] += offset
        lengths = gather(settings, "vision.calibration_length_m")
        self._waves[..., :2] /= lengths[:, None, None, None, None]
        self._waves[..., 2:] *= sigma[:, None, None, None, None] / np.sqrt(N_FEATURES)

    def __call__(self, positions: Array, camera: int | None = None) -> Array:
        """Return the errors (n, 2), m, of measured positions.

        Args:
            positions: True positions, (n, 2) m.
            camera: Number of the camera. Default: the camera whose part of the field a robot is in.
        """
        if self._is_zero:
            return np.zeros(positions.shape)
        cameras = self._find_cameras(positions) if camera is None else np.array([camera])
        rows = np.arange(len(self._offsets))
        waves = self._waves[rows, cameras]
        phase = (waves[..., :2] * positions[:, None, None]).sum(-1)
        smooth = waves[..., 2] * np.cos(phase) + waves[..., 3] * np.sin(phase)
        return np.asarray(self._offsets[rows, cameras] + smooth.sum(-1))

    def _find_cameras(self, positions: Array) -> np.ndarray:
        """Return the number of the camera of each robot, numbered along x, then along y, (n,)."""
        fractions = np.nan_to_num(positions) / self._carpet_sizes + 0.5
        grid_indices = np.clip(np.floor(fractions * self._grids), 0, self._grids - 1).astype(int)
        return np.asarray(grid_indices[:, 0] + self._grids[:, 0] * grid_indices[:, 1])


@lru_cache(maxsize=4096)
def _draw(seed: Seed, stream: Stream, shape: tuple[int, ...]) -> Array:
    """Return normal numbers, the same as the first ones of `Noise`."""
    return np.random.default_rng([stream, *seed]).standard_normal(shape)
