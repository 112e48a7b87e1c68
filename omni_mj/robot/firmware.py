"""Firmware: from a received command to the duty cycles of the motor drivers.

The firmware estimates the robot's heading, rotates the commanded velocity into the body frame
(equation 2 of the paper), and computes wheel speeds (inverse of equation 3). It adds a turn-rate
loop on the gyro, and runs a PID loop for each wheel. The PID loops feed the back-EMF forward,
computed with the torque constant of the motors' datasheet.

The PID loops compute voltages for a nominal battery and command the duty cycle voltage / nominal
voltage. A battery below the nominal voltage therefore lowers their gain. Loops slower than the
cycle (`firmware.rate_hz`) run in every k-th cycle, and hold the duty cycles in between.

Commands are velocities in the world frame, velocities in the body frame, or wheel speeds. A robot
that receives no new command for `firmware.timeout_s` halts: its wheels are held at rest.
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

# Derating begins this far below the temperature limit of the winding, K
DERATING_BAND_K = 10.0


def accept_command(
    p: FirmwareParameters, s: FirmwareState, cycle: Array, command: FirmwareCommand
) -> FirmwareState:
    """Store a command that applies from this cycle on, and restart the timeout.

    For the velocity (x, y) and the heading a, the body moves forward at x cos a + y sin a and
    sideways at y cos a - x sin a. Wheel speeds are linear in both, so they are
    cos a speeds_at_0_deg + sin a speeds_at_90_deg, and both terms are stored.

    Args:
        p: Parameters.
        s: State.
        cycle: Number of cycles before this one.
        command: Command; only new ones restart the timeout.
    """
    xp = namespace(command.velocity)
    x, y, turn_rate = command.velocity
    halt_cycle = xp.where(command.is_new, cycle + p.timeout_cycles, s.halt_cycle)
    if s.ignores_commands is not None:
        halt_cycle = xp.where(s.ignores_commands, xp.minimum(halt_cycle, cycle), halt_cycle)
    return s._replace(
        speeds_at_0_deg=x * p.wheel_per_forward + y * p.wheel_per_sideways,
        speeds_at_90_deg=y * p.wheel_per_forward - x * p.wheel_per_sideways,
        # The turn loop's output is (1 + gain) r - gain * measured turn rate, which is r if the
        # robot turns at the commanded rate r.
        turn_rate=turn_rate * (1 + p.turn_rate_gain),
        halt_cycle=halt_cycle,
        in_body_frame=command.in_body_frame,
        wheel_speeds=command.wheel_speeds,
    )


def set_encoder_scale(s: FirmwareState, scale: Array, angle: Array) -> FirmwareState:
    """Change the scale of the encoders, with an offset that keeps measured angles continuous.

    Args:
        s: State.
        scale: Ratio of measured to true angle from now on, (W, n).
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
    """Switch processors off or on, and halt robots that ignore commands.

    A processor that restarts has lost its memory. Its robot halts until a heading measured by
    vision arrives.

    Args:
        p: Parameters.
        s: State.
        cycle: Number of cycles before this one.
        inputs: Inputs of the frame. While a processor is off, its loops do not run and its duty
            cycles are zero.
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
        encoder_count=xp.where(restarts, compute_encoder_counts(p, s, angle), s.encoder_count),
        duty=xp.where(is_off, 0.0, s.duty),
        halt_cycle=xp.where(ignores_commands, xp.minimum(s.halt_cycle, cycle), s.halt_cycle),
        is_off=is_off,
        lacks_heading=lacks_heading,
        ignores_commands=ignores_commands,
    )


def set_heading(s: FirmwareState, mask: Array, heading: Array) -> FirmwareState:
    """Restart the heading estimate of some robots, and reset their estimate of the gyro's bias.

    Args:
        s: State.
        mask: Robots to change, (n,).
        heading: New estimate, (n,) or () rad. It replaces past estimates as well.
    """
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

    A command carries vision's heading of the frame in which it is sent. The firmware compares it
    with its own estimate for that frame, and corrects its present estimate by a fraction of the
    difference. A robot that lacks a heading takes that of vision.

    Args:
        p: Parameters.
        s: State.
        frame: Number of frames before this one.
        inputs: Inputs of the frame.
    """
    vision_heading = inputs.vision_heading
    xp = namespace(vision_heading)
    memory_frames = len(s.past_headings)
    if s.lacks_heading is not None:
        initializes = s.lacks_heading & ~xp.isnan(vision_heading)
        s = set_heading(s, initializes, vision_heading)
        s = s._replace(
            lacks_heading=s.lacks_heading & ~initializes,
            ignores_commands=xp.where(initializes, inputs.ignores_commands, s.ignores_commands),
        )
        vision_heading = xp.where(s.is_off, np.nan, vision_heading)
    is_current_frame = xp.arange(memory_frames)[:, None] == frame % memory_frames
    past_headings = xp.where(is_current_frame, s.heading, s.past_headings)
    sent_frame = (frame - inputs.heading_age) % memory_frames
    past_heading = past_headings[sent_frame, xp.arange(len(vision_heading))]
    error = xp.where(xp.isnan(vision_heading), past_heading, vision_heading) - past_heading
    # Wrapped to (-pi, pi]
    error = error - 2 * np.pi * xp.ceil(error / (2 * np.pi) - 0.5)
    correction = p.heading_gain * error
    heading = s.heading + correction
    return s._replace(
        heading=heading,
        cosine=xp.cos(heading),
        sine=xp.sin(heading),
        # Corrected as well, so that later headings do not correct the same error again
        past_headings=past_headings + correction,
        gyro_bias=s.gyro_bias - p.gyro_bias_gain * error,
    )


