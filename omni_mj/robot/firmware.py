"""Firmware: from a received velocity to the duties of the motors.

The firmware turns velocities into its own frame by the heading it estimates, adds a turn-rate loop on the gyro, and
runs a PID loop for each wheel. The loops compute in volts of a nominal battery and command duties, so a low battery
weakens them. They know the motors' data sheet, from which they feed the back-EMF forward. Slow loops
(`firmware.rate_hz`) read sensors in every k-th cycle only, and hold their duties in between.

Commands are velocities in the world frame, velocities in the robot's frame, or speeds of the rims. A robot that
receives nothing new for `firmware.timeout_s` stands: its wheels are held at rest.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from omni_control.kinematics import Kinematics
from omni_mj.config.settings import CYCLE_RATE_HZ, PERIOD_S, Settings, gather
from omni_mj.robot.array_namespace import (
    Array,
    any_true,
    clip,
    floor,
    namespace,
    rotate,
    select,
    small_rotation,
)
from omni_mj.robot.motors import Motor

CYCLE_S = 1 / CYCLE_RATE_HZ
CYCLES = round(PERIOD_S * CYCLE_RATE_HZ)  # in a camera frame
# Current at which derating begins, over the nominal current; at the limit no current is allowed
DERATED_SHARE = 2.0
DERATE_BAND_K = 10.0  # derating begins this far below the limit


class LoopParameters(NamedTuple):
    """Gains and knowledge of the firmware, (n,) unless another shape is given."""

    cycles_per_run: Array  # from one run of the loops to the next; None if all run in every cycle
    period: Array  # between runs, s
    patience: Array  # cycles without a new command after which the robot stands
    heading_gain: Array  # share of the difference to vision's heading that is corrected in a frame
    bias_gain: Array  # correction of the gyro's bias for that difference, 1/s
    turn_gain: Array  # of the turn-rate loop
    counts_per_rad: Array  # of the encoders, at the wheel
    kp: Array  # V s/rad
    ki: Array  # V/rad; None if no robot has an integral or derivative part
    kd: Array  # V s^2/rad; None as ki
    feed_forward: Array  # back-EMF that is fed forward, V s/rad
    sheet_back_emf: Array  # back-EMF by the data sheet, V s/rad
    sheet_resistance: Array  # ohm
    nominal_voltage: Array  # V
    # Winding temperature at which derating leaves no current, deg C; None if no robot derates
    limit_c: Array
    derated_current: Array  # at which derating begins, A
    forward: Array  # wheel speed per velocity ahead, (W, n) rad/m
    sideways: Array  # wheel speed per velocity to the left, (W, n) rad/m
    turn: Array  # wheel speed per turn rate, (W, n)


class Command(NamedTuple):
    """Commands that the radio delivers, (n,) unless another shape is given."""

    velocity_x: Array  # m/s
    velocity_y: Array  # m/s
    turn_rate: Array  # rad/s
    is_new: Array  # whether it arrived in this frame
    # Whether the velocity is in the robot's frame; None if all are in the world frame
    in_robot_frame: Array = None
    # In place of the velocity, (W, n) rad/s; NaN where there is none, None if nowhere
    wheel_speeds: Array = None


class LoopState(NamedTuple):
    """Memory of the firmware, (n,) unless another shape is given."""

    heading: Array  # estimate, rad
    cosine: Array  # of the heading
    sine: Array
    gyro_bias: Array  # estimate, rad/s
    past_headings: Array  # ring buffer of the estimates at the beginning of frames, (frames, n) rad
    stops: Array  # cycle from which the robot stands
    speed_0: Array  # wheel speeds for the commanded velocity at heading 0, (W, n) rad/s
    speed_90: Array  # the same at heading 90 degrees
    turn_rate: Array  # commanded turn rate times 1 + turn_gain, rad/s
    last_count: Array  # of the encoders, (W, n)
    duty: Array  # of the drivers, (W, n) in [-1, 1]
    in_robot_frame: Array = None  # see `Command`
    wheel_speeds: Array = None  # see `Command`
    # How far a motor's voltage may be from its back-EMF, (W, n) V; None without derating
    swing: Array = None
    integral: Array = None  # (W, n) rad; None without integral part
    last_error: Array = None  # (W, n) rad/s; None as integral
    # Angle that encoders show over the wheel's angle, (W, n); None if no robot has faults
    encoder_scale: Array = None
    encoder_shift: Array = None  # angle that they show besides, (W, n) rad
    is_off: Array = None  # whether the processor is off; None as encoder_scale
    # Whether it started again and does not know its heading yet; None as is_off
    is_lost: Array = None
    ignores: Array = None  # whether it ignores commands; None as is_off


def loop_parameters(settings: Sequence[Settings], kinematics: Kinematics) -> LoopParameters:
    """Return the parameters of n robots with one geometry of wheels."""
    motors = [Motor.of(s.motor) for s in settings]

    def values(name: str) -> Array:
        return gather(settings, f"firmware.{name}")

    cycles = np.maximum(1.0, np.rint(1 / (values("rate_hz") * CYCLE_S)))
    timeout = values("timeout_s")
    back_emf, gear = gather(motors, "speed_constant"), gather(motors, "gear")
    integrates = bool(values("ki").any() or values("kd").any())
    derates = values("derate").astype(bool)
    limit = np.where(derates, gather(settings, "motor.limit_c"), np.inf)
    per_wheel = (kinematics.matrix.T / kinematics.radius)[..., None] * np.ones(len(settings))
    return LoopParameters(
        cycles_per_run=cycles if (cycles > 1).any() else None,
        period=cycles * CYCLE_S,
        patience=np.where(timeout > 0, np.rint(timeout / CYCLE_S), np.inf),
        heading_gain=values("heading_gain") * PERIOD_S,
        bias_gain=values("bias_gain") * PERIOD_S,
        turn_gain=values("turn_gain"),
        counts_per_rad=gather(settings, "sensors.encoder_counts") * gear / (2 * np.pi),
        kp=values("kp"),
        ki=values("ki") if integrates else None,
        kd=values("kd") if integrates else None,
        feed_forward=values("feed_forward") * back_emf,
        sheet_back_emf=back_emf,
        sheet_resistance=gather(motors, "resistance"),
        nominal_voltage=values("nominal_voltage_v"),
        limit_c=limit if derates.any() else None,
        derated_current=DERATED_SHARE * gather(settings, "motor.nominal_current_a"),
        forward=per_wheel[0],
        sideways=per_wheel[1],
        turn=per_wheel[2],
    )


def loops_at_rest(p: LoopParameters, heading: Array, frames: int, fails: bool) -> LoopState:
    """Return the state of robots that are switched on, with wheels at the angle zero.

    Args:
        p: Parameters.
        heading: At the start, (n,) rad.
        frames: For which estimates of the heading are remembered.
        fails: Whether processors and encoders may fail in this run.
    """
    zero, still = np.zeros_like(p.forward), np.zeros_like(heading)
    no = np.zeros(len(heading), bool)
    return LoopState(
        heading=heading.copy(),
        cosine=np.cos(heading),
        sine=np.sin(heading),
        gyro_bias=still,
        past_headings=np.tile(heading, (frames, 1)),
        stops=p.patience,
        speed_0=zero,
        speed_90=zero,
        turn_rate=still,
        swing=None if p.limit_c is None else np.full_like(zero, np.inf),
        last_count=zero,
        integral=None if p.ki is None else zero,
        last_error=None if p.ki is None else zero,
        duty=zero,
        encoder_scale=np.ones_like(zero) if fails else None,
        encoder_shift=zero if fails else None,
        is_off=no if fails else None,
        is_lost=no if fails else None,
        ignores=no if fails else None,
    )


def accept_command(p: LoopParameters, s: LoopState, cycle: Array, command: Command) -> LoopState:
    """Take over a command from this cycle on."""
    xp = namespace(command.velocity_x)
    x, y = command.velocity_x, command.velocity_y
    stops = xp.where(command.is_new, cycle + p.patience, s.stops)
    if s.ignores is not None:
        stops = xp.where(s.ignores, xp.minimum(stops, cycle), stops)
    return s._replace(
        speed_0=x * p.forward + y * p.sideways,
        speed_90=y * p.forward - x * p.sideways,
        turn_rate=command.turn_rate * (1 + p.turn_gain),
        stops=stops,
        in_robot_frame=command.in_robot_frame,
        wheel_speeds=command.wheel_speeds,
    )


def mislead_encoders(s: LoopState, scale: Array, angle: Array) -> LoopState:
    """Let encoders show `scale` (W, n) times the turning of wheels that are now at an angle (W, n) in rad."""
    shift = s.encoder_shift + (s.encoder_scale - scale) * angle
    return s._replace(encoder_scale=scale, encoder_shift=shift)


def restart_processors(
    p: LoopParameters, s: LoopState, cycle: Array, is_deaf: Array, is_off: Array, angle: Array
) -> LoopState:
    """Switch processors off and on, and let some ignore commands.

    A processor that starts again has forgotten everything. Its robot stands until vision tells it a
    heading.

    Args:
        p: Parameters.
        s: State.
        cycle: Number of cycles before this one.
        is_deaf: Robots that ignore commands and stand, (n,).
        is_off: Robots whose loops do not run and whose duties are zero, (n,).
        angle: Of the wheels, (W, n) rad.
    """
    xp = namespace(is_off)
    starts = s.is_off & ~is_off
    is_lost = (s.is_lost | starts) & ~is_off
    ignores = is_deaf | is_off | is_lost

    def forget(memory: Array) -> Array:
        return None if memory is None else xp.where(starts, 0.0, memory)

    return s._replace(
        integral=forget(s.integral),
        last_error=forget(s.last_error),
        gyro_bias=forget(s.gyro_bias),
        last_count=xp.where(starts, encoder_count(p, s, angle), s.last_count),
        duty=xp.where(is_off, 0.0, s.duty),
        stops=xp.where(ignores, xp.minimum(s.stops, cycle), s.stops),
        is_off=is_off,
        is_lost=is_lost,
        ignores=ignores,
    )


def set_heading(s: LoopState, chosen: Array, heading: Array) -> LoopState:
    """Have chosen robots (n,) take a heading, (n,) rad, for theirs, and forget what was before."""
    xp = namespace(s.heading)
    return s._replace(
        heading=xp.where(chosen, heading, s.heading),
        cosine=xp.where(chosen, xp.cos(heading), s.cosine),
        sine=xp.where(chosen, xp.sin(heading), s.sine),
        past_headings=xp.where(chosen, heading, s.past_headings),
        gyro_bias=xp.where(chosen, 0.0, s.gyro_bias),
    )


def correct_heading(
    p: LoopParameters, s: LoopState, frame: Array, seen: Array, age: Array, is_deaf: Array
) -> LoopState:
    """Correct the estimate of the heading by vision's, at the beginning of a frame.

    Vision's heading arrives with a command, as late as that. It is compared with the robot's
    estimate at the time when the command was sent.

    Args:
        p: Parameters.
        s: State.
        frame: Number of frames before this one.
        seen: Vision's heading that arrived since the frame before, (n,) rad; NaN where none did.
        age: Frames since it was sent, (n,).
        is_deaf: See `restart_processors`.
    """
    xp, frames = namespace(seen), len(s.past_headings)
    if s.is_lost is not None:
        found = s.is_lost & ~xp.isnan(seen)
        s = set_heading(s, found, seen)
        s = s._replace(is_lost=s.is_lost & ~found, ignores=xp.where(found, is_deaf, s.ignores))
        seen = xp.where(found | s.is_off, np.nan, seen)
    now = xp.arange(frames)[:, None] == frame % frames
    past = xp.where(now, s.heading, s.past_headings)
    then = past[(frame - age) % frames, xp.arange(len(seen))]
    error = xp.where(xp.isnan(seen), then, seen) - then
    error = error - 2 * np.pi * xp.ceil(error / (2 * np.pi) - 0.5)
    correction = p.heading_gain * error
    heading = s.heading + correction
    return s._replace(
        heading=heading,
        cosine=xp.cos(heading),
        sine=xp.sin(heading),
        past_headings=past + correction,  # an error that is corrected once is not corrected again
        gyro_bias=s.gyro_bias - p.bias_gain * error,
    )


def derate(p: LoopParameters, s: LoopState, winding: Array) -> LoopState:
    """Limit the currents of motors whose windings (W, n), deg C, are close to their limit."""
    if p.limit_c is None:
        return s
    xp = namespace(winding)
    share = clip((p.limit_c - winding) / DERATE_BAND_K, 0.0, 1.0)
    return s._replace(
        swing=xp.where(share < 1, p.sheet_resistance * (share * p.derated_current), np.inf)
    )


def encoder_count(p: LoopParameters, s: LoopState, angle: Array) -> Array:
    """Return the counts (W, n) of encoders on wheels at an angle (W, n) in rad."""
    if s.encoder_scale is not None:
        angle = s.encoder_scale * angle + s.encoder_shift
    return floor(angle * p.counts_per_rad)


def run_wheel_loops(
    p: LoopParameters, s: LoopState, cycle: Array, gyro: Array, angle: Array
) -> LoopState:
    """Run the loops of those robots whose turn it is in this cycle; their duties are in the state.

    Args:
        p: Parameters.
        s: State.
        cycle: Number of cycles before this one.
        gyro: Turn rate, (n,) rad/s.
        angle: Of the wheels, (W, n) rad.
    """
    xp = namespace(gyro)
    due: Any = None
    if p.cycles_per_run is not None:
        due = cycle % p.cycles_per_run == 0
    if s.is_off is not None:
        due = ~s.is_off if due is None else due & ~s.is_off
    if due is not None and not any_true(due):
        return s
    rate = gyro - s.gyro_bias
    turn = rate * p.period
    heading, (cosine, sine) = s.heading + turn, rotate(s.cosine, s.sine, *small_rotation(turn))
    wanted = _desired_speeds(p, s, (cosine, sine), rate, cycle >= s.stops)
    count = encoder_count(p, s, angle)
    speed = (count - s.last_count) / (p.counts_per_rad * p.period)
    error = wanted - speed
    voltage = p.feed_forward * wanted + p.kp * error
    integral = s.integral
    if integral is not None:
        integral = s.integral + error * p.period
        voltage = voltage + p.kd * (error - s.last_error) / p.period
        voltage = voltage + p.ki * integral
        winds_up = (abs(voltage) > p.nominal_voltage) & (voltage * error > 0)
        integral = xp.where(winds_up, s.integral, integral)
    if s.swing is not None:
        back_emf = p.sheet_back_emf * speed
        voltage = clip(voltage, back_emf - s.swing, back_emf + s.swing)
    new = s._replace(
        heading=heading,
        cosine=cosine,
        sine=sine,
        last_count=count,
        integral=integral,
        last_error=None if integral is None else error,
        duty=clip(voltage / p.nominal_voltage, -1.0, 1.0),
    )
    if due is None:
        return new
    changed = ("heading", "cosine", "sine", "last_count", "integral", "last_error", "duty")
    after, before = (tuple(getattr(state, name) for name in changed) for state in (new, s))
    return s._replace(**dict(zip(changed, select(due, after, before), strict=True)))


def _desired_speeds(
    p: LoopParameters, s: LoopState, facing: tuple[Array, Array], rate: Array, stands: Array
) -> Array:
    """Return desired wheel speeds (W, n): equation 2, the turn-rate loop, and the inverse of equation 3."""
    xp = namespace(rate)
    cosine, sine = facing
    if s.in_robot_frame is not None:
        cosine, sine = (
            xp.where(s.in_robot_frame, 1.0, cosine),
            xp.where(s.in_robot_frame, 0.0, sine),
        )
    turn = s.turn_rate
    if any_true(stands):
        cosine, sine = xp.where(stands, 0.0, cosine), xp.where(stands, 0.0, sine)
        turn = xp.where(stands, 0.0, turn)
    speeds = cosine * s.speed_0 + sine * s.speed_90 + (turn - p.turn_gain * rate) * p.turn
    if s.wheel_speeds is None:
        return speeds
    return xp.where(xp.isnan(s.wheel_speeds) | stands, speeds, s.wheel_speeds)
