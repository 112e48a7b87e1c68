"""Effects of faults on robots with wheels.

If a fault begins or ends, the effects of all active faults are applied to the nominal robots. A
fault that has ended therefore leaves no effect, and a robot's results do not depend on the faults
of other robots in its batch.

If several faults of a kind are active, their forces, payloads, slopes and biases add up, and their
factors are multiplied. If they replace the value of a setting, the last one counts.
"""

from collections.abc import Callable, Iterable, Sequence
from operator import add, attrgetter, mul
from typing import Any, Protocol

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config import faults
from omni_mj.config.faults import Payload
from omni_mj.config.rows import Row
from omni_mj.network.fault_schedule import ActiveFaults, FaultSchedule
from omni_mj.network.random_streams import Noise, Stream
from omni_mj.robot.wheel_carpet_forces import stack_patches

# Dry friction of a blocked hub, N m, which motor and carpet cannot overcome
BLOCKED_HUB_NM = 100.0


class ChangeableBodies(Protocol):
    """Bodies of n robots that faults can change."""

    def set_payloads(self, payloads: Iterable[tuple[int, Payload]]) -> None:
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

    def displace_robot(self, robot: int, displacement: tuple[float, float, float]) -> None:
        """Move a robot by a displacement, and bring it to rest.

        Args:
            robot: Row of the robot.
            displacement: Change of the pose, world frame, (3,) m, m, rad.
        """


