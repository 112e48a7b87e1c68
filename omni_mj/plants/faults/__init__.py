"""What faults do to robots on wheels: for each kind a function that makes what acts when something changes.

What acts starts anew from the robots as they were built, so that a fault leaves nothing behind, and that a robot's
numbers do not depend on what happens to others of its batch. Pushes, payloads, slopes and biases of several faults add
up, factors multiply, and of several values in place of the scenario's the last in its list counts.
"""

from collections.abc import Callable, Sequence

import numpy as np

from omni_control.kinematics import Array
from omni_mj.link.schedule import Schedule
from omni_mj.onboard.battery import Battery
from omni_mj.onboard.firmware import Firmware
from omni_mj.onboard.motors import Motors
from omni_mj.onboard.traction import Traction
from omni_mj.plants.faults import onboard, world
from omni_mj.plants.faults.robots import Act, Bodies, Robots
from omni_mj.scenarios import faults
from omni_mj.scenarios.rows import Row

ACTS: dict[type[faults.Fault], tuple[Callable[[Robots], Act], ...]] = {
    faults.Push: (world.push,),
    faults.Kidnap: (world.kidnap,),
    faults.Payload: (world.payload,),
    faults.Tilt: (world.tilt,),
    faults.Friction: (world.friction,),
    faults.FrictionPatch: (world.patch,),
    faults.MotorWeak: (onboard.weaken,),
    faults.MotorDead: (onboard.release,),
    faults.MotorBlocked: (onboard.block,),
    faults.WheelWorn: (onboard.wear,),
    faults.WheelRoller: (onboard.wear,),
    faults.EncoderDropout: (onboard.mislead,),
    faults.EncoderScale: (onboard.mislead,),
    faults.GyroBias: (onboard.shift,),
    faults.GyroScale: (onboard.mislead,),
    faults.FirmwareTimeout: (onboard.silence,),
    faults.BrownOut: (onboard.starve,),
    faults.Reboot: (onboard.silence, onboard.release),
}


class Faults:
    """Faults of n robots with W wheels.

    Args:
        rows: of the robots.
        bodies, traction, motors, firmware, battery: of the robots.
        encoders: what theirs showed last, (n, W) rad; a live array.

    Attributes:
        push, gyro: see `Robots`.

    Raises:
        OmniError: robots that share a world stand on carpets that lean differently.
    """

    def __init__(
        self,
        rows: Sequence[Row],
        bodies: Bodies,
        onboard: tuple[Firmware, Motors, Battery, Traction],
        encoders: Array,
    ) -> None:
        n, off = len(rows), np.full_like(encoders, np.nan)
        firmware, motors, battery, traction = onboard
        robots = Robots(
            rows, bodies, traction, motors, firmware, battery, encoders, np.zeros((n, 2)), np.zeros((n, 1)), off
        )
        self.push, self.gyro, self._off, self._each_frame = robots.push, robots.gyro, off, robots.each_frame
        self._any_off = False
        self._schedule, self._frame = Schedule([row.faults for row in rows], *ACTS), 0
        makers = dict.fromkeys(make for kind in self._schedule.kinds for make in ACTS[kind])
        self._acts = [make(robots) for make in makers]

    def begin(self) -> None:
        """Let begin what begins in the next frame, and end what ends."""
        active = self._schedule.at(self._frame)
        self._frame += 1
        if active is not None:
            for act in self._acts:
                act(active)
            self._any_off = not np.isnan(self._off).all()
        for act_always in self._each_frame:
            act_always()

    def held(self, current: Array | None) -> Array | None:
        """The currents (n, W), A, that drivers hold, or None for none, where others have them hold some."""
        if not self._any_off:
            return current
        return self._off if current is None else np.where(np.isnan(self._off), current, self._off)
