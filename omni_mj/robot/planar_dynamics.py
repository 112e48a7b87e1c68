"""Equations of motion in the plane of a body on wheels that creep and slide.

See docs/explanation/planar-plant.md.

**A wheel.** The hub turns at w with its motor, whose inertia over a step h is 1 / G. The rim turns
at J v with the body's twist v, because contacts do not slide. Rubber lets hub and rim differ by the
slip S t, where t is the torque between them and S the compliance. In a step of backward Euler, with
e for the hub's speed without that torque,

    w = e - G t,    w - J v = S t        so        t = (e - J v) / (S + G),    |t| <= mu N R.

**The body.** With the mass matrix M of the body, the rims, and the rollers that turn along the
axles, and with the other forces F,

    M (v - v_before) / h = F + sum J t,        so

    (M / h + sum J J' / (S + G)) v = M v_before / h + F + sum J e / (S + G).

A wheel whose torque would exceed Coulomb's limit has that limit. Vectors are in the body frame.
In v_before the mass keeps its velocity in the world, so its direction turns in this frame. Rims and
rollers keep their speeds, so theirs does not.

**Normal forces.** Wheels share the robot's weight, and the moments of the forces on it, as equal
springs do. A wheel that turns carries more, and its normal force ripples as rollers pass. The robot
yields to the sum and the moments of both, so that wheels keep only the part that no motion of the
body takes away.
"""

from typing import NamedTuple

from omni_mj.robot.array_ops import (
    Array,
    any_true,
    clip,
    cos_sin_small,
    iterate_while,
    namespace,
    rotate,
    solve_symmetric,
    sum_wheels,
)
from omni_mj.robot.firmware_state import CYCLE_S
from omni_mj.robot.wheel_carpet_forces import ChassisMotion, Drag, compute_torque_limit

# A wheel that starts to slide may let others slide. More than two such passes are rare.
MAX_SLIDING_PASSES = 3
# Fraction of its speed that a sticking hub retains after a cycle. MuJoCo damps a sticking joint at
# 2 / time constant, with solreffriction="0.005 1" in models/ssl_robot.xml.
STICTION_RETENTION = 1 - 400.0 * CYCLE_S


class RollerResponse(NamedTuple):
    """Mean effect of rollers on wheels that turn at w, (W, n)."""

    rolling_radius: Array  # from the axle to the carpet, m
    standing_rollers: Array  # mean number of rollers on the carpet
    # 1 / q^2 with the distance q of a roller's axis from the carpet, 1/m^2: mean, and where rollers
    # come down
    inverse_square: Array
    inverse_square_down: Array
    # Torque of rolling resistance, rolling_loss w / (1 + rolling_loss_fade |w|), N m
    rolling_loss: Array
    rolling_loss_fade: Array
    # Normal force that turning adds to a wheel, lift w^2 / (1 + lift_fade |w|), N
    lift: Array
    lift_fade: Array
    # Ripple of the normal force as rollers pass, (ripple + ripple_growth |w|) times
    # `compute_ripple_wave`, N
    ripple: Array
    ripple_growth: Array


class BodyParameters(NamedTuple):
    """Bodies and wheels of n robots, (n,) unless another shape is given.

    Positions are in the body frame, from the center of mass.
    """

    contact: Array  # where wheels touch the carpet, (2, W, n) m
    edge: Array  # from there to the next wheel's contact counter-clockwise, (2, W, n) m
    jacobian: Array  # J: rim speed per twist of the body, (3, W, n) 1/m, 1/m, 1
    mass_rate: Array  # M / h: mass matrix over a cycle, (3, 3, n) kg/s, kg m/s and kg m^2/s
    # Part of M due to rims and rollers, columns of the two velocities, (3, 2, n) kg and kg m
    rolling_mass: Array
    hub_gain: Array  # G: speed that a hub gains per torque in a cycle, rad/s / (N m)
    hub_viscous_friction: Array  # N m s/rad
    hub_dry_friction: Array  # (W, n) N m
    contact_compliance: Array  # slip speed over torque of the contacts, (W, n) rad/s / (N m)
    # Force along the axle over speed, roller_drag + spin_up |w| (1 - exp(-spin_up_speed / |w|)),
    # (W, n) N s/m
    roller_drag: Array
    spin_up: Array
    # Wheel speed at which rollers take on most of the carpet's speed, (W, n) rad/s
    spin_up_speed: Array
    response: RollerResponse
    rollers_per_speed: Array  # rollers that pass in a cycle per rim speed, s/rad
    center: Array  # center of the wheels, (2, n) m
    push_point: Array  # where push forces act, (3, n) m
    mass_height: Array  # center of mass above the carpet, m
    static_load: Array  # normal force of each wheel at rest, (W, n) N
    # Normal forces of the wheels for a vertical force and two moments, (3, W, n) 1, 1/m, 1/m
    load_distribution: Array
    slope_force: Array  # gravity along the carpet, world frame, (2, n) N


