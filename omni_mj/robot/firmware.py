"""Firmware: from a received velocity to the duties of the motors.

The firmware rotates commanded velocities into its own frame by the heading that it estimates, adds
a turn-rate loop on the gyro, and runs a PID loop for each wheel. The loops compute in volts of a
nominal battery and command duties, so a low battery weakens them. They know the motors' data
sheet, from which they feed the back-EMF forward. Slow loops (`firmware.rate_hz`) read sensors in
every k-th cycle only, and hold their duties in between.

Commands are velocities in the world frame, velocities in the body frame, or speeds of the rims.
A robot that receives nothing new for `firmware.timeout_s` halts: its wheels are held at rest.
Equations are those of the paper: 2 rotates the velocity, the inverse of 3 gives wheel speeds.
"""

from typing import Any

import numpy as np

from omni_mj.robot.array_ops import (
    Array,
    any_true,
    clip,
    cos_sin_small,
    namespace,
    rotate,
    select,
    straight_through_floor,
)
from omni_mj.robot.firmware_state import (
    FirmwareCommand,
    FirmwareParameters,
    FirmwareState,
    FrameInputs,
)

DERATING_BAND_K = 10.0  # derating begins this far below the winding's temperature limit


def accept_command(
    p: FirmwareParameters, s: FirmwareState, cycle: Array, command: FirmwareCommand
) -> FirmwareState:
    """Store a command that applies from this cycle on, and restart the timeout."""
    xp = namespace(command.velocity)
    x, y, turn_rate = command.velocity
    halt_cycle = xp.where(command.is_new, cycle + p.timeout_cycles, s.halt_cycle)
    if s.ignores_commands is not None:
        halt_cycle = xp.where(s.ignores_commands, xp.minimum(halt_cycle, cycle), halt_cycle)
    return s._replace(
        speeds_at_0_deg=x * p.wheel_per_forward + y * p.wheel_per_sideways,
        speeds_at_90_deg=y * p.wheel_per_forward - x * p.wheel_per_sideways,
        turn_rate=turn_rate * (1 + p.turn_rate_gain),
        halt_cycle=halt_cycle,
        in_body_frame=command.in_body_frame,
        wheel_speeds=command.wheel_speeds,
    )


def set_encoder_scale(s: FirmwareState, scale: Array, angle: Array) -> FirmwareState:
    """Change the encoders' scale, with an offset that keeps the shown angles continuous.

    Args:
        s: State.
        scale: Shown over true angle from now on, (W, n).
        angle: True angles of the wheels now, (W, n) rad.
    """
    offset = s.encoder_offset + (s.encoder_scale - scale) * angle
    return s._replace(encoder_scale=scale, encoder_offset=offset)


def switch_processors(
    p: FirmwareParameters,
    s: FirmwareState,
    cycle: Array,
    inputs: FrameInputs,
    angle: Array,
) -> FirmwareState:
    """Switch processors off or on, and let some robots ignore commands.

    A processor that restarts has lost its memory. Its robot halts until vision sends a heading.

    Args:
        p: Parameters.
        s: State.
        cycle: Number of cycles before this one.
        inputs: Inputs of the frame. The loops of robots whose processors are off do not run, and
            their duties are zero.
        angle: Angles of the wheels, (W, n) rad.
    """
    is_off = inputs.processor_is_off
    xp = namespace(is_off)
    restarts = s.is_off & ~is_off
    lacks_heading = (s.lacks_heading | restarts) & ~is_off
    ignores_commands = inputs.ignores_commands | is_off | lacks_heading

    def clear_memory(memory: Array) -> Array:
        return None if memory is None else xp.where(restarts, 0.0, memory)

    return s._replace(
        error_integral=clear_memory(s.error_integral),
        speed_error=clear_memory(s.speed_error),
        gyro_bias=clear_memory(s.gyro_bias),
        encoder_count=xp.where(restarts, count_encoders(p, s, angle), s.encoder_count),
        duty=xp.where(is_off, 0.0, s.duty),
        halt_cycle=xp.where(ignores_commands, xp.minimum(s.halt_cycle, cycle), s.halt_cycle),
        is_off=is_off,
        lacks_heading=lacks_heading,
        ignores_commands=ignores_commands,
    )


