"""What may happen while a run goes on: each kind of [[fault]] with its settings.

A kind is a class here, and a small function where it acts: `omni_mj.plants.fault_effects` for robots on wheels,
`omni_mj.network.radio` for the radio, `omni_mj.network.camera` for the camera.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field, computed_field

from omni_control.errors import OmniError, suggest_names
from omni_mj.config import FRAME_RATE_HZ, PERIOD_S
from omni_mj.config.plugins import PLANTS, find_plant
from omni_mj.config.validation import (
    FRICTION_RANGE,
    MAX_COORDINATE_M,
    SettingsModel,
    format_value,
    raise_errors,
    setting,
)

if TYPE_CHECKING:
    from omni_mj.config.settings import Settings

ON_WHEELS, KINEMATIC = ("mujoco", "planar"), ("kinematic",)
HIGHEST = 15  # number of a robot in the league
FAULT_KINDS: dict[str, type["Fault"]] = {}  # name in files -> class
Robots = Annotated[tuple[Annotated[int, Field(ge=0, le=HIGHEST)], ...], Field(strict=False)]


class Fault(SettingsModel):
    """Something that begins in a frame and ends in another, or with the run.

    Attributes:
        plants: The plants that know it; None for what happens between robot and team, whatever the
            plant.
    """

    plants: ClassVar[tuple[str, ...] | None] = None

    start_s: float = setting(
        ..., "s", "when it begins, from the start of the run; to the nearest frame", 0, 36_000
    )
    duration_s: float = setting(
        0.0, "s", "how long it lasts; 0: until the end of the run", 0, 36_000
    )
    robots: Robots = setting(
        (),
        "",
        "to which robots it happens: their numbers in their world (serve: in their team); none: all",
        0,
        12,
    )

    def __init_subclass__(cls, **keywords: Any) -> None:
        super().__init_subclass__(**keywords)
        if not cls.__name__.startswith("On"):  # a class of several kinds
            FAULT_KINDS[_kind(cls)] = cls

    @computed_field  # type: ignore[prop-decorator]
    @property
    def kind(self) -> str:
        """Its name in files."""
        return _kind(type(self))

    @property
    def text(self) -> str:
        """Its kind with its values, as in 'push (force_n = 20, direction_deg = 90)'."""
        common = Fault.model_fields
        values = {name: value for name, value in self if name not in common}
        details = ", ".join(
            f"{n} = {v if isinstance(v, str) else format(v, 'g')}" for n, v in values.items()
        )
        return f"{self.kind} ({details})" if details else self.kind

    @property
    def description(self) -> str:
        """Its text, and when it happens to which robots."""
        until = f"to {self.start_s + self.duration_s:g} s" if self.duration_s else "on"
        whose = f", of robots {', '.join(map(str, self.robots))}" if self.robots else ""
        return f"{self.text}, from {self.start_s:g} s {until}{whose}"

    def affects(self, robot: int) -> bool:
        """Return whether it happens to the robot of this number."""
        return not self.robots or robot in self.robots

    def find_contradictions(self) -> Iterator[str]:
        """Yield what its values cannot be."""
        if 0 < self.duration_s < 0.999 * PERIOD_S:
            yield f"duration_s must be 0 or at least a frame, {PERIOD_S:.4f} s, not {self.duration_s:g}"


def _kind(cls: type[Fault]) -> str:
    """Return the name of a kind in files: wheel-worn of `WheelWorn`."""
    return re.sub("(?<=[a-z])(?=[A-Z])", "-", cls.__name__).lower()


class OnWheels(Fault):
    """What happens to a robot on wheels."""

    plants = ON_WHEELS


class OnOneWheel(OnWheels):
    """What happens to one wheel, or its motor or encoder."""

    wheel: int = setting(
        ..., "", "whose, counted from 1 at the front left, counter-clockwise", 1, 8
    )


def _chance(doc: str, default: Any = ...) -> Any:
    return setting(default, "", f"probability {doc}", 0, 1)


# Of the world.


class Push(OnWheels):
    """A force on the chassis at its centre of mass: another robot, a hand."""

    force_n: float = setting(..., "N", "force", 0, 1000)
    direction_deg: float = setting(
        0.0, "deg", "towards where, from the world's x to its y", -360, 360
    )


class Kidnap(Fault):
    """A hand that puts the robot elsewhere, at rest, in no time; its gyro and encoders see nothing of it."""

    plants = ON_WHEELS + KINEMATIC
    x_m: float = setting(0.0, "m", "how far along the world's x", -10, 10)
    y_m: float = setting(0.0, "m", "same, along y", -10, 10)
    heading_deg: float = setting(0.0, "deg", "how far turned", -180, 180)

    @property
    def displacement(self) -> tuple[float, float, float]:
        """The displacement, m, m, rad."""
        return self.x_m, self.y_m, math.radians(self.heading_deg)


class Payload(OnWheels):
    """More mass, a point on the vertical line through the chassis' centre of mass; it comes and goes at its speed."""

    mass_kg: float = setting(..., "kg", "how much more", 0, 20)
    height_m: float = setting(
        0.0, "m", "of it above the carpet; 0: that of the chassis' centre of mass", 0, 0.5
    )


