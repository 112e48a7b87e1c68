"""A cycle of bodies and wheels of all robots at once, by numpy; `by_robot` is the same by loops."""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.onboard import laws as onboard
from omni_mj.onboard.arrays import total
from omni_mj.onboard.traction import Traction
from omni_mj.plants.planar import laws
from omni_mj.plants.planar.arrays import Motion, Robots
from omni_mj.worlds.build import CYCLE_S

Twist = tuple[Array, Array, Array]  # or the momentum of one: ahead, aside, turning

PASSES = 3  # wheels that turn out to slide let others slide; more than two are rare


def drag(r: Robots, m: Motion, traction: Traction, push: Array, downhill: Array) -> None:
    """Look at what drags and pushes robots, which changes slowly.

    Args:
        r: robots.
        m: how they move; written.
        traction: theirs, whose centres are the robots'.
        push: on chassis, in the world's axes, (2, n) N.
        downhill: on all of a robot, in the world's axes, (2, n) N.
    """
    facing, middle, outward = _plane(m.facing), _plane(r.middle), r.outward[:, None]
    body = _plane(m.twist) + 1j * m.twist[2] * middle
    traction.go(_plane(m.place) + middle * facing, facing, body, m.twist[2], m.load.T, m.angle.T)
    rims = m.speed - m.slip
    spin = np.abs(rims)
    aside = laws.spinning((body * outward.conj()).real, spin, r.bearing, r.spin_up)
    along = laws.rolling(rims, spin, r.cost, r.cost_fades) / r.lever
    each, wrench = (aside + 1j * along) * outward, traction.wrench
    upright = facing.conj()
    pushed, ground = _plane(push) * upright, (wrench[:, 0] + 1j * wrench[:, 1]) * upright + total(each)
    whole, (x, y) = ground + pushed + _plane(downhill) * upright, r.contacts
    m.push[0], m.push[1], m.ground[0], m.ground[1] = pushed.real, pushed.imag, ground.real, ground.imag
    m.force[0], m.force[1] = whole.real, whole.imag
    turning = total(x * each.imag - y * each.real)
    m.force[2] = wrench[:, 5] + turning + (r.pushed[0] * pushed.imag - r.pushed[1] * pushed.real)
    raised = laws.lifting(spin, r.lift, r.lift_fades)
    m.raised[:] = raised - r.even * total(raised) - r.ahead * total(x * raised) - r.aside * total(y * raised)


def move(r: Robots, m: Motion, rim_friction: Array, softness: Array, current: Array) -> None:
    """Move on by a cycle.

    Args:
        r: robots.
        m: how they move; written.
        rim_friction: see `omni_mj.onboard.arrays.RimArrays`, (W, n).
        softness: the same.
        current: of the motors, (W, n) A.
    """
    pressed = onboard.pressed(m.load)
    limit, soft = rim_friction * pressed, laws.soft(softness, pressed, r.contact)
    end, give = laws.hub(m.speed, r.torque_constant * current, m.torque, soft, r.give, r.viscous, r.dry)
    pull = 1 / (soft + give)
    momentum = laws.momentum(tuple(r.inertia), tuple(m.twist), tuple(m.force))
    twist = _twist(r.inertia, momentum, pull, pull * end, r.squares, r.rims)
    rims = _rims(r.rims, twist)
    torque = pull * (end - rims)
    over = np.abs(torque) > limit
    held = np.zeros_like(pull) if over.any() else pull
    for _ in range(PASSES):
        rows = np.flatnonzero(over.any(0))
        if not len(rows):
            break
        # Taking many out costs more than what it saves; those of which no other wheel slides get what they have.
        some = rows if len(rows) < over.shape[1] / 4 else slice(None)
        np.copysign(limit, torque, out=held, where=over)
        pull[over] = 0.0
        few, of = pull[:, some], r.rims[..., some]
        ends, before = few * end[:, some] + held[:, some], tuple(each[some] for each in momentum)
        found = _twist(r.inertia[:, some], before, few, ends, r.squares[..., some], of)
        for each, new in zip(twist, found, strict=True):
            each[some] = new
        rims[:, some] = _rims(of, found)
        torque = np.where(held == 0, pull * (end - rims), held)
        over = (np.abs(torque) > limit) & (held == 0)
    np.minimum(np.maximum(torque, -limit, out=m.torque), limit, out=m.torque)

    m.seen_angle[:], m.seen_rate[:] = m.angle, m.twist[2]
    np.subtract(end, give * m.torque, out=m.speed)
    np.add(m.angle, CYCLE_S * m.speed, out=m.angle)
    np.subtract(m.speed, rims, out=m.slip)
    tilt = r.height * (total(m.torque * r.rims[:2]) + m.ground) - r.pushed_height * m.push
    np.add(m.tilt, tilt, out=m.tilt)
    np.maximum(r.weight - (r.ahead * tilt[0] + r.aside * tilt[1]) + m.raised, 0.0, out=m.load)

    (x, y, rate), (cosine, sine), turn = twist, m.facing, CYCLE_S * twist[2]
    m.place[0] += CYCLE_S * (cosine * x - sine * y)
    m.place[1] += CYCLE_S * (sine * x + cosine * y)
    np.add(m.heading, turn, out=m.heading)
    c, s = laws.small(turn)
    m.facing[0], m.facing[1] = cosine * c - sine * s, sine * c + cosine * s
    m.twist[0], m.twist[1], m.twist[2] = c * x + s * y, c * y - s * x, rate


def _twist(inertia: Array, momentum: Twist, pull: Array, ends: Array, squares: Array, rims: Array) -> Twist:
    """Twists, (k,) each, of k robots that wheels pull."""
    a, (x, y, z), (p, q, u) = inertia + total(pull * squares), total(ends * rims), momentum
    return laws.solved(tuple(a), (p + x, q + y, u + z))


def _rims(rims: Array, twist: Twist) -> Array:
    """Angular speeds (W, k) of the rims of k robots with twists, (k,) each."""
    found: Array = rims[0] * twist[0]
    found += rims[1] * twist[1]
    found += rims[2] * twist[2]
    return found


def _plane(vectors: Array) -> np.ndarray:
    """Vectors (2 or more, n) as complex numbers (n,)."""
    found: np.ndarray = vectors[0] + 1j * vectors[1]
    return found
