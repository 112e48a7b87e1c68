"""Settings of the link between robots and team: cameras and radio."""

from collections.abc import Iterator
from typing import Literal

from omni_mj.config import CYCLES_PER_FRAME, FRAME_RATE_HZ, PERIOD_S
from omni_mj.config.validation import (
    Number,
    SettingsModel,
    Vectors,
    drop_zero_fraction,
    setting,
)

# Time between packets of a broadcast burst, with a lognormal distribution: median, and standard
# deviation of the logarithm. With them, half of all intervals between packets sent every 15 ms are
# below 1.136 ms, and 20 of 654 packets share a cycle of 1/960 s with a newer one.
BURST_SPACING_S, BURST_SPACING_SIGMA = 1.0984e-3, 0.155


class VisionSettings(SettingsModel):
    """Cameras. Default noise and misses are those of ER-Force's simulator, profile "Realistic"."""

    position_noise_m: float = setting(
        0.0013, "standard deviation of the measured position, per axis", "m", low=0, high=1
    )
    heading_noise_rad: float = setting(
        0.01, "standard deviation of the measured heading", "rad", low=0, high=1
    )
    miss_probability: float = setting(
        0.02,
        "probability that the cameras miss the robot in an image",
        low=0,
        high=0.9,
    )
    dropout_fraction: float = setting(
        0.0,
        "fraction of images in dropouts, in which the cameras miss the robot: bursts with random "
        "lengths, in addition to misses",
        low=0,
        high=0.8,
    )
    mean_dropout_frames: float = setting(
        5.0, "mean length of a dropout, images", "frames", low=1, high=600
    )
    rate_hz: float = setting(
        float(FRAME_RATE_HZ),
        "frame rate of a camera; its images need not coincide with the team's frames",
        "Hz",
        low=10,
        high=960,
    )
    delay_s: float = setting(
        0.0, "latency from exposure to arrival of the packet", "s", low=0, high=1
    )
    jitter_s: float = setting(
        0.0, "largest additional latency of a packet, uniformly distributed", "s", low=0, high=1
    )
    processing_s: float = setting(
        0.0,
        "mean processing time of an image, in addition to delay_s and jitter_s; it has a gamma "
        "distribution, which is skewed to late images",
        "s",
        low=0,
        high=1,
    )
    processing_variation: float = setting(
        0.5, "standard deviation of the processing time over its mean", low=0.05, high=3
    )
    loss_probability: float = setting(
        0.0, "probability that a packet (an image of one camera) is lost", low=0, high=0.95
    )
    cameras: int = setting(
        1,
        "number of cameras; each covers an equal part of the field's length (2, 3) or a quadrant "
        "(4), and has errors of its own",
        low=1,
        high=4,
    )
    overlap_m: float = setting(
        0.4,
        "omni-mj serve: width of the strips where the images of two cameras overlap",
        "m",
        low=0,
        high=4,
    )
    camera_offset_m: float = setting(
        0.0,
        "standard deviation of camera positions, per axis (observed: 0.02)",
        "m",
        low=0,
        high=0.5,
    )
    camera_offsets_m: Vectors = setting(
        (),
        "known displacement [x, y] of each camera's measurements, in addition to random errors; "
        "cameras that are not listed: none",
        "m",
        max_length=4,
    )
    calibration_error_m: float = setting(
        0.0,
        "standard deviation of the position error of a camera's calibration, per axis: a smooth "
        "function of the position on the field, random per seed",
        "m",
        low=0,
        high=0.5,
    )
    calibration_length_m: float = setting(
        2.0,
        "distance over which the calibration error changes: its correlation falls to 0.61",
        "m",
        low=0.1,
        high=100,
    )
    clock_offset_s: float = setting(
        0.0, "omni-mj serve: standard deviation of a camera's clock offset", "s", low=0, high=10
    )

    def find_contradictions(self) -> Iterator[str]:
        """Yield a message for impossible dropouts, and for offsets of cameras that do not exist."""
        fraction = self.dropout_fraction
        if fraction / (1 - fraction) > self.mean_dropout_frames:
            yield (
                "vision.mean_dropout_frames must be at least dropout_fraction / "
                f"(1 - dropout_fraction) = {fraction / (1 - fraction):.3g}, not "
                f"{self.mean_dropout_frames:g}: there is an image between two dropouts"
            )
        if len(self.camera_offsets_m) > self.cameras:
            yield (
                f"vision.camera_offsets_m has {len(self.camera_offsets_m)} offsets, but "
                f"vision.cameras is {self.cameras}"
            )


