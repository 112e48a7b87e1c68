"""A cycle of bodies and wheels of all robots at once, by numpy; `by_robot` is the same by loops."""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.onboard import laws as onboard
from omni_mj.onboard.arrays import total
from omni_mj.onboard.traction import Traction
from omni_mj.plants.planar import laws
from omni_mj.plants.planar.arrays import Motion, Robots
from omni_mj.worlds.build import CYCLE_S

Twist = tuple[Array, Array, Array]  # ahead, aside, turning

PASSES = 3  # wheels that turn out to slide let others slide; more than two are rare
SETTLES = 40  # half of what is left and less each time


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
    body = _plane(m.twist) + m.twist[2] * (1j * middle)
    traction.go(_plane(m.place) + middle * facing, facing, body, m.twist[2], m.load.T, m.angle.T)
    wrench = _plane(traction.wrench.T)
    spin = np.abs(m.rims)
    axle = (body * outward.conj()).real
    m.drift[:] = laws.drifting(axle, m.twist[2], r.lever)
    aside = laws.spinning(axle, spin, r.bearing, r.spin_up, r.spin_fades)
    along = laws.rolling(m.rims, spin, r.cost, r.cost_fades) / r.lever
    each, upright = _plane((aside, along)) * outward, facing.conj()
    pushed, ground, (x, y) = _plane(push) * upright, wrench * upright + total(each), r.contacts
    whole, tilting = ground + pushed + _plane(downhill) * upright, r.height * ground - r.pushed_height * pushed
    m.tilting[0], m.tilting[1], m.force[0], m.force[1] = tilting.real, tilting.imag, whole.real, whole.imag
    turning = total(x * each.imag - y * each.real)
    m.force[2] = traction.wrench[:, 5] + turning + (r.pushed[0] * pushed.imag - r.pushed[1] * pushed.real)
    m.ripple[:] = laws.rippling(spin, r.ripple, r.ripple_grows)
    raised = laws.lifting(spin, r.lift, r.lift_fades)
    sums = moments(r, raised)
    np.add(r.weight, raised - _shared(r, sums), out=m.standing)


def move(r: Robots, m: Motion, rim_friction: Array, softness: Array, motor: Array) -> None:
    """Move on by a cycle.

    Args:
        r: robots.
        m: how they move; written.
        rim_friction: see `omni_mj.onboard.arrays.RimArrays`, (W, n).
        softness: the same.
        motor: torques of the motors, at the hubs, (W, n) N m.
    """
    pressed = onboard.pressed(m.load)
    limit, soft = rim_friction * pressed, laws.soft(softness, pressed, r.contact)
    end, give = laws.hub(m.speed, motor, m.torque, soft, r.give, r.viscous, r.dry)
    pull = 1 / (soft + give)
    end -= m.drift
    momentum = laws.momentum(tuple(r.rows), tuple(r.wheeling), tuple(m.twist)) + m.force
    twist = _twist(r.inertia, momentum, pull, pull * end, r.squares, r.rims)
    rims = _rims(r.rims, twist, m.rims)
    torque = pull * (end - rims)
    over = np.abs(torque) > limit
    held = np.zeros_like(pull) if np.count_nonzero(over) else pull
    for _ in range(PASSES if held is not pull else 0):
        rows = np.flatnonzero(over.any(0))
        if not len(rows):
            break
        # Taking many out costs more than what it saves; those of which no other wheel slides get what they have.
        some = rows if len(rows) < over.shape[1] / 4 else slice(None)
        np.copysign(limit, torque, out=held, where=over)
        pull[over] = 0.0
        few, of = pull[:, some], r.rims[..., some]
        ends = few * end[:, some] + held[:, some]
        found = _twist(r.inertia[:, some], momentum[:, some], few, ends, r.squares[..., some], of)
        for each, new in zip(twist, found, strict=True):
            each[some] = new
        rims[:, some] = _rims(of, found)
        torque = np.where(held == 0, pull * (end - rims), held)
        over = (np.abs(torque) > limit) & (held == 0)
    if held is pull:
        m.torque[:] = torque
    else:
        np.minimum(np.maximum(torque, -limit, out=m.torque), limit, out=m.torque)

    m.seen_angle[:], m.seen_rate[:] = m.angle, m.twist[2]
    np.subtract(end, give * m.torque, out=m.speed)
    np.add(m.speed, m.drift, out=m.speed)
    rims += m.drift
    np.add(m.angle, CYCLE_S * m.speed, out=m.angle)
    tilt = r.height * total(m.torque[:, None] * r.rims[:, :2]) + m.tilting
    np.add(m.tilt, tilt, out=m.tilt)
    np.add(m.turns, r.passing * rims, out=m.turns)
    wave = laws.passing(m.turns)
    ripple = m.ripple * wave
    pressed = moments(r, ripple)
    pressed[1:] += tilt
    yields = laws.swaying(pressed, m.sway, m.sway_rate, r.spring, r.damper)
    stiffer = _stiffer(r, wave, pressed - r.carried * yields)
    ripple -= stiffer
    pressed -= moments(r, stiffer)
    yields = laws.swaying(pressed, m.sway, m.sway_rate, r.spring, r.damper)
    np.add(m.sway_rate, CYCLE_S * yields, out=m.sway_rate)
    np.add(m.sway, CYCLE_S * m.sway_rate, out=m.sway)
    pressed -= r.carried * yields
    np.maximum(m.standing + ripple - _shared(r, pressed), 0.0, out=m.load)

    (x, y, rate), (cosine, sine), turn = twist, m.facing, CYCLE_S * twist[2]
    m.place[0] += CYCLE_S * (cosine * x - sine * y)
    m.place[1] += CYCLE_S * (sine * x + cosine * y)
    np.add(m.heading, turn, out=m.heading)
    c, s = laws.small(turn)
    m.facing[0], m.facing[1] = cosine * c - sine * s, sine * c + cosine * s
    m.twist[0], m.twist[1], m.twist[2] = c * x + s * y, c * y - s * x, rate