class BodyState(NamedTuple):
    """Bodies and wheels of n robots, (n,) unless another shape is given."""

    x: Array  # center of mass, world frame, m
    y: Array
    heading: Array  # rad
    cosine: Array  # of the heading
    sine: Array
    twist: Array  # body frame, (3, n) m/s, m/s, rad/s
    gyro_rate: Array  # turn rate at the gyro, one cycle old, rad/s
    hub_angle: Array  # (W, n) rad
    encoder_angle: Array  # hub angle at the encoders, one cycle old, (W, n) rad
    hub_speed: Array  # (W, n) rad/s
    rim_speed: Array  # (W, n) rad/s
    torque: Array  # t: of the rubber between hub and rim, (W, n) N m
    load: Array  # normal force, (W, n) N
    passed_rollers: Array  # rollers of each wheel that have passed so far, (W, n)
    tilting_moment: Array  # about -y and x, summed over the cycles of a frame, (2, n) N m


class SlowForces(NamedTuple):
    """Forces computed every `DRAG_CYCLES` cycles; (n,) unless another shape is given."""

    drag: Drag
    force: Array  # F: all but the wheels' traction, and its moment, (3, n) N and N m
    tilting_moment: Array  # of drag and pushes, (2, n) N m
    lift: Array  # normal force that turning adds, (W, n) N
    ripple: Array  # amplitude of the normal force's ripple, (W, n) N


def compute_center_motion(p: BodyParameters, s: BodyState) -> ChassisMotion:
    """Return the motion of the center of the wheels, from that of the center of mass."""
    forward, sideways, turn_rate = s.twist
    world_x, world_y = rotate(p.center, s.cosine, s.sine)
    return ChassisMotion(
        x=s.x + world_x,
        y=s.y + world_y,
        cosine=s.cosine,
        sine=s.sine,
        velocity=(forward - turn_rate * p.center[1], sideways + turn_rate * p.center[0]),
        turn_rate=turn_rate,
    )


def advance_body(
    p: BodyParameters, s: BodyState, slow: SlowForces, motor_torque: Array
) -> BodyState:
    """Advance hubs, rubber and body by a cycle of backward Euler, then compute normal forces."""
    xp = namespace(s.x)
    torque_limit, load = compute_torque_limit(slow.drag.torque_per_load, s.load)
    compliance = slow.drag.slip_compliance / load + p.contact_compliance
    free_speed, hub_gain = compute_free_hub_speed(p, s, motor_torque, compliance)
    forward, sideways, turn_rate = s.twist
    rolling = p.rolling_mass
    # The twist is rotated into the new body frame at the end of a cycle. Rims and rollers keep
    # their speeds in this frame, so the second term cancels the rotation of their momentum.
    momentum = (
        (p.mass_rate * s.twist).sum(1)
        + turn_rate * (rolling[:, 1] * forward - rolling[:, 0] * sideways)
        + slow.force
    )
    twist, rim_speed, torque = solve_traction(
        p, momentum, free_speed, 1 / (compliance + hub_gain), torque_limit
    )
    hub_speed = free_speed - hub_gain * torque
    tilting = p.mass_height * sum_wheels(torque * p.jacobian[:2]) + slow.tilting_moment
    passed_rollers = s.passed_rollers + p.rollers_per_speed * rim_speed
    turn = CYCLE_S * twist[2]
    cos_turn, sin_turn = cos_sin_small(turn)
    world_x, world_y = rotate(twist[:2], s.cosine, s.sine)
    cosine, sine = rotate((s.cosine, s.sine), cos_turn, sin_turn)
    return BodyState(
        x=s.x + CYCLE_S * world_x,
        y=s.y + CYCLE_S * world_y,
        heading=s.heading + turn,
        cosine=cosine,
        sine=sine,
        twist=xp.stack([*rotate(twist[:2], cos_turn, -sin_turn), twist[2]]),
        gyro_rate=turn_rate,
        hub_angle=s.hub_angle + CYCLE_S * hub_speed,
        encoder_angle=s.hub_angle,
        hub_speed=hub_speed,
        rim_speed=rim_speed,
        torque=torque,
        load=compute_wheel_loads(
            p, slow.lift + slow.ripple * compute_ripple_wave(passed_rollers), tilting
        ),
        passed_rollers=passed_rollers,
        tilting_moment=s.tilting_moment + tilting,
    )


