"""Laws of a body on creeping wheels, as those in `omni_mj.onboard.laws`: for single numbers and for columns of them.

A wheel. The hub turns at w with its motor, whose inertia over a step h is 1 / G, the rim at r v / R with the body's
twist v, for contacts do not slide; r are the rim's direction and its arm. Rubber lets hub and rim differ by S times
the torque t between them. In a step of backward Euler, with e what the hub's speed would be without rubber,

    w = e - G t,    w - r v / R = S t        so        t = (e - r v / R) / (S + G).

The body. With M its inertia, that of the rims and that of rollers that turn along the axles, and F what else acts,

    M (v - v_before) / h = F + sum r t / R,

which is linear in v: three equations. A wheel of which more torque would be asked than Coulomb's limit has that limit.
Vectors are along the robot's axes. In v_before the mass keeps its velocity in the world, and so its direction turns in
these axes; rims and rollers keep their speeds, and so theirs does not.

The load. Rollers that pass press unevenly, by p_i at a wheel at a height, so that sum p_i (1, x_i, y_i) is a force up
and two moments; p is that, with the moments of what pulls at the robot. The robot sways up, ahead and aside on the
contacts, count of them at a wheel, each of them a spring K, a damper c and a mass m (`omni_mj.worlds.contact`). With
the mass M of the robot, and s for the sway times all mass,

    s'' = p - d s' - k s,    (k, d) = sum count (K, c) / (M + sum count m),

and M s'' / (M + sum count m) of p is left, for wheels to share as they share weight and moments; of each p_i they keep
beside that what no motion of the body feels. Both moments are reckoned as if mass and springs were spread alike.
"""

import numpy as np

from omni_mj.onboard.laws import Number, Truth, where
from omni_mj.worlds.build import CYCLE_S
from omni_mj.worlds.contact import FRICTION_RATE_HZ

# How late contacts see axes turn, less the cycle that bodies are late here too.
BEHIND_S = 1 / FRICTION_RATE_HZ - CYCLE_S
RESTING = 1 - 400.0 * CYCLE_S  # of its speed a hub keeps in a cycle that dry friction stops; models/ssl_robot.xml


def soft(softness: Number, load: Number, contact: Number) -> Number:
    """Slip over torque of rubber and contact, rad/s / (N m); `softness` is the rubber's, times the load."""
    return softness / load + contact


def hub(
    speed: Number, motor: Number, torque: Number, soft: Number, give: Number, viscous: Number, dry: Number
) -> tuple[Number, Number]:
    """A hub with its friction. It rests where dry friction could bring it to rest within the cycle.

    A hub that slows takes its rim along: rubber adds to its torque of the cycle before what it is then strained by.

    Args:
        speed: before, rad/s.
        motor: torque, N m.
        torque: of rubber, N m, in the cycle before.
        soft: see `soft`.
        give: speed per torque that a cycle gives the hub, rad/s / (N m).
        viscous: friction per speed, N m s/rad.
        dry: greatest dry friction, N m.

    Returns:
        The hub's speed after the cycle without rubber, rad/s, and its speed per torque of rubber.
    """
    driven = motor - viscous * speed
    needed = driven - torque + (1 - RESTING) * speed * (1 / give + 1 / soft)
    rests = np.abs(needed) <= dry
    end = where(rests, RESTING * speed, speed + give * (driven - np.copysign(dry, needed)))
    return end, where(rests, 0.0, give)


def momentum(
    inertia: tuple[Number, Number, Number], wheels: tuple[Number, Number], twist: tuple[Number, Number, Number]
) -> Number:
    """Momentum over a cycle, by a row of the inertia, or all at once by its columns.

    Args:
        inertia: of all, over a cycle, kg/s.
        wheels: of rims and rollers alone, but for that about the vertical, kg.
        twist: as it was in the world, m/s and rad/s: that of the wheels had not turned yet with the robot's axes.
    """
    (x, y, z), (own_x, own_y), (ahead, aside, turning) = inertia, wheels, twist
    return x * ahead + y * aside + z * turning + turning * (own_y * ahead - own_x * aside)


