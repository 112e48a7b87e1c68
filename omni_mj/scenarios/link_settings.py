"""Settings of what is between robots and team: the cameras, and the radio."""

from typing import Self

from pydantic import model_validator

from omni_mj.scenarios.checking import Checked, setting
from omni_mj.scenarios.clock import FRAME_RATE_HZ


class VisionSettings(Checked):
    """The cameras. Noise and misses: "Realistic" of the ER-Force simulator."""

    position_noise_m: float = setting(0.0013, "m", "standard deviation of the position seen, per axis", 0, 1)
    heading_noise_rad: float = setting(0.01, "rad", "standard deviation of the heading seen", 0, 1)
    miss_probability: float = setting(0.02, "", "probability, per frame, that a robot is not seen from then on", 0, 0.9)
    miss_frames: int = setting(1, "frames", "how long it is then not seen", 1, 600)
    rate_hz: float = setting(
        float(FRAME_RATE_HZ), "Hz", "images of a camera per second, by a clock of its own", 10, 960
    )
    delay_s: float = setting(0.0, "s", "from an image to its packet's arrival", 0, 1)
    jitter_s: float = setting(0.0, "s", "a packet takes up to this longer, uniformly", 0, 1)
    loss_probability: float = setting(
        0.0, "", "probability that a packet, of one camera's image, never arrives", 0, 0.95
    )
    cameras: int = setting(
        1, "", "serve: how many share the field: 2 or 3 side by side along it, 4 a quarter each", 1, 4
    )
    overlap_m: float = setting(0.4, "m", "serve: width of the strips that two cameras see", 0, 4)
    camera_offset_m: float = setting(
        0.0, "m", "serve: standard deviation, per axis, by which a camera is out of place (seen: 0.02)", 0, 0.5
    )
    clock_offset_s: float = setting(0.0, "s", "serve: standard deviation by which a camera's clock is off", 0, 10)


class RadioSettings(Checked):
    """The radio link from the team's computer to the robot."""

    delay_frames: int = setting(6, "frames", "dead time k_d from command to robot (paper: 0.1 s)", 0, 600)
    jitter_frames: int = setting(0, "frames", "a packet takes up to this more or less, uniformly; newest wins", 0, 600)
    loss_probability: float = setting(0.0, "", "probability that a packet never arrives", 0, 0.95)

    @model_validator(mode="after")
    def _causal(self) -> Self:
        if self.jitter_frames > self.delay_frames:
            raise ValueError(
                "radio.jitter_frames must not be above radio.delay_frames: no packet arrives before it is sent"
            )
        return self
