r"""The law of wheels to motion: creep, Coulomb's limit and drag of each wheel, solved over stretches of logs.

Wheel i of direction d_i = (cosines, arm) has the load N_i and travels at |v_i| over the carpet. What it is told to do,
r_i in m/s at its rim, and what the ground does, d_i nu, differ by what its traction f_i costs:

    r_i - d_i nu = (z + |v_i| / (C N_i)) f_i,        |f_i| <= sqrt(mu^2 - b^2) N_i
    M nu' = sum f_i d_i - drag + lean,               nu: twist of the body, along its own axes

C is the creep stiffness, and the drag that of the plant (`omni_mj.robot.carpet`): of the pile, p N_i against the
wheel's travel, and of rollers' bearings, b N_i along its axle; and what grows with speed (`Body`): bearings' viscous
friction, rollers that are spun up as they come to the carpet, and rubber that is pressed. Loads shift as the body,
whose centre of mass is above the floor, speeds up. With encoders r_i is what they show, times the scale of the wheels,
and z is 0. With commands r_i is what the wheel loops are told, and 1/z their stiffness: a force f_i makes wheels slower
by z f_i. So along an axis

    (tau + T0 |v|) (v' + drag / m) = K u - v,        T0 = m / (C sum N_i d_i^2),    tau = z m / sum d_i^2.

Turn rates are commanded through a loop on the gyro, (1 + k) u - k w. What loops are late by is in `loops`. All is per
mass: forces are accelerations here.
What a carpet that slopes pulls is constant in the world, as no other force is, so that moves in several directions tell
it. That wheels differ, in radius or in the stiffness of their loops, is not fitted but tested for (`suspects`).
"""

from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_mj.robot.motors import Motor
from omni_mj.scenarios.settings import Settings
from omni_mj.studies.identify.loops import Loops
from omni_mj.studies.identify.segments import COARSEST_S, Segments

NAMES = (
    "creep",
    "pile",
    "roller_friction",
    "scale",
    "arm",
    "compass_rad",
    "give_s",
    "friction_m_s",
    "turn_gain",
    "grip",
    "drift",
    "integral_1_s",
    "lean_x_m_s2",
    "lean_y_m_s2",
)
CREEP, PILE, ROLLERS, SCALE, ARM, COMPASS, GIVE, FRICTION, TURN, GRIP, DRIFT, INTEGRAL, LEAN_X, LEAN_Y = range(
    len(NAMES)
)
GRAVITY_M_S2 = 9.81
ROLLER_KG = 0.0015  # as in models/ssl_robot.xml: what turns beyond the creep is as mass that only rims push, 1 to 2 %
AT_REST_M_S = 0.01  # below which dry drag fades, as on the plant
RUBBED_M_S = 0.05  # speed of wheels from which their own dry friction is all there
# Rollers of which two touch around each handover, a bit nearer to their axes than the middle one, and rubber that is
# pressed: measured on the plant, three robots at 0.6 to 1.9 m/s in three directions without dry drag, within 0.04 N.
BOTH_TOUCH, SPUN_EARLY, PRESSED_S_M = 1.5, 1.1, 0.004
STIFFEST_S = 1e-4  # of z m: wheels without creep and give
AROUND = np.array([1, 2, 0, 1])  # rows, and columns, that a cofactor is of: two that follow its own


