"""Frames and cycles of robots on the plant `planar`: electronics, drag, and a body in the plane."""

from typing import NamedTuple

from omni_mj.config import CYCLES_PER_FRAME
from omni_mj.robot.array_ops import Array, any_true, namespace, rotate, scan, sum_wheels
from omni_mj.robot.electronics import (
    CycleRecord,
    ElectronicsParameters,
    ElectronicsState,
    begin_frame,
    end_frame,
    receive_command,
    run_cycle,
    stack_telemetry,
)
from omni_mj.robot.firmware_state import FirmwareCommand, FrameInputs
from omni_mj.robot.motors_and_drivers import compute_load_friction
from omni_mj.robot.planar_dynamics import (
    BodyParameters,
    BodyState,
    SlowForces,
    advance_body,
    compute_center_motion,
)
from omni_mj.robot.wheel_carpet_forces import DRAG_CYCLES, CarpetParameters, compute_drag


class PlanarParameters(NamedTuple):
    """Parameters of n robots on the plant `planar`."""

    electronics: ElectronicsParameters
    carpet: CarpetParameters
    body: BodyParameters


class PlanarState(NamedTuple):
    """State of n robots on the plant `planar`."""

    electronics: ElectronicsState
    body: BodyState


class FrameReport(NamedTuple):
    """Motion and telemetry at the end of a frame, (n,) unless another shape is given."""

    pose: Array  # pose of the center of the wheels, world frame, (3, n) m, m, rad
    twist: Array  # twist of the center of the wheels, world frame, (3, n) m/s, m/s, rad/s
    topples: Array  # whether the robot would topple
    # Quantities of `omni_mj.plants.telemetry.Telemetry` in that order, (10 W + 4, n)
    telemetry: Array


