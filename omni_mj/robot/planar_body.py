"""A robot in the plane on wheels that creep and slide (docs/explanation/planar-plant.md).

**A wheel.** The hub turns at w with its motor, whose inertia over a step h is 1 / G. The rim turns at J v with the
body's twist v, because contacts do not slide. Rubber lets hub and rim differ by S times the torque t between them. In a
step of backward Euler, with e for the hub's speed without rubber,

    w = e - G t,    w - J v = S t        so        t = (e - J v) / (S + G),    |t| <= grip N.

**The body.** With M its inertia, that of the rims and that of rollers that turn along the axles, and F what else acts,

    M (v - v_before) / h = F + sum J t,        so

    (M / h + sum J J' / (S + G)) v = M v_before / h + F + sum J e / (S + G).

A wheel of which more torque would be asked than Coulomb's limit has that limit. Vectors are in the robot's frame. In
v_before the mass keeps its velocity in the world, so its direction turns in this frame. Rims and rollers keep their
speeds, so theirs does not.

**The load.** Wheels share the robot's weight and the moments of what pulls at it, as equal springs do. A wheel that
turns carries more, and its load ripples as rollers pass. The robot yields to the sum and the moments of both, so that
wheels keep only what no motion of the body takes away.
"""

from typing import NamedTuple

from omni_mj.robot.array_namespace import (
    Array,
    any_true,
    clip,
    namespace,
    refine,
    repeat,
    rotate,
    small_rotation,
    total,
)
from omni_mj.robot.carpet import (
    DRAG_CYCLES,
    CarpetParameters,
    Drag,
    Motion,
    compute_drag,
    limit_torque,
)
from omni_mj.robot.firmware import CYCLE_S, CYCLES, Command
from omni_mj.robot.onboard import (
    CycleRecord,
    FrameInputs,
    OnboardParameters,
    OnboardState,
    begin_frame,
    end_frame,
    hear,
    run_cycle,
    telemetry_rows,
)

SLIDING_PASSES = 3  # a wheel that is found to slide may let others slide; more than two are rare
# Of its speed a hub keeps in a cycle if dry friction stops it; models/ssl_robot.xml
REST_SHARE = 1 - 400.0 * CYCLE_S


class BodyParameters(NamedTuple):
    """Bodies and wheels of n robots, (n,) unless another shape is given; positions from the centre of mass."""

    contact_x: Array  # where wheels touch, (W, n) m
    contact_y: Array
    edge_x: Array  # from there to the next wheel counter-clockwise, (W, n) m
    edge_y: Array
    jacobian: Array  # speed of each rim for the body's twist, (3, W, n) 1/m, 1/m, 1
    inertia: Array  # of body, rims and rollers over a cycle, (3, 3, n) kg/s and kg m^2/s
    rolling_inertia: (
        Array  # of rims and rollers alone, two columns of the matrix, (3, 2, n) kg and kg m
    )
    hub_gain: Array  # speed per torque that a hub gains in a cycle, rad/s / (N m)
    hub_viscous: Array  # friction, N m s/rad
    hub_dry: Array  # friction, (W, n) N m
    contact_softness: Array  # slip over torque of the contacts, (W, n) rad/s / (N m)
    lever: Array  # from axles to the carpet, (W, n) m
    # Force along the axle over speed, bearing + spin_up |w| (1 - exp(-spun_at / |w|)), (W, n) N s/m
    bearing: Array
    spin_up: Array
    spun_at: Array  # wheel speed at which rollers take on most of the carpet's speed, (W, n) rad/s
    cost: Array  # torque that turning costs, cost w / (1 + cost_fades |w|), (W, n) N m
    cost_fades: Array
    lift: Array  # load that a turning wheel takes over, lift w^2 / (1 + lift_fades |w|), (W, n) N
    lift_fades: Array
    ripple: Array  # of the load as rollers pass, (ripple + ripple_grows |w|) wave, (W, n) N
    ripple_grows: Array
    passing: Array  # rollers that come down in a cycle for a rim's speed, s/rad
    middle_x: Array  # of the wheels, m
    middle_y: Array
    push_x: Array  # where pushes act, m
    push_y: Array
    height: Array  # of the centre of mass, m
    push_height: Array  # of where pushes act above it, m
    weight: Array  # load of each wheel at rest, (W, n) N
    shares: Array  # load of wheels for a force up and two moments, (3, W, n) 1, 1/m, 1/m
    downhill_x: Array  # force of a slope, world frame, N
    downhill_y: Array