def compute_free_hub_speed(
    p: BodyParameters, s: BodyState, motor_torque: Array, compliance: Array
) -> tuple[Array, Array]:
    """Return e and G of the hubs: the speed without rubber, and speed per torque of the rubber.

    A hub sticks if dry friction can bring it to rest within the cycle; its G is then 0. A hub that
    slows down takes its rim along. Rubber then adds the torque that strains it to the torque of
    the cycle before.

    Args:
        p: Parameters.
        s: State.
        motor_torque: Torque of the motors at the wheel, (W, n) N m.
        compliance: S: slip speed over torque, (W, n) rad/s / (N m).
    """
    xp = namespace(motor_torque)
    drive_torque = motor_torque - p.hub_viscous_friction * s.hub_speed
    stopping_torque = (
        drive_torque
        - s.torque
        + (1 - STICTION_RETENTION) * s.hub_speed * (1 / p.hub_gain + 1 / compliance)
    )
    dry_friction = xp.copysign(p.hub_dry_friction, stopping_torque)
    free_speed = s.hub_speed + p.hub_gain * (drive_torque - dry_friction)
    hub_gain = p.hub_gain + compliance * 0.0  # one per wheel
    sticks = abs(stopping_torque) <= p.hub_dry_friction
    if not any_true(sticks):
        return free_speed, hub_gain
    sticking_speed = STICTION_RETENTION * s.hub_speed
    return xp.where(sticks, sticking_speed, free_speed), xp.where(sticks, 0.0, hub_gain)


def solve_traction(
    p: BodyParameters, momentum: Array, free_speed: Array, traction_gain: Array, limit: Array
) -> tuple[Array, Array, Array]:
    """Solve the equations of body and wheels, see the module, with Coulomb's limit.

    Where a torque exceeds friction it is set to the limit, and the equations are solved again.

    Args:
        p: Parameters.
        momentum: M v_before / h + F, (3, n).
        free_speed: e: speeds of the hubs without rubber, (W, n) rad/s.
        traction_gain: 1 / (S + G): torque per slip, (W, n) N m s/rad.
        limit: Largest torque, (W, n) N m.

    Returns:
        Twist (3, n), speeds of the rims, (W, n) rad/s, and torques of the rubber, (W, n) N m.
    """
    xp = namespace(traction_gain)
    jacobian = p.jacobian

    def solve(gain: Array, sliding_torque: Array) -> tuple[Array, Array, Array]:
        matrix = p.mass_rate + sum_wheels((gain * jacobian)[:, None] * jacobian)
        right_side = momentum + sum_wheels((gain * free_speed + sliding_torque) * jacobian)
        twist = solve_symmetric(matrix, right_side)
        rim_speed = jacobian[0] * twist[0] + jacobian[1] * twist[1] + jacobian[2] * twist[2]
        return twist, rim_speed, gain * (free_speed - rim_speed) + sliding_torque

    def exceeds_limit(state: tuple[Array, ...]) -> Array:
        gain, *_, torque = state
        return (abs(torque) > limit) & (gain > 0)

    def let_slide(state: tuple[Array, ...]) -> tuple[Array, ...]:
        gain, sliding_torque, _, _, torque = state
        slides = exceeds_limit(state)
        sliding_torque = xp.where(slides, xp.copysign(limit, torque), sliding_torque)
        gain = xp.where(slides, 0.0, gain)
        return gain, sliding_torque, *solve(gain, sliding_torque)

    sliding_torque = traction_gain * 0.0
    state = traction_gain, sliding_torque, *solve(traction_gain, sliding_torque)
    state = iterate_while(let_slide, state, exceeds_limit, MAX_SLIDING_PASSES)
    _, _, twist, rim_speed, torque = state
    return twist, rim_speed, clip(torque, -limit, limit)


def compute_wheel_loads(p: BodyParameters, added_load: Array, tilting: Array) -> Array:
    """Return the normal forces of wheels that share weight and moments as equal springs, (W, n) N.

    Args:
        p: Parameters.
        added_load: Lift and ripple of turning wheels, (W, n) N.
        tilting: Moments that tilt the robot about -y and x, (2, n) N m.
    """
    moment_x, moment_y = sum_wheels(p.contact * added_load) + tilting
    unit_force, unit_moment_x, unit_moment_y = p.load_distribution
    yielding = (
        unit_force * sum_wheels(added_load) + unit_moment_x * moment_x + unit_moment_y * moment_y
    )
    return namespace(tilting).maximum(p.static_load + added_load - yielding, 0.0)


def compute_ripple_wave(turns: Array) -> Array:
    """Return 1/16 with a roller at the bottom and -1/16 between two: parabolas for a cosine."""
    phase = 0.25 - abs(turns - namespace(turns).round(turns))
    return phase * (0.5 - abs(phase))
