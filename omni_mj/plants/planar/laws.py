"""Laws of a body on creeping wheels, as those in `omni_mj.onboard.laws`: for single numbers and for columns of them.

A wheel. The hub turns at w with its motor, whose inertia over a step h is 1 / G, the rim at r v / R with the body's
twist v, for contacts do not slide; r are the rim's direction and its arm. Rubber lets hub and rim differ by S times
the torque t between them. In a step of backward Euler, with e what the hub's speed would be without rubber,

    w = e - G t,    w - r v / R = S t        so        t = (e - r v / R) / (S + G).

The body. With M its inertia and that of the rims, and F what else acts,

    M (v - v_before) / h = F + sum r t / R,

which is linear in v: three equations. A wheel of which more torque would be asked than Coulomb's limit has that limit.
"""

from omni_mj.onboard.laws import Number
from omni_mj.worlds.build import CYCLE_S

RESTING = 1 - 400.0 * CYCLE_S  # of its speed a hub keeps in a cycle that dry friction stops; models/ssl_robot.xml


def free(speed: Number, give: Number, motor: Number, viscous: Number) -> Number:
    """Speed of a hub after a cycle without dry friction and rubber, rad/s.

    Args:
        speed: before, rad/s.
        give: speed per torque that a cycle gives it, rad/s / (N m).
        motor: torque, N m.
        viscous: friction per speed, N m s/rad.
    """
    return speed + give * (motor - viscous * speed)


def dry(free: Number, speed: Number, give: Number, torque: Number, soft: Number) -> Number:
    """Torque of dry friction, N m, that would bring a hub to rest.

    A hub that slows takes its rim along: rubber adds to its torque of the cycle before what it is then strained by.
    """
    return (free - RESTING * speed) / give - torque + (1 - RESTING) * speed / soft


def soft(impedance: Number, contact: Number) -> Number:
    """Slip over torque of rubber and contact, rad/s / (N m); `impedance` as in `Traction`, for an inertia of 1."""
    return CYCLE_S * (1 - impedance) / impedance + contact


def solved(
    a: tuple[Number, Number, Number, Number, Number, Number], b: tuple[Number, Number, Number]
) -> tuple[Number, Number, Number]:
    """X of a x = b for a symmetric 3 x 3 matrix a, its upper half row by row."""
    xx, xy, xz, yy, yz, zz = a
    p, q, r = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    s, t, u = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    scale = 1 / (xx * p + xy * q + xz * r)
    x, y, z = b
    return (p * x + q * y + r * z) * scale, (q * x + s * y + t * z) * scale, (r * x + t * y + u * z) * scale


def spinning(axle: Number, spin: Number, bearing: Number, spin_up: Number) -> Number:
    """Force along its axle on a wheel whose rollers are spun up and braked; see `rollers`.

    Args:
        axle: speed along the axle, m/s.
        spin: of the wheel, without sign, rad/s.
        bearing: N s/m.
        spin_up: N s/m per rad/s.
    """
    return -(bearing + spin_up * spin) * axle


def rolling(speed: Number, spin: Number, cost: Number, fades: Number) -> Number:
    """Torque on a wheel that turns over its rollers, N m; see `rollers.Standing`."""
    return -cost * speed / (1 + fades * spin)


def lifting(spin: Number, lift: Number, fades: Number) -> Number:
    """Load that a turning wheel takes over, N; see `rollers.Standing`."""
    return lift * spin * spin / (1 + fades * spin)
