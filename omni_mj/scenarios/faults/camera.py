"""What happens to the camera: it is blind, shows what is not there, or shows it late."""

from typing import Literal

from omni_mj.scenarios.checking import REACH_M, setting
from omni_mj.scenarios.faults.base import Fault, chance


class VisionOut(Fault):
    """The camera does not see the robot."""

    says = "camera that does not see the robot"

    kind: Literal["vision-out"] = setting("vision-out", "", "a camera that does not see the robot")


class VisionFreeze(Fault):
    """The camera shows what it saw last, again and again, as if it saw it now."""

    says = "camera that is frozen"

    kind: Literal["vision-freeze"] = setting("vision-freeze", "", "a camera that shows its last image again and again")


class VisionMirrored(Fault):
    """The camera sees the robot backwards: its pattern is read the wrong way round."""

    says = "heading seen backwards in {probability:g} of the images"

    kind: Literal["vision-mirrored"] = setting(
        "vision-mirrored", "", "a heading that is seen backwards, by half a turn"
    )
    probability: float = chance("of an image", 1.0)


class VisionWrongId(Fault):
    """The camera takes another for the robot: it shows the pose of what stands elsewhere."""

    says = "another at ({x_m:g}, {y_m:g}) m that is taken for the robot in {probability:g} of the images"

    kind: Literal["vision-wrong-id"] = setting("vision-wrong-id", "", "another that is taken for the robot")
    x_m: float = setting(..., "m", "where it stands", -REACH_M, REACH_M)
    y_m: float = setting(..., "m", "same", -REACH_M, REACH_M)
    heading_deg: float = setting(0.0, "deg", "its heading", -360, 360)
    probability: float = chance("of an image", 1.0)


class VisionBias(Fault):
    """The camera sees the robot beside where it is, as one that was knocked, or calibrated badly."""

    says = "camera that sees {x_m:g} m, {y_m:g} m and {heading_deg:g} deg too much"

    kind: Literal["vision-bias"] = setting("vision-bias", "", "a camera that sees the robot beside where it is")
    x_m: float = setting(0.0, "m", "how much too far along the world's x", -1, 1)
    y_m: float = setting(0.0, "m", "same, along y", -1, 1)
    heading_deg: float = setting(0.0, "deg", "how much too far turned", -180, 180)


class VisionClock(Fault):
    """The camera's clock goes wrong: images are said to be older than they are by a time that grows.

    By that much farther the team carries what was seen on. When the fault ends, the clock is set right.
    """

    says = "camera whose clock loses {ms_per_s:g} ms a second"

    kind: Literal["vision-clock"] = setting("vision-clock", "", "a camera's clock that goes wrong")
    ms_per_s: float = setting(..., "ms/s", "how much it loses; below 0: gains", -100, 100)


class VisionJitter(Fault):
    """Images that come late, each by another time, of which the team knows when they were taken."""

    says = "images up to {s:g} s late"

    kind: Literal["vision-jitter"] = setting("vision-jitter", "", "images that come late, each by another time")
    s: float = setting(..., "s", "how late at most, uniformly, beside vision.jitter_s", 0, 1)


class VisionDelay(Fault):
    """Another time from an image to its packet's arrival."""

    says = "images that arrive after {to:g} s"

    kind: Literal["vision-delay"] = setting("vision-delay", "", "another latency of the camera")
    to: float = setting(..., "s", "from an image to its packet's arrival, in place of vision.delay_s", 0, 1)
