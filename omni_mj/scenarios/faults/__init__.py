"""What may happen while a run goes on: each kind of [[fault]] with its settings.

A kind is a class in one of the modules here, and a small function where it acts: of what happens to a robot on wheels
in `omni_mj.plants.faults`, of the radio in `omni_mj.link.radio_faults`, of the camera in `omni_mj.link.camera_faults`.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from omni_control.errors import OmniError, choose
from omni_mj.scenarios.checking import in_one, shown
from omni_mj.scenarios.faults.base import KINEMATIC, ON_WHEELS, Fault, span
from omni_mj.scenarios.faults.camera import (
    VisionBias,
    VisionClock,
    VisionDelay,
    VisionFreeze,
    VisionJitter,
    VisionMirrored,
    VisionOut,
    VisionWrongId,
)
from omni_mj.scenarios.faults.firmware import BrownOut, FirmwareTimeout, Reboot
from omni_mj.scenarios.faults.radio import Delay, RadioBursts, RadioDuplicates, RadioLoss, RadioOut, RadioReorder
from omni_mj.scenarios.faults.robot import (
    EncoderDropout,
    EncoderFreeze,
    EncoderScale,
    GyroBias,
    GyroOut,
    GyroScale,
    MotorBlocked,
    MotorDead,
    MotorWeak,
    WheelRoller,
    WheelWorn,
)
from omni_mj.scenarios.faults.world import Alpha, Friction, FrictionPatch, Kidnap, Payload, Push, Tilt
from omni_mj.scenarios.plants import PLANTS, find_plant

if TYPE_CHECKING:
    from omni_mj.scenarios.settings import Settings

__all__ = [
    "KINDS", "KINEMATIC", "ON_WHEELS", "Alpha", "BrownOut", "Delay", "EncoderDropout", "EncoderFreeze",
    "EncoderScale", "Fault", "FirmwareTimeout", "Friction", "FrictionPatch", "GyroBias", "GyroOut", "GyroScale",
    "Kidnap", "MotorBlocked", "MotorDead", "MotorWeak", "Payload", "Push", "RadioBursts", "RadioDuplicates",
    "RadioLoss", "RadioOut", "RadioReorder", "Reboot", "Tilt", "VisionBias", "VisionClock", "VisionDelay",
    "VisionFreeze", "VisionJitter", "VisionMirrored", "VisionOut", "VisionWrongId", "WheelRoller", "WheelWorn",
    "check_plant", "check_robots", "known", "made", "misfits", "of_robot", "span",
]  # fmt: skip

KINDS: dict[str, type[Fault]] = {
    str(kind.model_fields["kind"].default): kind
    for kind in (
        *(Push, Kidnap, Payload, Tilt, Friction, FrictionPatch),
        *(MotorWeak, MotorDead, MotorBlocked, WheelWorn, WheelRoller),
        *(EncoderFreeze, EncoderDropout, EncoderScale, GyroBias, GyroScale, GyroOut),
        *(FirmwareTimeout, BrownOut, Reboot),
        *(Delay, RadioLoss, RadioBursts, RadioDuplicates, RadioReorder, RadioOut),
        *(VisionOut, VisionFreeze, VisionMirrored, VisionWrongId, VisionBias, VisionClock, VisionJitter, VisionDelay),
        Alpha,
    )
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


def check_robots(faults: Iterable[Fault], robots: int) -> None:
    """See that a world has the robots to which something shall happen.

    Raises:
        OmniError: it has not; a line for each fault.
    """
    in_one(
        f"fault {number}: {fault.kind} is of robot {max(fault.robots)}, and a world has {robots}, numbered from 0"
        for number, fault in enumerate(faults, 1)
        if fault.robots and max(fault.robots) >= robots
    )


def of_robot(faults: Iterable[Fault], robot: int) -> tuple[Fault, ...]:
    """Those that happen to the robot of a number."""
    return tuple(fault for fault in faults if fault.concerns(robot))


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
