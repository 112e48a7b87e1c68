"""Kinds of faults: each [[fault]] of a scenario is one of these classes.

To add a kind, add a class here, and its effect where it acts: `omni_mj.plants.fault_effects` for
robots on wheels, `omni_mj.network.radio` for the radio, `omni_mj.network.camera` for the camera.
"""

import math
import re
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, computed_field

from omni_mj.config import FRAME_RATE_HZ, PERIOD_S
from omni_mj.config.validation import (
    MAX_COORDINATE_M,
    MAX_FRICTION,
    MIN_FRICTION,
    REQUIRED,
    Number,
    SettingsModel,
    setting,
)

WHEELED_PLANTS = ("mujoco", "planar")
KINEMATIC_PLANTS = ("kinematic",)
MAX_ROBOT_ID = 15  # in the league
FAULT_KINDS: dict[str, type["Fault"]] = {}  # name in files -> class
RobotIds = Annotated[tuple[Annotated[int, Field(ge=0, le=MAX_ROBOT_ID)], ...], Field(strict=False)]


class Fault(SettingsModel):
    """A fault with a start and a duration. Each subclass is a kind, unless its name ends in Fault.

    Attributes:
        plants: Plants that support it. None: all, because it acts between robot and team.
    """

    plants: ClassVar[tuple[str, ...] | None] = None

    start_s: float = setting(
        REQUIRED, "start, from the start of the run; rounded to a frame", "s", low=0, high=36_000
    )
    duration_s: float = setting(
        0.0, "duration; 0: until the end of the run", "s", low=0, high=36_000
    )
    robots: RobotIds = setting(
        (),
        "slots of the affected robots (omni-mj serve: their ids in the team); empty: all",
        max_length=12,
    )

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        if not cls.__name__.endswith("Fault"):
            FAULT_KINDS[_kind_name(cls)] = cls

    @computed_field  # type: ignore[prop-decorator]
    @property
    def kind(self) -> str:
        """Name of the kind in files."""
        return _kind_name(type(self))

    @property
    def label(self) -> str:
        """Kind and parameters, such as 'push (force_n = 20, direction_deg = 90)'."""
        parameters = [
            f"{name} = {value if isinstance(value, str) else format(value, 'g')}"
            for name, value in self
            if name not in Fault.model_fields
        ]
        return f"{self.kind} ({', '.join(parameters)})" if parameters else self.kind

    @property
    def description(self) -> str:
        """Label, time span and affected robots."""
        end = f"to {self.start_s + self.duration_s:g} s" if self.duration_s else "on"
        robots = f", robots {', '.join(map(str, self.robots))}" if self.robots else ""
        return f"{self.label}, from {self.start_s:g} s {end}{robots}"

    @property
    def frame_span(self) -> tuple[int, float]:
        """Number of the first frame, and of the first frame after the end (infinite: no end)."""
        start = round(self.start_s * FRAME_RATE_HZ)
        if not self.duration_s:
            return start, math.inf
        return start, start + round(self.duration_s * FRAME_RATE_HZ)

    def affects(self, robot: int) -> bool:
        """Return whether the fault affects the robot with a number as in `robots`."""
        return not self.robots or robot in self.robots

    def find_contradictions(self) -> Iterator[str]:
        """Yield a message if the fault is shorter than a frame."""
        # The factor allows for rounding, such as 0.01666 for 1/60.
        if 0 < self.duration_s < 0.999 * PERIOD_S:
            yield (
                f"duration_s must be 0 or at least a frame, {PERIOD_S:.4f} s, "
                f"not {self.duration_s:g}"
            )


def _kind_name(fault_class: type[Fault]) -> str:
    """Return the name of a kind in files: wheel-worn for `WheelWorn`."""
    return re.sub("(?<=[a-z])(?=[A-Z])", "-", fault_class.__name__).lower()


class WheeledRobotFault(Fault):
    """A fault of a robot on wheels."""

    plants = WHEELED_PLANTS


class WheelFault(WheeledRobotFault):
    """A fault of one wheel, or of its motor or encoder."""

    wheel: int = setting(
        REQUIRED, "number of the wheel, from 1 at the front left, counter-clockwise", low=1, high=8
    )


def _coordinate_setting(doc: str) -> Any:
    return setting(REQUIRED, doc, "m", low=-MAX_COORDINATE_M, high=MAX_COORDINATE_M)


def _angle_setting(doc: str) -> Any:
    return setting(0.0, doc, "deg", low=-360, high=360)