class Tilt(OnWheels):
    """A carpet that leans: gravity acts along it on every part of a robot, and so much less into it."""

    angle_deg: float = setting(..., "deg", "slope", 0, 30)
    direction_deg: float = setting(0.0, "deg", "downhill, from the world's x to its y", -360, 360)

    def find_contradictions(self) -> Iterator[str]:
        """Yield what its values cannot be."""
        yield from super().find_contradictions()
        if self.robots:
            yield "robots must be left out of a tilt: all robots of a world stand on one carpet"


class Friction(OnWheels):
    """Another carpet, wherever there is no patch."""

    friction: float = setting(
        ..., "", "coefficient of friction, in place of carpet.friction", *FRICTION_RANGE
    )


class FrictionPatch(OnWheels):
    """A patch of another friction: something was spilt. It covers carpet.patches."""

    x_m: float = setting(..., "m", "its centre", -MAX_COORDINATE_M, MAX_COORDINATE_M)
    y_m: float = setting(..., "m", "same", -MAX_COORDINATE_M, MAX_COORDINATE_M)
    radius_m: float = setting(..., "m", "its radius", 0.01, 20)
    friction: float = setting(..., "", "coefficient of friction on it", *FRICTION_RANGE)


class Alpha(Fault):
    """Another gain alpha of equation 7, along all axes."""

    plants = KINEMATIC
    alpha: float = setting(..., "", "alpha, in place of what is drawn", 0, 2)


# Of the robot.


class MotorDemagnetized(OnOneWheel):
    """A motor whose magnets have lost some of their field: less torque per current, and less back-EMF per speed."""

    factor: float = setting(..., "", "factor of its torque constant", 0.05, 2)


class MotorDead(OnOneWheel):
    """A motor that has no current, as of a driver that is off: its wheel is dragged along."""


class MotorBlocked(OnOneWheel):
    """A motor that is stuck: its wheel does not turn, and slides."""


class WheelWorn(OnOneWheel):
    """A wheel whose rollers have lost their rubber: it grips less; its radius stays."""

    factor: float = setting(..., "", "factor of the carpet's friction", 0.01, 2)


class WheelMissingRollers(OnOneWheel):
    """A wheel that has lost rollers, side by side: once a turn, while the gap is below, it grips nothing."""

    rollers: int = setting(1, "", "how many, side by side", 1, 8)


class EncoderDropout(OnOneWheel):
    """An encoder that counts nothing in some frames, and does not make up for it: a loose contact, or a broken one."""

    probability: float = _chance("of a frame", 1.0)


class EncoderScale(OnOneWheel):
    """An encoder of other counts per turn than the firmware believes."""

    factor: float = setting(..., "", "factor of its counts", 0.1, 4)


class GyroBias(OnWheels):
    """A gyro that shows more than there is, in addition to sensors.gyro_bias_rad_s."""

    bias_rad_s: float = setting(..., "rad/s", "how much too much", -10, 10)


