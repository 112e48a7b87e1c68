"""How frames pass for the robots of the plant: by numpy, all robots at once, or by loops that numba compiles."""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.link.radio import Received
from omni_mj.onboard.battery import Battery
from omni_mj.onboard.firmware import Firmware
from omni_mj.onboard.kernel import compiled
from omni_mj.onboard.laws import Some
from omni_mj.onboard.motors import Motors
from omni_mj.onboard.traction import EVERY, Traction
from omni_mj.plants import Telemetry
from omni_mj.plants.planar import by_robot, cycle
from omni_mj.plants.planar.arrays import Frame, Motion, Robots
from omni_mj.plants.planar.laws import turned
from omni_mj.plants.planar.table import HELD, Writer
from omni_mj.scenarios.settings import PERIOD_S

Onboard = tuple[Firmware, Motors, Battery, Traction]


class AtOnce:
    """By numpy.

    Args:
        onboard: firmware, motors, battery and traction of the robots.
        robots: themselves.
        motion: theirs; written.
        frame: what acts in it; what is noted of it is written.
    """

    def __init__(self, onboard: Onboard, robots: Robots, motion: Motion, frame: Frame) -> None:
        self._firmware, self._motors, self._battery, self._traction = onboard
        self._robots, self._motion, self._frame = robots, motion, frame

    def look(self) -> None:
        """See `Loops.look`; here, arrays are found by their names."""

    def obey(self, received: Received) -> None:
        """Take over commands."""
        self._firmware.obey(received)

    def go(self, received: Received, held: Array | None) -> bool:
        """Let a frame pass.

        Args:
            received: of which the headings count.
            held: currents that drivers hold, (n, W) A, or not a number; None for none.

        Returns:
            Whether all robots stand on their wheels, at places that are numbers.
        """
        motors, battery, firmware, r, m, g = (
            self._motors, self._battery, self._firmware, self._robots, self._motion, self._frame
        )  # fmt: skip
        firmware.correct(received.heading, received.age, motors.winding)
        m.before[:], m.tilt[:] = m.place, 0.0
        rims, (speeds, voltages, currents) = self._traction.arrays().rims, g.recorded.swapaxes(2, 3)
        for k in range(len(speeds)):
            duty = firmware.duties(m.seen_rate + g.gyro, m.seen_angle.T)
            if held is not None:
                motors.hold(duty, held, m.speed.T, battery.voltage[:, None])
            speeds[k], g.supplies[k] = m.speed.T, battery.voltage
            voltages[k], currents[k] = motors.drive(duty * battery.voltage[:, None], m.speed.T)
            if k % EVERY == 0:
                cycle.drag(r, m, self._traction, g.push, g.downhill)
            cycle.move(r, m, rims.rim_friction, rims.softness, motors.torque(currents[k]).T)
            battery.load(voltages[k], currents[k])
        motors.warm(currents, speeds)
        battery.discharge(PERIOD_S)
        return not np.count_nonzero(cycle.falls(r, m, len(speeds))) and bool(np.isfinite(cycle.where(m)).all())

    def pose(self) -> Array:
        """True poses, (n, 3)."""
        m, poses = self._motion, np.empty((len(self._motion.heading), 3))
        x, y = turned(*m.facing, *self._robots.middle)
        poses[:, 0], poses[:, 1], poses[:, 2] = m.place[0] + x, m.place[1] + y, m.heading
        return poses

    def telemetry(self) -> Telemetry:
        """Wheels and motors now."""
        m, (_, voltages, currents) = self._motion, self._frame.recorded.swapaxes(2, 3)
        slip, recorded = np.abs(m.speed - m.rims) * self._robots.radius, (voltages, currents, self._frame.supplies)
        return Telemetry.of_wheels(m.angle.T, m.speed.T, slip.T, recorded, self._motors, self._battery)


class Loops:
    """By compiled loops; see `AtOnce`."""

    def __init__(self, onboard: Onboard, robots: Robots, motion: Motion, frame: Frame) -> None:
        self._writer, self._firmware, self._frame = Writer(onboard, robots, motion, frame), onboard[0], frame
        self._table, n = self._writer.table, len(motion.heading)
        self._all: Some = None if n == 1 else (0, n)
        loops = by_robot.obey, by_robot.go, by_robot.look, by_robot.tell
        self._obey, self._go, self._look, self._tell = map(compiled, loops)

    def look(self) -> None:
        """Find anew what others stand in for when a fault begins or ends."""
        self._writer.look()

    def obey(self, received: Received) -> None:
        """See `AtOnce`."""
        self._firmware.note(received)
        self._obey(self._table, self._all, self._firmware.cycle)

    def go(self, received: Received, held: Array | None) -> bool:
        """See `AtOnce`."""
        firmware, frame = self._firmware, self._frame
        firmware.listen(received.heading, received.age)
        self._table[HELD] = 0 if held is None else len(frame.held)
        if held is not None:
            frame.held[:] = held.T
        stand: bool = self._go(self._table, self._all, firmware.cycle, firmware.estimate.frame, PERIOD_S)
        firmware.cycle += len(frame.supplies)
        firmware.estimate.frame += 1
        return stand

    def pose(self) -> Array:
        """See `AtOnce`."""
        self._look(self._table, self._all)
        return self._frame.pose.copy()

    def telemetry(self) -> Telemetry:
        """See `AtOnce`."""
        self._tell(self._table, self._all)
        return Telemetry(self._frame.telemetry.copy())