def falls(r: Robots, m: Motion, cycles: int) -> np.ndarray:
    """Which robots (n,) would topple in a frame of so many cycles.

    Over its wheels a robot stands as long as the point is between them that balances weight and forces: within the
    frame it may leave them, on the mean it may not.
    """
    outside: np.ndarray = laws.falls(tuple(r.corners), tuple(r.edges), tuple(m.tilt), r.weight.sum(0) * cycles)
    return np.asarray(outside.any(0))


def where(m: Motion) -> Array:
    """What is a number (n,) where a robot's pose is one."""
    return np.asarray(m.place[0] + m.place[1] + m.heading)


def moments(r: Robots, load: Array) -> Array:
    """Sums over the wheels of their loads (W, n), and of the loads times how far ahead and aside wheels are, (3, n)."""
    found = np.empty((3, load.shape[1]))
    found[0], found[1:] = total(load), total((r.contacts * load).swapaxes(0, 1))
    return found


def at_rest(r: Robots) -> Array:
    """How robots sway, (3, n), that stand with a roller of each wheel at the bottom."""
    wave = laws.passing(np.zeros_like(r.ripple))
    ripple = moments(r, r.ripple * wave)
    pressed = ripple
    for _ in range(SETTLES):
        pressed = ripple - moments(r, _stiffer(r, wave, ripple - r.carried * (ripple - pressed)))
    return pressed / r.spring


def _shared(r: Robots, sums: Array) -> Array:
    """What wheels take, (W, n) N, of a load and two moments of it, (3, n)."""
    return np.asarray(r.even * sums[0] + r.ahead * sums[1] + r.aside * sums[2])


def _stiffer(r: Robots, wave: Array, yields: Array) -> Array:
    """What wheels carry less, (W, n) N, that give way by a force and two moments (3, n) on stiffer springs."""
    return r.stiffens * wave * _shared(r, yields)


def _twist(inertia: Array, momentum: Array, pull: Array, ends: Array, squares: Array, rims: Array) -> Twist:
    """Twists, (k,) each, of k robots that wheels pull."""
    a, b = inertia + total(pull[:, None] * squares), momentum + total(ends[:, None] * rims)
    return laws.solved(tuple(a), tuple(b))


def _rims(rims: Array, twist: Twist, out: Array | None = None) -> Array:
    """Angular speeds (W, k) of the rims of k robots with twists, (k,) each."""
    found: Array = np.multiply(rims[:, 0], twist[0], out=out)
    found += rims[:, 1] * twist[1]
    found += rims[:, 2] * twist[2]
    return found


def _plane(vectors: Array | tuple[Array, Array]) -> np.ndarray:
    """Vectors (2 or more, ..., n) as complex numbers (..., n)."""
    found = np.empty(vectors[0].shape, complex)
    found.real, found.imag = vectors[0], vectors[1]
    return found
