"""What of robots on wheels faults may change, and what is called when they do."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from omni_control.kinematics import Array
from omni_mj.link.schedule import Active
from omni_mj.onboard.battery import Battery
from omni_mj.onboard.firmware import Firmware
from omni_mj.onboard.motors import Motors
from omni_mj.onboard.traction import Traction
from omni_mj.scenarios.rows import Row

Act = Callable[[Active], None]


class Bodies(Protocol):
    """The bodies of n robots.

    Attributes:
        centre: of mass, to which drag is referred, of what carries a load, with it, (n, 3) m.
    """

    @property
    def centre(self) -> Array:
        """See above."""
        ...

    def carry(self, loads: Iterable[tuple[int, float, float]]) -> None:
        """Carry these loads and no others.

        Args:
            loads: row, mass in kg, and height above the carpet in m, or 0 for that of the chassis' centre of mass.
        """
        ...

    def lean(self, along: Array) -> None:
        """Stand on carpets that lean so that gravity has the parts `along` (n, 2) of itself along them."""
        ...

    def block(self, stuck: np.ndarray) -> None:
        """Have these wheels stuck, (n, W), and no others."""
        ...

    def put(self, robot: int, moved: tuple[float, float, float]) -> None:
        """Put a robot as far from where it is, m, m and rad in the world, at rest."""
        ...


@dataclass(frozen=True, eq=False)
class Robots:
    """n robots with W wheels, and what of them faults may change.

    Attributes:
        rows: of the robots, those of one world one after the other.
        bodies, traction, motors, firmware, battery: theirs.
        encoders: what encoders showed last, (n, W) rad; a live array.
        push: forces on the chassis at their centres of mass, world frame, (n, 2) N.
        gyro: what gyros show too much, (n, 1) rad/s.
        off: currents of motors whose drivers are off, 0 A, (n, W); not a number of others.
        each_frame: called in every frame, after what changes.
    """

    rows: Sequence[Row]
    bodies: Bodies
    traction: Traction
    motors: Motors
    firmware: Firmware
    battery: Battery
    encoders: Array
    push: Array
    gyro: Array
    off: Array
    each_frame: list[Callable[[], None]] = field(default_factory=list)
