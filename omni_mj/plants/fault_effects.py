"""Effects of faults on robots with wheels.

Whenever a fault begins or ends, the effects of all active faults are applied to the nominal robots.
A fault that has ended therefore leaves no effect.

If several faults of a kind are active, their forces, payloads, slopes and biases add up, and their
factors are multiplied. Of faults that replace a setting the last one counts, and of gaps of missing
rollers in one wheel the largest.
"""

from collections.abc import Callable, Iterable, Sequence
from operator import attrgetter
from typing import Any, Protocol

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config import faults
from omni_mj.config.rows import Row
from omni_mj.network.fault_schedule import FaultSchedule
from omni_mj.robot.wheel_carpet_forces import stack_patches

# Dry friction of a blocked hub, N m, which motor and carpet cannot overcome
BLOCKED_HUB_NM = 100.0


class ChangeableBodies(Protocol):
    """Bodies of n robots that faults can change."""

    def set_payloads(self, payloads: Iterable[tuple[int, faults.Payload]]) -> None:
        """Replace all payloads of all robots.

        Args:
            payloads: Pairs of a row and its payload.
        """

    def set_slope(self, slope: Array) -> None:
        """Tilt the carpets.

        Args:
            slope: Fractions of gravity along the world's x and y, positive downhill, (n, 2).
        """

    def block_hubs(self, is_blocked: np.ndarray) -> None:
        """Block the hubs of some wheels, and free all others.

        Args:
            is_blocked: Whether each hub is blocked, (W, n).
        """

    def displace_robot(self, row: int, displacement: tuple[float, float, float]) -> None:
        """Move a robot by a displacement, and bring it to rest.

        Args:
            row: Row of the robot.
            displacement: Change of the pose, world frame, (3,) m, m, rad.
        """


