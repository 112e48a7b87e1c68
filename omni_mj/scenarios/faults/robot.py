"""What breaks on a robot: encoders, gyro, motors, wheels."""

from typing import TYPE_CHECKING, Literal

from omni_mj.scenarios.checking import setting
from omni_mj.scenarios.faults.base import ON_WHEELS, Fault, OfWheel, chance, creeping

if TYPE_CHECKING:
    from omni_mj.scenarios.settings import Settings


class EncoderFreeze(OfWheel):
    """An encoder that counts nothing: the firmware sees a wheel at rest."""

    says = "encoder {wheel} that counts nothing"

    kind: Literal["encoder-freeze"] = setting(
        "encoder-freeze", "", "plants with wheels: an encoder that counts nothing"
    )


class EncoderDropout(OfWheel):
    """A loose contact: an encoder that counts nothing in some frames, and does not make up for it."""

    says = "encoder {wheel} that counts nothing in {probability:g} of the frames"

    kind: Literal["encoder-dropout"] = setting(
        "encoder-dropout", "", "plants with wheels: an encoder that counts nothing in some frames"
    )
    probability: float = chance("of a frame")


class EncoderScale(OfWheel):
    """An encoder of other counts per turn than the firmware believes."""

    says = "encoder {wheel} that counts {to:g} times as much"

    kind: Literal["encoder-scale"] = setting(
        "encoder-scale", "", "plants with wheels: an encoder that counts otherwise"
    )
    to: float = setting(..., "", "factor of its counts", 0.1, 4)


class GyroBias(Fault):
    """A gyro that shows more than there is, beside sensors.gyro_bias_rad_s."""

    plants = ON_WHEELS
    says = "gyro that shows {rad_s:g} rad/s too much"

    kind: Literal["gyro-bias"] = setting("gyro-bias", "", "plants with wheels: a gyro that shows too much")
    rad_s: float = setting(..., "rad/s", "how much too much", -10, 10)


class GyroScale(Fault):
    """A gyro of another sensitivity than the firmware believes."""

    plants = ON_WHEELS
    says = "gyro that shows {to:g} times as much"

    kind: Literal["gyro-scale"] = setting("gyro-scale", "", "plants with wheels: a gyro of another sensitivity")
    to: float = setting(..., "", "factor of all that it shows", 0, 4)


class GyroOut(Fault):
    """A gyro that shows nothing: no turning, no noise, no bias."""

    plants = ON_WHEELS
    says = "gyro that shows nothing"

    kind: Literal["gyro-out"] = setting("gyro-out", "", "plants with wheels: a gyro that shows nothing")


class MotorWeak(OfWheel):
    """A motor whose magnets have lost some of their field: less torque per current, and less back-EMF per speed."""

    says = "motor {wheel} at {to:g} of its torque constant"

    kind: Literal["motor-weak"] = setting(
        "motor-weak", "", "plants with wheels: other magnets than its firmware believes"
    )
    to: float = setting(..., "", "factor of its torque constant", 0.05, 2)


class MotorDead(OfWheel):
    """A motor that has no current, as of a driver that is off: its wheel is dragged along."""

    says = "motor {wheel} that is dead"

    kind: Literal["motor-dead"] = setting("motor-dead", "", "plants with wheels: a motor without current")


class MotorBlocked(OfWheel):
    """A motor that is stuck: its wheel does not turn, and slides."""

    says = "motor {wheel} that is blocked"

    kind: Literal["motor-blocked"] = setting("motor-blocked", "", "plants with wheels: a wheel that does not turn")


class WheelWorn(OfWheel):
    """A wheel whose rollers have lost their rubber: it grips less; its radius stays."""

    says = "wheel {wheel} at {to:g} of its grip"

    kind: Literal["wheel-worn"] = setting("wheel-worn", "", "plants with wheels: a wheel that grips less")
    to: float = setting(..., "", "factor of the carpet's friction", 0.01, 2)

    def refused(self, settings: "Settings") -> str:
        """See `Fault` and `creeping`."""
        return super().refused(settings) or creeping(settings)


class WheelRoller(OfWheel):
    """A wheel that has lost rollers, side by side: once a turn, while the gap is below, it grips nothing.

    What it bears then is taken as it was.
    """

    says = "wheel {wheel} without {rollers} of its rollers"

    kind: Literal["wheel-roller"] = setting("wheel-roller", "", "plants with wheels: a wheel that has lost rollers")
    rollers: int = setting(1, "", "how many, side by side", 1, 8)

    def refused(self, settings: "Settings") -> str:
        """See `Fault` and `creeping`."""
        return super().refused(settings) or creeping(settings)
