"""Cameras whose images are not taken when the team's computer ticks, and come late: rate, delay, jitter and losses.

The loop ticks 60 times a second, and knows true poses then. An image in between is of a pose on the straight line from
one to the next: at 5 m/s^2 that is off by a T^2 / 8 = 0.2 mm at most. Packets say when they were captured; by the
velocity that it believes in, the team carries a robot on from there to its tick, as `omni-mj drive` does.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_mj.link.camera import Camera
from omni_mj.link.camera_faults import Timing
from omni_mj.link.noise import Noise, Seed, Stream
from omni_mj.scenarios.faults import Fault
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S, VisionSettings

TIMING = "rate_hz", "delay_s", "jitter_s", "loss_probability"
_SAME_S = 1e-9  # times that differ by less are the same


def camera(
    settings: Sequence[VisionSettings],
    seeds: Sequence[Seed],
    faults: Sequence[Sequence[Fault]],
) -> "Camera | Cameras":
    """The cameras of n rows, called once a frame with their true poses; see `Camera`.

    Args:
        settings: one per row.
        seeds: one per row.
        faults: of each row.
    """
    usual = tuple(VisionSettings.model_fields[name].default for name in TIMING)
    timings = [tuple(getattr(each, name) for name in TIMING) for each in settings]
    late = [timing != usual or Timing.matters(own) for timing, own in zip(timings, faults, strict=True)]
    if not any(late):
        return Camera(settings, seeds, faults)
    return Cameras(settings, seeds, faults, [t if own else () for t, own in zip(timings, late, strict=True)])


class Cameras:
    """Rows of one timing have a camera together, so that a row's numbers do not depend on others of the batch.

    Args:
        settings: one per row.
        seeds: one per row.
        faults: of each row.
        timings: of each row; rows of none have images at the ticks, at once.

    Attributes:
        age: see `Camera`.
    """

    def __init__(
        self,
        settings: Sequence[VisionSettings],
        seeds: Sequence[Seed],
        faults: Sequence[Sequence[Fault]],
        timings: Sequence[tuple[float, ...]],
    ) -> None:
        self._n = len(settings)
        self.age: Array | None = None
        self._parts = list[tuple[np.ndarray, Camera | LateCamera]]()
        for timing in dict.fromkeys(timings):
            rows = np.flatnonzero([each == timing for each in timings])
            own = [int(row) for row in rows]
            part = LateCamera if timing else Camera
            self._parts.append(
                (rows, part([settings[i] for i in own], [seeds[i] for i in own], [faults[i] for i in own]))
            )

    def __call__(self, pose: Array) -> tuple[Array, np.ndarray]:
        """See `Camera`."""
        measured, seen, self.age = np.full((self._n, 3), np.nan), np.zeros(self._n, bool), np.zeros(self._n)
        for rows, part in self._parts:
            measured[rows], seen[rows] = part(pose[rows])
            self.age[rows] = 0.0 if part.age is None else part.age
        return measured, seen


@dataclass
class _Image:
    """Taken at `time`, arrives at `arrival` (n,), is said to be older by `behind` (n,), s; poses (n, 3)."""

    time: float
    poses: Array  # not a number of what was not seen
    arrival: Array
    behind: Array


class LateCamera:
    """A camera of rows that have the same timing.

    Args:
        settings: one per row.
        seeds: one per row.
        faults: of each row.

    Attributes:
        age: see `Camera`.
    """

    def __init__(
        self, settings: Sequence[VisionSettings], seeds: Sequence[Seed], faults: Sequence[Sequence[Fault]]
    ) -> None:
        self._camera, self._timing = Camera(settings, seeds, faults), settings[0]
        self._late, self._lost = (
            Noise(seeds, stream, lambda rng, count: rng.random((count, 1)))
            for stream in (Stream.CAMERA_JITTER, Stream.CAMERA_LOSSES)
        )
        self._shifted = Timing.of(faults, seeds)
        self._before: Array | None = None
        self._tick, self._taken = 0, 0  # frames of the loop, and images
        self._flying: list[_Image] = []
        self._newest = np.full(len(settings), -np.inf)
        self.age = np.zeros(len(settings))

    def __call__(self, pose: Array) -> tuple[Array, np.ndarray]:
        """What arrived since the frame before; see `Camera`."""
        now = self._tick * PERIOD_S
        before = pose if self._before is None else self._before
        while (time := self._taken / self._timing.rate_hz) <= now + _SAME_S:
            if abs(time - now) <= _SAME_S:
                self._take(now, pose)
            else:
                self._take(time, before + ((time - now) / PERIOD_S + 1) * (pose - before))
        self._before, self._tick = np.array(pose), self._tick + 1
        measured, self.age = np.full(pose.shape, np.nan), np.zeros(len(pose))
        for image in self._flying:
            came = (image.arrival <= now + _SAME_S) & (image.time > self._newest) & ~np.isnan(image.poses[:, 0])
            measured[came] = image.poses[came]
            self.age[came] = np.maximum(now - image.time + image.behind[came], 0.0)
            self._newest[came] = image.time
        self._flying = [image for image in self._flying if (image.arrival > now + _SAME_S).any()]
        return measured, ~np.isnan(measured[:, 0])

    def _take(self, time: float, pose: Array) -> None:
        frame = int((time + _SAME_S) * FRAME_RATE_HZ)
        poses, _ = self._camera(pose, frame)
        timing, late, lost = self._timing, self._late.next()[:, 0], self._lost.next()[:, 0]
        poses[lost < timing.loss_probability] = np.nan
        delay, behind = np.full(len(poses), timing.delay_s), np.zeros(len(poses))
        if self._shifted is not None:
            delay, behind = self._shifted.at(frame, time, delay)
        self._flying.append(_Image(time, poses, time + delay + timing.jitter_s * late, behind))
        self._taken += 1