class GyroScale(OnWheels):
    """A gyro of another sensitivity than the firmware believes."""

    factor: float = setting(..., "", "factor of all that it shows; 0: it shows nothing", 0, 4)


class FirmwareTimeout(OnWheels):
    """The firmware takes its radio for dead: it holds the wheels at rest until the fault ends and a packet comes."""


class BrownOut(OnWheels):
    """A supply that sinks: motors have a part of the battery's voltage only; the processor goes on."""

    factor: float = setting(..., "", "factor of the battery's voltage", 0.05, 1)


class Reboot(OnWheels):
    """The firmware starts anew, and has done so when the fault ends; until then no loop runs.

    It has forgotten heading, gyro bias and the state of its loops. It takes vision's heading that
    comes with the first packet for its own, and stands until then.
    """

    motors: Literal["coast", "brake"] = setting(
        "coast",
        "",
        "meanwhile: coast: drivers are off, and wheels roll; brake: drivers short the windings",
    )


# Between robot and team.


class RadioDelay(Fault):
    """Another dead time of the radio, for what is sent from then on; the team does not know."""

    delay_frames: int = setting(..., "frames", "dead time, in place of radio.delay_frames", 0, 600)


class RadioLoss(Fault):
    """Packets that are lost, each independently."""

    probability: float = _chance(
        "that a packet never arrives, in addition to radio.loss_probability", 1.0
    )


class RadioBurstLoss(Fault):
    """Packets that are lost in bursts: the channel of Gilbert (1960) and Elliott (1963).

    A Markov chain steps from frame to frame between a state in which nothing is lost, in which it
    begins, and one in which packets are.
    """

    mean_burst_frames: float = setting(..., "frames", "how long a burst lasts, on average", 1, 600)
    burst_fraction: float = setting(
        ..., "", "of the time that is in bursts, in the long run", 0.001, 0.5
    )
    probability: float = _chance("that a packet of a burst is lost", 1.0)


class RadioDuplicates(Fault):
    """Packets that come twice; a robot applies the copy until the next packet comes."""

    probability: float = _chance("that a packet comes again")
    delay_frames: int = setting(
        ..., "frames", "how long after it; a copy comes last of what comes in a frame", 1, 120
    )


class RadioReorder(Fault):
    """Packets that come late, after younger ones; a robot applies them all the same until the next comes."""

    probability: float = _chance("that a packet is late")
    delay_frames: int = setting(
        ..., "frames", "by how much; a late packet comes last of what comes in a frame", 1, 120
    )


class VisionLoss(Fault):
    """A camera that does not see the robot."""


class VisionFreeze(Fault):
    """A camera that shows its last image again and again, as new."""


class VisionWrongId(Fault):
    """Another robot that is taken for this one: the camera shows the pose of what stands elsewhere."""

    x_m: float = setting(..., "m", "where it stands", -MAX_COORDINATE_M, MAX_COORDINATE_M)
    y_m: float = setting(..., "m", "same", -MAX_COORDINATE_M, MAX_COORDINATE_M)
    heading_deg: float = setting(0.0, "deg", "its heading", -360, 360)
    probability: float = _chance("of an image", 1.0)


class VisionBias(Fault):
    """A camera that sees the robot beside where it is: knocked, calibrated badly, or front taken for back (180 deg)."""

    x_m: float = setting(0.0, "m", "how much too far along the world's x", -1, 1)
    y_m: float = setting(0.0, "m", "same, along y", -1, 1)
    heading_deg: float = setting(0.0, "deg", "how much too far turned", -180, 180)
    probability: float = _chance("of an image", 1.0)


class VisionClockDrift(Fault):
    """A camera's clock that goes wrong: images are said to be older than they are by a time that grows.

    By that much farther the team carries what was seen on. When the fault ends, the clock is set
    right.
    """

    drift_ms_per_s: float = setting(..., "ms/s", "how much it loses; below 0: gains", -100, 100)


class VisionJitter(Fault):
    """Images that come late, each by another time, of which the team knows when they were taken."""

    jitter_s: float = setting(
        ..., "s", "how late at most, uniformly, in addition to vision.jitter_s", 0, 1
    )


