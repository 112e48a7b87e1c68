"""The 60 Hz camera that stands in for SSL-Vision: poses with noise, now and then none."""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.link.camera_faults import Sight
from omni_mj.link.noise import Noise, Seed, Stream
from omni_mj.scenarios.faults import Fault
from omni_mj.scenarios.settings import VisionSettings, column


class Camera:
    """Called once a frame with the true poses, returns what vision reports.

    Args:
        settings: noise and misses, one per row.
        seeds: one per row; rows with the same seed see the same noise.
        faults: of each row; see `Sight`. [none]

    Attributes:
        age: for how long robots had been where they were last seen, (n,) s; none where that is no time at all.
    """

    age: Array | None = None

    def __init__(
        self, settings: Sequence[VisionSettings], seeds: Sequence[Seed], faults: Sequence[Sequence[Fault]] = ()
    ) -> None:
        noise = [column(settings, name) for name in ("position_noise_m", "position_noise_m", "heading_noise_rad")]
        sigma, probability = np.concatenate(noise, axis=1), column(settings, "miss_probability")
        self._errors = Noise(
            seeds, Stream.VISION_NOISE, lambda rng, count: rng.standard_normal((count, 3)), lambda block: sigma * block
        )
        self._visible = Noise(
            seeds,
            Stream.VISION_MISSES,
            lambda rng, count: rng.random((count, 1)),
            lambda block: self._between_gaps((block < probability)[..., 0]),
        )
        self._gap = column(settings, "miss_frames")[:, 0]
        self._begun = np.full(len(seeds), -np.inf)  # image of a block in which the last gap began
        self._sight = Sight.of(faults, seeds)
        self._frame, self._first = 0, True

    def __call__(self, pose: Array, frame: int | None = None) -> tuple[Array, np.ndarray]:
        """Return the poses seen (n, 3), not a number where a robot was missed, and whether each was seen (n,).

        Args:
            pose: true, (n, 3).
            frame: of the loop in which this image is taken, by which faults go. [the next one]
        """
        self._frame = (self._frame if frame is None else frame) + 1
        sight, shown = self._sight, pose
        if sight is not None:
            shown = sight.look(pose, self._frame - 1)
        seen: np.ndarray = self._visible.next()
        measured = shown + self._errors.next()
        measured[:, 2] = wrap_angle(measured[:, 2])
        if np.count_nonzero(seen) < len(seen):
            measured[~seen] = np.nan
        if sight is not None:
            seen = sight.show(measured)
        return measured, seen

    def _between_gaps(self, begins: np.ndarray) -> np.ndarray:
        """Whether robots are seen in a block of images in which gaps begin, both (images, n)."""
        if self._first:
            begins[0] = self._first = False  # a robot is placed where the camera sees it
        image = np.arange(len(begins), dtype=float)[:, None]
        begun = np.maximum.accumulate(np.where(begins, image, self._begun))
        self._begun = begun[-1] - len(begins)
        return np.asarray(image - begun >= self._gap)