class PlanarParameters(NamedTuple):
    """Parameters of n robots on the plant `planar`."""

    onboard: OnboardParameters
    carpet: CarpetParameters
    body: BodyParameters


class BodyState(NamedTuple):
    """Bodies and wheels of n robots, (n,) unless another shape is given."""

    x: Array  # of the centre of mass, m
    y: Array
    heading: Array  # rad
    cosine: Array  # of the heading
    sine: Array
    twist: Array  # robot frame, (3, n) m/s, m/s, rad/s
    gyro_rate: Array  # turn rate as the gyro shows it, a cycle ago, rad/s
    hub_angle: Array  # (W, n) rad
    encoder_angle: Array  # hub angle as encoders show it, a cycle ago, (W, n) rad
    hub_speed: Array  # (W, n) rad/s
    rim_speed: Array  # (W, n) rad/s
    torque: Array  # of the rubber between hub and rim, (W, n) N m
    load: Array  # (W, n) N
    rollers: Array  # of each wheel that came down so far, (W, n)
    # Moments that tilt the robot back and aside, summed over the cycles of a frame, (2, n) N m
    tilt: Array


class PlanarState(NamedTuple):
    """State of n robots on the plant `planar`."""

    onboard: OnboardState
    body: BodyState


class SlowForces(NamedTuple):
    """What changes slowly, and is computed every `DRAG_CYCLES` cycles; (n,) unless another shape is given."""

    drag: Drag
    force: Array  # all but the wheels' pull, and its moment, (3, n) N and N m
    tilting: Array  # moments of drag and pushes that tilt the robot, (2, n) N m
    raised: Array  # load that turning wheels take over, (W, n) N
    ripple: Array  # of the load over `wave`, (W, n) N


class FrameReport(NamedTuple):
    """What a plant tells of a frame, (n,) unless another shape is given."""

    pose: Array  # of the middle of the wheels, (3, n) m, m, rad
    twist: Array  # world frame, (3, n) m/s, m/s, rad/s
    topples: Array  # whether the robot would topple
    telemetry: Array  # (10 W + 4, n), see `omni_mj.plants.Telemetry`