class VisionDelay(Fault):
    """Another latency of the camera."""

    delay_s: float = setting(
        ..., "s", "from an image to its packet's arrival, in place of vision.delay_s", 0, 1
    )


def parse_faults(given: Any) -> tuple[Fault, ...]:
    """Return the faults that the list of a scenario's file describes.

    Raises:
        OmniError: There is no such kind, or a value is not allowed; lines for each fault.
    """
    if not isinstance(given, (list, tuple)):
        raise ValueError(
            f"fault is a list: write [[fault]] and its fields below, not {format_value(given)}"
        )
    faults: list[Fault] = []
    errors: list[str] = []
    for number, fault in enumerate(given, 1):
        try:
            faults.append(fault if isinstance(fault, Fault) else _one(fault))
        except OmniError as error:
            errors += [f"fault {number}: {line}" for line in str(error).splitlines()]
    raise_errors(errors)
    return tuple(faults)


def _one(given: Any) -> Fault:
    fields = dict(given) if isinstance(given, Mapping) else {"kind": given}
    kind = str(fields.pop("kind", None))
    if kind not in FAULT_KINDS:
        raise OmniError(
            f"kind must be a fault's, not {format_value(kind)}; {suggest_names(kind, FAULT_KINDS)}"
        )
    return FAULT_KINDS[kind](**fields)


def select_faults_of_robot(faults: Iterable[Fault], robot: int) -> tuple[Fault, ...]:
    """Return the faults that happen to the robot of a number."""
    return tuple(fault for fault in faults if fault.affects(robot))


def compute_frame_span(fault: Fault) -> tuple[int, float]:
    """Return a fault's first frame, and the first frame after it; infinite if it lasts until the end of the run."""
    start = round(fault.start_s * FRAME_RATE_HZ)
    return start, start + round(fault.duration_s * FRAME_RATE_HZ) if fault.duration_s else math.inf


def find_settings_conflicts(faults: Iterable[Fault], settings: "Settings") -> Iterator[str]:
    """Yield why some cannot happen under these settings, a line for each."""
    wheels, jitter = len(settings.wheels.azimuths_deg), settings.radio.jitter_frames
    for number, fault in enumerate(faults, 1):
        where = f"fault {number}: {fault.kind}"
        if isinstance(fault, OnOneWheel) and fault.wheel > wheels:
            yield f"{where}: wheel must be 1 to {wheels}, not {fault.wheel}: the robot has {wheels}"
        if isinstance(fault, RadioDelay) and fault.delay_frames < jitter:
            yield f"{where}: delay_frames must be at least radio.jitter_frames, {jitter}, not {fault.delay_frames}"


def list_supported_kinds(plant: str) -> list[str]:
    """Return the kinds that a plant knows; a user's own plant names them in its attribute `faults`.

    Raises:
        OmniError: There is no such plant.
    """
    own = () if plant in PLANTS else getattr(find_plant(plant), "faults", ())
    return [
        name
        for name, kind in FAULT_KINDS.items()
        if kind.plants is None or plant in kind.plants or name in own
    ]


def check_plant_supports(faults: Sequence[Fault], plant: str, robots: int | None = None) -> None:
    """Check that a plant knows all faults, and that its worlds have the robots to which they happen.

    Args:
        faults: What shall happen.
        plant: Name of the plant.
        robots: Number of robots in a world, if it is known.

    Raises:
        OmniError: It does not; a line for each fault.
    """
    kinds, errors = list_supported_kinds(plant) if faults else [], []
    for number, fault in enumerate(faults, 1):
        if fault.kind not in kinds:
            errors.append(
                f"fault {number}: the plant {plant} has no {fault.kind}; it has {', '.join(kinds)}"
            )
        if robots is not None and fault.robots and max(fault.robots) >= robots:
            errors.append(
                f"fault {number}: {fault.kind} names robot {max(fault.robots)}; a world has {robots}, numbered from 0"
            )
    raise_errors(errors)