class FaultEffects:
    """Effects of the faults of n robots with W wheels, frame by frame.

    Args:
        rows: Rows of the robots.
        plant: Plant with an attribute `parameters`, whose fields `electronics` and `carpet` change.
        bodies: Bodies of the robots.
        frame: Number of frames so far.

    Attributes:
        push_force: Force of pushes on the chassis, world frame, (n, 2) N.
        gyro_bias: Bias that faults add to the gyros, (n, 1) rad/s.
        current_setpoint: 0 A for motors whose drivers are off, NaN for others, (W, n).
        inputs: Mapping from field of `omni_mj.robot.firmware_state.FrameInputs` to its value, for
            fields that faults set.
    """

    def __init__(
        self, rows: Sequence[Row], plant: Any, bodies: ChangeableBodies, frame: int = 0
    ) -> None:
        self._rows = rows
        self._plant = plant
        self._bodies = bodies
        self._nominal_parameters = plant.parameters
        self._fault_types = {type(fault) for row in rows for fault in row.faults}
        # Without faults of radio and camera, which act on all plants
        self._schedule = FaultSchedule(
            [[fault for fault in row.faults if fault.plants] for row in rows]
        )
        self._frame = frame
        self._wheel_shape = plant.parameters.carpet.friction_factor.shape
        self._update_inputs()
        # Largest number of patches on a carpet. JAX would compile again for another length.
        self._max_patches = max(
            len(row.settings.carpet.patches)
            + sum(isinstance(fault, faults.FrictionPatch) for fault in row.faults)
            for row in rows
        )

    def begin_frame(self, uniform: Array) -> None:
        """Apply faults that begin or end in this frame.

        Args:
            uniform: Random numbers that decide which encoders drop out, in [0, 1), (W, n).
        """
        if self._schedule.advance(self._frame):
            self._change_parameters()
            self._change_bodies()
            self._update_inputs()
        self._frame += 1
        drops_out = self._dropout_probability > uniform
        self.inputs["encoder_scale"] = np.where(drops_out, 0.0, self._encoder_scale)

    def _change_parameters(self) -> None:
        """Apply faults of carpet, wheels and magnets to the plant's parameters."""
        carpet = self._nominal_parameters.carpet
        electronics = self._nominal_parameters.electronics
        friction = carpet.friction.copy()
        for row, carpet_change in self._schedule.list_active(faults.Friction):
            friction[row] = carpet_change.friction
        patches = [list(row.settings.carpet.patches) for row in self._rows]
        for row, patch in self._schedule.list_active(faults.FrictionPatch):
            patches[row].append((patch.x_m, patch.y_m, patch.radius_m, patch.friction))
        n_missing = np.zeros(self._wheel_shape)
        for row, gap in self._schedule.list_active(faults.WheelMissingRollers):
            wheel = gap.wheel - 1
            n_missing[wheel, row] = max(n_missing[wheel, row], gap.rollers)
        n_rollers = np.array([row.settings.wheels.rollers for row in self._rows])
        carpet = carpet._replace(
            friction=friction,
            patches=stack_patches(patches, self._max_patches),
            friction_factor=carpet.friction_factor * self._combine_factors(faults.WheelWorn),
            missing_angle=2 * np.pi * n_missing / n_rollers,
        )
        motors = electronics.motors
        motors = motors._replace(
            cold_torque_constant=motors.cold_torque_constant
            * self._combine_factors(faults.MotorDemagnetized)
        )
        self._plant.parameters = self._plant.parameters._replace(
            carpet=carpet, electronics=electronics._replace(motors=motors)
        )

    def _change_bodies(self) -> None:
        """Apply payloads, slopes, blocked hubs and displacements to the bodies."""
        if faults.Payload in self._fault_types:
            self._bodies.set_payloads(self._schedule.list_active(faults.Payload))
        if faults.Tilt in self._fault_types:
            slope = np.zeros((len(self._rows), 2))
            for row, tilt in self._schedule.list_active(faults.Tilt):
                slope[row] += np.sin(np.radians(tilt.angle_deg)) * _unit_vector(tilt)
            self._bodies.set_slope(slope)
        if faults.MotorBlocked in self._fault_types:
            self._bodies.block_hubs(self._is_affected(faults.MotorBlocked))
        for row, kidnap in self._schedule.list_active(faults.Kidnap):
            if kidnap.frame_span[0] == self._frame:
                self._bodies.displace_robot(row, kidnap.displacement)

    def _update_inputs(self) -> None:
        """Set the attributes to the effects of active faults."""
        self.push_force = np.zeros((len(self._rows), 2))
        for row, push in self._schedule.list_active(faults.Push):
            self.push_force[row] += push.force_n * _unit_vector(push)
        self.gyro_bias = np.zeros((len(self._rows), 1))
        for row, bias in self._schedule.list_active(faults.GyroBias):
            self.gyro_bias[row] += bias.bias_rad_s
        self._encoder_scale = self._combine_factors(faults.EncoderScale)
        self._dropout_probability = 1 - self._combine_factors(
            faults.EncoderDropout, lambda dropout: 1 - dropout.probability
        )
        self.inputs = {
            "battery_voltage_factor": self._combine_factors(faults.BrownOut),
            "gyro_scale": self._combine_factors(faults.GyroScale),
            "ignores_commands": self._is_affected(faults.FirmwareTimeout),
            "processor_is_off": self._is_affected(faults.Reboot),
        }
        is_off = self._is_affected(faults.MotorDead)
        for row, reboot in self._schedule.list_active(faults.Reboot):
            is_off[:, row] |= reboot.motors == "coast"
        self.current_setpoint = np.where(is_off, 0.0, np.nan)

    def _combine_factors(
        self,
        kind: type[faults.Fault],
        get_factor: Callable[[Any], float] = attrgetter("factor"),
    ) -> Array:
        """Return the product of the factors of active faults of a kind; 1 without such a fault.

        Args:
            kind: Class of the faults.
            get_factor: Returns the factor of a fault. Default: its attribute `factor`.

        Returns:
            Products for wheels, (W, n), if the fault is one of a wheel; otherwise for robots, (n,).
        """
        is_of_wheel = issubclass(kind, faults.WheelFault)
        product = np.ones(self._wheel_shape if is_of_wheel else self._wheel_shape[1:])
        for row, fault in self._schedule.list_active(kind):
            index = (fault.wheel - 1, row) if isinstance(fault, faults.WheelFault) else row
            product[index] *= get_factor(fault)
        return product

    def _is_affected(self, kind: type[faults.Fault]) -> np.ndarray:
        """Return whether a fault of a kind affects each wheel, (W, n), or each robot, (n,)."""
        return self._combine_factors(kind, lambda _: 0.0) == 0


def _unit_vector(fault: faults.Push | faults.Tilt) -> Array:
    """Return the direction of a push or slope, (2,)."""
    angle = np.radians(fault.direction_deg)
    return np.array([np.cos(angle), np.sin(angle)])
