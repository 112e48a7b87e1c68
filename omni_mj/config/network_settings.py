"""Settings of the link between robots and team: cameras and radio."""

from collections.abc import Iterator

from omni_mj.config import FRAME_RATE_HZ
from omni_mj.config.validation import SettingsModel, setting


class VisionSettings(SettingsModel):
    """Cameras. Noise and misses are those of the "Realistic" profile of the ER-Force simulator."""

    position_noise_m: float = setting(
        0.0013, "m", "standard deviation of the measured position, per axis", 0, 1
    )
    heading_noise_rad: float = setting(
        0.01, "rad", "standard deviation of the measured heading", 0, 1
    )
    miss_probability: float = setting(
        0.02, "", "probability, per frame, that detection of a robot is lost", 0, 0.9
    )
    miss_frames: int = setting(1, "frames", "duration of a lost detection", 1, 600)
    rate_hz: float = setting(
        float(FRAME_RATE_HZ), "Hz", "frame rate of a camera, which has its own clock", 10, 960
    )
    delay_s: float = setting(0.0, "s", "latency from exposure to arrival of the packet", 0, 1)
    jitter_s: float = setting(
        0.0, "s", "largest additional latency of a packet, uniformly distributed", 0, 1
    )
    loss_probability: float = setting(
        0.0, "", "probability that a packet (an image of one camera) is lost", 0, 0.95
    )
    cameras: int = setting(
        1, "", "serve: number of cameras; 2 or 3 divide the field's length, 4 its quadrants", 1, 4
    )
    overlap_m: float = setting(
        0.4, "m", "serve: width of the strips where the images of two cameras overlap", 0, 4
    )
    camera_offset_m: float = setting(
        0.0, "m", "serve: standard deviation of camera positions, per axis (observed: 0.02)", 0, 0.5
    )
    clock_offset_s: float = setting(
        0.0, "s", "serve: standard deviation of a camera's clock offset", 0, 10
    )


class RadioSettings(SettingsModel):
    """The radio link from the team's computer to the robot."""

    delay_frames: int = setting(
        6, "frames", "dead time k_d from command to robot (paper: 0.1 s)", 0, 600
    )
    jitter_frames: int = setting(
        0, "frames", "largest deviation of dead time, uniform; the newest packet wins", 0, 600
    )
    loss_probability: float = setting(0.0, "", "probability that a packet is lost", 0, 0.95)

    def find_contradictions(self) -> Iterator[str]:
        """Yield a message if packets would arrive before they are sent."""
        if self.jitter_frames > self.delay_frames:
            yield (
                "radio.jitter_frames must not be above radio.delay_frames: no packet arrives "
                "before it is sent"
            )
