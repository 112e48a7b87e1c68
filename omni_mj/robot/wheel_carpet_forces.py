"""Rubber on carpet: creep, Coulomb's limit, and drag of the wheels.

**Creep.** Rubber enters the contact unstrained and leaves it strained, as in the brush model of a
tire (H. B. Pacejka, Tire and Vehicle Dynamics, chapter 3). Let a contact of length l travel at |v|
over the carpet while the rim slides at s against the direction of its traction. After the time t
in the contact the rubber is strained by s t, and at the end by s l / |v|. With a stiffness k per
length and strain the traction is f = k l^2 s / (2 |v|). Slip speed and traction are proportional,
and the slip falls as the travel brings fresh rubber faster. Contact length and stiffness grow with
the normal force N so that k l^2 / 2 = C N, with one number C per robot, its creep stiffness.

*Direction.* The contact of a roller is an ellipse, longer along the rim than along the axle by the
ratio rho. By Hertz's theory rho = (R / r)^(2/3), with the radii R of the wheel and r of the roller
(K. L. Johnson, Contact Mechanics, section 4.2). Stretched by rho along the axle, the ellipse is a
circle, through which rubber passes at the contact speed

    |v|_c = hypot(v_rim, rho v_axle).

It takes the place of |v|: rollers that travel along the axle bring fresh rubber rho times as fast.

*Softening.* The friction circle leaves mu' N for the traction along the rim (see Drag). Rubber
sticks up to the pressure's share of it, which is 6 mu' N y (l - y) / l^3 at the distance y from the
entry, for a parabolic pressure (Pacejka, section 3.2). The strain k s y / |v|_c reaches this share
at l - y = x l. So the last part x of the contact slides, and both parts add up to the traction

    f = mu' N (1 - (1 - x)^3),        x = s / s_max,        s_max = 3 mu' |v|_c / C,

or s = |v|_c f / (N C h) with the softening h = 1 - x + x^2 / 3, which falls from 1 to 1/3. Beyond
x = 1 the whole contact slides, and f = mu' N. A wheel at rest does not creep.

Logs of TIGERs Mannheim's robots confirm that the slip grows with speed and acceleration, and that
it is larger sideways (`omni-mj slip`).

**Time steps.** Both plants use the secant stiffness N C h / |v|_c until the next computation of
drag, with h at the latest slip. If the traction is given, the slip converges to that of the law. An
error of the slip is multiplied by x (1 - 2 x / 3) / (1 - x + x^2 / 3) at each update, which is
below 1 before the wheel slides. If the slip is given, the traction is exact at once. With h at the
latest traction the factor would be 1 - h / (1 - x)^2 for a given slip, which is below -1 from
x = 0.44 on, so that the traction would oscillate.

**In MuJoCo** the contacts between rollers and carpet never slide. The hinge between hub and rim of
a wheel with the radius R slides in their place. Its dry friction is the limit mu' N R. For a torque
tau = f R and a step dt, the angular speed of the slip is w = -dt Q tau with
Q = |v|_c / (dt R^2 N C h). With the angular acceleration a of the hinge, the constraint
a + Q tau = -w / dt is backward Euler for the law above. MuJoCo's impedance is d = A / (A + Q) with
the hinge's inverse inertia A. The normal force is that of the contacts in the previous step.

**Drag** acts at the contacts of the wheels, in proportion to the normal force N.

- Carpet: a wheel presses fibers down in front of it. They push radially against the wheel, without
  a moment about its axle. The force is p N against the wheel's travel. Fibers lean (nap). To first
  order, p grows by the factor 1 + nap cos(angle between the travel and the direction straight
  against the fibers).
- Roller bearings: rollers turn on plain bearings as the wheel travels along its axle. The force is
  b N against that travel. It goes through the contact, and leaves mu' N = sqrt(mu^2 - b^2) N of
  the friction circle for the traction of the rim.

Both are forces on the body, which the wheels must overcome by traction and therefore by creep.
They change slowly, and are computed every `DRAG_CYCLES` cycles of the wheel loops.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Kinematics
from omni_control.traction_limits import compute_softening
from omni_mj.config.settings import Settings, gather
from omni_mj.robot.array_ops import Array, namespace, rotate, safe_sqrt, sum_wheels

DRAG_CYCLES = 4  # cycles of the wheel loops from one computation of drag to the next
AT_REST_M_S = 0.01  # speed below which drag fades linearly to zero, m/s
MIN_LOAD_N = 1e-3  # normal force assumed for a wheel in the air, N
UNUSED_PATCH = 0.0, 0.0, -1.0, 0.0  # a patch whose negative radius covers nothing

# Circular patches of another friction: x, y and radius in m, coefficient of friction
Patches = Sequence[tuple[float, float, float, float]]


class CarpetParameters(NamedTuple):
    """Carpet and wheels of n robots, (n,) unless another shape is given."""

    friction: Array  # coefficient of friction of the carpet, 1
    # Circular patches of another friction: x, y and radius in m, coefficient, (patches, 4, n).
    # Where patches overlap, the last one counts. None if there are none.
    patches: Array
    rolling_resistance: Array  # p: rolling resistance over normal force, 1
    nap: Array  # relative rise of p straight against the fibers, 1; None if no fibers lean
    fiber_direction: Array  # unit vector straight against the fibers, world frame, (2, n)
    friction_factor: Array  # ratio of each wheel's friction to the carpet's, (W, n)
    # Angle of the sector without rollers, which starts at the wheel angle 0, (W, n) rad; None if no
    # rollers are missing
    missing_angle: Array
    roller_friction: Array  # b: friction of the rollers' bearings over normal force, 1
    # 1 / (R^2 C): slip speed times normal force, per torque and contact speed, for rubber that
    # sticks, (W, n) rad/m^2. On the plant mujoco it is divided by dt A, so that it gives Q / A.
    creep_compliance: Array
    sliding_slip: Array  # 3 / C: s_max over contact speed and friction coefficient mu', 1
    contact_ratio: Array  # rho: length of the contact along the rim over that along the axle, 1
    radius: Array  # R: radius of the wheels, (W, n) m
    arm: Array  # distance of the wheels' contacts from the center of the wheels, m
    axle: Array  # unit vectors along the axles, body frame, (2, W, n)


class ChassisMotion(NamedTuple):
    """Pose and twist of the center of the wheels, (n,)."""

    x: Array  # position, world frame, m
    y: Array  # position, world frame, m
    cosine: Array  # cosine of the heading
    sine: Array  # sine of the heading
    velocity: tuple[Array, Array]  # forward and sideways velocity, body frame, m/s
    turn_rate: Array  # rad/s


class Drag(NamedTuple):
    """Drag, slip compliance and limit of traction, constant for `DRAG_CYCLES` cycles."""

    force: tuple[Array, Array]  # forward and sideways drag force, body frame, (n,) N each
    moment: Array  # moment of the drag about the center of the wheels, (n,) N m
    # |v|_c / h times `creep_compliance`: slip speed times normal force, per torque, at the latest
    # slip, (W, n) rad/(m s)
    slip_compliance: Array
    # Coulomb's limit of the rim's torque over normal force: R mu' = R sqrt(mu^2 - b^2), where b is
    # the part that the bearings use, (W, n) m
    torque_per_load: Array
    axle_speed: Array  # speed of the wheels along their axles, (W, n) m/s


def make_carpet_parameters(
    settings: Sequence[Settings], kinematics: Kinematics, friction_factor: Array, wear: Array
) -> CarpetParameters:
    """Return the parameters of n robots.

    Args:
        settings: One per robot.
        kinematics: Geometry of their wheels.
        friction_factor: Ratio of each wheel's friction to the carpet's, (W, n).
        wear: Loss of each wheel's radius, (W, n) m.
    """
    names = "rolling_resistance", "nap", "nap_direction_deg", "friction"
    rolling_resistance, nap, direction, friction = (
        gather(settings, f"carpet.{name}") for name in names
    )
    radius = kinematics.radius - wear
    creep_stiffness = gather(settings, "drivetrain.creep_stiffness")
    return CarpetParameters(
        friction=friction,
        patches=stack_patches([s.carpet.patches for s in settings]),
        rolling_resistance=rolling_resistance,
        nap=nap if nap.any() else None,
        fiber_direction=np.stack([np.cos(np.radians(direction)), np.sin(np.radians(direction))]),
        friction_factor=friction_factor,
        missing_angle=None,
        roller_friction=gather(settings, "drivetrain.roller_friction"),
        creep_compliance=1 / (radius**2 * creep_stiffness),
        sliding_slip=3 / creep_stiffness,
        contact_ratio=gather(settings, "wheels.contact_ratio"),
        radius=radius,
        arm=np.full(len(settings), kinematics.arm),
        axle=kinematics.axles.T[:2, :, None] * np.ones(len(settings)),
    )


def stack_patches(patches_by_robot: Sequence[Patches], min_patches: int = 0) -> Array:
    """Return the patches of n robots as an array (patches, 4, n), or None if there are none.

    Args:
        patches_by_robot: Patches of friction on each robot's carpet.
        min_patches: Smallest length of the first axis; unused entries cover nothing.
    """
    n_patches = max(min_patches, *(len(patches) for patches in patches_by_robot))
    if not n_patches:
        return None
    unused_patches = [UNUSED_PATCH] * n_patches
    padded_patches = [[*patches, *unused_patches][:n_patches] for patches in patches_by_robot]
    return np.array(padded_patches).transpose(1, 2, 0)


def compute_drag(
    p: CarpetParameters, motion: ChassisMotion, load: Array, wheel_angle: Array, slip_speed: Array
) -> Drag:
    """Compute the drag of carpet and bearings, the slip compliance, and Coulomb's limit.

    Args:
        p: Parameters.
        motion: Motion of the centers of the wheels.
        load: Normal force of the wheels, (W, n) N.
        wheel_angle: Angles of the wheels, (W, n) rad; used for wheels that lack rollers.
        slip_speed: Speeds of the hubs relative to the rims, (W, n) rad/s.
    """
    xp = namespace(load)
    axle_x, axle_y = p.axle
    forward, sideways = motion.velocity
    axle_speed = forward * axle_x + sideways * axle_y
    rim_speed = sideways * axle_x - forward * axle_y + p.arm * motion.turn_rate
    friction = _compute_friction(p, motion, wheel_angle)
    speed = safe_sqrt(axle_speed * axle_speed + rim_speed * rim_speed)
    inverse_speed = 1 / xp.maximum(speed, AT_REST_M_S)
    # Direction of the wheel's travel along the axle and along the rim, shorter than 1 near rest
    axle_direction = axle_speed * inverse_speed
    rim_direction = rim_speed * inverse_speed
    # On ice, where mu < b, rollers slide instead of turning on their bearings.
    bearing_drag = (
        xp.minimum(p.roller_friction, friction)
        / xp.maximum(abs(axle_speed), AT_REST_M_S)
        * axle_speed
    )
    rolling_resistance = p.rolling_resistance
    if p.nap is not None:
        fiber_x, fiber_y = rotate(p.fiber_direction, motion.cosine, -motion.sine)
        travel_x, travel_y = rotate((axle_direction, rim_direction), axle_x, axle_y)
        rolling_resistance = p.rolling_resistance * (
            1 + p.nap * (travel_x * fiber_x + travel_y * fiber_y)
        )
    axle_force = load * (rolling_resistance * axle_direction + bearing_drag)
    rim_force = load * (rolling_resistance * rim_direction)
    force_x, force_y = rotate((axle_force, rim_force), axle_x, axle_y)
    rim_friction = safe_sqrt(friction * friction - bearing_drag * bearing_drag)
    contact_axle_speed = p.contact_ratio * axle_speed
    contact_speed = safe_sqrt(contact_axle_speed * contact_axle_speed + rim_speed * rim_speed)
    sliding_speed = p.sliding_slip * rim_friction * xp.maximum(contact_speed, AT_REST_M_S)
    softening = compute_softening(xp.minimum(abs(slip_speed) * p.radius / sliding_speed, 1.0))
    return Drag(
        force=(-sum_wheels(force_x), -sum_wheels(force_y)),
        moment=-p.arm * sum_wheels(rim_force),
        slip_compliance=p.creep_compliance * contact_speed / softening,
        torque_per_load=p.radius * rim_friction,
        axle_speed=axle_speed,
    )


def _compute_friction(p: CarpetParameters, motion: ChassisMotion, wheel_angle: Array) -> Array:
    """Return the coefficient of friction under each wheel, (W, n).

    Patches replace the carpet's coefficient. It is zero at angles where rollers are missing.
    """
    xp = namespace(wheel_angle)
    friction = p.friction * p.friction_factor
    if p.patches is not None:
        wheel_x, wheel_y = rotate(p.arm * p.axle, motion.cosine, motion.sine)
        for x, y, radius, patch_friction in p.patches:
            distance_x = motion.x + wheel_x - x
            distance_y = motion.y + wheel_y - y
            squared_distance = distance_x * distance_x + distance_y * distance_y
            # The square has the sign of the radius, so that an unused patch covers nothing.
            is_inside = squared_distance < radius * abs(radius)
            friction = xp.where(is_inside, patch_friction * p.friction_factor, friction)
    if p.missing_angle is not None:
        friction = xp.where(wheel_angle % (2 * np.pi) < p.missing_angle, 0.0, friction)
    return friction


def compute_torque_limit(torque_per_load: Array, load: Array) -> tuple[Array, Array]:
    """Return Coulomb's limit of the rims' torques, mu' N R, and the normal forces N in it.

    Args:
        torque_per_load: Largest torque over normal force, mu' R, (W, n) m.
        load: Normal force of the wheels, (W, n) N.

    Returns:
        Largest torque, (W, n) N m, and the normal force, at least `MIN_LOAD_N`, (W, n) N.
    """
    positive_load = namespace(load).maximum(load, MIN_LOAD_N)
    return torque_per_load * positive_load, positive_load