def advance_frame(
    p: PlanarParameters, s: PlanarState, command: Command, inputs: FrameInputs
) -> tuple[PlanarState, FrameReport]:
    """Advance by a frame of 1/60 s, in 16 cycles of the wheel loops."""
    xp = namespace(s.body.x)
    onboard = begin_frame(
        p.onboard, hear(p.onboard, s.onboard, command), inputs, s.body.encoder_angle
    )
    cosine, sine = xp.cos(s.body.heading), xp.sin(s.body.heading)
    body = s.body._replace(cosine=cosine, sine=sine, tilt=s.body.tilt * 0.0)

    def some_cycles(s: PlanarState) -> tuple[PlanarState, CycleRecord]:
        slow = slow_forces(p, s)
        return repeat(lambda s: advance_cycle(p, s, slow), s, DRAG_CYCLES, cosine)

    s, nested = repeat(some_cycles, PlanarState(onboard, body), CYCLES // DRAG_CYCLES, cosine)
    record = CycleRecord(*(part.reshape((CYCLES, *part.shape[2:])) for part in nested))
    s = PlanarState(end_frame(p.onboard, s.onboard, record), s.body)
    return s, report(p, s, record)


def advance_cycle(
    p: PlanarParameters, s: PlanarState, slow: SlowForces
) -> tuple[PlanarState, CycleRecord]:
    """Advance by a cycle of 1/960 s."""
    body = s.body
    onboard, record = run_cycle(
        p.onboard, s.onboard, body.gyro_rate, body.encoder_angle, body.hub_speed
    )
    motor_torque = onboard.motors.back_emf * record.current
    return PlanarState(onboard, move_body(p.body, body, slow, motor_torque)), record


def slow_forces(p: PlanarParameters, s: PlanarState) -> SlowForces:
    """Compute drag, pushes, slope, and what rollers do to their wheels."""
    b, body, inputs = p.body, s.body, s.onboard.inputs
    xp = namespace(body.x)
    ahead, aside, rate = body.twist
    middle_x, middle_y = rotate(b.middle_x, b.middle_y, body.cosine, body.sine)
    motion = Motion(
        body.x + middle_x, body.y + middle_y, body.cosine, body.sine,
        ahead - rate * b.middle_y, aside + rate * b.middle_x, rate,
    )  # fmt: skip
    drag, spin = compute_drag(p.carpet, motion, body.load, body.encoder_angle), abs(body.rim_speed)
    # Rollers are spun up and braked along the axle, and pressed into the carpet as the wheel turns.
    spun_up = 1 - xp.exp(-b.spun_at / xp.maximum(spin, 1.0))
    along_axle = -(b.bearing + b.spin_up * spin * spun_up) * drag.axle_speed
    along_rim = -b.cost * body.rim_speed / (1 + b.cost_fades * spin) / b.lever
    rollers_x, rollers_y = rotate(along_axle, along_rim, p.carpet.axle_x, p.carpet.axle_y)
    ground_x, ground_y = drag.ahead + total(rollers_x), drag.aside + total(rollers_y)
    push_x, push_y = rotate(inputs.push_x, inputs.push_y, body.cosine, -body.sine)
    slope_x, slope_y = rotate(b.downhill_x, b.downhill_y, body.cosine, -body.sine)
    moment = drag.moment + b.middle_x * drag.aside - b.middle_y * drag.ahead
    moment = moment + total(b.contact_x * rollers_y - b.contact_y * rollers_x)
    moment = moment + b.push_x * push_y - b.push_y * push_x
    tilting_x = b.height * ground_x - b.push_height * push_x
    tilting_y = b.height * ground_y - b.push_height * push_y
    return SlowForces(
        drag=drag,
        force=xp.stack([ground_x + push_x + slope_x, ground_y + push_y + slope_y, moment]),
        tilting=xp.stack([tilting_x, tilting_y]),
        raised=b.lift * spin * spin / (1 + b.lift_fades * spin),
        ripple=b.ripple + b.ripple_grows * spin,
    )


def move_body(p: BodyParameters, s: BodyState, slow: SlowForces, motor_torque: Array) -> BodyState:
    """Move hubs, rubber and body by backward Euler, then find the load of the wheels."""
    xp = namespace(s.x)
    limit, pressed = limit_torque(slow.drag.rim_friction, s.load)
    softness = slow.drag.softness / pressed + p.contact_softness
    free, give = free_hub(p, s, motor_torque, softness)
    ahead, aside, rate = s.twist
    own = p.rolling_inertia
    momentum = (
        (p.inertia * s.twist).sum(1) + rate * (own[:, 1] * ahead - own[:, 0] * aside) + slow.force
    )
    twist, rim, torque = solve_traction(p, momentum, free, 1 / (softness + give), limit)
    hub_speed = free - give * torque
    tilting = p.height * total(torque * p.jacobian[:2]) + slow.tilting
    rollers = s.rollers + p.passing * rim
    turn = CYCLE_S * twist[2]
    cosine, sine = small_rotation(turn)
    world_x, world_y = rotate(twist[0], twist[1], s.cosine, s.sine)
    facing = rotate(s.cosine, s.sine, cosine, sine)
    return BodyState(
        x=s.x + CYCLE_S * world_x,
        y=s.y + CYCLE_S * world_y,
        heading=s.heading + turn,
        cosine=facing[0],
        sine=facing[1],
        twist=xp.stack([*rotate(twist[0], twist[1], cosine, -sine), twist[2]]),
        gyro_rate=rate,
        hub_angle=s.hub_angle + CYCLE_S * hub_speed,
        encoder_angle=s.hub_angle,
        hub_speed=hub_speed,
        rim_speed=rim,
        torque=torque,
        load=load_wheels(p, slow.raised + slow.ripple * wave(rollers), tilting),
        rollers=rollers,
        tilt=s.tilt + tilting,
    )


def free_hub(
    p: BodyParameters, s: BodyState, motor_torque: Array, softness: Array
) -> tuple[Array, Array]:
    """Return the speed of hubs after the cycle without rubber, and speed per torque that rubber takes off it.

    A hub rests if dry friction could bring it to rest within the cycle. A hub that slows takes its
    rim along: rubber adds to its torque of the cycle before what it is then strained by.
    """
    xp = namespace(motor_torque)
    driven = motor_torque - p.hub_viscous * s.hub_speed
    needed = driven - s.torque + (1 - REST_SHARE) * s.hub_speed * (1 / p.hub_gain + 1 / softness)
    turning = s.hub_speed + p.hub_gain * (driven - xp.copysign(p.hub_dry, needed))
    give = p.hub_gain + softness * 0.0
    rests = abs(needed) <= p.hub_dry
    if not any_true(rests):
        return turning, give
    return xp.where(rests, REST_SHARE * s.hub_speed, turning), xp.where(rests, 0.0, give)


def solve_traction(
    p: BodyParameters, momentum: Array, free: Array, pull: Array, limit: Array
) -> tuple[Array, Array, Array]:
    """Solve for the twist (3, n), the speeds of rims (W, n) and the torques of rubber (W, n).

    A wheel of which more is asked than friction allows has that limit, and the equations are solved
    again.

    Args:
        p: Parameters.
        momentum: Before, over a cycle, with all forces, (3, n).
        free: Speeds of hubs without rubber, (W, n) rad/s.
        pull: Torque per slip, (W, n).
        limit: Greatest torque, (W, n) N m.
    """
    xp = namespace(pull)
    jacobian = p.jacobian

    def solve(pull: Array, held: Array) -> tuple[Array, Array, Array]:
        matrix = p.inertia + total((pull * jacobian)[:, None] * jacobian)
        twist = solve_symmetric(matrix, momentum + total((pull * free + held) * jacobian))
        rim = jacobian[0] * twist[0] + jacobian[1] * twist[1] + jacobian[2] * twist[2]
        return twist, rim, pull * (free - rim) + held

    def slide(state: tuple[Array, ...]) -> tuple[Array, ...]:
        pull, held, _, _, torque = state
        slides = (abs(torque) > limit) & (pull > 0)
        held = xp.where(slides, xp.copysign(limit, torque), held)
        pull = xp.where(slides, 0.0, pull)
        return pull, held, *solve(pull, held)

    held = pull * 0.0
    state = pull, held, *solve(pull, held)
    state = refine(
        slide, state, lambda state: (abs(state[-1]) > limit) & (state[0] > 0), SLIDING_PASSES
    )
    _, _, twist, rim, torque = state
    return twist, rim, clip(torque, -limit, limit)


def load_wheels(p: BodyParameters, raised: Array, tilting: Array) -> Array:
    """Return the load of wheels, (W, n) N.

    Args:
        p: Parameters.
        raised: What turning wheels take over, with its ripple, (W, n) N.
        tilting: Moments that tilt the robot, (2, n) N m.
    """
    moment_x, moment_y = (
        total(p.contact_x * raised) + tilting[0],
        total(p.contact_y * raised) + tilting[1],
    )
    shared = p.shares[0] * total(raised) + p.shares[1] * moment_x + p.shares[2] * moment_y
    return namespace(tilting).maximum(p.weight + raised - shared, 0.0)


def wave(turns: Array) -> Array:
    """Return 1/16 with a roller at the bottom and -1/16 between two: arcs of parabolas in place of a cosine."""
    off = 0.25 - abs(turns - namespace(turns).round(turns))
    return off * (0.5 - abs(off))


def report(p: PlanarParameters, s: PlanarState, record: CycleRecord) -> FrameReport:
    """Tell where robots are at the end of a frame."""
    b, body = p.body, s.body
    xp = namespace(body.x)
    middle_x, middle_y = rotate(b.middle_x, b.middle_y, body.cosine, body.sine)
    ahead, aside, rate = body.twist
    velocity = rotate(ahead - rate * b.middle_y, aside + rate * b.middle_x, body.cosine, body.sine)
    slip = abs(body.hub_speed - body.rim_speed) * p.carpet.radius
    return FrameReport(
        pose=xp.stack([body.x + middle_x, body.y + middle_y, body.heading]),
        twist=xp.stack([*velocity, rate]),
        topples=topples(b, body),
        telemetry=telemetry_rows(s.onboard, record, body.hub_angle, body.hub_speed, slip),
    )


def topples(p: BodyParameters, s: BodyState) -> Array:
    """Return whether the point that balances weight and forces left the polygon of the wheels, on a frame's mean."""
    weight = total(p.weight) * CYCLES
    outside = p.edge_x * (s.tilt[1] + p.contact_y * weight) > p.edge_y * (
        s.tilt[0] + p.contact_x * weight
    )
    return outside.any(0)


def solve_symmetric(a: Array, b: Array) -> Array:
    """Solve a x = b for symmetric positive definite matrices (3, 3, n) and right sides (3, n), by a = L D L'."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = a
    x, y, z = b
    p, q = xy / xx, xz / xx
    yy, yz = yy - p * xy, yz - p * xz
    r = yz / yy
    y = y - p * x
    z = (z - q * x - r * y) / (zz - q * xz - r * yz)
    y = y / yy - r * z
    return namespace(x).stack([x / xx - p * y - q * z, y, z])