def advance_frame(
    p: PlanarParameters,
    s: PlanarState,
    command: FirmwareCommand,
    inputs: FrameInputs,
    later_commands: FirmwareCommand | None = None,
) -> tuple[PlanarState, FrameReport]:
    """Advance by a frame of 1/60 s, in 16 cycles of the wheel loops.

    Args:
        p: Parameters.
        s: State.
        command: Command that the robots receive at the beginning of the frame.
        inputs: Other inputs of the frame.
        later_commands: Velocities (cycles, 3, n) that apply in each cycle, and whether they arrived
            in it (cycles, n). Default: the command applies in the whole frame.
    """
    s = s._replace(electronics=receive_command(p.electronics, s.electronics, command))
    s = begin_planar_frame(p, s, inputs)

    def advance_one_cycle(s: PlanarState, slow: SlowForces) -> tuple[PlanarState, CycleRecord]:
        if later_commands is not None:
            s = s._replace(electronics=receive_later_command(p, s.electronics, later_commands))
        return advance_cycle(p, s, slow)

    def advance_drag_cycles(s: PlanarState) -> tuple[PlanarState, CycleRecord]:
        slow = compute_slow_forces(p.body, p.carpet, s.body, s.electronics.inputs)
        return scan(lambda s: advance_one_cycle(s, slow), s, DRAG_CYCLES, s.body.cosine)

    s, nested = scan(advance_drag_cycles, s, CYCLES_PER_FRAME // DRAG_CYCLES, s.body.cosine)
    record = CycleRecord(
        *(values.reshape((CYCLES_PER_FRAME, *values.shape[2:])) for values in nested)
    )
    s = PlanarState(end_frame(p.electronics, s.electronics, record), s.body)
    return s, make_report(p, s, record)


def begin_planar_frame(p: PlanarParameters, s: PlanarState, inputs: FrameInputs) -> PlanarState:
    """Apply what changes from frame to frame, and start the sums over the frame anew."""
    xp = namespace(s.body.x)
    electronics = begin_frame(p.electronics, s.electronics, inputs, s.body.encoder_angle)
    cosine, sine = xp.cos(s.body.heading), xp.sin(s.body.heading)
    body = s.body._replace(cosine=cosine, sine=sine, tilting_moment=s.body.tilting_moment * 0.0)
    return PlanarState(electronics, body)


def receive_later_command(
    p: PlanarParameters, s: ElectronicsState, commands: FirmwareCommand
) -> ElectronicsState:
    """Pass the commands of this cycle to the firmware; see `advance_frame`."""
    cycle = s.cycle % CYCLES_PER_FRAME
    command = FirmwareCommand(commands.velocity[cycle], commands.is_new[cycle])
    if not any_true(command.is_new):
        return s
    return receive_command(p.electronics, s, command)


def compute_slow_forces(
    p: BodyParameters, carpet: CarpetParameters, s: BodyState, inputs: FrameInputs
) -> SlowForces:
    """Compute drag, pushes, the force of a slope, and the forces of rollers on their wheels.

    Args:
        p: Parameters of the bodies.
        carpet: Parameters of the carpet.
        s: State of the bodies.
        inputs: Inputs of the frame, of which the push forces are used.
    """
    xp = namespace(s.x)
    slip_speed = s.hub_speed - s.rim_speed
    drag = compute_drag(carpet, compute_center_motion(p, s), s.load, s.encoder_angle, slip_speed)
    response = p.response
    abs_speed = abs(s.rim_speed)
    # Along the axle rollers are spun up and braked (`omni_mj.plants.planar_body_parameters`). In
    # the rolling direction the carpet resists them as they come down (`RollerResponse`).
    spun_up_fraction = 1 - xp.exp(-p.spin_up_speed / xp.maximum(abs_speed, 1.0))
    axle_force = -(p.roller_drag + p.spin_up * abs_speed * spun_up_fraction) * drag.axle_speed
    rolling_torque = (
        -response.rolling_loss * s.rim_speed / (1 + response.rolling_loss_fade * abs_speed)
    )
    roller_x, roller_y = rotate(
        (axle_force, rolling_torque / response.rolling_radius), *carpet.axle
    )
    forward, sideways = drag.force
    ground_x = forward + sum_wheels(roller_x)
    ground_y = sideways + sum_wheels(roller_y)
    push_x, push_y = rotate(inputs.push_force, s.cosine, -s.sine)
    slope_x, slope_y = rotate(p.slope_force, s.cosine, -s.sine)
    moment = drag.moment + p.center[0] * sideways - p.center[1] * forward
    moment = moment + sum_wheels(p.contact[0] * roller_y - p.contact[1] * roller_x)
    moment = moment + p.push_point[0] * push_y - p.push_point[1] * push_x
    tilting_x = p.mass_height * ground_x - p.push_point[2] * push_x
    tilting_y = p.mass_height * ground_y - p.push_point[2] * push_y
    return SlowForces(
        drag=drag,
        force=xp.stack([ground_x + push_x + slope_x, ground_y + push_y + slope_y, moment]),
        tilting_moment=xp.stack([tilting_x, tilting_y]),
        lift=response.lift * abs_speed * abs_speed / (1 + response.lift_fade * abs_speed),
        ripple=response.ripple + response.ripple_growth * abs_speed,
    )


def advance_cycle(
    p: PlanarParameters, s: PlanarState, slow: SlowForces
) -> tuple[PlanarState, CycleRecord]:
    """Advance by a cycle of 1/960 s.

    Args:
        p: Parameters.
        s: State.
        slow: Forces that are constant for `DRAG_CYCLES` cycles.
    """
    body = s.body
    electronics, record = run_cycle(
        p.electronics, s.electronics, body.gyro_rate, body.encoder_angle, body.hub_speed
    )
    motors = electronics.motors
    motor_torque = motors.back_emf_constant * record.current
    load_friction = compute_load_friction(p.electronics.motors, motors, record.current)
    body = advance_body(p.body, body, slow, motor_torque, load_friction)
    return PlanarState(electronics, body), record


def make_report(p: PlanarParameters, s: PlanarState, record: CycleRecord) -> FrameReport:
    """Return motion and telemetry at the end of a frame."""
    body = s.body
    xp = namespace(body.x)
    motion = compute_center_motion(p.body, body)
    velocity_x, velocity_y = rotate(motion.velocity, body.cosine, body.sine)
    slip = abs(body.hub_speed - body.rim_speed) * p.carpet.radius
    return FrameReport(
        pose=xp.stack([motion.x, motion.y, body.heading]),
        twist=xp.stack([velocity_x, velocity_y, motion.turn_rate]),
        topples=is_toppling(p.body, body),
        telemetry=stack_telemetry(s.electronics, record, body.hub_angle, body.hub_speed, slip),
    )


def is_toppling(p: BodyParameters, s: BodyState) -> Array:
    """Return whether the zero-moment point of a frame is outside the polygon of the contacts, (n,).

    About the zero-moment point, weight and horizontal forces have no tilting moment. For the weight
    W and the mean tilting moment m it is at -m / W. It is outside the edge e that starts at the
    contact c if it is on the right of it: e x (-m / W - c) < 0, or e x (m + c W) > 0.
    """
    # Moments are sums over the cycles of a frame.
    weight = sum_wheels(p.static_load) * CYCLES_PER_FRAME
    moment_x, moment_y = s.tilting_moment[:, None] + p.contact * weight
    edge_x, edge_y = p.edge
    return (edge_x * moment_y > edge_y * moment_x).any(0)
