"""Kinds of faults: each [[fault]] of a scenario is one of these classes.

To add a kind, add a class here, and its effect where it acts: `omni_mj.plants.fault_effects` for
robots on wheels, `omni_mj.network.radio` for the radio, `omni_mj.network.camera` for the camera.
"""

import math
import re
from collections.abc import Iterable, Iterator
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, computed_field

from omni_mj.config import FRAME_RATE_HZ, PERIOD_S
from omni_mj.config.validation import FRICTION_RANGE, MAX_COORDINATE_M, SettingsModel, setting

WHEELED_PLANTS = ("mujoco", "planar")
KINEMATIC_PLANTS = ("kinematic",)
MAX_ROBOT_ID = 15  # in the league
FAULT_KINDS: dict[str, type["Fault"]] = {}  # name in files -> class
RobotIds = Annotated[tuple[Annotated[int, Field(ge=0, le=MAX_ROBOT_ID)], ...], Field(strict=False)]


class Fault(SettingsModel):
    """A fault with a start and a duration.

    Attributes:
        plants: Plants that support it; None if it acts between robot and team, on every plant.
    """

    plants: ClassVar[tuple[str, ...] | None] = None

    start_s: float = setting(
        ..., "s", "start, from the start of the run; rounded to a frame", 0, 36_000
    )
    duration_s: float = setting(0.0, "s", "duration; 0: until the end of the run", 0, 36_000)
    robots: RobotIds = setting(
        (), "", "slots of the affected robots (serve: their ids in the team); empty: all", 0, 12
    )

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        is_abstract = cls.__name__.endswith("Fault")
        if not is_abstract:
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
        """First frame, and first frame after the end; infinite without a duration."""
        start = round(self.start_s * FRAME_RATE_HZ)
        if not self.duration_s:
            return start, math.inf
        return start, start + round(self.duration_s * FRAME_RATE_HZ)

    def affects(self, robot: int) -> bool:
        """Return whether it affects the robot in a slot."""
        return not self.robots or robot in self.robots

    def find_contradictions(self) -> Iterator[str]:
        """Yield a message if it is shorter than a frame."""
        if 0 < self.duration_s < 0.999 * PERIOD_S:
            yield (
                f"duration_s must be 0 or at least a frame, {PERIOD_S:.4f} s, "
                f"not {self.duration_s:g}"
            )


def select_faults_of_robot(faults: Iterable[Fault], robot: int) -> tuple[Fault, ...]:
    """Return the faults that affect the robot in a slot."""
    return tuple(fault for fault in faults if fault.affects(robot))


def _kind_name(fault_class: type[Fault]) -> str:
    """Return the name of a kind in files: wheel-worn for `WheelWorn`."""
    return re.sub("(?<=[a-z])(?=[A-Z])", "-", fault_class.__name__).lower()


class WheeledRobotFault(Fault):
    """A fault of a robot on wheels."""

    plants = WHEELED_PLANTS


class WheelFault(WheeledRobotFault):
    """A fault of one wheel, or of its motor or encoder."""

    wheel: int = setting(
        ..., "", "number of the wheel, from 1 at the front left, counter-clockwise", 1, 8
    )


def _probability(doc: str, default: Any = ...) -> Any:
    return setting(default, "", f"probability {doc}", 0, 1)


# Faults of the world.


class Push(WheeledRobotFault):
    """An external force on the chassis at its center of mass."""

    force_n: float = setting(..., "N", "force", 0, 1000)
    direction_deg: float = setting(
        0.0, "deg", "direction of the force, from the world's x axis to its y axis", -360, 360
    )


class Kidnap(Fault):
    """An instant displacement of the robot, at rest; its gyro and encoders do not measure it."""

    plants = WHEELED_PLANTS + KINEMATIC_PLANTS
    x_m: float = setting(0.0, "m", "displacement along the world's x axis", -10, 10)
    y_m: float = setting(0.0, "m", "displacement along the world's y axis", -10, 10)
    heading_deg: float = setting(0.0, "deg", "rotation", -180, 180)

    @property
    def displacement(self) -> tuple[float, float, float]:
        """Displacement [x, y, heading], m, m, rad."""
        return self.x_m, self.y_m, math.radians(self.heading_deg)