@dataclass(frozen=True, eq=False)
class Body:
    """What is known of a robot: its wheels and how its weight is on them.

    Attributes:
        wheels: directions (W, 3): cosines and arm.
        outward: of each wheel, (W,) unit vectors.
        arm: m. radius: of the wheels, m. centre: of mass, ahead of the middle, m.
        mass: matrix (3, 3) over the mass: of a twist of the middle of the wheels.
        rest: loads at rest over the mass, (W,) m/s^2; shift: what an acceleration adds, (2, W).
        viscous: drag of a wheel's rollers over speed along its axle and mass, 1/s.
        spun: drag of rollers that are spun up, over the same and the speed of the rim, 1/m.
        commutation: by which share a motor's resistance grows with the speed of its wheel, s/m.
        hub: inertia of a motor, as a mass at the rim, over the mass.
        loops: what is late in them.
    """

    wheels: Array
    outward: np.ndarray
    arm: float
    radius: float
    centre: float
    mass: Array
    rest: Array
    shift: Array
    viscous: float
    spun: float
    commutation: float
    hub: float
    loops: Loops

    @classmethod
    def of(cls, settings: Settings) -> "Body":
        """That of a robot under its settings."""
        geometry, body = settings.wheels.kinematics, settings.body
        outward, centre = np.exp(1j * geometry.azimuths), body.centre_x_m
        places = np.column_stack([np.ones(len(outward)), geometry.arm * outward.real, geometry.arm * outward.imag])
        loads = places @ np.linalg.inv(places.T @ places)  # of force, and moments about the middle
        mass = np.array([[1, 0, 0], [0, 1, centre], [0, centre, body.yaw_inertia_kg_m2 / body.mass_kg + centre**2]])
        count, roller, radius = settings.wheels.rollers, settings.wheels.roller_radius_m, geometry.radius
        ring = 1 - roller / radius  # rollers, over the wheel's radius
        mass += count * ROLLER_KG * ring**2 / body.mass_kg * geometry.matrix.T @ geometry.matrix
        viscous = BOTH_TOUCH * settings.drive.roller_damping_nm_s / roller**2 / body.mass_kg
        turning = roller - radius * (1 - np.cos(np.pi / count))  # radius at which one is spun up, half a pitch ahead
        spun = SPUN_EARLY * count / (2 * np.pi * radius) * 0.4 * ROLLER_KG * (roller / turning) ** 2 / body.mass_kg
        rest, shift = loads @ [GRAVITY_M_S2, GRAVITY_M_S2 * centre, 0.0], -body.centre_height_m * loads[:, 1:].T
        motor = Motor.of(settings.motor)
        commutation = motor.commutation * motor.gear / (motor.resistance * radius)
        hub = motor.inertia * motor.gear**2 / (radius**2 * body.mass_kg)
        known = geometry.matrix, outward, geometry.arm, radius, centre, mass, rest, shift, viscous, spun
        return cls(*known, commutation, hub, Loops.of(settings))


@dataclass(frozen=True)
class Motion:
    """What the law makes of S stretches with P sets of parameters, at all m samples.

    Attributes:
        way: from the first sample on, world frame, (S, P, m) complex m.
        turned: the same, (S, P, m) rad.
        twist: along the body's axes, (S, P, m, 3).
    """

    way: np.ndarray
    turned: Array
    twist: Array