class RadioSettings(SettingsModel):
    """The radio link from the team's computer to the robot."""

    kind: Literal["fixed", "wifi-broadcast", "wifi-unicast", "time-slots"] = setting(
        "fixed",
        "time on air in addition to delay_frames: none (fixed), until the beacon of an access "
        "point (wifi-broadcast), a short random one (wifi-unicast), or until the robot's slot "
        "(time-slots)",
    )
    delay_frames: Number = setting(
        6,
        "dead time k_d: from sending a command to its first effect (paper: 0.1 s); rounded to "
        "cycles of 1/960 s",
        "frames",
        low=0,
        high=600,
    )
    jitter_frames: Number = setting(
        0,
        "largest deviation of the dead time, uniformly distributed, in whole frames if it is "
        "whole; robots apply the newest packet",
        "frames",
        low=0,
        high=600,
    )
    loss_probability: float = setting(0.0, "probability that a packet is lost", low=0, high=0.95)
    beacon_interval_s: float = setting(
        0.1024, "wifi-broadcast: time between two bursts", "s", low=0.01, high=1
    )
    burst_loss_probability: float = setting(
        0.02, "wifi-broadcast: probability that a whole burst is lost", low=0, high=0.95
    )
    access_delay_s: float = setting(
        0.00096,
        "wifi-unicast: largest value of two random waits of a packet, each uniformly distributed",
        "s",
        low=0,
        high=0.1,
    )
    slots: int = setting(
        16,
        "time-slots: number of slots in a cycle; robot i of a world has slot i",
        low=1,
        high=64,
    )
    slot_s: float = setting(
        0.001, "time-slots: length of a slot, with the answer", "s", low=0.0001, high=0.02
    )

    @property
    def slot_cycle_s(self) -> float:
        """Time between two slots of a robot, s."""
        return self.slots * self.slot_s

    @property
    def _burst_s(self) -> float:
        """Mean length of a burst, s: a packet for each frame between two bursts."""
        return BURST_SPACING_S * self.beacon_interval_s / PERIOD_S

    @property
    def mean_air_frames(self) -> float:
        """Mean time on air, frames. A burst is half as long on average as all of its packets."""
        means = {
            "fixed": 0.0,
            "wifi-broadcast": (self.beacon_interval_s + self._burst_s) / 2,
            "wifi-unicast": self.access_delay_s,
            "time-slots": self.slot_cycle_s / 2,
        }
        return means[self.kind] / PERIOD_S

    @property
    def max_air_frames(self) -> float:
        """Upper limit of the time on air, frames: for broadcasts, twice the mean burst."""
        limits = {
            "fixed": 0.0,
            "wifi-broadcast": self.beacon_interval_s + 2 * self._burst_s + PERIOD_S,
            "wifi-unicast": 2 * self.access_delay_s,
            "time-slots": self.slot_cycle_s,
        }
        return limits[self.kind] / PERIOD_S

    @property
    def mean_delay_frames(self) -> float:
        """Mean dead time, frames; an integer if it is a whole number.

        The dead time is a whole number of cycles, and the mean time on air is added.
        """
        delay = round(self.delay_frames * CYCLES_PER_FRAME) / CYCLES_PER_FRAME
        return drop_zero_fraction(delay + self.mean_air_frames)

    def find_contradictions(self) -> Iterator[str]:
        """Yield a message if the jitter is above the dead time."""
        if self.jitter_frames > self.delay_frames:
            yield (
                "radio.jitter_frames must not be above radio.delay_frames: packets would arrive "
                "before they are sent"
            )
