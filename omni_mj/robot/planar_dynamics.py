"""Equations of motion in the plane of a body on wheels that creep and slide.

See docs/explanation/planar-plant.md. The step h of backward Euler is a cycle, 1/960 s.

**A wheel.** The hub and its motor turn at the speed w. The rim turns at J' v, where v is the twist
of the body and the column vector J the Jacobian of the wheel, because contacts do not slide. Rubber
transmits the torque t from hub to rim, and lets their speeds differ by the slip S t with the
compliance S. Without t, the hub would reach the speed e in a step. With the inertia I of hub and
motor and G = h / I,

    w = e - G t,    w - J' v = S t,    therefore    t = (e - J' v) / (S + G),    |t| <= mu' N R,

with the normal force N, the wheel radius R, and the friction mu' that the bearings of rollers
leave (`omni_mj.robot.wheel_carpet_forces`).

**The body.** The mass matrix M is that of the body, the rims, and the rollers that turn as wheels
travel along their axles. F are all other forces. Sums are over wheels.

    M (v - v_before) / h = F + sum J t,    therefore

    (M / h + sum J J' / (S + G)) v = M v_before / h + F + sum J e / (S + G).

The torque of a sliding wheel is Coulomb's limit mu' N R, with the sign of t. Vectors are in the
body frame, which turns. The body keeps its velocity in the world frame, so v_before is rotated.
Rims and rollers keep their speeds in the body frame, so their terms are not rotated.

**Normal forces.** Wheels share the robot's weight, and the tilting moments of the forces on it, as
equal springs do. Turning raises the normal force of a wheel (lift), and it ripples as rollers pass.
The robot heaves and tilts until the sum and the moments of these additions vanish. Wheels retain
only the remainder.
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

# A wheel that starts to slide may cause others to slide, which takes another pass. More than two
# passes are rare.
MAX_SLIDING_PASSES = 3
# Fraction of its speed that a sticking hub retains after a cycle. MuJoCo damps a sticking joint at
# the rate 2 / time constant = 400 1/s, with solreffriction="0.005 1" in models/ssl_robot.xml.
STICTION_RETENTION = 1 - 400.0 * CYCLE_S


class RollerResponse(NamedTuple):
    """Mean effect of rollers on wheels that turn at w in rad/s, (W, n).

    Computed in `omni_mj.plants.planar_roller_forces`.
    """

    rolling_radius: Array  # effective radius of the wheel, from the axle to the carpet, m
    standing_rollers: Array  # mean number of rollers on the carpet
    # 1 / q^2 with the distance q of a roller's axis from the carpet, 1/m^2: mean over the contact
    inverse_square: Array
    inverse_square_down: Array  # the same where rollers come down, 1/m^2
    # Torque of rolling resistance in N m: rolling_loss w / (1 + rolling_loss_fade |w|)
    rolling_loss: Array  # N m s/rad
    rolling_loss_fade: Array  # s/rad
    # Normal force in N that turning adds to a wheel: lift w^2 / (1 + lift_fade |w|)
    lift: Array  # N s^2/rad^2
    lift_fade: Array  # s/rad
    # Ripple of the normal force in N as rollers pass:
    # (ripple + ripple_growth |w|) compute_ripple_wave(number of passed rollers)
    ripple: Array  # N
    ripple_growth: Array  # N s/rad


class BodyParameters(NamedTuple):
    """Bodies and wheels of n robots, (n,) unless another shape is given.

    Positions are in the body frame, from the center of mass.
    """

    contact: Array  # contact points of the wheels with the carpet, (2, W, n) m
    # Vectors from each contact point to the next one counter-clockwise, (2, W, n) m
    edge: Array
    jacobian: Array  # J: rim speed per twist of the body, (3, W, n) rad/m, rad/m, 1
    # M / h: mass matrix divided by the duration of a cycle, (3, 3, n) kg/s, kg m/s, kg m^2/s
    mass_rate: Array
    # Contribution of rims and rollers to M, columns of the two velocities, (3, 2, n) kg and kg m
    rolling_mass: Array
    hub_gain: Array  # G: speed that a hub gains in a cycle per torque, rad/s / (N m)
    hub_viscous_friction: Array  # friction torque per speed of the hub, N m s/rad
    hub_dry_friction: Array  # dry friction torque of the hub without load, (W, n) N m
    # Slip speed per torque due to the contact damping of the rollers, (W, n) rad/s / (N m)
    contact_compliance: Array
    # Force of the rollers along the axle per speed of the wheel along it, for the wheel speed w:
    # roller_drag + spin_up |w| (1 - exp(-spin_up_speed / |w|)), N s/m
    roller_drag: Array  # drag of the bearings of standing rollers, (W, n) N s/m
    spin_up: Array  # drag of spinning up rollers that come down, per wheel speed, (W, n) N s^2/m
    # Wheel speed below which rollers take on most of the carpet's speed, (W, n) rad/s
    spin_up_speed: Array
    response: RollerResponse  # mean effect of rollers under the static loads
    rollers_per_speed: Array  # rollers that pass in a cycle per rim speed, s/rad
    center: Array  # center of the wheels, (2, n) m
    push_point: Array  # center of mass of the chassis, where push forces act, (3, n) m
    mass_height: Array  # height of the center of mass above the carpet, m
    static_load: Array  # normal force of each wheel at rest, (W, n) N
    # Normal forces of the wheels per vertical force and per two moments, (3, W, n) 1, 1/m, 1/m
    load_distribution: Array
    slope_force: Array  # component of gravity along the carpet, world frame, (2, n) N


class BodyState(NamedTuple):
    """Bodies and wheels of n robots, (n,) unless another shape is given."""

    x: Array  # position of the center of mass, world frame, m
    y: Array  # position of the center of mass, world frame, m
    heading: Array  # unwrapped, rad
    cosine: Array  # cosine of the heading
    sine: Array  # sine of the heading
    twist: Array  # v: twist of the center of mass, body frame, (3, n) m/s, m/s, rad/s
    gyro_rate: Array  # turn rate at the gyro, one cycle old, rad/s
    hub_angle: Array  # angle of the hubs, (W, n) rad
    encoder_angle: Array  # hub angle at the encoders, one cycle old, (W, n) rad
    hub_speed: Array  # w: speed of the hubs, (W, n) rad/s
    rim_speed: Array  # J' v: speed of the rims, (W, n) rad/s
    torque: Array  # t: torque from hub to rim through the rubber, (W, n) N m
    load: Array  # N: normal force of the wheels, (W, n) N
    passed_rollers: Array  # number of rollers of each wheel that have passed so far, (W, n)
    # Tilting moment about -y and about x, summed over the cycles of this frame so far, (2, n) N m
    tilting_moment: Array


class SlowForces(NamedTuple):
    """Forces computed every `DRAG_CYCLES` cycles; (n,) unless another shape is given."""

    drag: Drag  # drag of carpet and bearings
    # F: force on the body without the traction of the wheels, and its moment, (3, n) N, N, N m
    force: Array
    tilting_moment: Array  # moment of drag and pushes about -y and about x, (2, n) N m
    lift: Array  # normal force that turning adds to a wheel, (W, n) N
    ripple: Array  # ripple of the normal force per `compute_ripple_wave`, (W, n) N


def compute_center_motion(p: BodyParameters, s: BodyState) -> ChassisMotion:
    """Return the motion of the center of the wheels, computed from that of the center of mass."""
    world_x, world_y = rotate(p.center, s.cosine, s.sine)
    return ChassisMotion(
        x=s.x + world_x,
        y=s.y + world_y,
        cosine=s.cosine,
        sine=s.sine,
        velocity=compute_point_velocity(s.twist, p.center),
        turn_rate=s.twist[2],
    )


def compute_point_velocity(twist: Array, point: Array) -> tuple[Array, Array]:
    """Return the velocity of a point that is fixed to a body, forward and sideways.

    Args:
        twist: Twist of another point of the body, body frame, (3, n) m/s, m/s, rad/s.
        point: Position relative to that point, body frame, (2, n) m.
    """
    forward, sideways, turn_rate = twist
    return forward - turn_rate * point[1], sideways + turn_rate * point[0]


def advance_body(
    p: BodyParameters, s: BodyState, slow: SlowForces, motor_torque: Array, load_friction: Array
) -> BodyState:
    """Advance hubs, rubber and body by a cycle of backward Euler, then compute normal forces.

    Args:
        p: Parameters.
        s: State.
        slow: Forces that are constant for `DRAG_CYCLES` cycles.
        motor_torque: Torque of the motors at the wheels, (W, n) N m.
        load_friction: Friction torque of the hubs by the load of the motors, (W, n) N m.
    """
    xp = namespace(s.x)
    torque_limit, load = compute_torque_limit(slow.drag.torque_per_load, s.load)
    compliance = slow.drag.slip_compliance / load + p.contact_compliance
    free_speed, hub_gain = compute_free_hub_speed(
        p, s, motor_torque, p.hub_dry_friction + load_friction, compliance
    )
    forward, sideways, turn_rate = s.twist
    rolling = p.rolling_mass
    # The twist is rotated into the new body frame at the end of the cycle: at the turn rate r the
    # velocity (v_x, v_y) changes at the rate (r v_y, -r v_x). Rims and rollers keep their speeds in
    # the body frame, so the second term adds their mass times (-r v_y, r v_x).
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
    p: BodyParameters, s: BodyState, motor_torque: Array, friction: Array, compliance: Array
) -> tuple[Array, Array]:
    """Return e and G of the hubs: speed after the cycle without rubber, and speed per torque.

    A hub sticks if dry friction can slow it down to `STICTION_RETENTION` times its speed; its G is
    then 0.

    Args:
        p: Parameters.
        s: State.
        motor_torque: Torque of the motors at the wheels, (W, n) N m.
        friction: Dry friction torque of the hubs, (W, n) N m.
        compliance: S: slip speed per torque, (W, n) rad/s / (N m).

    Returns:
        e, (W, n) rad/s, and G, (W, n) rad/s / (N m).
    """
    xp = namespace(motor_torque)
    drive_torque = motor_torque - p.hub_viscous_friction * s.hub_speed
    # Dry friction that slows a hub from w to r w: drive torque - t + (1 - r) w / G. While the rim
    # keeps its speed, the torque t of the rubber falls by (1 - r) w / S.
    stopping_torque = (
        drive_torque
        - s.torque
        + (1 - STICTION_RETENTION) * s.hub_speed * (1 / p.hub_gain + 1 / compliance)
    )
    dry_friction = xp.copysign(friction, stopping_torque)
    free_speed = s.hub_speed + p.hub_gain * (drive_torque - dry_friction)
    hub_gain = p.hub_gain + compliance * 0.0  # broadcast to (W, n)
    sticks = abs(stopping_torque) <= friction
    if not any_true(sticks):
        return free_speed, hub_gain
    sticking_speed = STICTION_RETENTION * s.hub_speed
    return xp.where(sticks, sticking_speed, free_speed), xp.where(sticks, 0.0, hub_gain)


def solve_traction(
    p: BodyParameters, momentum: Array, free_speed: Array, traction_gain: Array, limit: Array
) -> tuple[Array, Array, Array]:
    """Solve the equations of body and wheels (see the module) with Coulomb's limit.

    A torque that exceeds the limit is set to it, and the equations are solved again.

    Args:
        p: Parameters.
        momentum: M v_before / h + F, (3, n) N, N, N m.
        free_speed: e: speeds of the hubs without rubber, (W, n) rad/s.
        traction_gain: 1 / (S + G): torque per slip speed, (W, n) N m s/rad.
        limit: mu' N R: largest torque, (W, n) N m.

    Returns:
        Twist v, (3, n) m/s, m/s, rad/s; speeds of the rims, (W, n) rad/s; and torques t of the
        rubber, (W, n) N m.
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

    The robot heaves and tilts until its weight and the moments are balanced. A wheel never pulls.

    Args:
        p: Parameters.
        added_load: Lift and ripple of turning wheels, (W, n) N.
        tilting: Moments that tilt the robot about -y and about x, (2, n) N m.
    """
    moment_x, moment_y = sum_wheels(p.contact * added_load) + tilting
    unit_force, unit_moment_x, unit_moment_y = p.load_distribution
    relieved_load = (
        unit_force * sum_wheels(added_load) + unit_moment_x * moment_x + unit_moment_y * moment_y
    )
    return namespace(tilting).maximum(p.static_load + added_load - relieved_load, 0.0)


def compute_ripple_wave(passed_rollers: Array) -> Array:
    """Return a periodic wave made of parabolas, which are cheaper than a cosine.

    It is 1/16 at whole numbers, with a roller at the bottom, and -1/16 halfway between two rollers.

    Args:
        passed_rollers: Number of rollers that have passed, (W, n).
    """
    phase = 0.25 - abs(passed_rollers - namespace(passed_rollers).round(passed_rollers))
    return phase * (0.5 - abs(phase))