def simulate(
    body: Body, segments: Segments, parameters: Array, late: Array, start: Array, coarsest: float | None = None
) -> Motion:
    """Solve the law.

    Each step's mean input acts through it; with the lags of its middle, extrapolated, it is solved by the (0, 2) Pade
    approximant of the exponential, of second order and for any stiffness.

    Args:
        body: the robot, of W wheels.
        segments: S stretches.
        parameters: P sets (P, 14 + 2 W), in the order of `NAMES`, arm relative to the body's; then by how much more
            each wheel's rim moves than the scale says, and by how much more its loop gives way, as shares.
        late: by how much inputs are, (S, P) s.
        start: at the first sample heading in rad, twist, and acceleration, world frame, (S, P, 7).
        coarsest: longest step, s. [`COARSEST_S`]
    """
    par = parameters.T[:, None]  # (14 + 2 W, 1, P)
    count = len(body.wheels)
    odd, softer = (1 + np.moveaxis(par[at : at + count], 0, -1) for at in (len(NAMES), len(NAMES) + count))
    lean = par[LEAN_X] + 1j * par[LEAN_Y]
    parts = max(1, int(np.ceil(segments.period / (COARSEST_S if coarsest is None else coarsest))))
    waits = 0.0 if segments.wheels else body.loops.wait
    inputs, duration = segments.means(late + waits, parameters[:, DRIFT], parts)
    wheels, outward = body.wheels, body.outward
    arm, creep, give = body.arm * par[ARM], par[CREEP][..., None], par[GIVE][..., None] * softer
    stretch = np.ones((1, len(parameters), 3))
    stretch[..., 2] = par[ARM]
    squares = stretch[..., None] * stretch[..., None, :]
    basis = _basis(body)
    inverse = np.linalg.inv(body.mass)
    rims = par[SCALE][..., None] * odd * body.radius
    cap = np.sqrt(np.maximum(par[GRIP] ** 2 - par[ROLLERS] ** 2, 1e-4))[..., None]
    heading = start[..., 0] + np.zeros_like(late)
    v, w = start[..., 1] + 1j * start[..., 2], start[..., 3].copy()
    ahead = np.exp(1j * (heading + par[COMPASS]))
    v, gaining = v / ahead, (start[..., 4] + 1j * start[..., 5]) / ahead
    pull = _columns(gaining.real, gaining.imag, start[..., 6])  # acceleration of the step before
    held: Array | None = None  # what loops have integrated
    way, turned = np.zeros(v.shape, complex), np.zeros(v.shape)
    samples = segments.lines.shape[1]
    motion = Motion(
        np.zeros((*v.shape, samples), complex), np.zeros((*v.shape, samples)), np.zeros((*v.shape, samples, 3))
    )
    motion.twist[:, :, 0] = _columns(v.real, v.imag, w)
    unit = np.eye(3)
    for k in range(duration.shape[1]):
        h = duration[:, k, None]
        half = np.exp(-0.5j * h * (w + 0.5 * h * pull[..., 2]))
        v = v * half
        before = _columns(v.real, v.imag, w)
        middle = before + 0.5 * h[..., None] * pull
        travel = (middle[..., 0] + 1j * middle[..., 1])[..., None] + 1j * (middle[..., 2] * arm)[..., None] * outward
        speed, axle = np.abs(travel), np.abs((travel * outward.conj()).real)
        down = lean * np.exp(-1j * (heading + turned + par[COMPASS] + 0.5 * h * w))
        down = _columns(down.real, down.imag, body.centre * down.imag)
        load = np.maximum(body.rest + (pull - down)[..., :2] @ body.shift, 0.02 * GRAVITY_M_S2)
        slack = creep * speed / load
        if segments.wheels:
            rim = rims * inputs[:, :, k]
            yields = 1 / np.maximum(slack, STIFFEST_S)
        else:
            u = inputs[:, :, k, 0] + 1j * inputs[:, :, k, 1]
            u = np.where(segments.in_body[:, None], u, u * np.exp(-1j * (heading + turned + 0.5 * h * w)))
            turn = inputs[:, :, k, 2] + par[TURN] * (inputs[:, :, k, 2] - middle[..., 2])
            told = _columns(u.real, u.imag, turn * par[ARM]) @ wheels.T
            soft = give * (1 + body.commutation * np.abs(told))
            if held is None:  # as if all had been steady before
                held = _steady(body, pull, v, par) + (1 - par[SCALE][..., None]) * told / soft
                held = held * (par[INTEGRAL] > 0)[..., None]
            rim = par[SCALE][..., None] * odd * told + soft * held
            rim = rim - par[FRICTION][..., None] * told / np.maximum(np.abs(told), RUBBED_M_S)
            yields = 1 / np.maximum(soft + slack, STIFFEST_S)
        rolling = (middle * stretch) @ wheels.T
        off = np.abs(rim - rolling)
        yields = np.minimum(yields, cap * load / np.maximum(off, 1e-9))
        coefficients = np.concatenate(
            [
                yields + PRESSED_S_M * load,
                par[PILE][..., None] * load / np.maximum(speed, AT_REST_M_S),
                par[ROLLERS][..., None] * load / np.maximum(axle, AT_REST_M_S)
                + body.viscous
                + body.spun * np.abs(rolling),
            ],
            -1,
        )
        resisting = (coefficients @ basis).reshape(*v.shape, 3, 3) * squares
        if not segments.wheels:  # the loop on the gyro; and motors, which turn with the body
            resisting_turn = (par[TURN] * par[SCALE] * arm)[..., None] * stretch * (yields @ wheels)
            resisting[..., 2] += resisting_turn
            driven = ((body.hub * soft * yields) @ basis[: len(wheels)]).reshape(*v.shape, 3, 3) * squares
            inverse = _inverse(body.mass + driven)
            late = (yields @ basis[: len(wheels)]).reshape(*v.shape, 3, 3) * squares * body.loops.seen
            late[..., 2] += body.loops.turned * resisting_turn
            share = inverse @ late  # of the mass that loops which see late do away with
            inverse = inverse + share @ (inverse + share @ inverse)
        pushing = stretch * ((yields * rim) @ wheels) + down
        if not segments.wheels:  # of the loop on the gyro, what depends on the turn rate is solved for
            pushing = pushing + resisting_turn * middle[..., 2:]
        x = (inverse @ resisting) * h[..., None, None]
        gain = h[..., None] * (inverse @ pushing[..., None])[..., 0]
        right = _columns(before, h[..., None] * before)
        upper = unit + 0.5 * x
        right[..., 0] += (upper @ gain[..., None])[..., 0]
        right[..., 1] = (upper @ right[..., 1:])[..., 0] + 0.5 * h[..., None] * ((unit + x) @ gain[..., None])[..., 0]
        solved = _inverse(unit + x @ upper) @ right
        after, moved = solved[..., 0], solved[..., 1]
        pull = np.where(h[..., None] > 0, (after - before) / np.maximum(h, 1e-9)[..., None], pull)
        way = way + (moved[..., 0] + 1j * moved[..., 1]) * np.exp(1j * (heading + turned + par[COMPASS])) * half.conj()
        turned = turned + moved[..., 2]
        w = after[..., 2]
        v = (after[..., 0] + 1j * after[..., 1]) * np.exp(-1j * moved[..., 2]) * half.conj()
        if held is not None and par[INTEGRAL].any():
            needed = yields * (rim - (after * stretch) @ wheels.T) + (1 - par[SCALE][..., None]) * told / soft
            held = held - (needed - held) * np.expm1(-h * par[INTEGRAL])[..., None]
        if (k + 1) % parts == 0:
            at = (k + 1) // parts
            motion.way[:, :, at], motion.turned[:, :, at] = way, turned
            motion.twist[:, :, at] = _columns(v.real, v.imag, w)
    return motion


