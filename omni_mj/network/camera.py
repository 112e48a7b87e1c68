"""The camera that stands in for SSL-Vision: noise, misses, faults, and images that come late.

The loop ticks 60 times a second, and knows true poses then. An image in between is of a pose on the straight line from
one to the next: at 5 m/s^2 that is off by a T^2 / 8 = 0.2 mm at most. Packets say when they were captured; by the
velocity that it believes in, the team carries a robot on from there to its tick, as `omni-mj drive` does.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omni_control.delay_compensation import RowSelection
from omni_control.kinematics import Array, wrap_angle
from omni_mj.config.faults import (
    Fault,
    VisionBias,
    VisionClockDrift,
    VisionDelay,
    VisionFreeze,
    VisionJitter,
    VisionLoss,
    VisionWrongId,
    span,
)
from omni_mj.config.settings import FRAME_RATE_HZ, PERIOD_S, VisionSettings, gather
from omni_mj.network.fault_schedule import FaultSchedule
from omni_mj.network.random_streams import Noise, Seed, Stream, make_uniform_noise

_SAME_S = 1e-9  # times that differ by less are the same


class Camera:
    """What a camera sees of n robots in an image.

    Biases of several faults add up; of several robots taken for this one the last counts.

    Args:
        settings: Noise and misses, one per row.
        seeds: One per row; rows with the same seed see the same noise.
        faults: Of each row. [none]
    """

    def __init__(
        self,
        settings: Sequence[VisionSettings],
        seeds: Sequence[Seed],
        faults: Sequence[Sequence[Fault]] = (),
    ) -> None:
        noise = [
            gather(settings, name)
            for name in ("position_noise_m", "position_noise_m", "heading_noise_rad")
        ]
        self._sigma = np.stack(noise, axis=1)
        self._miss, self._gap = (
            gather(settings, name) for name in ("miss_probability", "miss_frames")
        )
        self._errors = Noise(
            seeds, Stream.VISION_NOISE, lambda rng, count: rng.standard_normal((count, 3))
        )
        self._misses = make_uniform_noise(seeds, Stream.VISION_MISSES)
        # Drawn for each image whatever goes on, so that a fault changes nothing of another.
        self._chance = make_uniform_noise(seeds, Stream.CAMERA_FAULTS, 2)
        self._schedule = FaultSchedule(faults, VisionLoss, VisionFreeze, VisionWrongId, VisionBias)
        n = len(seeds)
        self._missed = np.full(
            n, -1.0
        )  # images that a gap goes on for; below 0 before the first image
        self._out, self._frozen = np.zeros((2, n), bool)
        self._wrong_ids: list[tuple[int, VisionWrongId]] = []
        self._biases: list[tuple[int, VisionBias]] = []
        self._last = np.full((n, 3), np.nan)  # what was shown

    def __call__(self, pose: Array, frame: int) -> Array:
        """Return the poses seen (n, 3), NaN where a robot was missed.

        Args:
            pose: True, (n, 3).
            frame: Of the loop in which this image is taken.
        """
        begins = (self._misses.next()[:, 0] < self._miss) & (
            self._missed >= 0
        )  # first, robots are placed in view
        self._missed = np.where(begins, self._gap, np.maximum(self._missed - 1, 0))
        measured = self._misled(pose, frame) + self._sigma * self._errors.next()
        measured[:, 2] = wrap_angle(measured[:, 2])
        measured[self._missed > 0] = np.nan
        measured[self._frozen] = self._last[self._frozen]
        seen = ~np.isnan(measured[:, 0])
        self._last[seen] = measured[seen]
        measured[self._out] = np.nan
        return measured

    def _misled(self, pose: Array, frame: int) -> Array:
        """Return what there is to see in a frame in place of true poses (n, 3), but for noise."""
        if (active := self._schedule.update(frame)) is not None:
            self._out[:] = self._frozen[:] = False
            self._out[[row for row, _ in active.of_kind(VisionLoss)]] = True
            self._frozen[[row for row, _ in active.of_kind(VisionFreeze)]] = True
            self._wrong_ids, self._biases = (
                list(active.of_kind(VisionWrongId)),
                list(active.of_kind(VisionBias)),
            )
        chances, shown = self._chance.next(), pose.copy()
        for row, bias in self._biases:
            if chances[row, 1] < bias.probability:
                shown[row] += bias.x_m, bias.y_m, np.radians(bias.heading_deg)
        for row, other in self._wrong_ids:
            if chances[row, 0] < other.probability:
                shown[row] = other.x_m, other.y_m, np.radians(other.heading_deg)
        return shown


class ImageTiming:
    """When images of n robots arrive, and how old they are said to be.

    Errors of clocks and jitters of several faults add up.

    Args:
        settings: Delay and jitter, one per row.
        seeds: One per row.
        faults: Of each row.
    """

    def __init__(
        self,
        settings: Sequence[VisionSettings],
        seeds: Sequence[Seed],
        faults: Sequence[Sequence[Fault]],
    ) -> None:
        self._usual, self._jitter, self._loss = (
            gather(settings, name) for name in ("delay_s", "jitter_s", "loss_probability")
        )
        self._late, self._lost, self._chance = (
            make_uniform_noise(seeds, stream)
            for stream in (Stream.CAMERA_JITTER, Stream.CAMERA_LOSSES, Stream.CAMERA_LATE)
        )
        self._schedule = FaultSchedule(faults, VisionClockDrift, VisionJitter, VisionDelay)
        self._delay = self._usual
        self._more_jitter, self._loses, self._lost_s = np.zeros((3, len(seeds)))

    def schedule_arrival(self, frame: int, time: float) -> tuple[Array, Array]:
        """Return when an image arrives, infinite if it is lost, and how much older it is said to be than it is.

        Args:
            frame: Of the loop in which it is taken.
            time: When it is taken, from the start of the run, s.

        Returns:
            Both (n,), s.
        """
        if (active := self._schedule.update(frame)) is not None:
            self._delay = self._usual.copy()
            self._more_jitter, self._loses, self._lost_s = np.zeros((3, len(self._usual)))
            for row, late in active.of_kind(VisionDelay):
                self._delay[row] = late.delay_s
            for row, jitter in active.of_kind(VisionJitter):
                self._more_jitter[row] += jitter.jitter_s
            for row, clock in active.of_kind(VisionClockDrift):
                self._loses[row] += clock.drift_ms_per_s / 1000
                self._lost_s[row] -= clock.drift_ms_per_s / 1000 * span(clock)[0] * PERIOD_S
        delay = self._delay + self._more_jitter * self._chance.next()[:, 0]
        arrival = time + delay + self._jitter * self._late.next()[:, 0]
        lost = self._lost.next()[:, 0] < self._loss
        return np.where(lost, np.inf, arrival), self._lost_s + self._loses * time


class _Image(NamedTuple):
    """Taken at `time`, arrives at `arrival` (n,), is said to be older by `behind` (n,), s; poses (n, 3)."""

    time: float
    poses: Array  # NaN where a robot was not seen
    arrival: Array
    behind: Array


class Cameras:
    """The cameras of n rows: rows of one rate take images at the same times.

    Args:
        settings: One per row.
        seeds: One per row.
        faults: Of each row.

    Attributes:
        measurement_age: For how long robots had been where they were last seen, (n,) s.
    """

    def __init__(
        self,
        settings: Sequence[VisionSettings],
        seeds: Sequence[Seed],
        faults: Sequence[Sequence[Fault]],
    ) -> None:
        rates = [row.rate_hz for row in settings]
        self._groups: list[tuple[RowSelection, _SameRate]] = []
        for rate in dict.fromkeys(rates):
            own = [
                part
                for part in zip(settings, seeds, faults, strict=True)
                if part[0].rate_hz == rate
            ]
            rows = slice(None) if len(own) == len(rates) else np.flatnonzero(np.equal(rates, rate))
            self._groups.append((rows, _SameRate(*(list(part) for part in zip(*own, strict=True)))))
        self.measurement_age: Array | None = None

    def __call__(self, pose: Array) -> tuple[Array, np.ndarray]:
        """Return the poses (n, 3) that arrived since the frame before, NaN where none did, and whether one did (n,)."""
        measured, self.measurement_age = np.full(pose.shape, np.nan), np.zeros(len(pose))
        for rows, group in self._groups:
            measured[rows], self.measurement_age[rows] = group.arrive(pose[rows])
        return measured, ~np.isnan(measured[:, 0])


class _SameRate:
    """Rows of a batch whose cameras take images at the same times."""

    def __init__(
        self,
        settings: Sequence[VisionSettings],
        seeds: Sequence[Seed],
        faults: Sequence[Sequence[Fault]],
    ) -> None:
        self._camera, self._timing = (
            Camera(settings, seeds, faults),
            ImageTiming(settings, seeds, faults),
        )
        self._rate = settings[0].rate_hz
        self._before: Array | None = None
        self._tick, self._taken = 0, 0  # frames of the loop, and images
        self._flying: list[_Image] = []
        self._newest = np.full(len(seeds), -np.inf)

    def arrive(self, pose: Array) -> tuple[Array, Array]:
        """Return what arrived since the frame before: poses (n, 3), and how old they are (n,), s."""
        now, measured, age = self._tick * PERIOD_S, np.full(pose.shape, np.nan), np.zeros(len(pose))
        before = pose if self._before is None else self._before
        while (time := self._taken / self._rate) <= now + _SAME_S:
            if abs(time - now) <= _SAME_S:
                self._take(now, pose)
            else:
                self._take(time, before + ((time - now) / PERIOD_S + 1) * (pose - before))
        self._before, self._tick = pose, self._tick + 1
        for image in self._flying:
            came = (
                (image.arrival <= now + _SAME_S)
                & (image.time > self._newest)
                & ~np.isnan(image.poses[:, 0])
            )
            measured[came] = image.poses[came]
            age[came] = np.maximum(now - image.time + image.behind[came], 0.0)
            self._newest[came] = image.time
        self._flying = [image for image in self._flying if (image.arrival > now + _SAME_S).any()]
        return measured, age

    def _take(self, time: float, pose: Array) -> None:
        frame = int((time + _SAME_S) * FRAME_RATE_HZ)
        poses = self._camera(pose, frame)
        arrival, behind = self._timing.schedule_arrival(frame, time)
        poses[np.isinf(arrival)] = np.nan
        arrival[np.isinf(arrival)] = time
        self._flying.append(_Image(time, poses, arrival, behind))
        self._taken += 1
