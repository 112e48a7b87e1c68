"""What all kinds of [[fault]] have: when, for how long, to which robots, and how it is told."""

import math
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import field_validator

from omni_mj.scenarios.checking import Checked, Wholes, setting
from omni_mj.scenarios.clock import FRAME_RATE_HZ, PERIOD_S

if TYPE_CHECKING:
    from omni_mj.scenarios.settings import Settings

ON_WHEELS, KINEMATIC = ("mujoco", "planar"), ("kinematic",)
HIGHEST = 15  # number of a robot in the league


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
    robots: Wholes = setting(
        (),
        "",
        "to which robots it happens: their numbers in their world, from 0 (serve: in their team); none: all",
        0,
        12,
    )

    @property
    def text(self) -> str:
        """What it is, in words."""
        return self.says.format(**self.values())

    @property
    def told(self) -> str:
        """What it is and when, in words."""
        until = f"to {self.at + self.for_:g} s" if self.for_ else "on"
        whose = f", of robots {', '.join(map(str, self.robots))}" if self.robots else ""
        return f"{self.text}, from {self.at:g} s {until}{whose}"

    def concerns(self, robot: int) -> bool:
        """Whether it happens to the robot of this number."""
        return not self.robots or robot in self.robots

    def refused(self, settings: "Settings") -> str:
        """Why it cannot happen under these settings; nothing where it can."""
        return ""

    @field_validator("for_")
    @classmethod
    def _in_frames(cls, lasts: float) -> float:
        if 0 < lasts < 0.999 * PERIOD_S:
            raise ValueError(f"for must be 0, until the end, or at least a frame, {PERIOD_S:.4f} s, not {lasts:g}")
        return lasts

    @field_validator("robots")
    @classmethod
    def _numbers(cls, robots: tuple[int, ...]) -> tuple[int, ...]:
        if len(set(robots)) < len(robots) or any(not 0 <= robot <= HIGHEST for robot in robots):
            raise ValueError(f"robots must be different numbers from 0 to {HIGHEST}, not {list(robots)}")
        return robots


class OfWheel(Fault):
    """What happens to one wheel, or its motor or encoder."""

    plants = ON_WHEELS

    wheel: int = setting(..., "", "whose, counted from 1 at the front left, counter-clockwise", 1, 8)

    def refused(self, settings: "Settings") -> str:
        """See `Fault`: there must be such a wheel."""
        wheels = len(settings.wheels.azimuths_deg)
        return f"wheel must be 1 to {wheels}, not {self.wheel}: the robot has {wheels}" if self.wheel > wheels else ""


def creeping(settings: "Settings") -> str:
    """Why friction cannot change: wheels without creep have it in their contacts, as built; nothing where it can."""
    return "needs wheels.creep = on" if settings.wheels.creep == "off" else ""


def span(fault: Fault) -> tuple[int, float]:
    """The first frame of a fault, and the first after it; infinite where it lasts until the end of the run."""
    start = round(fault.at * FRAME_RATE_HZ)
    return start, start + round(fault.for_ * FRAME_RATE_HZ) if fault.for_ else math.inf


def chance(doc: str, default: Any = ...) -> Any:
    """A field that is a probability."""
    return setting(default, "", doc, 0, 1)