def set_heading(s: FirmwareState, mask: Array, heading: Array) -> FirmwareState:
    """Set the heading estimate of the masked robots (n,), rad, and clear their heading memory."""
    xp = namespace(s.heading)
    return s._replace(
        heading=xp.where(mask, heading, s.heading),
        cosine=xp.where(mask, xp.cos(heading), s.cosine),
        sine=xp.where(mask, xp.sin(heading), s.sine),
        past_headings=xp.where(mask, heading, s.past_headings),
        gyro_bias=xp.where(mask, 0.0, s.gyro_bias),
    )


def correct_heading(
    p: FirmwareParameters, s: FirmwareState, frame: Array, inputs: FrameInputs
) -> FirmwareState:
    """Correct heading and gyro bias by vision (complementary filter), at the beginning of a frame.

    Vision's heading arrives with a command and is as old as the command. It is compared with the
    robot's estimate at the time when the command was sent.

    Args:
        p: Parameters.
        s: State.
        frame: Number of frames before this one.
        inputs: Inputs of the frame.
    """
    vision_heading = inputs.vision_heading
    xp = namespace(vision_heading)
    n_frames = len(s.past_headings)
    if s.lacks_heading is not None:
        initializes = s.lacks_heading & ~xp.isnan(vision_heading)
        s = set_heading(s, initializes, vision_heading)
        s = s._replace(
            lacks_heading=s.lacks_heading & ~initializes,
            ignores_commands=xp.where(initializes, inputs.ignores_commands, s.ignores_commands),
        )
        vision_heading = xp.where(initializes | s.is_off, np.nan, vision_heading)
    is_current_frame = xp.arange(n_frames)[:, None] == frame % n_frames
    past_headings = xp.where(is_current_frame, s.heading, s.past_headings)
    sent_frame = (frame - inputs.heading_age) % n_frames
    heading_then = past_headings[sent_frame, xp.arange(len(vision_heading))]
    error = xp.where(xp.isnan(vision_heading), heading_then, vision_heading) - heading_then
    error = error - 2 * np.pi * xp.ceil(error / (2 * np.pi) - 0.5)
    correction = p.heading_gain * error
    heading = s.heading + correction
    return s._replace(
        heading=heading,
        cosine=xp.cos(heading),
        sine=xp.sin(heading),
        # Corrected as well, so that the same error is not corrected again by later headings
        past_headings=past_headings + correction,
        gyro_bias=s.gyro_bias - p.gyro_bias_gain * error,
    )


def derate_motors(p: FirmwareParameters, s: FirmwareState, winding: Array) -> FirmwareState:
    """Limit |V - K w| <= R I_max near the temperature limit of the windings (W, n), deg C."""
    if p.winding_limit is None:
        return s
    xp = namespace(winding)
    fraction = clip((p.winding_limit - winding) / DERATING_BAND_K, 0.0, 1.0)
    margin = p.nominal_resistance * (fraction * p.derating_current)
    return s._replace(voltage_margin=xp.where(fraction < 1, margin, np.inf))


def count_encoders(p: FirmwareParameters, s: FirmwareState, angle: Array) -> Array:
    """Return the counts (W, n) of encoders on wheels at true angles (W, n) in rad."""
    if s.encoder_scale is not None:
        angle = s.encoder_scale * angle + s.encoder_offset
    return straight_through_floor(angle * p.counts_per_rad)


