"""Electronics of a robot: firmware, motors and battery, advanced by frames and by cycles."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Kinematics
from omni_mj.config import CYCLES_PER_FRAME
from omni_mj.config.settings import Settings, gather
from omni_mj.robot.array_ops import Array, namespace, sum_wheels
from omni_mj.robot.battery import (
    BatteryParameters,
    BatterySource,
    BatteryState,
    apply_motor_load,
    discharge_battery,
    make_battery,
    make_battery_source,
)
from omni_mj.robot.firmware import (
    accept_command,
    correct_heading,
    derate_motors,
    run_wheel_loops,
    set_encoder_scale,
    switch_processors,
)
from omni_mj.robot.firmware_state import (
    FirmwareCommand,
    FirmwareParameters,
    FirmwareState,
    FrameInputs,
    make_firmware_parameters,
    make_firmware_state,
    make_undisturbed_inputs,
)
from omni_mj.robot.motors_and_drivers import (
    MotorParameters,
    MotorState,
    drive_motors,
    make_motor_parameters,
    make_motor_state,
    override_duty,
    update_temperatures,
)


class ElectronicsParameters(NamedTuple):
    """Parameters of firmware, motors and battery."""

    firmware: FirmwareParameters
    motors: MotorParameters
    battery: BatteryParameters


class ElectronicsState(NamedTuple):
    """State of firmware, motors and battery."""

    cycle: Array  # number of cycles so far, ()
    firmware: FirmwareState
    motors: MotorState
    battery: BatteryState
    battery_source: BatterySource  # Thevenin equivalent of the battery in this frame
    inputs: FrameInputs  # faults, disturbances and vision's headings in this frame


class CycleRecord(NamedTuple):
    """Motors and batteries in a cycle, (W, n) unless another shape is given.

    The record of a frame has a leading axis of cycles in every field.
    """

    wheel_speed: Array  # speed of the hubs at the beginning of the cycle, rad/s
    voltage: Array  # voltage at the motor terminals, V
    current: Array  # motor current, A
    is_limited: Array  # whether the driver limited the current
    battery_voltage: Array  # voltage at the battery terminals, (n,) V
    battery_current: Array  # current that the drivers take from the battery, (n,) A


def make_electronics(
    settings: Sequence[Settings],
    kinematics: Kinematics,
    heading: Array,
    magnet_factor: Array,
    n_frames: int,
    has_faults: bool,
) -> tuple[ElectronicsParameters, ElectronicsState]:
    """Return parameters and initial state of n robots.

    Args:
        settings: One per robot.
        kinematics: Geometry of their wheels.
        heading: Heading at the start, (n,) rad.
        magnet_factor: Ratio of each motor's torque constant to the datasheet's, (W, n).
        n_frames: Number of past headings that the firmware stores, one per frame.
        has_faults: Whether processors and encoders may fail.
    """
    firmware = make_firmware_parameters(settings, kinematics)
    motors = make_motor_parameters(settings, magnet_factor)
    battery, battery_state = make_battery(settings)
    temperatures = (
        gather(settings, f"motor.{name}_c") * np.ones_like(magnet_factor)
        for name in ("winding", "housing")
    )
    state = ElectronicsState(
        cycle=np.array(0),
        firmware=make_firmware_state(firmware, heading, n_frames, has_faults),
        motors=make_motor_state(motors, *temperatures),
        battery=battery_state,
        battery_source=make_battery_source(battery, battery_state, np.ones(len(settings))),
        inputs=make_undisturbed_inputs(len(settings)),
    )
    return ElectronicsParameters(firmware, motors, battery), state


def receive_command(
    p: ElectronicsParameters, s: ElectronicsState, command: FirmwareCommand
) -> ElectronicsState:
    """Pass a command to the firmware, which applies it from the next cycle on."""
    return s._replace(firmware=accept_command(p.firmware, s.firmware, s.cycle, command))


def begin_frame(
    p: ElectronicsParameters, s: ElectronicsState, inputs: FrameInputs, wheel_angle: Array
) -> ElectronicsState:
    """Begin a frame: faults, heading correction by vision, derating, and the battery's source.

    Args:
        p: Parameters.
        s: State.
        inputs: Inputs of the frame.
        wheel_angle: True angles of the wheels at the last cycle, (W, n) rad.
    """
    firmware = s.firmware
    if inputs.encoder_scale is not None:
        firmware = set_encoder_scale(firmware, inputs.encoder_scale, wheel_angle)
    if inputs.processor_is_off is not None:
        firmware = switch_processors(p.firmware, firmware, s.cycle, inputs, wheel_angle)
    firmware = correct_heading(p.firmware, firmware, s.cycle // CYCLES_PER_FRAME, inputs)
    motors = make_motor_state(p.motors, s.motors.winding, s.motors.housing)
    return s._replace(
        firmware=derate_motors(p.firmware, firmware, motors.winding),
        motors=motors,
        battery_source=make_battery_source(p.battery, s.battery, inputs.battery_voltage_factor),
        inputs=inputs,
    )


def run_cycle(
    p: ElectronicsParameters,
    s: ElectronicsState,
    gyro: Array,
    wheel_angle: Array,
    wheel_speed: Array,
) -> tuple[ElectronicsState, CycleRecord]:
    """Advance sensors, firmware, drivers, motor currents and battery by a cycle of 1/960 s.

    Args:
        p: Parameters.
        s: State.
        gyro: True turn rate at the gyro, (n,) rad/s.
        wheel_angle: True angles at the encoders, (W, n) rad.
        wheel_speed: True speeds of the wheels, (W, n) rad/s.

    Returns:
        The state after the cycle, and the record of the cycle.
    """
    inputs = s.inputs
    gyro_rate = gyro + inputs.gyro_error
    if inputs.gyro_scale is not None:
        gyro_rate = inputs.gyro_scale * gyro_rate
    firmware = run_wheel_loops(p.firmware, s.firmware, s.cycle, gyro_rate, wheel_angle)
    duty = firmware.duty
    battery_voltage = s.battery.voltage
    if inputs.has_failed is not None:
        duty = namespace(duty).where(inputs.has_failed, 0.0, duty)
    if inputs.current_setpoint is not None:
        duty = override_duty(
            p.motors, s.motors, duty, inputs.current_setpoint, wheel_speed, battery_voltage
        )
    voltage, current, is_limited = drive_motors(
        p.motors, s.motors, duty * battery_voltage, wheel_speed, battery_voltage > 0
    )
    battery, battery_current = apply_motor_load(s.battery, s.battery_source, voltage, current)
    record = CycleRecord(
        wheel_speed, voltage, current, is_limited, battery_voltage, battery_current
    )
    return s._replace(cycle=s.cycle + 1, firmware=firmware, battery=battery), record


def end_frame(
    p: ElectronicsParameters, s: ElectronicsState, record: CycleRecord
) -> ElectronicsState:
    """Advance motor temperatures and battery charge by the currents of a frame.

    Args:
        p: Parameters.
        s: State.
        record: Records of the frame's cycles, with a leading axis of cycles.
    """
    # (cycles, n): `sum_wheels` sums over the last axis but one, which here counts cycles.
    mean_battery_current = sum_wheels(record.battery_current) / len(record.battery_current)
    return s._replace(
        motors=update_temperatures(p.motors, s.motors, record.current, record.wheel_speed),
        battery=discharge_battery(p.battery, s.battery, mean_battery_current),
    )


def stack_telemetry(
    s: ElectronicsState, record: CycleRecord, wheel_angle: Array, wheel_speed: Array, slip: Array
) -> Array:
    """Return the quantities of `omni_mj.plants.telemetry.Telemetry` stacked, (10 W + 4, n).

    Args:
        s: State at the end of a frame.
        record: Records of the frame's cycles, with a leading axis of cycles.
        wheel_angle: True angles of the wheels, (W, n) rad.
        wheel_speed: True speeds of the wheels, (W, n) rad/s.
        slip: Speed at which rims slide over the carpet, (W, n) m/s.
    """
    xp = namespace(wheel_angle)
    abs_voltage = abs(record.voltage)
    n_cycles = len(abs_voltage)
    battery_voltage = record.battery_voltage[:, None]
    is_powered = battery_voltage > 0
    duty = xp.where(is_powered, abs_voltage / xp.where(is_powered, battery_voltage, 1.0), 0.0)
    quantities = [
        wheel_angle,
        wheel_speed,
        record.voltage[-1],
        record.current[-1],
        record.voltage.sum(0) / n_cycles,
        record.current.sum(0) / n_cycles,
        xp.minimum(duty.max((0, 1)), 1.0)[None],
        abs_voltage.max((0, 1))[None],
        abs(record.current).max((0, 1))[None],
        record.is_limited.sum(0) / n_cycles,
        s.motors.winding,
        s.motors.housing,
        s.battery.voltage[None],
        slip,
    ]
    return xp.concatenate(quantities, axis=0)