def _probability_setting(doc: str, default: Any = REQUIRED) -> Any:
    return setting(default, f"probability {doc}", low=0, high=1)


# Faults of the world.


class Push(WheeledRobotFault):
    """An external force on the chassis at its center of mass."""

    force_n: float = setting(REQUIRED, "force", "N", low=0, high=1000)
    direction_deg: float = _angle_setting(
        "direction of the force, from the world's x axis to its y axis"
    )


class Kidnap(Fault):
    """An instant displacement of the robot, at rest; its gyro and encoders do not measure it."""

    plants = WHEELED_PLANTS + KINEMATIC_PLANTS
    x_m: float = setting(0.0, "displacement along the world's x axis", "m", low=-10, high=10)
    y_m: float = setting(0.0, "displacement along the world's y axis", "m", low=-10, high=10)
    heading_deg: float = setting(0.0, "rotation", "deg", low=-180, high=180)

    @property
    def displacement(self) -> tuple[float, float, float]:
        """Displacement [x, y, heading], m, m, rad."""
        return self.x_m, self.y_m, math.radians(self.heading_deg)


class Payload(WheeledRobotFault):
    """An additional point mass above or below the chassis's center of mass."""

    mass_kg: float = setting(REQUIRED, "additional mass", "kg", low=0, high=20)
    height_m: float = setting(
        0.0,
        "height of the mass above the carpet; 0: at the chassis's center of mass",
        "m",
        low=0,
        high=0.5,
    )


class Tilt(WheeledRobotFault):
    """A sloping carpet: gravity has a component along it, for all robots of the world."""

    angle_deg: float = setting(REQUIRED, "slope", "deg", low=0, high=30)
    direction_deg: float = _angle_setting(
        "direction downhill, from the world's x axis to its y axis"
    )

    def find_contradictions(self) -> Iterator[str]:
        """Yield a message if the fault names robots."""
        yield from super().find_contradictions()
        if self.robots:
            yield "robots must be left out of a tilt: all robots of a world stand on one carpet"


class Friction(WheeledRobotFault):
    """Another friction coefficient of the carpet, outside of its patches."""

    friction: float = setting(
        REQUIRED,
        "friction coefficient, in place of carpet.friction",
        low=MIN_FRICTION,
        high=MAX_FRICTION,
    )


class FrictionPatch(WheeledRobotFault):
    """A circular patch with another friction coefficient, on top of those in carpet.patches."""

    x_m: float = _coordinate_setting("x of the center, world frame")
    y_m: float = _coordinate_setting("y of the center, world frame")
    radius_m: float = setting(REQUIRED, "radius", "m", low=0.01, high=20)
    friction: float = setting(REQUIRED, "friction coefficient", low=MIN_FRICTION, high=MAX_FRICTION)


class Alpha(Fault):
    """A constant alpha (equation 7) on all axes."""

    plants = KINEMATIC_PLANTS
    alpha: float = setting(REQUIRED, "alpha, in place of random values", low=0, high=2)


# Faults of the robot.


class MotorDemagnetized(WheelFault):
    """A motor with weak magnets: less torque per current, and less back-EMF per speed."""

    factor: float = setting(REQUIRED, "factor of the torque constant", low=0.05, high=2)


class MotorDead(WheelFault):
    """A motor without current, as if its driver were off: the moving robot turns the wheel."""


class MotorBlocked(WheelFault):
    """A locked rotor: the wheel does not turn, and slides."""


class WheelWorn(WheelFault):
    """A wheel with worn rubber: less friction at the same radius."""

    factor: float = setting(REQUIRED, "factor of the friction coefficient", low=0.01, high=2)


class WheelMissingRollers(WheelFault):
    """A wheel with missing rollers: no grip once per turn, while the gap is at the carpet."""

    rollers: int = setting(1, "number of missing adjacent rollers", low=1, high=8)


class EncoderDropout(WheelFault):
    """An encoder that misses all counts of some frames: a loose or broken contact."""

    probability: float = _probability_setting("per frame", 1.0)


class EncoderScale(WheelFault):
    """An encoder whose counts per turn differ from those that the firmware assumes."""

    factor: float = setting(REQUIRED, "factor of the counts", low=0.1, high=4)


class GyroBias(WheeledRobotFault):
    """A gyro bias, in addition to sensors.gyro_bias_rad_s."""

    bias_rad_s: float = setting(REQUIRED, "bias", "rad/s", low=-10, high=10)


