"""What may happen while a run goes on: each kind of [[fault]] with its settings.

A kind is a class here, and one small function where it acts: of what happens to a robot on wheels in
`omni_mj.plants.faults`, of the radio's in `omni_mj.link.radio`, of the camera's in `omni_mj.link.camera`.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import field_validator

from omni_control.errors import OmniError, choose
from omni_mj.scenarios.checking import FRICTIONS, Checked, in_one, setting, shown
from omni_mj.scenarios.clock import FRAME_RATE_HZ, PERIOD_S
from omni_mj.scenarios.plants import PLANTS, find_plant

if TYPE_CHECKING:
    from omni_mj.scenarios.settings import Settings

ON_WHEELS, KINEMATIC = ("mujoco", "planar"), ("kinematic",)


class Fault(Checked):
    """Something that begins in a frame and ends in another, or with the run.

    Attributes:
        plants: those that know it; None for what happens between robot and team, whatever the plant.
        says: what it is, in words, with its values.
    """

    plants: ClassVar[tuple[str, ...] | None] = None
    says: ClassVar[str] = ""

    kind: str
    at: float = setting(..., "s", "when it begins, from the start of the run; to the nearest frame", 0, 36_000)
    for_: float = setting(0.0, "s", "how long it lasts; 0: until the end of the run", 0, 36_000, alias="for")

    @property
    def text(self) -> str:
        """What it is, in words."""
        return self.says.format(**self.values())

    @property
    def told(self) -> str:
        """What it is and when, in words."""
        until = f"to {self.at + self.for_:g} s" if self.for_ else "on"
        return f"{self.text}, from {self.at:g} s {until}"

    def refused(self, settings: "Settings") -> str:
        """Why it cannot happen under these settings; nothing where it can."""
        return ""

    @field_validator("for_")
    @classmethod
    def _in_frames(cls, lasts: float) -> float:
        if 0 < lasts < 0.999 * PERIOD_S:
            raise ValueError(f"for must be 0, until the end, or at least a frame, {PERIOD_S:.4f} s, not {lasts:g}")
        return lasts


class Push(Fault):
    """A force on the chassis at its centre of mass: another robot, a hand."""

    plants = ON_WHEELS
    says = "push of {force_n:g} N towards {direction_deg:g} deg"

    kind: Literal["push"] = setting("push", "", "plants with wheels: a force on the chassis")
    force_n: float = setting(..., "N", "force", 0, 1000)
    direction_deg: float = setting(0.0, "deg", "towards where, from the world's x to its y", -360, 360)


class Tilt(Fault):
    """The carpet leans: gravity acts along it on every part of a robot, and so much less into it."""

    plants = ON_WHEELS
    says = "tilt of {angle_deg:g} deg, downhill towards {direction_deg:g} deg"

    kind: Literal["tilt"] = setting("tilt", "", "plants with wheels: a carpet that leans")
    angle_deg: float = setting(..., "deg", "slope", 0, 30)
    direction_deg: float = setting(0.0, "deg", "downhill, from the world's x to its y", -360, 360)


class Friction(Fault):
    """Another carpet, wherever there is no patch."""

    plants = ON_WHEELS
    says = "carpet of friction {to:g}"

    kind: Literal["friction"] = setting("friction", "", "plants with wheels: another friction, patches excepted")
    to: float = setting(..., "", "coefficient of friction, in place of carpet.friction", *FRICTIONS)

    def refused(self, settings: "Settings") -> str:
        """See `Fault`: wheels without creep have their friction in their contacts, as built."""
        return "needs wheels.creep = on" if settings.wheels.creep == "off" else ""


class Payload(Fault):
    """More mass, a point on the vertical line through the chassis' centre of mass; it comes and goes at its speed."""

    plants = ON_WHEELS
    says = "payload of {mass_kg:g} kg"

    kind: Literal["payload"] = setting("payload", "", "plants with wheels: more mass")
    mass_kg: float = setting(..., "kg", "how much more", 0, 20)
    height_m: float = setting(0.0, "m", "of it above the carpet; 0: that of the chassis' centre of mass", 0, 0.5)


class Delay(Fault):
    """Another dead time of what is sent from then on; the team is not told."""

    says = "dead time of {to} frames"

    kind: Literal["delay"] = setting("delay", "", "another dead time of the radio, which the team is not told")
    to: int = setting(..., "frames", "dead time, in place of radio.delay_frames", 0, 600)

    def refused(self, settings: "Settings") -> str:
        """See `Fault`: no packet arrives before it is sent."""
        jitter = settings.radio.jitter_frames
        return f"to must not be below radio.jitter_frames, {jitter}, but is {self.to}" if self.to < jitter else ""