def small(angle: Number) -> tuple[Number, Number]:
    """Cosine and sine of the angle by which a robot turns in a cycle, rad, by their series.

    Exact below 0.03, which is 30 rad/s. At ten times as much 2e-9 are missing, for a frame: then the heading says.
    """
    square = angle * angle
    cosine = 1 - square * (1 / 2 - square * (1 / 24 - square * (1 / 720)))
    return cosine, angle * (1 - square * (1 / 6 - square * (1 / 120 - square * (1 / 5040))))


def solved(
    a: tuple[Number, Number, Number, Number, Number, Number], b: tuple[Number, Number, Number]
) -> tuple[Number, Number, Number]:
    """X of a x = b for a symmetric positive definite 3 x 3 matrix a, its upper half row by row, by a = L D L'."""
    xx, xy, xz, yy, yz, zz = a
    x, y, z = b
    p, q = xy / xx, xz / xx
    yy, yz = yy - p * xy, yz - p * xz
    r = yz / yy
    y = y - p * x
    z = (z - q * x - r * y) / (zz - q * xz - r * yz)
    y = y / yy - r * z
    return x / xx - p * y - q * z, y, z


def spinning(axle: Number, spin: Number, bearing: Number, spin_up: Number, fades: Number) -> Number:
    """Force along its axle on a wheel whose rollers are spun up and braked; see `rollers.Standing`.

    Args:
        axle: speed along the axle, m/s.
        spin: of the wheel, without sign, rad/s.
        bearing: N s/m.
        spin_up: N s/m per rad/s.
        fades: s/rad.
    """
    return -(bearing + spin_up * spin) / (1 + fades * spin) * axle


def drifting(axle: Number, turning: Number, lever: Number) -> Number:
    """How much faster a rim turns than the carpet goes by as its robot turns, rad/s.

    A contact's friction is a damper with the time constant 1 / b that knows nothing of axes which turn (MuJoCo leaves
    out what a Jacobian's change does): the speed along the axle, which rollers take, appears along the rim.

    Args:
        axle: speed along the axle, m/s.
        turning: of the robot, rad/s.
        lever: from the axle to the carpet, m.
    """
    return axle * turning * BEHIND_S / lever


def rolling(speed: Number, spin: Number, cost: Number, fades: Number) -> Number:
    """Torque on a wheel that turns over its rollers, N m; see `rollers.Standing`."""
    return -cost * speed / (1 + fades * spin)


def passing(turns: Number) -> Number:
    """A wave that is 1/16 with a roller at the bottom and -1/16 between two: arcs of parabolas in place of a cosine.

    Args:
        turns: of the wheel, in rollers.
    """
    away = 0.25 - np.abs(turns - np.rint(turns))
    return away * (0.5 - np.abs(away))


def swaying(pressed: Number, sway: Number, rate: Number, spring: Number, damper: Number) -> Number:
    """How a robot sways on wheels that press unevenly, s'' = p - d s' - k s: a force, which is mass times acceleration.

    Args:
        pressed: force up of all wheels at a height, or moment of it and of what pulls at the robot, p.
        sway: s.
        rate: s'.
        spring: k, of all wheels over the mass that moves, 1/s^2.
        damper: d, the same, 1/s.
    """
    return pressed - damper * rate - spring * sway


def rippling(spin: Number, ripple: Number, grows: Number) -> Number:
    """Load that a wheel at a height takes over as rollers pass, N, over `passing`; see `rollers.Standing`."""
    return ripple + grows * spin


def lifting(spin: Number, lift: Number, fades: Number) -> Number:
    """Load that a turning wheel takes over, N; see `rollers.Standing`."""
    return lift * spin * spin / (1 + fades * spin)


def turned(cosine: Number, sine: Number, x: Number, y: Number) -> tuple[Number, Number]:
    """A vector along the world's axes, of a robot whose heading has this cosine and sine."""
    return cosine * x - sine * y, sine * x + cosine * y


def falls(
    corner: tuple[Number, Number], edge: tuple[Number, Number], tilt: tuple[Number, Number], weight: Number
) -> Truth:
    """Whether the point that balances weight and forces is outside of an edge of the polygon of the wheels.

    Args:
        corner: where the edge begins, m.
        edge: to where it ends, counter-clockwise, m.
        tilt: moments that tilt the robot back and aside, summed over cycles, N m.
        weight: the same, N.
    """
    (x, y), (along, across), (back, aside) = corner, edge, tilt
    return along * (aside + y * weight) > across * (back + x * weight)