def run_wheel_loops(
    p: FirmwareParameters, s: FirmwareState, cycle: Array, gyro: Array, angle: Array
) -> FirmwareState:
    """Run the control loops that are due in this cycle: gyro integration, wheel PID, duties.

    Args:
        p: Parameters.
        s: State.
        cycle: Number of cycles before this one.
        gyro: Turn rate that the gyro shows, (n,) rad/s.
        angle: Angles of the wheels, (W, n) rad.
    """
    is_due: Any = None
    if p.cycles_per_run is not None:
        is_due = cycle % p.cycles_per_run == 0
    if s.is_off is not None:
        is_due = ~s.is_off if is_due is None else is_due & ~s.is_off
    if is_due is not None and not any_true(is_due):
        return s
    new = _run_loops(p, s, cycle, gyro, angle)
    return new if is_due is None else select(is_due, new, s)


def _run_loops(
    p: FirmwareParameters, s: FirmwareState, cycle: Array, gyro: Array, angle: Array
) -> FirmwareState:
    """Run the control loops of all robots; see `run_wheel_loops`.

    PID with feedforward: V = K_ff w_d + kp e + kd de/dt + ki int e dt with e = w_d - w. The
    integral is frozen while the voltage is saturated in the error's direction (anti-windup).
    """
    xp = namespace(gyro)
    turn_rate = gyro - s.gyro_bias
    turn = turn_rate * p.period
    cosine, sine = rotate((s.cosine, s.sine), *cos_sin_small(turn))
    is_halted = cycle >= s.halt_cycle
    desired_speed = _compute_desired_speeds(p, s, (cosine, sine), turn_rate, is_halted)
    count = count_encoders(p, s, angle)
    speed = (count - s.encoder_count) / (p.counts_per_rad * p.period)
    error = desired_speed - speed
    voltage = p.feedforward * desired_speed + p.kp * error
    integral = s.error_integral
    if integral is not None:
        integral = s.error_integral + error * p.period
        voltage = voltage + p.kd * (error - s.speed_error) / p.period
        voltage = voltage + p.ki * integral
        winds_up = (abs(voltage) > p.nominal_voltage) & (voltage * error > 0)
        integral = xp.where(winds_up, s.error_integral, integral)
    if s.voltage_margin is not None:
        back_emf = p.nominal_back_emf_constant * speed
        voltage = clip(voltage, back_emf - s.voltage_margin, back_emf + s.voltage_margin)
    return s._replace(
        heading=s.heading + turn,
        cosine=cosine,
        sine=sine,
        encoder_count=count,
        error_integral=integral,
        speed_error=None if integral is None else error,
        duty=clip(voltage / p.nominal_voltage, -1.0, 1.0),
    )


def _compute_desired_speeds(
    p: FirmwareParameters,
    s: FirmwareState,
    cos_sin: tuple[Array, Array],
    turn_rate: Array,
    is_halted: Array,
) -> Array:
    """Return desired wheel speeds: equation 2, the turn-rate loop, and the inverse of equation 3.

    Args:
        p: Parameters.
        s: State.
        cos_sin: Cosine and sine of the heading, (n,) each.
        turn_rate: Measured turn rate without bias, (n,) rad/s.
        is_halted: Robots whose wheels are held at rest, (n,).

    Returns:
        Wheel speeds, (W, n) rad/s.
    """
    xp = namespace(turn_rate)
    cosine, sine = cos_sin
    if s.in_body_frame is not None:
        cosine = xp.where(s.in_body_frame, 1.0, cosine)
        sine = xp.where(s.in_body_frame, 0.0, sine)
    desired_turn_rate = s.turn_rate
    if any_true(is_halted):
        cosine = xp.where(is_halted, 0.0, cosine)
        sine = xp.where(is_halted, 0.0, sine)
        desired_turn_rate = xp.where(is_halted, 0.0, desired_turn_rate)
    turn_control = desired_turn_rate - p.turn_rate_gain * turn_rate
    speeds = (
        cosine * s.speeds_at_0_deg + sine * s.speeds_at_90_deg + turn_control * p.wheel_per_turn
    )
    if s.wheel_speeds is None:
        return speeds
    return xp.where(xp.isnan(s.wheel_speeds) | is_halted, speeds, s.wheel_speeds)