class MotorWeak(Fault):
    """A motor whose magnets have lost some of their field: less torque per current, and less back-EMF per speed."""

    plants = ON_WHEELS
    says = "motor {wheel} at {to:g} of its torque constant"

    kind: Literal["motor-weak"] = setting(
        "motor-weak", "", "plants with wheels: other magnets than its firmware believes"
    )
    wheel: int = setting(..., "", "whose, counted from 1 at the front left, counter-clockwise", 1, 8)
    to: float = setting(..., "", "factor of its torque constant", 0.05, 2)

    def refused(self, settings: "Settings") -> str:
        """See `Fault`: there must be such a wheel."""
        wheels = len(settings.wheels.azimuths_deg)
        return f"wheel must be 1 to {wheels}, not {self.wheel}: the robot has {wheels}" if self.wheel > wheels else ""


class GyroBias(Fault):
    """A gyro that shows more than there is, beside sensors.gyro_bias_rad_s."""

    plants = ON_WHEELS
    says = "gyro that shows {rad_s:g} rad/s too much"

    kind: Literal["gyro-bias"] = setting("gyro-bias", "", "plants with wheels: a gyro that shows too much")
    rad_s: float = setting(..., "rad/s", "how much too much", -10, 10)


class VisionOut(Fault):
    """The camera does not see the robot."""

    says = "camera that does not see the robot"

    kind: Literal["vision-out"] = setting("vision-out", "", "a camera that does not see the robot")


class Alpha(Fault):
    """The kinematic plant's gain, in place of what it draws, along all axes."""

    plants = KINEMATIC
    says = "alpha of {to:g}"

    kind: Literal["alpha"] = setting("alpha", "", "kinematic plant: another gain alpha of equation 7")
    to: float = setting(..., "", "alpha, in place of what is drawn", 0, 2)


KINDS: dict[str, type[Fault]] = {
    str(kind.model_fields["kind"].default): kind
    for kind in (Push, Tilt, Friction, Payload, Delay, MotorWeak, GyroBias, VisionOut, Alpha)
}


def made(given: Any) -> tuple[Fault, ...]:
    """Faults from tables, or as they are.

    Raises:
        OmniError: something is no fault, or one of its values is not allowed; the message has a line for each.
    """
    if not isinstance(given, (list, tuple)):
        raise OmniError(f"fault is a list: write [[fault]] and its fields below, once for each, not {shown(given)}")
    found, errors = list[Fault](), list[str]()
    for number, each in enumerate(given, 1):
        try:
            found.append(_made(each))
        except OmniError as error:
            errors += [f"fault {number}: {line}" for line in str(error).splitlines()]
    in_one(errors)
    return tuple(found)


def _made(given: Any) -> Fault:
    if type(given) in KINDS.values():
        return given
    if not isinstance(given, Mapping):
        raise OmniError(f"write [[fault]] and its fields below, not {shown(given)}")
    kind = given.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        raise OmniError(f"kind must be one of those there are, not {shown(kind)}; {choose(kind, KINDS)}")
    return KINDS[kind](**given)


def misfits(faults: Iterable[Fault], settings: "Settings") -> Iterator[str]:
    """Why some cannot happen under these settings, a line for each."""
    for number, fault in enumerate(faults, 1):
        if why := fault.refused(settings):
            yield f"fault {number}: {fault.kind} {why}"


def known(plant: str) -> list[str]:
    """The kinds that a plant knows; one of a user's names them in its attribute `faults`.

    Raises:
        OmniError: there is no such plant.
    """
    own = () if plant in PLANTS else getattr(find_plant(plant), "faults", ())
    return [name for name, kind in KINDS.items() if kind.plants is None or plant in kind.plants or name in own]


def check_plant(faults: Sequence[Fault], plant: str) -> None:
    """See that a plant knows all that shall happen.

    Raises:
        OmniError: it does not; a line for each fault.
    """
    kinds = known(plant) if faults else []
    in_one(
        f"fault {number}: the plant {plant} has no {fault.kind}; it has {', '.join(kinds)}"
        for number, fault in enumerate(faults, 1)
        if fault.kind not in kinds
    )


def span(fault: Fault) -> tuple[int, float]:
    """The first frame of a fault, and the first after it; infinite where it lasts until the end of the run."""
    start = round(fault.at * FRAME_RATE_HZ)
    return start, start + round(fault.for_ * FRAME_RATE_HZ) if fault.for_ else math.inf