class FaultEffects:
    """Effects of the faults of n robots with W wheels, frame by frame.

    Args:
        rows: Rows of the robots.
        plant: Plant with an attribute `parameters`, whose fields `electronics` and `carpet` change.
        bodies: Bodies of the robots.

    Attributes:
        push_force: Force of pushes on the chassis, world frame, (n, 2) N.
        gyro_bias: Bias that faults add to the gyros, (n, 1) rad/s.
        current_setpoint: 0 A for motors whose drivers are off, NaN for others, (W, n).
        inputs: Mapping from field of `omni_mj.robot.firmware_state.FrameInputs` to its value, for
            fields that faults set.
    """

    def __init__(self, rows: Sequence[Row], plant: Any, bodies: ChangeableBodies) -> None:
        self._rows = rows
        self._plant = plant
        self._bodies = bodies
        self._nominal_parameters = plant.parameters
        self._fault_types = {type(fault) for row in rows for fault in row.faults}
        faults_by_row = [row.faults for row in rows]
        self._schedule = FaultSchedule(faults_by_row, faults.WheeledRobotFault, faults.Kidnap)
        self._frame = 0
        self._robot_ones = np.ones(len(rows))
        self._wheel_ones = np.ones(plant.parameters.carpet.friction_factor.shape)
        self._zero_vectors = np.zeros((len(rows), 2))
        self._change_inputs(ActiveFaults([]))
        n_wheels = len(self._wheel_ones)
        self._dropout_noise = Noise(
            [row.noise_seed for row in rows],
            Stream.ENCODER_FAULTS,
            n_wheels,
        )
        self._max_patches = max(
            len(row.settings.carpet.patches)
            + sum(isinstance(fault, faults.FrictionPatch) for fault in row.faults)
            for row in rows
        )

    def begin_frame(self) -> None:
        """Apply faults that begin or end in the next frame, and draw its encoder dropouts."""
        active = self._schedule.update(self._frame)
        self._frame += 1
        if active is not None:
            self._change_parameters(active)
            self._change_bodies(active)
            self._change_inputs(active)
        drops_out = self._dropout_probability > self._dropout_noise.next().T
        self.inputs["encoder_scale"] = np.where(drops_out, 0.0, self._encoder_scale)

    def _change_parameters(self, active: ActiveFaults) -> None:
        """Apply faults of carpet, wheels and magnets to the plant's parameters."""
        carpet = self._nominal_parameters.carpet
        electronics = self._nominal_parameters.electronics
        wheel_ones = self._wheel_ones
        patches = [list(row.settings.carpet.patches) for row in self._rows]
        for row, patch in active.of_kind(faults.FrictionPatch):
            patches[row].append((patch.x_m, patch.y_m, patch.radius_m, patch.friction))
        n_missing = _combine(
            active, faults.WheelMissingRollers, 0 * wheel_ones, attrgetter("rollers"), max
        )
        n_rollers = np.array([row.settings.wheels.rollers for row in self._rows])
        carpet = carpet._replace(
            friction=_combine(
                active,
                faults.Friction,
                carpet.friction,
                attrgetter("friction"),
                lambda _, friction: friction,
            ),
            patches=stack_patches(patches, self._max_patches),
            friction_factor=carpet.friction_factor * _combine(active, faults.WheelWorn, wheel_ones),
            missing_angle=2 * np.pi * n_missing / n_rollers,
        )
        torque_constant = electronics.motors.cold_torque_constant
        torque_constant = torque_constant * _combine(active, faults.MotorDemagnetized, wheel_ones)
        motors = electronics.motors._replace(cold_torque_constant=torque_constant)
        self._plant.parameters = self._plant.parameters._replace(
            carpet=carpet, electronics=electronics._replace(motors=motors)
        )

    def _change_bodies(self, active: ActiveFaults) -> None:
        """Apply payloads, slopes, blocked hubs and displacements to the bodies."""
        if Payload in self._fault_types:
            self._bodies.set_payloads(active.of_kind(Payload))
        if faults.Tilt in self._fault_types:
            self._bodies.set_slope(
                _combine(
                    active,
                    faults.Tilt,
                    self._zero_vectors,
                    lambda tilt: np.sin(np.radians(tilt.angle_deg)) * _unit_vector(tilt),
                    add,
                )
            )
        if faults.MotorBlocked in self._fault_types:
            turns = _combine(active, faults.MotorBlocked, self._wheel_ones, _zero)
            self._bodies.block_hubs(turns == 0)
        for row, kidnap in active.of_kind(faults.Kidnap):
            if kidnap.frame_span[0] == self._frame - 1:
                self._bodies.displace_robot(row, kidnap.displacement)

    def _change_inputs(self, active: ActiveFaults) -> None:
        """Apply faults of sensors, drivers, processors and supplies, and push forces."""
        robot_ones = self._robot_ones
        wheel_ones = self._wheel_ones
        self.push_force = _combine(
            active,
            faults.Push,
            self._zero_vectors,
            lambda push: push.force_n * _unit_vector(push),
            add,
        )
        self.gyro_bias = _combine(
            active, faults.GyroBias, 0 * robot_ones[:, None], attrgetter("bias_rad_s"), add
        )
        self._encoder_scale = _combine(active, faults.EncoderScale, wheel_ones)
        self._dropout_probability = 1 - _combine(
            active, faults.EncoderDropout, wheel_ones, lambda fault: 1 - fault.probability
        )
        self.inputs = {
            "battery_voltage_factor": _combine(active, faults.BrownOut, robot_ones),
            "gyro_scale": _combine(active, faults.GyroScale, robot_ones),
            # The product of factors of 0 is 0 for rows with such a fault, 1 for others.
            "ignores_commands": _combine(active, faults.FirmwareTimeout, robot_ones, _zero) == 0,
            "processor_is_off": _combine(active, faults.Reboot, robot_ones, _zero) == 0,
        }
        is_driven = _combine(active, faults.MotorDead, wheel_ones, _zero)
        is_driven *= _combine(
            active, faults.Reboot, robot_ones, lambda reboot: reboot.motors == "brake"
        )
        self.current_setpoint = np.where(is_driven, np.nan, 0.0)


def _combine(
    active: ActiveFaults,
    kind: type[faults.Fault],
    nominal: Array,
    get_value: Callable[[Any], Any] = attrgetter("factor"),
    operator: Callable[[Any, Any], Any] = mul,
) -> Array:
    """Return the values of robots or wheels under all active faults of a kind.

    Args:
        active: Active faults.
        kind: Class of the faults to apply.
        nominal: Values without faults, of robots (n, ...) or wheels (W, n).
        get_value: Returns the value of a fault. Default: its attribute `factor`.
        operator: Maps the present value and that of a fault to the new value. Default:
            multiplication.
    """
    result = nominal.copy()
    for row, fault in active.of_kind(kind):
        index = (fault.wheel - 1, row) if isinstance(fault, faults.WheelFault) else row
        result[index] = operator(result[index], get_value(fault))
    return result


def _zero(_: Any) -> float:
    """Return 0: the factor of a fault that switches something off."""
    return 0.0


def _unit_vector(fault: Any) -> Array:
    """Return the direction of a push or slope, (2,)."""
    angle = np.radians(fault.direction_deg)
    return np.array([np.cos(angle), np.sin(angle)])
