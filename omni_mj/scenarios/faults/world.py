"""What the world does to a robot: it is pushed, loaded, put elsewhere, and the carpet changes."""

import math
from typing import TYPE_CHECKING, Literal

from omni_mj.scenarios.checking import FRICTIONS, REACH_M, setting
from omni_mj.scenarios.faults.base import KINEMATIC, ON_WHEELS, Fault, creeping

if TYPE_CHECKING:
    from omni_mj.scenarios.settings import Settings


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
        """See `creeping`."""
        return creeping(settings)


class FrictionPatch(Fault):
    """A patch of another friction: something was spilt. It covers carpet.patches."""

    plants = ON_WHEELS
    says = "patch of friction {to:g} at ({x_m:g}, {y_m:g}) m"

    kind: Literal["friction-patch"] = setting("friction-patch", "", "plants with wheels: a patch of another friction")
    x_m: float = setting(..., "m", "its centre", -REACH_M, REACH_M)
    y_m: float = setting(..., "m", "same", -REACH_M, REACH_M)
    radius_m: float = setting(..., "m", "its radius", 0.01, 20)
    to: float = setting(..., "", "coefficient of friction on it", *FRICTIONS)

    def refused(self, settings: "Settings") -> str:
        """See `creeping`."""
        return creeping(settings)


class Kidnap(Fault):
    """A hand puts the robot elsewhere, at rest, in no time; how long it lasts says only how long one looks at it.

    Its gyro and its encoders have seen nothing of it.
    """

    plants = ON_WHEELS + KINEMATIC
    says = "hand that puts the robot {x_m:g} m, {y_m:g} m and {heading_deg:g} deg farther"

    kind: Literal["kidnap"] = setting("kidnap", "", "a hand that puts the robot elsewhere, at rest")
    x_m: float = setting(0.0, "m", "how far along the world's x", -10, 10)
    y_m: float = setting(0.0, "m", "same, along y", -10, 10)
    heading_deg: float = setting(0.0, "deg", "how far turned", -180, 180)

    @property
    def moved(self) -> tuple[float, float, float]:
        """How far, m, m, rad."""
        return self.x_m, self.y_m, math.radians(self.heading_deg)


class Payload(Fault):
    """More mass, a point on the vertical line through the chassis' centre of mass; it comes and goes at its speed."""

    plants = ON_WHEELS
    says = "payload of {mass_kg:g} kg"

    kind: Literal["payload"] = setting("payload", "", "plants with wheels: more mass")
    mass_kg: float = setting(..., "kg", "how much more", 0, 20)
    height_m: float = setting(0.0, "m", "of it above the carpet; 0: that of the chassis' centre of mass", 0, 0.5)


class Alpha(Fault):
    """The kinematic plant's gain, in place of what it draws, along all axes."""

    plants = KINEMATIC
    says = "alpha of {to:g}"

    kind: Literal["alpha"] = setting("alpha", "", "kinematic plant: another gain alpha of equation 7")
    to: float = setting(..., "", "alpha, in place of what is drawn", 0, 2)
