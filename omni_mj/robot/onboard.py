"""A robot's firmware, motors and battery together, from frame to frame and from cycle to cycle."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Kinematics
from omni_mj.config.settings import Settings, gather
from omni_mj.robot.array_namespace import Array, namespace, total
from omni_mj.robot.battery import (
    BatteryParameters,
    BatteryState,
    Source,
    battery_parameters,
    discharge,
    load_battery,
    source_of,
)
from omni_mj.robot.firmware import (
    Command,
    LoopParameters,
    LoopState,
    accept_command,
    correct_heading,
    derate,
    loop_parameters,
    loops_at_rest,
    mislead_encoders,
    restart_processors,
    run_wheel_loops,
)
from omni_mj.robot.motors import (
    MotorParameters,
    MotorState,
    drive_motors,
    hold_current,
    motor_parameters,
    motors_at,
    warm_motors,
)


class OnboardParameters(NamedTuple):
    """Parameters of what robots carry."""

    loops: LoopParameters
    motors: MotorParameters
    battery: BatteryParameters


class FrameInputs(NamedTuple):
    """What acts on robots in a frame, (n,) unless another shape is given."""

    seen_heading: Array  # vision's, that arrived since the frame before, rad; NaN where none did
    age: Array  # frames since it was sent
    gyro_error: Array  # rad/s
    push_x: Array  # force on the chassis, world frame, N
    push_y: Array
    power_share: Array  # share of the battery's voltage that its contacts pass
    # Turn rate that the gyro shows over the true one; None if no robot has faults
    gyro_scale: Array = None
    # Angle that encoders show over the true one, (W, n); None as gyro_scale
    encoder_scale: Array = None
    # That drivers hold, (W, n) A; NaN where the firmware drives; None if it does everywhere
    held_current: Array = None
    is_deaf: Array = None  # robots that ignore commands; None as gyro_scale
    is_off: Array = None  # robots whose processors are off; None as gyro_scale
    # Robots that have failed, whose drivers short the motors; None if all go on
    is_stopped: Array = None


class OnboardState(NamedTuple):
    """State of what robots carry."""

    cycle: Array  # number of cycles so far, ()
    frame: Array  # number of frames so far, ()
    loops: LoopState
    motors: MotorState
    battery: BatteryState
    source: Source  # the battery in this frame
    inputs: FrameInputs  # in this frame


class CycleRecord(NamedTuple):
    """What motors and batteries did in a cycle, (W, n) unless another shape is given."""

    speed: Array  # of the wheels, rad/s
    voltage: Array  # V
    current: Array  # A
    is_limited: Array  # whether the driver limited the current
    supply: Array  # voltage of the battery, (n,) V
    drawn: Array  # current from the battery, (n,) A


def onboard(
    settings: Sequence[Settings],
    kinematics: Kinematics,
    heading: Array,
    strength: Array,
    options: tuple[int, bool],
) -> tuple[OnboardParameters, OnboardState]:
    """Return parameters and the state at the start of n robots.

    Args:
        settings: One per robot.
        kinematics: Of their wheels.
        heading: At the start, (n,) rad.
        strength: Of each motor's magnets over the data sheet's, a factor, (W, n).
        options: Frames for which headings are remembered, and whether processors and encoders may
            fail.
    """
    loops, motors = loop_parameters(settings, kinematics), motor_parameters(settings, strength)
    battery, battery_state = battery_parameters(settings)
    winding, housing = (
        gather(settings, f"motor.{name}_c") * np.ones_like(strength)
        for name in ("winding", "housing")
    )
    frames, fails = options
    state = OnboardState(
        cycle=np.array(0),
        frame=np.array(0),
        loops=loops_at_rest(loops, heading, frames, fails),
        motors=motors_at(motors, winding, housing),
        battery=battery_state,
        source=source_of(battery, battery_state, np.ones(len(settings))),
        inputs=quiet_inputs(len(settings)),
    )
    return OnboardParameters(loops, motors, battery), state


def quiet_inputs(n: int) -> FrameInputs:
    """Return the inputs of a frame in which nothing acts on n robots."""
    none = np.zeros(n)
    return FrameInputs(np.full(n, np.nan), np.zeros(n, int), none, none, none, np.ones(n))


def hear(p: OnboardParameters, s: OnboardState, command: Command) -> OnboardState:
    """Take over a command, which acts from the next cycle on."""
    return s._replace(loops=accept_command(p.loops, s.loops, s.cycle, command))


def begin_frame(
    p: OnboardParameters, s: OnboardState, inputs: FrameInputs, wheel_angle: Array
) -> OnboardState:
    """Let a frame begin.

    Args:
        p: Parameters.
        s: State.
        inputs: What acts in the frame.
        wheel_angle: As sensed last, (W, n) rad.
    """
    loops = s.loops
    if inputs.encoder_scale is not None:
        loops = mislead_encoders(loops, inputs.encoder_scale, wheel_angle)
    if inputs.is_off is not None:
        loops = restart_processors(
            p.loops, loops, s.cycle, inputs.is_deaf, inputs.is_off, wheel_angle
        )
    loops = correct_heading(
        p.loops, loops, s.frame, inputs.seen_heading, inputs.age, inputs.is_deaf
    )
    motors = motors_at(p.motors, s.motors.winding, s.motors.housing)
    return s._replace(
        frame=s.frame + 1,
        loops=derate(p.loops, loops, motors.winding),
        motors=motors,
        source=source_of(p.battery, s.battery, inputs.power_share),
        inputs=inputs,
    )


def run_cycle(
    p: OnboardParameters, s: OnboardState, gyro: Array, wheel_angle: Array, wheel_speed: Array
) -> tuple[OnboardState, CycleRecord]:
    """Let sensors, firmware, drivers, motors and battery pass a cycle of the wheel loops.

    Args:
        p: Parameters.
        s: State.
        gyro: Turn rate as sensed, (n,) rad/s.
        wheel_angle: As sensed, (W, n) rad.
        wheel_speed: True speeds, (W, n) rad/s.
    """
    inputs = s.inputs
    shown = gyro + inputs.gyro_error
    if inputs.gyro_scale is not None:
        shown = inputs.gyro_scale * shown
    loops = run_wheel_loops(p.loops, s.loops, s.cycle, shown, wheel_angle)
    supply, duty = s.battery.voltage, loops.duty
    if inputs.is_stopped is not None:
        duty = namespace(duty).where(inputs.is_stopped, 0.0, duty)
    if inputs.held_current is not None:
        duty = hold_current(p.motors, s.motors, duty, inputs.held_current, wheel_speed, supply)
    voltage, current, is_limited = drive_motors(p.motors, s.motors, duty * supply, wheel_speed)
    battery, drawn = load_battery(s.battery, s.source, voltage, current)
    record = CycleRecord(wheel_speed, voltage, current, is_limited, supply, drawn)
    return s._replace(cycle=s.cycle + 1, loops=loops, battery=battery), record


def end_frame(p: OnboardParameters, s: OnboardState, record: CycleRecord) -> OnboardState:
    """Warm motors and discharge batteries by the records of a frame's cycles, which have a leading axis of cycles."""
    drawn = total(record.drawn) / len(record.drawn)  # over cycles
    return s._replace(
        motors=warm_motors(p.motors, s.motors, record.current, record.speed),
        battery=discharge(p.battery, s.battery, drawn),
    )