class Payload(WheeledRobotFault):
    """An additional point mass above or below the chassis' center of mass."""

    mass_kg: float = setting(..., "kg", "additional mass", 0, 20)
    height_m: float = setting(
        0.0, "m", "height above the carpet; 0: that of the chassis' center of mass", 0, 0.5
    )


class Tilt(WheeledRobotFault):
    """A sloping carpet: gravity has a component along it, for all robots of the world."""

    angle_deg: float = setting(..., "deg", "slope", 0, 30)
    direction_deg: float = setting(
        0.0, "deg", "direction downhill, from the world's x axis to its y axis", -360, 360
    )

    def find_contradictions(self) -> Iterator[str]:
        """Yield a message if it names robots."""
        yield from super().find_contradictions()
        if self.robots:
            yield "robots must be left out of a tilt: all robots of a world stand on one carpet"


class Friction(WheeledRobotFault):
    """Another friction coefficient of the carpet outside of patches."""

    friction: float = setting(
        ..., "", "friction coefficient, in place of carpet.friction", *FRICTION_RANGE
    )


class FrictionPatch(WheeledRobotFault):
    """A circular patch of other friction, above those in carpet.patches."""

    x_m: float = setting(
        ..., "m", "x of the center, world frame", -MAX_COORDINATE_M, MAX_COORDINATE_M
    )
    y_m: float = setting(
        ..., "m", "y of the center, world frame", -MAX_COORDINATE_M, MAX_COORDINATE_M
    )
    radius_m: float = setting(..., "m", "radius", 0.01, 20)
    friction: float = setting(..., "", "friction coefficient", *FRICTION_RANGE)


class Alpha(Fault):
    """Another gain alpha of equation 7, on all axes."""

    plants = KINEMATIC_PLANTS
    alpha: float = setting(..., "", "alpha, in place of random values", 0, 2)


# Faults of the robot.


class MotorDemagnetized(WheelFault):
    """A motor with weak magnets: less torque per current, and less back-EMF per speed."""

    factor: float = setting(..., "", "factor of the torque constant", 0.05, 2)


class MotorDead(WheelFault):
    """A motor without current, as with a driver that is off: its wheel is dragged along."""


class MotorBlocked(WheelFault):
    """A locked rotor: the wheel does not turn, and slides."""


class WheelWorn(WheelFault):
    """A wheel with worn rubber: less friction at the same radius."""

    factor: float = setting(..., "", "factor of the carpet's friction", 0.01, 2)


class WheelMissingRollers(WheelFault):
    """A wheel with missing rollers: no grip once per turn, while the gap is at the carpet."""

    rollers: int = setting(1, "", "number of missing rollers, side by side", 1, 8)


class EncoderDropout(WheelFault):
    """An encoder that misses all counts of some frames: a loose or broken contact."""

    probability: float = _probability("per frame", 1.0)


class EncoderScale(WheelFault):
    """An encoder with other counts per turn than the firmware assumes."""

    factor: float = setting(..., "", "factor of the counts", 0.1, 4)


class GyroBias(WheeledRobotFault):
    """A gyro bias, in addition to sensors.gyro_bias_rad_s."""

    bias_rad_s: float = setting(..., "rad/s", "bias", -10, 10)


class GyroScale(WheeledRobotFault):
    """A gyro with another sensitivity than the firmware assumes."""

    factor: float = setting(..., "", "factor of the gyro's signal; 0: no signal", 0, 4)


class FirmwareTimeout(WheeledRobotFault):
    """A radio timeout: the firmware stops the wheels until the fault ends and a packet comes."""


