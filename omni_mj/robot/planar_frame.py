"""A frame of the plant `planar`: firmware, motors and the body in the plane, as a pure function."""

from omni_mj.robot.array_ops import Array, namespace, rotate, scan, sum_wheels
from omni_mj.robot.carpet import DRAG_CYCLES
from omni_mj.robot.firmware_state import CYCLES, FirmwareCommand
from omni_mj.robot.onboard import (
    CycleRecord,
    FrameInputs,
    begin_frame,
    end_frame,
    receive_command,
    run_cycle,
    stack_telemetry,
)
from omni_mj.robot.planar_body import advance_body, compute_center_motion, compute_slow_forces
from omni_mj.robot.planar_state import (
    BodyParameters,
    BodyState,
    FrameReport,
    PlanarParameters,
    PlanarState,
    SlowForces,
)


def advance_frame(
    p: PlanarParameters, s: PlanarState, command: FirmwareCommand, inputs: FrameInputs
) -> tuple[PlanarState, FrameReport]:
    """Advance by a frame of 1/60 s, in 16 cycles of the wheel loops.

    Args:
        p: Parameters.
        s: State.
        command: Command that the robots receive at the beginning of the frame.
        inputs: Other inputs of the frame.
    """
    xp = namespace(s.body.x)
    onboard = receive_command(p.onboard, s.onboard, command)
    onboard = begin_frame(p.onboard, onboard, inputs, s.body.encoder_angle)
    cosine, sine = xp.cos(s.body.heading), xp.sin(s.body.heading)
    body = s.body._replace(cosine=cosine, sine=sine, tilting_moment=s.body.tilting_moment * 0.0)

    def advance_drag_cycles(s: PlanarState) -> tuple[PlanarState, CycleRecord]:
        slow = compute_slow_forces(p.body, p.carpet, s.body, s.onboard.inputs)
        return scan(lambda s: advance_cycle(p, s, slow), s, DRAG_CYCLES, cosine)

    s = PlanarState(onboard, body)
    s, nested = scan(advance_drag_cycles, s, CYCLES // DRAG_CYCLES, cosine)
    record = CycleRecord(*(values.reshape((CYCLES, *values.shape[2:])) for values in nested))
    s = PlanarState(end_frame(p.onboard, s.onboard, record), s.body)
    return s, make_report(p, s, record)


def advance_cycle(
    p: PlanarParameters, s: PlanarState, slow: SlowForces
) -> tuple[PlanarState, CycleRecord]:
    """Advance by a cycle of 1/960 s."""
    body = s.body
    onboard, record = run_cycle(
        p.onboard, s.onboard, body.gyro_rate, body.encoder_angle, body.hub_speed
    )
    motor_torque = onboard.motors.back_emf_constant * record.current
    return PlanarState(onboard, advance_body(p.body, body, slow, motor_torque)), record


def make_report(p: PlanarParameters, s: PlanarState, record: CycleRecord) -> FrameReport:
    """Return motion and telemetry at the end of a frame."""
    body = s.body
    xp = namespace(body.x)
    motion = compute_center_motion(p.body, body)
    velocity_x, velocity_y = rotate(
        motion.forward_velocity, motion.sideways_velocity, body.cosine, body.sine
    )
    slip = abs(body.hub_speed - body.rim_speed) * p.carpet.radius
    return FrameReport(
        pose=xp.stack([motion.x, motion.y, body.heading]),
        twist=xp.stack([velocity_x, velocity_y, motion.turn_rate]),
        topples=is_toppling(p.body, body),
        telemetry=stack_telemetry(s.onboard, record, body.hub_angle, body.hub_speed, slip),
    )


def is_toppling(p: BodyParameters, s: BodyState) -> Array:
    """Return whether the zero-moment point, averaged over a frame, is outside the wheels' polygon.

    The zero-moment point is the one where weight and horizontal forces have no tilting moment.
    """
    weight = sum_wheels(p.static_load) * CYCLES
    moment_x, moment_y = s.tilting_moment
    is_outside = p.edge_x * (moment_y + p.contact_y * weight) > p.edge_y * (
        moment_x + p.contact_x * weight
    )
    return is_outside.any(0)
