"""What happens to the electronics on a robot: its processor and its supply."""

from typing import Literal

from omni_mj.scenarios.checking import setting
from omni_mj.scenarios.faults.base import ON_WHEELS, Fault


class FirmwareTimeout(Fault):
    """The firmware takes its radio for dead: it holds the wheels at rest, whatever comes, as after firmware.timeout_s.

    It then obeys the next packet.
    """

    plants = ON_WHEELS
    says = "firmware that holds its wheels at rest"

    kind: Literal["firmware-timeout"] = setting(
        "firmware-timeout", "", "plants with wheels: a command time-out, whatever the radio brings"
    )


class BrownOut(Fault):
    """The supply sinks: motors have a part of the battery's voltage only. The processor, with its own supply, goes on.

    The rest is lost in a bad contact, on the robot's side of the battery's protection.
    """

    plants = ON_WHEELS
    says = "supply at {to:g} of the battery's voltage"

    kind: Literal["brown-out"] = setting("brown-out", "", "plants with wheels: motors have a part of the voltage only")
    to: float = setting(..., "", "factor of the battery's voltage", 0.05, 1)


class Reboot(Fault):
    """The firmware starts anew, and has done so when the fault ends; until then no loop runs.

    It has forgotten heading, gyro bias and the state of its loops. It takes vision's heading that comes with the first
    packet for its own, and stands until then.
    """

    plants = ON_WHEELS
    says = "firmware that starts anew while motors {motors}"

    kind: Literal["reboot"] = setting(
        "reboot", "", "plants with wheels: the firmware starts anew, and is there again when the fault ends"
    )
    motors: Literal["coast", "brake"] = setting(
        "coast", "", "meanwhile: coast: drivers are off, and wheels roll; brake: drivers short the windings"
    )
