"""A cycle of bodies and wheels of all robots at once, by numpy; `by_robot` is the same, robot by robot."""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.onboard.traction import Traction
from omni_mj.plants.planar import laws
from omni_mj.plants.planar.arrays import Motion, Plane, Robots
from omni_mj.worlds.build import CYCLE_S

PASSES = 3  # wheels that turn out to slide let others slide; more than two are rare


def drag(r: Robots, m: Motion, traction: Traction, push: Plane, downhill: Plane) -> None:
    """Look at what drags and pushes robots, which changes slowly.

    Args:
        r: robots.
        m: how they move; written.
        traction: theirs, whose centres are the robots'.
        push: on chassis, in the world's axes, (n,) N.
        downhill: on all of a robot, in the world's axes, (n,) N.
    """
    heading = np.exp(1j * m.heading)
    body = m.velocity * heading.conj() + 1j * m.rate * r.middle
    place, velocity = m.place + r.middle * heading, body * heading
    half, none = m.heading / 2, np.zeros_like(m.heading)
    quaternion = np.stack([np.cos(half), none, none, np.sin(half)], axis=1)
    twist = np.stack([velocity.real, velocity.imag, none, none, none, m.rate], axis=1)
    traction.travel(np.stack([place.real, place.imag], axis=1), quaternion, twist, m.load, m.angle)
    rims = m.speed - m.slip
    spin = np.abs(rims)
    aside = laws.spinning((body[:, None] * r.outward.conj()).real, spin, r.bearing, r.spin_up)
    along = laws.rolling(rims, spin, r.cost, r.cost_fades) / r.lever
    each, wrench = (aside + 1j * along) * r.outward, traction.wrench
    m.push[:] = push * heading.conj()
    m.ground[:] = (wrench[:, 0] + 1j * wrench[:, 1]) * heading.conj() + each.sum(1)
    m.force[:] = m.ground + m.push + downhill * heading.conj()
    m.moment[:] = wrench[:, 5] + (r.contacts.conj() * each).imag.sum(1) + (r.pushed.conj() * m.push).imag
    raised = laws.lifting(spin, r.lift, r.lift_fades)
    x, y = (r.contacts.real * raised).sum(1), (r.contacts.imag * raised).sum(1)
    m.raised[:] = raised - r.even * raised.sum(1, keepdims=True) - r.ahead * x[:, None] - r.aside * y[:, None]


def move(r: Robots, m: Motion, traction: Traction, motor: Array) -> None:
    """Move on by a cycle, with torques of the motors on the hubs, (n, W) N m."""
    traction.press(m.load)
    limit = traction.limit
    free = laws.free(m.speed, r.give, motor, r.viscous)
    soft = laws.soft(traction.impedance, r.contact)
    dry = laws.dry(free, m.speed, r.give, m.torque, soft)
    rests = np.abs(dry) <= r.dry
    end = np.where(rests, laws.RESTING * m.speed, free - r.give * np.copysign(r.dry, dry))
    give = np.where(rests, 0.0, r.give)
    pull = 1 / (soft + give)

    heading = np.exp(1j * m.heading)
    body, held = m.velocity * heading.conj(), np.zeros_like(pull)
    xx, xy, xz, yy, yz, zz = r.inertia.T
    x, y, z = body.real, body.imag, m.rate
    momentum = (
        xx * x + xy * y + xz * z + m.force.real, xy * x + yy * y + yz * z + m.force.imag,
        xz * x + yz * y + zz * z + m.moment,
    )  # fmt: skip
    twist = _twist(r.inertia, momentum, pull, pull * end, r.squares, r.rims)
    rims = np.einsum("rwk,rk->rw", r.rims, twist)
    torque = pull * (end - rims)
    over = np.abs(torque) > limit
    for _ in range(PASSES):
        rows = np.flatnonzero(over.any(1))
        if not len(rows):
            break
        held = np.where(over, np.copysign(limit, torque), held)
        pull[over] = 0.0
        some = pull[rows]
        twist[rows] = _twist(
            r.inertia[rows], tuple(each[rows] for each in momentum), some, some * end[rows] + held[rows],
            r.squares[rows], r.rims[rows],
        )  # fmt: skip
        rims[rows] = np.einsum("rwk,rk->rw", r.rims[rows], twist[rows])
        torque = np.where(held == 0, pull * (end - rims), held)
        over = (np.abs(torque) > limit) & (held == 0)
    m.torque[:] = np.minimum(np.maximum(torque, -limit), limit)

    m.seen_angle[:], m.seen_rate[:] = m.angle, m.rate
    m.speed[:] = end - give * m.torque
    m.angle[:] += CYCLE_S * m.speed
    m.slip[:] = m.speed - rims
    after = twist[:, 0] + 1j * twist[:, 1]
    m.velocity[:], m.rate[:] = after * heading, twist[:, 2]
    m.place[:] += CYCLE_S * m.velocity
    m.heading[:] += CYCLE_S * m.rate
    pulled = np.einsum("rw,rwk->kr", m.torque, r.rims)
    ahead, aside = pulled[0] + m.ground.real, pulled[1] + m.ground.imag
    tilt = r.height * (ahead + 1j * aside) - r.pushed_height * m.push
    m.tilt[:] += tilt
    shifted = r.ahead * tilt.real[:, None] + r.aside * tilt.imag[:, None]
    m.load[:] = np.maximum(r.weight - shifted + m.raised, 0.0)


def _twist(inertia: Array, momentum: tuple[Array, ...], pull: Array, ends: Array, squares: Array, rims: Array) -> Array:
    """Twists (k, 3) of k robots that wheels pull."""
    x, y, z = np.einsum("rw,rwk->kr", ends, rims)
    p, q, r = momentum
    a = inertia + np.einsum("rw,rwk->rk", pull, squares)
    return np.stack(laws.solved(tuple(a.T), (p + x, q + y, r + z)), axis=1)
