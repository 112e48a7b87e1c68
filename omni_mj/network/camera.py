"""Model of the cameras of SSL-Vision: noise, calibration, missed detections, faults, delays.

The loop knows true poses 60 times a second. An image in between shows poses that are interpolated
linearly: at 5 m/s^2 the error is at most a T^2 / 8 = 0.2 mm. Packets contain their capture time.
The team extrapolates a pose from there to its frame with the filtered velocity, as `omni-mj drive`
does.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.config import FRAME_RATE_HZ, PERIOD_S
from omni_mj.config.faults import (
    VisionBias,
    VisionClockDrift,
    VisionDelay,
    VisionFreeze,
    VisionJitter,
    VisionLoss,
    VisionWrongId,
)
from omni_mj.config.settings import Settings, gather
from omni_mj.network.camera_calibration import CameraErrors
from omni_mj.network.fault_schedule import FaultsByRow, FaultSchedule
from omni_mj.network.random_streams import Noise, Seed, Stream, continue_bursts

_TIME_TOLERANCE_S = 1e-9  # for the comparison of times


class Camera:
    """Camera that measures the poses of n robots in an image.

    The biases of simultaneous faults add up. Of simultaneous wrong detections of a robot the last
    one counts.

    Args:
        settings: Noise and missed detections of each row.
        seeds: Seed of each row; rows with the same seed get the same noise.
        faults: Faults of each row.
        number: Number of the camera. Default: robots are measured by the camera whose part of the
            field they are in.
    """

    def __init__(
        self,
        settings: Sequence[Settings],
        seeds: Sequence[Seed],
        faults: FaultsByRow,
        number: int | None = None,
    ) -> None:
        self._pose_noise = Noise(seeds, Stream.VISION_NOISE, 3, "standard_normal")
        self._miss_noise = Noise(seeds, Stream.VISION_MISSES)
        self._dropout_noise = Noise(seeds, Stream.CAMERA_DROPOUTS)
        self._number, self._seeds = number, seeds
        # Drawn for each image, also without faults, so that a fault does not affect another.
        self._fault_noise = Noise(seeds, Stream.CAMERA_FAULTS, 2)
        n = len(seeds)
        self._has_images = False
        self._is_dropout = np.zeros(n, bool)
        self._last_measured = np.full((n, 3), np.nan)
        self.change_settings(settings, faults)

    def change_settings(self, settings: Sequence[Settings], faults: FaultsByRow) -> None:
        """Change noise, calibration, missed detections and faults of images from now on."""
        position_sigma = gather(settings, "vision.position_noise_m")
        heading_sigma = gather(settings, "vision.heading_noise_rad")
        self._sigma = np.column_stack([position_sigma, position_sigma, heading_sigma])
        self._miss_probability = gather(settings, "vision.miss_probability")
        self._dropout_fraction = gather(settings, "vision.dropout_fraction")
        self._mean_dropout_images = gather(settings, "vision.mean_dropout_frames")
        self._errors = CameraErrors(settings, self._seeds)
        self._schedule = FaultSchedule(faults)
        self._apply_faults()

    def __call__(self, pose: Array, frame: int) -> Array:
        """Return the measured poses (n, 3); NaN for robots that were not detected.

        Args:
            pose: True poses, (n, 3).
            frame: Frame of the loop in which this image is taken.
        """
        # A robot is always detected in its first image, so that the team knows its pose.
        is_missed = self._has_images & (self._miss_noise.next()[:, 0] < self._miss_probability)
        self._is_dropout = self._has_images & continue_bursts(
            self._is_dropout,
            self._mean_dropout_images,
            self._dropout_fraction,
            self._dropout_noise.next()[:, 0],
        )
        self._has_images = True
        measured = self._get_visible_poses(pose, frame) + self._sigma * self._pose_noise.next()
        measured[:, 2] = wrap_angle(measured[:, 2])
        measured[is_missed | self._is_dropout] = np.nan
        measured[self._is_frozen] = self._last_measured[self._is_frozen]
        is_detected = ~np.isnan(measured[:, 0])
        self._last_measured[is_detected] = measured[is_detected]
        measured[self._is_lost] = np.nan
        return measured

    def _get_visible_poses(self, pose: Array, frame: int) -> Array:
        """Return the poses that faults show in place of the true poses (n, 3), without noise."""
        if self._schedule.advance(frame):
            self._apply_faults()
        uniform, visible = self._fault_noise.next(), pose.copy()
        visible[:, :2] += self._errors(pose[:, :2], self._number)
        for row, bias in self._biases:
            if uniform[row, 1] < bias.probability:
                visible[row] += bias.x_m, bias.y_m, np.radians(bias.heading_deg)
        for row, wrong_id in self._wrong_ids:
            if uniform[row, 0] < wrong_id.probability:
                visible[row] = wrong_id.x_m, wrong_id.y_m, np.radians(wrong_id.heading_deg)
        return visible

    def _apply_faults(self) -> None:
        """Set lost and frozen images, biases and wrong detections to those of the active faults."""
        self._is_lost, self._is_frozen = np.zeros((2, len(self._seeds)), bool)
        self._is_lost[[row for row, _ in self._schedule.list_active(VisionLoss)]] = True
        self._is_frozen[[row for row, _ in self._schedule.list_active(VisionFreeze)]] = True
        self._wrong_ids = list(self._schedule.list_active(VisionWrongId))
        self._biases = list(self._schedule.list_active(VisionBias))


class ImageTiming:
    """Arrival times of the images of n robots, and errors of their capture times.

    The clock errors and jitters of simultaneous faults add up.

    Args:
        settings: Delay and jitter of each row.
        seeds: Seed of each row.
        faults: Faults of each row.
    """

    def __init__(
        self,
        settings: Sequence[Settings],
        seeds: Sequence[Seed],
        faults: FaultsByRow,
    ) -> None:
        self._processing_noise = Noise(seeds, Stream.CAMERA_PROCESSING)
        self._jitter_noise = Noise(seeds, Stream.CAMERA_JITTER)
        self._loss_noise = Noise(seeds, Stream.CAMERA_LOSSES)
        self._fault_noise = Noise(seeds, Stream.CAMERA_LATE)
        self.change_settings(settings, faults)

    def change_settings(self, settings: Sequence[Settings], faults: FaultsByRow) -> None:
        """Change delays, losses and faults of images from now on."""
        self._nominal_delay_s = gather(settings, "vision.delay_s")
        self._jitter_s = gather(settings, "vision.jitter_s")
        # Gamma distribution: mean = shape * scale, (standard deviation / mean)^2 = 1 / shape
        self._processing_shape = gather(settings, "vision.processing_variation") ** -2
        self._processing_scale_s = gather(settings, "vision.processing_s") / self._processing_shape
        self._loss_probability = gather(settings, "vision.loss_probability")
        self._schedule = FaultSchedule(faults)
        self._apply_faults()

    def schedule_arrival(self, frame: int, time: float) -> tuple[Array, Array]:
        """Return the arrival time of an image, and the lag of its capture time.

        Args:
            frame: Frame of the loop in which the image is taken.
            time: Capture time since the start of the run, s.

        Returns:
            Arrival times (n,), s, infinite for a lost image; and the amounts (n,), s, by which the
            reported capture times are too early.
        """
        if self._schedule.advance(frame):
            self._apply_faults()
        delay = self._delay_s + self._fault_jitter_s * self._fault_noise.next()[:, 0]
        arrival = time + delay + self._jitter_s * self._jitter_noise.next()[:, 0]
        arrival += self._draw_processing_times()
        is_lost = self._loss_noise.next()[:, 0] < self._loss_probability
        clock_lag = self._clock_offset_s + self._clock_drift * time
        return np.where(is_lost, np.inf, arrival), clock_lag

    def _draw_processing_times(self) -> Array | float:
        """Return the processing times of an image, (n,) s."""
        if not self._processing_scale_s.any():
            return 0.0
        from scipy.special import gammaincinv  # slow to import

        quantile = gammaincinv(self._processing_shape, self._processing_noise.next()[:, 0])
        return np.asarray(self._processing_scale_s * quantile)

    def _apply_faults(self) -> None:
        """Set delay, jitter and clock error to those of the active faults."""
        self._delay_s = self._nominal_delay_s.copy()
        # The clock's lag at time t is offset + drift t.
        self._fault_jitter_s, self._clock_drift, self._clock_offset_s = np.zeros(
            (3, len(self._nominal_delay_s))
        )
        for row, delay in self._schedule.list_active(VisionDelay):
            self._delay_s[row] = delay.delay_s
        for row, jitter in self._schedule.list_active(VisionJitter):
            self._fault_jitter_s[row] += jitter.jitter_s
        for row, clock in self._schedule.list_active(VisionClockDrift):
            drift = clock.drift_ms_per_s / 1000
            self._clock_drift[row] += drift
            self._clock_offset_s[row] -= drift * clock.frame_span[0] * PERIOD_S


class _Image(NamedTuple):
    """An image on its way to the team.

    Attributes:
        time: Capture time, s.
        poses: Measured poses (n, 3); NaN for robots that were not detected.
        arrival: Arrival time for each row, (n,) s.
        clock_lag: Amount by which the reported capture time is too early, (n,) s.
    """

    time: float
    poses: Array
    arrival: Array
    clock_lag: Array


class Cameras:
    """The cameras of n rows. Rows with the same frame rate take images at the same times.

    Args:
        settings: Settings of each row.
        seeds: Seed of each row.
        faults: Faults of each row.
    """

    def __init__(
        self,
        settings: Sequence[Settings],
        seeds: Sequence[Seed],
        faults: FaultsByRow,
    ) -> None:
        rates = gather(settings, "vision.rate_hz")
        self._groups: list[tuple[np.ndarray, _CamerasWithSameRate]] = []
        for rate in np.unique(rates):
            rows: np.ndarray = np.flatnonzero(rates == rate)
            cameras = _CamerasWithSameRate(
                [settings[i] for i in rows], [seeds[i] for i in rows], [faults[i] for i in rows]
            )
            self._groups.append((rows, cameras))

    def change_settings(self, settings: Sequence[Settings], faults: FaultsByRow) -> None:
        """Change settings of images from now on, except the frame rate, and faults of each row."""
        for rows, cameras in self._groups:
            row_values = [settings[i] for i in rows], [faults[i] for i in rows]
            cameras.camera.change_settings(*row_values)
            cameras.timing.change_settings(*row_values)

    def __call__(self, pose: Array) -> tuple[Array, Array]:
        """Return the measured poses (n, 3) since the last frame, and their ages (n,), s.

        Rows without a measured pose are NaN. Ages are those according to capture times.

        Args:
            pose: True poses in this frame, (n, 3).
        """
        measured = np.full(pose.shape, np.nan)
        age = np.zeros(len(pose))
        for rows, cameras in self._groups:
            measured[rows], age[rows] = cameras.receive_images(pose[rows])
        return measured, age


class _CamerasWithSameRate:
    """The cameras of rows that take images at the same times."""

    def __init__(
        self,
        settings: Sequence[Settings],
        seeds: Sequence[Seed],
        faults: FaultsByRow,
    ) -> None:
        self.camera = Camera(settings, seeds, faults)
        self.timing = ImageTiming(settings, seeds, faults)
        self._rate_hz = settings[0].vision.rate_hz
        self._last_pose: Array | None = None
        self._frame = 0
        self._n_images = 0
        self._images_in_flight: list[_Image] = []
        self._newest_capture_time = np.full(len(seeds), -np.inf)

    def receive_images(self, pose: Array) -> tuple[Array, Array]:
        """Return the measured poses (n, 3) since the last frame, and their ages (n,), s.

        Args:
            pose: True poses in this frame, (n, 3).
        """
        now = self._frame * PERIOD_S
        self._take_images(now, pose)
        self._last_pose = pose
        self._frame += 1
        measured = np.full(pose.shape, np.nan)
        age = np.zeros(len(pose))
        for image in self._images_in_flight:
            has_arrived = (
                (image.arrival <= now + _TIME_TOLERANCE_S)
                & (image.time > self._newest_capture_time)
                & ~np.isnan(image.poses[:, 0])
            )
            measured[has_arrived] = image.poses[has_arrived]
            age[has_arrived] = np.maximum(now - image.time + image.clock_lag[has_arrived], 0.0)
            self._newest_capture_time[has_arrived] = image.time
        self._images_in_flight = [
            image
            for image in self._images_in_flight
            if (image.arrival > now + _TIME_TOLERANCE_S).any()
        ]
        return measured, age

    def _take_images(self, now: float, pose: Array) -> None:
        """Take all images since the last frame, with poses interpolated to their times."""
        last_pose = pose if self._last_pose is None else self._last_pose
        while (time := self._n_images / self._rate_hz) <= now + _TIME_TOLERANCE_S:
            if abs(time - now) <= _TIME_TOLERANCE_S:
                self._take_image(now, pose)
            else:
                fraction = (time - now) / PERIOD_S + 1
                self._take_image(time, last_pose + fraction * (pose - last_pose))

    def _take_image(self, time: float, pose: Array) -> None:
        """Take an image of the true poses (n, 3) at a time, s."""
        frame = int((time + _TIME_TOLERANCE_S) * FRAME_RATE_HZ)
        poses = self.camera(pose, frame)
        arrival, clock_lag = self.timing.schedule_arrival(frame, time)
        # A row that loses the image gets no pose from it, and does not wait for it.
        poses[np.isinf(arrival)] = np.nan
        arrival[np.isinf(arrival)] = time
        self._images_in_flight.append(_Image(time, poses, arrival, clock_lag))
        self._n_images += 1