class GyroScale(WheeledRobotFault):
    """A gyro whose sensitivity differs from the one that the firmware assumes."""

    factor: float = setting(REQUIRED, "factor of the gyro's signal; 0: no signal", low=0, high=4)


class FirmwareTimeout(WheeledRobotFault):
    """A radio timeout: the firmware stops the wheels until the fault ends and a packet comes."""


class BrownOut(WheeledRobotFault):
    """A supply voltage dip at the motors; the processor keeps running."""

    factor: float = setting(REQUIRED, "factor of the battery's voltage", low=0.05, high=1)


class Reboot(WheeledRobotFault):
    """A restart of the firmware. No control loop runs during the fault.

    The firmware loses its heading, the gyro bias and the state of its loops. After the fault, the
    robot stands still until the first packet. It then adopts the heading by vision in that packet.
    """

    motors: Literal["coast", "brake"] = setting(
        "coast", "motor drivers during the fault: off (coast), or shorting the windings (brake)"
    )


# Faults between robot and team.


class RadioDelay(Fault):
    """Another dead time of packets sent during the fault, which the team does not know."""

    delay_frames: Number = setting(
        REQUIRED, "dead time, in place of radio.delay_frames", "frames", low=0, high=600
    )


class RadioLoss(Fault):
    """Packets that are lost independently."""

    probability: float = _probability_setting(
        "that a packet is lost, in addition to radio.loss_probability", 1.0
    )


class RadioBurstLoss(Fault):
    """Packets that are lost in bursts: the channel of Gilbert (1960) and Elliott (1963).

    A Markov chain steps from frame to frame between a state without losses, in which it begins, and
    a state with losses.
    """

    mean_burst_frames: float = setting(
        REQUIRED, "mean duration of a burst", "frames", low=1, high=600
    )
    burst_fraction: float = setting(
        REQUIRED, "fraction of time in bursts, in the long run", low=0.001, high=0.5
    )
    probability: float = _probability_setting("that a packet in a burst is lost", 1.0)


class RadioDuplicates(Fault):
    """Packets that arrive twice. A robot applies the copy until the next packet arrives."""

    probability: float = _probability_setting("that a packet arrives again")
    delay_frames: Number = setting(
        REQUIRED,
        "delay of the copy, which is applied after other packets of its frame",
        "frames",
        low=1,
        high=120,
    )


class RadioReorder(Fault):
    """Packets that arrive after newer ones. A robot applies them until the next packet arrives."""

    probability: float = _probability_setting("that a packet is late")
    delay_frames: Number = setting(
        REQUIRED,
        "additional delay; a late packet is applied after other packets of its frame",
        "frames",
        low=1,
        high=120,
    )


class VisionLoss(Fault):
    """A camera that does not detect the robot."""


class VisionFreeze(Fault):
    """A camera that repeats its last image, with new timestamps."""


class VisionWrongId(Fault):
    """Detections of another robot, at rest elsewhere, with the id of this one."""

    x_m: float = _coordinate_setting("x of the other robot")
    y_m: float = _coordinate_setting("y of the other robot")
    heading_deg: float = _angle_setting("heading of the other robot")
    probability: float = _probability_setting("per image", 1.0)


class VisionBias(Fault):
    """A biased measurement: a displaced or badly calibrated camera, or a reversed heading."""

    x_m: float = setting(0.0, "error along the world's x axis", "m", low=-1, high=1)
    y_m: float = setting(0.0, "error along the world's y axis", "m", low=-1, high=1)
    heading_deg: float = setting(0.0, "error of the heading", "deg", low=-180, high=180)
    probability: float = _probability_setting("per image", 1.0)


class VisionClockDrift(Fault):
    """A drifting camera clock. By their timestamps, images seem older and older than they are.

    So the team extrapolates measurements too far. The clock is corrected when the fault ends.
    """

    drift_ms_per_s: float = setting(
        REQUIRED, "drift; below 0: images seem younger than they are", "ms/s", low=-100, high=100
    )


class VisionJitter(Fault):
    """A random additional latency of images. Their timestamps are correct."""

    jitter_s: float = setting(
        REQUIRED,
        "largest latency, uniformly distributed, in addition to vision.jitter_s",
        "s",
        low=0,
        high=1,
    )


class VisionDelay(Fault):
    """Another latency of the camera."""

    delay_s: float = setting(
        REQUIRED, "latency from exposure to arrival, in place of vision.delay_s", "s", low=0, high=1
    )