def _columns(*columns: Array) -> Array:
    """What `numpy.stack` makes of them along a new last axis, in a third of the time."""
    made = np.empty((*columns[0].shape, len(columns)))
    for i, column in enumerate(columns):
        made[..., i] = column
    return made


def _inverse(matrices: Array) -> Array:
    """Of (..., 3, 3), by cofactors: several times as fast as LAPACK for many small ones."""
    around = matrices[..., AROUND[:, None], AROUND]
    one, other = around[..., :3, :3] * around[..., 1:, 1:], around[..., :3, 1:] * around[..., 1:, :3]
    cofactors = one - other
    size = (matrices[..., 0, :] * cofactors[..., 0, :]).sum(-1)
    inverse: Array = cofactors.swapaxes(-1, -2) / size[..., None, None]
    return inverse


def _steady(body: Body, pull: Array, velocity: np.ndarray, par: Array) -> Array:
    """Tractions (S, P, W) of wheels that share an acceleration and drag."""
    drag = (par[PILE] + par[ROLLERS]) * GRAVITY_M_S2 * velocity / np.maximum(np.abs(velocity), RUBBED_M_S)
    force = pull @ body.mass + np.stack([drag.real, drag.imag, 0 * drag.real], -1)
    shared: Array = force @ np.linalg.pinv(body.wheels)
    return shared


def _basis(body: Body) -> Array:
    """What rims, pile and bearings resist a twist by, for coefficients of 1: (3 W, 9)."""
    x, y = body.arm * body.outward.real, body.arm * body.outward.imag
    one, none = np.ones_like(x), np.zeros_like(x)
    across = np.stack([np.stack([one, none, -y], -1), np.stack([none, one, x], -1)], 1)  # (W, 2, 3)
    axles = np.stack([body.outward.real, body.outward.imag, none], -1)
    rows = [body.wheels[:, None], across, axles[:, None]]
    return np.concatenate([np.einsum("wki,wkj->wij", row, row).reshape(-1, 9) for row in rows])