def telemetry_rows(
    s: OnboardState, record: CycleRecord, wheel_angle: Array, wheel_speed: Array, slip: Array
) -> Array:
    """Return the columns of `omni_mj.plants.Telemetry` as rows, (10 W + 4, n).

    Args:
        s: State at the end of a frame.
        record: Of the frame's cycles, with a leading axis of cycles.
        wheel_angle: True angles, (W, n) rad.
        wheel_speed: (W, n) rad/s.
        slip: Speed at which rims slide over the carpet, (W, n) m/s.
    """
    xp = namespace(wheel_angle)
    voltages, supply = abs(record.voltage), record.supply[:, None]
    duties = xp.where(supply > 0, voltages / xp.where(supply > 0, supply, 1.0), 0.0)
    peaks = (
        xp.minimum(duties.max((0, 1)), 1.0),
        voltages.max((0, 1)),
        abs(record.current).max((0, 1)),
    )
    rows = [
        *(wheel_angle, wheel_speed, record.voltage[-1], record.current[-1]),
        *(record.voltage.sum(0) / len(voltages), record.current.sum(0) / len(voltages)),
        *(peak[None] for peak in peaks),
        record.is_limited.sum(0) / len(voltages),
        *(s.motors.winding, s.motors.housing, s.battery.voltage[None], slip),
    ]
    return xp.concatenate(rows, axis=0)