def derate_motors(p: FirmwareParameters, s: FirmwareState, winding: Array) -> FirmwareState:
    """Limit motor currents near the temperature limit of the windings.

    The current I = (V - K w) / R is limited to I_max by |V - K w| <= R I_max, with the voltage V,
    the back-EMF K w and the resistance R of the datasheet. I_max falls linearly from the derating
    current at `DERATING_BAND_K` below the temperature limit to zero at the limit. Cooler windings
    have no limit.

    Args:
        p: Parameters.
        s: State.
        winding: Temperatures of the windings, (W, n) deg C.
    """
    if p.winding_limit is None:
        return s
    xp = namespace(winding)
    fraction = clip((p.winding_limit - winding) / DERATING_BAND_K, 0.0, 1.0)
    margin = p.nominal_resistance * (fraction * p.derating_current)
    return s._replace(voltage_margin=xp.where(fraction < 1, margin, np.inf))


def compute_encoder_counts(p: FirmwareParameters, s: FirmwareState, angle: Array) -> Array:
    """Return encoder counts (W, n) from the true angles of the wheels, (W, n) rad."""
    if s.encoder_scale is not None:
        angle = s.encoder_scale * angle + s.encoder_offset
    return straight_through_floor(angle * p.counts_per_rad)


def run_wheel_loops(
    p: FirmwareParameters, s: FirmwareState, cycle: Array, gyro: Array, angle: Array
) -> FirmwareState:
    """Run the loops that are due in this cycle: integrate the gyro, and compute duty cycles.

    Args:
        p: Parameters.
        s: State.
        cycle: Number of cycles before this one.
        gyro: Turn rate measured by the gyro, (n,) rad/s.
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
    """Run the loops of all robots once; arguments as for `run_wheel_loops`.

    PID with feedforward: V = K_ff w_d + kp e + kd de/dt + ki int e dt, with the voltage V, the
    desired wheel speed w_d, the measured wheel speed w, and the error e = w_d - w. The integral is
    frozen while the voltage is saturated in the direction of the error (anti-windup).
    """
    xp = namespace(gyro)
    turn_rate = gyro - s.gyro_bias
    turn_angle = turn_rate * p.period
    cosine, sine = rotate((s.cosine, s.sine), *cos_sin_small(turn_angle))
    is_halted = cycle >= s.halt_cycle
    desired_speed = _compute_desired_speeds(p, s, (cosine, sine), turn_rate, is_halted)
    count = compute_encoder_counts(p, s, angle)
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
        heading=s.heading + turn_angle,
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

    The turn-rate loop turns the wheels at r + gain (r - measured turn rate) for the commanded turn
    rate r.

    Args:
        p: Parameters.
        s: State.
        cos_sin: Cosine and sine of the estimated heading, (n,) each.
        turn_rate: Turn rate measured by the gyro, less the estimated bias, (n,) rad/s.
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
        # Cosine and sine of zero command no translation.
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
