"""Rubber on carpet: creep, Coulomb's limit, and drag of the wheels.

**Creep.** Rubber that comes into the contact is unstrained and leaves it strained, as in the brush model of a tyre (H.
B. Pacejka, Tire and Vehicle Dynamics, chapter 3). In a contact of length l that travels at |v| over the carpet, a rim
that slides at s against the direction of its pull strains the rubber by s t after the time t in the contact, s l/|v| at
its end. With a stiffness k per length and strain its traction is f = k l^2 s / (2 |v|): slip speed and traction are
proportional, and the slip falls as the travel brings fresh rubber faster. Contact length and stiffness grow with the
load N so that k l^2 / 2 = C N, with one number C for a robot, its creep stiffness:

    s = |v| f / (N C),    |f| <= mu N.

|v| is the speed of the wheel's centre over the carpet in any direction, because rollers bring fresh rubber along the
axle as well. A wheel at rest does not creep. A robot with W wheels whose directions have the cosines d_i and that
accelerates at a is slower than its wheels by s/v = T a, T = W / (g C sum d_i^2): measured on robots of TIGERs
Mannheim (`omni-mj slip`).

**In MuJoCo** a hinge between hub and rim slides; the contacts below do not. Its dry friction is the limit mu N R. As a
constraint a + Q tau = -w/h with Q = |v| / (h R^2 N C) it is, over a step h, backward Euler for the law above: the
slip's angular speed becomes w = -h Q tau, for a torque tau = f R. MuJoCo's impedance is d = A / (A + Q) with the
hinge's inverse inertia A. The load is that which the contacts carried in the step before.

**Drag** acts where wheels touch, in proportion to load. The pile of the carpet is pressed down in front of a wheel and
pushes against it, radially, so not about its axle: p N against the wheel's travel. Fibres lean: to first order in the
lean, p grows by nap cos(angle between the travel and the direction straight against the fibres). Rollers turn on plain
bearings as the wheel travels along its axle: b N against that. Both are forces on the body which the wheels must pull,
and creep for. The bearing's goes through the contact, and leaves sqrt(mu^2 - b^2) N of the friction circle to the rim.
Drag and travel change slowly, and are computed every `DRAG_CYCLES` cycles of the wheel loops.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Kinematics
from omni_mj.config.settings import Settings, gather
from omni_mj.robot.array_namespace import Array, namespace, root, rotate, total

DRAG_CYCLES = 4  # of the wheel loops, between two computations of drag
AT_REST_M_S = 0.01  # below it, dry drag fades
LEAST_LOAD_N = 1e-3  # of a wheel in the air
NOWHERE = -1.0  # radius of a patch that covers nothing


class CarpetParameters(NamedTuple):
    """Carpet and wheels of n robots, (n,) unless another shape is given."""

    friction: Array  # coefficient of the carpet
    # X, y and radius in m, and friction, (patches, 4, n); the last one counts; None if there are
    # none
    patches: Array
    pile: Array  # rolling resistance over load
    nap: Array  # how much more against the fibres; None if no fibres lean
    fibre_x: Array  # direction straight against the fibres, world frame
    fibre_y: Array
    grip: Array  # friction of each wheel over the carpet's, (W, n)
    # Angle over which rollers are missing, from a wheel's angle 0 on, (W, n) rad; None if nowhere
    gap: Array
    bearing: Array  # friction of the rollers' bearings over load
    creep: Array  # softness of the rubber over speed, (W, n), in units of the plant
    radius: Array  # of the wheels, (W, n) m
    arm: Array  # from the robot's middle to where wheels touch, m
    axle_x: Array  # directions of the axles, robot frame, (W, n)
    axle_y: Array


class Motion(NamedTuple):
    """Pose and twist of the middle of the wheels, (n,)."""

    x: Array  # m
    y: Array
    cosine: Array  # of the heading
    sine: Array
    ahead: Array  # velocity in the robot's frame, m/s
    aside: Array
    turn_rate: Array  # rad/s


class Drag(NamedTuple):
    """What carpet and bearings do to a robot until they are computed again."""

    ahead: Array  # force in the robot's frame, (n,) N
    aside: Array
    moment: Array  # about the middle of the wheels, (n,) N m
    softness: Array  # slip speed over torque, times load, (W, n)
    rim_friction: Array  # greatest torque over load, (W, n) m
    axle_speed: Array  # of the wheels along their axles, (W, n) m/s


def carpet_parameters(
    settings: Sequence[Settings], kinematics: Kinematics, grip: Array, wear: Array
) -> CarpetParameters:
    """Return the parameters of n robots; `creep` is for slip speeds in rad/s per torque in N m.

    Args:
        settings: One per robot.
        kinematics: Of their wheels.
        grip: Friction of each wheel over the carpet's, (W, n).
        wear: What each wheel has lost of its radius, (W, n) m.
    """
    names = "pile", "nap", "nap_deg", "friction"
    pile, nap, direction, friction = (gather(settings, f"carpet.{name}") for name in names)
    radius, (axle_x, axle_y, _) = (
        kinematics.radius - wear,
        kinematics.axles.T[..., None] * np.ones(len(settings)),
    )
    return CarpetParameters(
        friction=friction,
        patches=covered([s.carpet.patches for s in settings]),
        pile=pile,
        nap=nap if nap.any() else None,
        fibre_x=np.cos(np.radians(direction)),
        fibre_y=np.sin(np.radians(direction)),
        grip=grip,
        gap=None,
        bearing=gather(settings, "drive.roller_friction"),
        creep=1 / (radius**2 * gather(settings, "drive.creep_stiffness")),
        radius=radius,
        arm=np.full(len(settings), kinematics.arm),
        axle_x=axle_x,
        axle_y=axle_y,
    )


def covered(patches: Sequence[Sequence[tuple[float, float, float, float]]], room: int = 0) -> Array:
    """Return patches of n robots as (patches, 4, n), with room for so many, or None if there are none."""
    most = max(room, *(len(each) for each in patches))
    if not most:
        return None
    result = np.zeros((most, 4, len(patches)))
    result[:, 2] = NOWHERE
    for robot, each in enumerate(patches):
        if each:
            result[: len(each), :, robot] = each
    return result


def compute_drag(p: CarpetParameters, motion: Motion, load: Array, wheel_angle: Array) -> Drag:
    """Compute drag, softness of the rubber, and friction left to the rims.

    Args:
        p: Parameters.
        motion: Of the robots.
        load: Of the wheels, (W, n) N.
        wheel_angle: (W, n) rad; it matters to wheels that have lost rollers.
    """
    xp, ahead, aside = namespace(load), motion.ahead, motion.aside
    axle = ahead * p.axle_x + aside * p.axle_y
    along = aside * p.axle_x - ahead * p.axle_y + p.arm * motion.turn_rate
    friction = _friction(p, motion, wheel_angle)
    speed = root(axle * axle + along * along)
    fade = 1 / xp.maximum(speed, AT_REST_M_S)
    way_axle, way_along = axle * fade, along * fade
    # On ice rollers slide first
    held = xp.minimum(p.bearing, friction) / xp.maximum(abs(axle), AT_REST_M_S) * axle
    pile = p.pile
    if p.nap is not None:
        x, y = rotate(p.fibre_x, p.fibre_y, motion.cosine, -motion.sine)
        lean = (way_axle * p.axle_x - way_along * p.axle_y) * x + (
            way_axle * p.axle_y + way_along * p.axle_x
        ) * y
        pile = p.pile * (1 + p.nap * lean)
    on_axle, on_rim = load * (pile * way_axle + held), load * (pile * way_along)
    return Drag(
        ahead=-total(on_axle * p.axle_x - on_rim * p.axle_y),
        aside=-total(on_axle * p.axle_y + on_rim * p.axle_x),
        moment=-p.arm * total(on_rim),
        softness=p.creep * speed,
        rim_friction=p.radius * root(friction * friction - held * held),
        axle_speed=axle,
    )


def _friction(p: CarpetParameters, motion: Motion, wheel_angle: Array) -> Array:
    """Return the coefficient of friction at the rim of each wheel, (W, n)."""
    xp = namespace(wheel_angle)
    friction = p.friction * p.grip
    if p.patches is not None:
        x, y = rotate(p.arm * p.axle_x, p.arm * p.axle_y, motion.cosine, motion.sine)
        x, y = motion.x + x, motion.y + y
        for patch in p.patches:
            apart_x, apart_y, radius = x - patch[0], y - patch[1], patch[2]
            inside = apart_x * apart_x + apart_y * apart_y < radius * abs(radius)
            friction = xp.where(inside, patch[3] * p.grip, friction)
    if p.gap is not None:
        friction = xp.where(wheel_angle % (2 * np.pi) < p.gap, 0.0, friction)
    return friction


def limit_torque(rim_friction: Array, load: Array) -> tuple[Array, Array]:
    """Return the greatest torque of rims under a load (W, n) in N, (W, n) N m, and that load, a little in the air."""
    pressed = namespace(load).maximum(load, LEAST_LOAD_N)
    return rim_friction * pressed, pressed
