"""What happens between the physics steps of the MuJoCo plant, with all robots at once, by numpy.

Two calls a step: `before` it sensors and commands become voltages, loads become limits of the slip hinges; `after` it
sensors are read, rollers handed over, and the battery sags. `between` has the same in compiled loops.
"""

import numpy as np

from omni_control.kinematics import Array, wrapped
from omni_mj.link.radio import Received
from omni_mj.onboard import laws
from omni_mj.onboard.battery import Battery
from omni_mj.onboard.firmware import Firmware
from omni_mj.onboard.motors import Motors
from omni_mj.onboard.traction import EVERY, Traction
from omni_mj.plants.bound import Bound


class AtOnce:
    """What happens before and after each step.

    Args:
        at: where robots are in their batch.
        onboard: firmware, motors, battery and traction of the robots.
        sensed: what encoders and gyros showed last, (W, n) rad and (n,) rad/s; written.
        off: robots that are switched off, (n,); a live array.
        heading: at the start, full turns counted, (n,) rad; written at the end of each frame.
        recorded: written: wheel speeds, voltages and currents of a frame's cycles (3, cycles, W, n), and the battery's
            voltage (cycles, n, 1).
    """

    def __init__(
        self,
        at: Bound,
        onboard: tuple[Firmware, Motors, Battery, Traction],
        sensed: tuple[Array, Array],
        off: np.ndarray,
        heading: Array,
        recorded: tuple[Array, Array],
    ) -> None:
        self._at, self._off, self._heading = at, off, heading
        self._firmware, self._motors, self._battery, self._traction = onboard
        self._angles, self._turn_rates = sensed[0].T, sensed[1]
        self._speeds, self._voltages, self._currents = recorded[0].swapaxes(2, 3)
        self._supplies = recorded[1]
        self._gyro_error, self._push = np.zeros(len(off)), np.zeros((len(off), 2))
        self._held: Array | None = None

    def look(self) -> None:
        """See `Between`: here everything is found where it is used."""

    def obey(self, received: Received) -> None:
        """Take over commands, from the next cycle on."""
        self._firmware.obey(received)

    def begin(self, heard: tuple[Array, np.ndarray], gyro_error: Array, push: Array) -> None:
        """Begin a frame.

        Args:
            heard: vision's headings that arrived since the frame before, (n,) rad, not a number where none did; and
                frames since they were sent, (n,).
            gyro_error: by which gyros show too much, (n,) rad/s.
            push: on chassis, (n, 2) N.
        """
        self._firmware.correct(*heard, self._motors.winding)
        self._gyro_error, self._push = gyro_error, push

    def hold(self, held: Array | None) -> None:
        """Have drivers hold currents from now on, (n, W) A, or not a number; None for none."""
        self._held = held

    def before(self, k: int) -> None:
        """Let the wheel loops run in the cycle `k` of a frame, before physics steps."""
        at, motors, battery, traction = self._at, self._motors, self._battery, self._traction
        duty = self._firmware.duties(self._turn_rates + self._gyro_error, self._angles)
        if self._held is not None:
            motors.hold(duty, self._held, at.wheel_speed.get(), battery.voltage[:, None])
        if np.count_nonzero(self._off):
            duty[self._off] = 0.0
        self._speeds[k], self._supplies[k, :, 0] = at.wheel_speed.get(), battery.voltage
        self._voltages[k], self._currents[k] = motors.drive(duty * self._supplies[k], self._speeds[k])
        at.ctrl.set(motors.told(self._currents[k], self._speeds[k]))
        if k % EVERY == 0:
            traction.travel(at.position.get(), at.quaternion.get(), at.velocity.get(), at.load.get(), self._angles)
            traction.wrench[:, :2] += self._push
            at.wrench.set(traction.wrench)
        self._press()

    def after(self, k: int, first: bool, last: bool) -> None:
        """See to what follows a physics step, the `first` or `last` in the cycle `k` of a frame."""
        if first:  # what MuJoCo sensed at its start: a cycle ago, however many steps there are in it
            self._angles[:], self._turn_rates[:] = self._at.encoders.get(), self._at.gyro.get()[:, 0]
        if self._at.handover is not None:
            self._at.handover()
        if last:
            self._battery.load(self._voltages[k], self._currents[k])
        else:
            self._press()

    def end(self, period: float) -> bool:
        """Warm motors and discharge batteries after a frame that lasted so long, s, and read headings.

        Returns:
            Whether a robot that is on has toppled.
        """
        self._motors.warm(self._currents, self._speeds)
        self._battery.discharge(period)
        w, x, y, z = self._at.quaternion.get().T
        self._heading += wrapped(laws.heading(w, x, y, z) - self._heading)
        return bool((laws.toppled(x, y) & ~self._off).any())

    def _press(self) -> None:
        """Let the wheels' loads limit how much their rims hold."""
        if (slips := self._at.slips) is not None:
            self._traction.press(self._at.load.get())
            slips.limit.set(self._traction.limit)
            slips.impedance.set(self._traction.impedance)
