"""Settings of the link between robots and team: cameras and radio."""

from collections.abc import Iterator

from omni_mj.config import FRAME_RATE_HZ
from omni_mj.config.validation import SettingsModel, setting


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
        "probability per frame that the cameras begin to miss the robot, for miss_frames",
        low=0,
        high=0.9,
    )
    miss_frames: int = setting(
        1,
        "number of consecutive frames in which the cameras then miss the robot",
        "frames",
        low=1,
        high=600,
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
    loss_probability: float = setting(
        0.0, "probability that a packet (an image of one camera) is lost", low=0, high=0.95
    )
    cameras: int = setting(
        1,
        "omni-mj serve: number of cameras; each covers an equal part of the field's length "
        "(2, 3) or a quadrant (4)",
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
        "omni-mj serve: standard deviation of camera positions, per axis (observed: 0.02)",
        "m",
        low=0,
        high=0.5,
    )
    clock_offset_s: float = setting(
        0.0, "omni-mj serve: standard deviation of a camera's clock offset", "s", low=0, high=10
    )


class RadioSettings(SettingsModel):
    """The radio link from the team's computer to the robot."""

    delay_frames: int = setting(
        6,
        "dead time k_d: from sending a command to its first effect (paper: 0.1 s)",
        "frames",
        low=0,
        high=600,
    )
    jitter_frames: int = setting(
        0,
        "largest deviation of the dead time, uniformly distributed; robots apply the newest packet",
        "frames",
        low=0,
        high=600,
    )
    loss_probability: float = setting(0.0, "probability that a packet is lost", low=0, high=0.95)

    def find_contradictions(self) -> Iterator[str]:
        """Yield a message if the jitter is above the dead time."""
        if self.jitter_frames > self.delay_frames:
            yield (
                "radio.jitter_frames must not be above radio.delay_frames: packets would arrive "
                "before they are sent"
            )
