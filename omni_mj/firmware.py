"""What runs on the robot: from a received world-frame velocity to four motor voltages, at the physics rate."""

import numpy as np

from omni_control.kinematics import Array, Kinematics
from omni_mj.robot import Motor
from omni_mj.settings import FirmwareSettings


class Firmware:
    """Heading from the gyro, inverse kinematics, and one PID loop per wheel.

    Args:
        settings: gains.
        kinematics: of the robot's wheels.
        motor: for the back-EMF that is fed forward.
        voltage_limit: what the battery gives, V.
        heading: at the start, (n,) rad.
        timestep: time between calls, s.
    """

    def __init__(
        self,
        settings: FirmwareSettings,
        kinematics: Kinematics,
        motor: Motor,
        voltage_limit: float,
        heading: Array,
        timestep: float,
    ) -> None:
        self._gains = settings
        self._rim = kinematics.matrix / kinematics.radius
        self._back_emf = settings.feed_forward * motor.constant * motor.gear
        self._limit = voltage_limit
        self._timestep = timestep
        self.heading = np.array(heading, float)
        self._integral = np.zeros((len(heading), 4))
        self._last_error = np.zeros((len(heading), 4))

    def voltages(self, command: Array, gyro: Array, encoders: Array) -> Array:
        """Return the motor voltages (n, 4).

        Args:
            command: received velocity (n, 3), world frame.
            gyro: turn rate (n,), rad/s.
            encoders: wheel speeds (n, 4), rad/s.
        """
        self.heading += gyro * self._timestep
        wanted = self._wheel_speeds(command)
        error = wanted - encoders
        integral = self._integral + error * self._timestep
        rate = (error - self._last_error) / self._timestep
        self._last_error = error
        g = self._gains
        free = self._back_emf * wanted + g.kp * error + g.ki * integral + g.kd * rate
        voltage = np.clip(free, -self._limit, self._limit)
        # Anti-windup: while the voltage is at its limit, an error that pushes further is not integrated.
        windup = (free != voltage) & (free * error > 0)
        self._integral = np.where(windup, self._integral, integral)
        return voltage

    def _wheel_speeds(self, command: Array) -> Array:
        """Wheel speeds (n, 4) for world-frame commands (n, 3): equation 2, then the inverse of equation 3."""
        c, s = np.cos(self.heading), np.sin(self.heading)
        forward = c * command[:, 0] + s * command[:, 1]
        left = c * command[:, 1] - s * command[:, 0]
        per_forward, per_left, per_turn = self._rim.T
        return forward[:, None] * per_forward + left[:, None] * per_left + command[:, 2:] * per_turn
