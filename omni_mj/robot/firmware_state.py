"""Parameters, commands, inputs and state of the firmware; see `omni_mj.robot.firmware`."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Kinematics
from omni_mj.config import CYCLE_RATE_HZ, PERIOD_S
from omni_mj.config.settings import Settings, gather
from omni_mj.robot.array_ops import Array

CYCLE_S = 1 / CYCLE_RATE_HZ  # duration of a cycle, s
# Current limit at the beginning of derating, relative to the nominal current. The limit then falls
# linearly to zero at the temperature limit of the winding.
DERATING_CURRENT_RATIO = 2.0


class FirmwareParameters(NamedTuple):
    """Gains and nominal values of the firmware, (n,) unless another shape is given."""

    # Cycles from one run of the loops to the next; None if all robots run them in every cycle
    cycles_per_run: Array
    period: Array  # time from one run of the loops to the next, s
    timeout_cycles: Array  # cycles without a new command after which the robot halts; inf for never
    heading_gain: Array  # fraction of the heading error, by vision, that a frame corrects, 1
    # Correction of the gyro's bias in a frame, per heading error, 1/s
    gyro_bias_gain: Array
    turn_rate_gain: Array  # gain of the turn-rate loop, 1
    counts_per_rad: Array  # encoder counts per radian of the wheel, 1/rad
    kp: Array  # proportional gain of the wheel loop, V s/rad
    # Integral gain of the wheel loop, V/rad; None if no robot has an integral or derivative term
    ki: Array
    kd: Array  # derivative gain of the wheel loop, V s^2/rad; None as ki
    feedforward: Array  # voltage per desired wheel speed, V s/rad
    nominal_back_emf_constant: Array  # back-EMF per wheel speed, by the datasheet, V s/rad
    nominal_resistance: Array  # terminal resistance by the datasheet, ohm
    nominal_voltage: Array  # nominal voltage of the battery, V
    # Winding temperature at which derating leaves no current, deg C; None if no robot derates
    winding_limit: Array
    derating_current: Array  # current limit at the beginning of derating, A
    wheel_per_forward: Array  # wheel speed per forward velocity, (W, n) rad/m
    wheel_per_sideways: Array  # wheel speed per sideways velocity, (W, n) rad/m
    wheel_per_turn: Array  # wheel speed per turn rate, (W, n) 1


class FirmwareCommand(NamedTuple):
    """Commands that the radio delivers, (n,) unless another shape is given."""

    velocity: Array  # twist: velocity along x and y, turn rate, (3, n) m/s, m/s, rad/s
    is_new: Array  # whether the command arrived in this frame
    # Whether the velocity is in the body frame; None if all velocities are in the world frame
    in_body_frame: Array = None
    # Wheel speeds that replace the velocity, (W, n) rad/s; NaN for robots that get a velocity, None
    # if all robots do
    wheel_speeds: Array = None


class FrameInputs(NamedTuple):
    """Inputs of a frame other than the command, (n,) unless another shape is given."""

    # Heading measured by vision that arrived since the previous frame, rad; NaN if none arrived
    vision_heading: Array
    heading_age: Array  # frames since that heading was sent
    gyro_error: Array  # noise and bias of the gyro, rad/s
    push_force: Array  # disturbance force on the chassis, world frame, (2, n) N
    battery_voltage_factor: Array  # fraction of the battery's voltage that its contacts pass
    gyro_scale: Array = None  # ratio of measured to true turn rate; None if no robot has faults
    encoder_scale: Array = None  # ratio of measured to true angle, (W, n); None as gyro_scale
    # Current that drivers hold in place of the firmware's duty cycle, (W, n) A; NaN where the
    # firmware drives, None if it drives all motors
    current_setpoint: Array = None
    ignores_commands: Array = None  # whether the robot ignores commands; None as gyro_scale
    processor_is_off: Array = None  # whether the processor is off; None as gyro_scale
    # Whether the robot has failed, so that its drivers short the motors; None if no robot has
    has_failed: Array = None


class FirmwareState(NamedTuple):
    """Memory of the firmware, (n,) unless another shape is given."""

    heading: Array  # estimated heading, unwrapped, rad
    cosine: Array  # cosine of the estimated heading
    sine: Array  # sine of the estimated heading
    gyro_bias: Array  # estimated bias of the gyro, rad/s
    # Ring buffer of the estimated headings at the beginning of frames, (frames, n) rad
    past_headings: Array
    halt_cycle: Array  # cycle from which the robot halts unless a new command arrives
    speeds_at_0_deg: Array  # wheel speeds for the commanded velocity at heading 0, (W, n) rad/s
    speeds_at_90_deg: Array  # the same at heading 90 degrees, (W, n) rad/s
    turn_rate: Array  # commanded turn rate times 1 + turn_rate_gain, rad/s
    encoder_count: Array  # encoder counts at the last run of the loops, (W, n)
    duty: Array  # duty cycles of the drivers, (W, n) in [-1, 1]
    # Whether the commanded velocity is in the body frame; None if all are in the world frame
    in_body_frame: Array = None
    wheel_speeds: Array = None  # commanded wheel speeds, (W, n) rad/s, NaN or None for a velocity
    # Largest difference of a motor's voltage from its back-EMF, (W, n) V; None without derating
    voltage_margin: Array = None
    error_integral: Array = None  # integral of the wheel speed error, (W, n) rad; None as `ki`
    speed_error: Array = None  # wheel speed error at the last run, (W, n) rad/s; None as `ki`
    # Ratio of measured to true angle of the wheels, (W, n); None if no robot has faults
    encoder_scale: Array = None
    # Measured angle of a wheel at the true angle 0, (W, n) rad; None as encoder_scale
    encoder_offset: Array = None
    is_off: Array = None  # whether the processor is off; None as encoder_scale
    # Whether the processor has restarted and waits for a heading from vision; None as encoder_scale
    lacks_heading: Array = None
    ignores_commands: Array = None  # whether the robot ignores commands; None as encoder_scale


def make_undisturbed_inputs(n: int) -> FrameInputs:
    """Return the inputs of a frame for n robots without vision, push forces and sensor errors."""
    zeros = np.zeros(n)
    return FrameInputs(np.full(n, np.nan), np.zeros(n, int), zeros, np.zeros((2, n)), np.ones(n))


def make_firmware_parameters(
    settings: Sequence[Settings], kinematics: Kinematics
) -> FirmwareParameters:
    """Return the parameters of n robots with one wheel geometry."""

    def values(name: str) -> Array:
        return gather(settings, f"firmware.{name}")

    cycles = np.maximum(1.0, np.rint(1 / (values("rate_hz") * CYCLE_S)))
    timeout = values("timeout_s")
    back_emf_constant = gather(settings, "motor.wheel_back_emf_v_s")
    has_integral = bool(values("ki").any() or values("kd").any())
    derates = values("thermal_derating").astype(bool)
    winding_limit = np.where(derates, gather(settings, "motor.max_winding_c"), np.inf)
    wheel_per_twist = (kinematics.matrix.T / kinematics.radius)[..., None] * np.ones(len(settings))
    encoder_counts = gather(settings, "sensors.encoder_counts")
    return FirmwareParameters(
        cycles_per_run=cycles if (cycles > 1).any() else None,
        period=cycles * CYCLE_S,
        timeout_cycles=np.where(timeout > 0, np.rint(timeout / CYCLE_S), np.inf),
        heading_gain=values("heading_gain") * PERIOD_S,
        gyro_bias_gain=values("gyro_bias_gain") * PERIOD_S,
        turn_rate_gain=values("turn_rate_gain"),
        counts_per_rad=encoder_counts * gather(settings, "motor.gear_ratio") / (2 * np.pi),
        kp=values("kp"),
        ki=values("ki") if has_integral else None,
        kd=values("kd") if has_integral else None,
        feedforward=values("feedforward") * back_emf_constant,
        nominal_back_emf_constant=back_emf_constant,
        nominal_resistance=gather(settings, "motor.resistance_ohm"),
        nominal_voltage=values("nominal_voltage_v"),
        winding_limit=winding_limit if derates.any() else None,
        derating_current=DERATING_CURRENT_RATIO * gather(settings, "motor.nominal_current_a"),
        wheel_per_forward=wheel_per_twist[0],
        wheel_per_sideways=wheel_per_twist[1],
        wheel_per_turn=wheel_per_twist[2],
    )


def extend_memory(s: FirmwareState, fresh: FirmwareState, frame: int) -> FirmwareState:
    """Return the state with the memory that other parameters or faults need.

    Args:
        s: State.
        fresh: Initial state for these parameters and faults.
        frame: Number of frames so far.
    """
    added = {name: value for name, value in fresh._asdict().items() if getattr(s, name) is None}
    added["voltage_margin"] = fresh.voltage_margin  # no memory: computed in every frame
    n_frames, n_old = len(fresh.past_headings), len(s.past_headings)
    if n_frames > n_old:
        frames = frame - 1 - np.arange(n_old)
        added["past_headings"] = np.array(fresh.past_headings)
        added["past_headings"][frames % n_frames] = s.past_headings[frames % n_old]
    return s._replace(**added)


def make_firmware_state(
    p: FirmwareParameters, heading: Array, n_frames: int, has_faults: bool
) -> FirmwareState:
    """Return the state of robots that are switched on, with wheels at the angle zero.

    Args:
        p: Parameters.
        heading: Heading at the start, (n,) rad.
        n_frames: Length of the ring buffer of headings.
        has_faults: Whether processors and encoders may fail in this run.
    """
    wheel_zeros = np.zeros_like(p.wheel_per_forward)
    zeros = np.zeros_like(heading)
    fault_memory: dict[str, Array] = {}
    if has_faults:
        names = "is_off", "lacks_heading", "ignores_commands"
        fault_memory = dict.fromkeys(names, np.zeros(len(heading), bool))
        fault_memory["encoder_scale"] = np.ones_like(wheel_zeros)
        fault_memory["encoder_offset"] = wheel_zeros
    return FirmwareState(
        heading=heading.copy(),
        cosine=np.cos(heading),
        sine=np.sin(heading),
        gyro_bias=zeros,
        past_headings=np.tile(heading, (n_frames, 1)),
        halt_cycle=p.timeout_cycles,
        speeds_at_0_deg=wheel_zeros,
        speeds_at_90_deg=wheel_zeros,
        turn_rate=zeros,
        voltage_margin=None if p.winding_limit is None else np.full_like(wheel_zeros, np.inf),
        encoder_count=wheel_zeros,
        error_integral=None if p.ki is None else wheel_zeros,
        speed_error=None if p.ki is None else wheel_zeros,
        duty=wheel_zeros,
        **fault_memory,
    )