class BrownOut(WheeledRobotFault):
    """A supply voltage dip at the motors; the processor keeps running."""

    factor: float = setting(..., "", "factor of the battery's voltage", 0.05, 1)


class Reboot(WheeledRobotFault):
    """A restart of the firmware, completed when the fault ends; until then no loop runs.

    It forgets heading, gyro bias and the state of its loops. It stands until the first packet, and
    takes the heading of vision in that packet for its own.
    """

    motors: Literal["coast", "brake"] = setting(
        "coast",
        "",
        "until then: coast: drivers off, wheels roll; brake: drivers short the windings",
    )


# Faults between robot and team.


class RadioDelay(Fault):
    """Another dead time of packets sent during the fault; the team does not know."""

    delay_frames: int = setting(..., "frames", "dead time, in place of radio.delay_frames", 0, 600)


class RadioLoss(Fault):
    """Packets that are lost independently."""

    probability: float = _probability(
        "that a packet is lost, in addition to radio.loss_probability", 1.0
    )


class RadioBurstLoss(Fault):
    """Packets that are lost in bursts: the channel of Gilbert (1960) and Elliott (1963).

    A Markov chain steps from frame to frame between a state without losses, in which it begins, and
    a state with losses.
    """

    mean_burst_frames: float = setting(..., "frames", "mean duration of a burst", 1, 600)
    burst_fraction: float = setting(
        ..., "", "fraction of time in bursts, in the long run", 0.001, 0.5
    )
    probability: float = _probability("that a packet in a burst is lost", 1.0)


class RadioDuplicates(Fault):
    """Packets that arrive twice; a robot applies the copy until the next packet comes."""

    probability: float = _probability("that a packet arrives again")
    delay_frames: int = setting(
        ..., "frames", "delay of the copy, which is the last packet applied in its frame", 1, 120
    )


class RadioReorder(Fault):
    """Packets that arrive after newer ones; a robot applies them until the next packet comes."""

    probability: float = _probability("that a packet is late")
    delay_frames: int = setting(
        ...,
        "frames",
        "additional delay; a late packet is the last one applied in its frame",
        1,
        120,
    )


class VisionLoss(Fault):
    """A camera that does not detect the robot."""


class VisionFreeze(Fault):
    """A camera that repeats its last image, with new timestamps."""


class VisionWrongId(Fault):
    """Detections of another robot, at rest elsewhere, with the id of this one."""

    x_m: float = setting(..., "m", "x of the other robot", -MAX_COORDINATE_M, MAX_COORDINATE_M)
    y_m: float = setting(..., "m", "y of the other robot", -MAX_COORDINATE_M, MAX_COORDINATE_M)
    heading_deg: float = setting(0.0, "deg", "heading of the other robot", -360, 360)
    probability: float = _probability("per image", 1.0)


class VisionBias(Fault):
    """A biased measurement: a displaced or badly calibrated camera, or a reversed heading."""

    x_m: float = setting(0.0, "m", "error along the world's x axis", -1, 1)
    y_m: float = setting(0.0, "m", "error along the world's y axis", -1, 1)
    heading_deg: float = setting(0.0, "deg", "error of the heading", -180, 180)
    probability: float = _probability("per image", 1.0)


class VisionClockDrift(Fault):
    """A drifting camera clock: the stated age of images is too high, by a growing error.

    The team extrapolates measurements too far. The clock is corrected when the fault ends.
    """

    drift_ms_per_s: float = setting(..., "ms/s", "drift; below 0: ages too low", -100, 100)


class VisionJitter(Fault):
    """Random additional latency of images; their timestamps are correct."""

    jitter_s: float = setting(
        ..., "s", "largest additional latency, uniform, in addition to vision.jitter_s", 0, 1
    )


class VisionDelay(Fault):
    """Another latency of the camera."""

    delay_s: float = setting(
        ..., "s", "latency from exposure to arrival, in place of vision.delay_s", 0, 1
    )
