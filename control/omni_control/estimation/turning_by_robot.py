"""`Turning` by loops over robots, and what its filter shares with that of positions; see `by_robot`."""

import numpy as np

from omni_control.estimation import compliance, evidence, turning
from omni_control.estimation.arrays import GivesArrays, TurningArrays
from omni_control.kinematics import Array, wrapped


def turned(
    i: int,
    t: TurningArrays,
    held: bool,
    after: float,
    seen: float,
    command: float,
    speed: float,
    shortfall: complex,
    sliding: float,
    change: float,
) -> tuple[float, float]:
    """Take in a frame of a heading; see `Turning.update`."""
    state, variance, of = t.state[i], t.variance[i], np.empty(turning.STATES)
    if not held:
        heading, rate, effort = state[0], state[1], state[4]
        slow, final, rubbing = answer(i, t, command, speed, shortfall)
        moved, later, decay = turning.go_on(rate, final, slow, t.period)
        maps, carried = np.empty((2, 8)), (1 - decay) * slow
        maps[0, 0], maps[0, 1] = carried, (t.period - carried) / effort
        maps[1, 0], maps[1, 1] = decay, (1 - decay) / effort
        tells = t.tells * evidence.evident(t.arm * abs(rate))
        acts = (
            (rate - later) / t.period,
            -(rate + later) / 2,
            -rubbing,
            -shortfall.real,
            -shortfall.imag,
            change * tells,
        )
        for k in range(6):
            maps[0, 2 + k], maps[1, 2 + k] = maps[0, 1] * acts[k], maps[1, 1] * acts[k]
        carry(variance, maps, t.kept)
        for k in range(turning.STATES):
            variance[k, k] += t.forget[k]
            state[k] = t.kept[k] * state[k] + t.renewed[k]
        variance[1, 1] += t.forget[1] * (evidence.restless(t.surprise[i]) - 1)
        variance[2, 2] += t.slid * sliding
        state[0], state[1] = heading + moved, later
    thought, doubt = state[turning.LATENCY], variance[turning.LATENCY, turning.LATENCY]
    if not np.isnan(seen):
        for k in range(turning.STATES):
            of[k] = variance[0, k] + after * variance[1, k]
        gain, surprise = 1 / (of[0] + after * of[1] + t.noise), wrapped(seen - (state[0] + after * state[1]))
        t.surprise[i] = evidence.surprised(t.surprise[i], gain * surprise**2)
        share = evidence.learned(sliding, t.surprise[i])
        for j in range(turning.STATES):
            left = 1 - share if j > 2 else 0.0
            state[j] += (1 - left) * gain * of[j] * surprise
            for k in range(turning.STATES):
                variance[j, k] -= gain * of[j] * of[k] * (1 - left * (1 - share if k > 2 else 0.0))
    within(state, 3, t.least, t.most)
    return state[turning.LATENCY] - thought, variance[turning.LATENCY, turning.LATENCY] / doubt


def answer(i: int, t: TurningArrays, command: float, speed: float, shortfall: complex) -> tuple[float, float, float]:
    """See `turning.answer`."""
    state = t.state[i]
    lag, effort, friction = state[3], state[4], state[5]
    pushed = turning.driven(state[2], state[6], state[7], shortfall)
    slower = effort * t.creeps * t.creep[i]
    return turning.answer(command, speed, pushed, lag / effort, slower, effort, friction, t.arm)


def pulled(
    g: GivesArrays, velocity: complex, rate: float, acceleration: complex, shortfall: complex, lag: float, creep: float
) -> float:
    """See `Compliance.turned`; zero for robots of whose wheels nothing is known."""
    moment, whole = 0.0, 0.0
    for w in range(len(g.rims)):
        load = compliance.loaded(acceleration, g.standing[w], g.shifting[w])
        stiff = compliance.stiffness(velocity, g.arm * rate, g.rims[w], load, lag, creep)
        moment += stiff * (shortfall.conjugate() * g.rims[w]).real
        whole += stiff
    return g.share * moment / whole if whole > 0 else 0.0


def carry(variance: Array, maps: Array, kept: Array) -> None:
    """Pass a variance (m, m) on by a matrix of the diagonal `kept` (m,), and `maps` (r, k) in its last k columns."""
    size, (rows, width) = len(variance), maps.shape
    first, half = size - width, np.empty_like(variance)
    for j in range(size):
        for k in range(size):
            half[j, k] = kept[j] * variance[j, k]
    for j in range(rows):
        for m in range(width):
            for k in range(size):
                half[j, k] += maps[j, m] * variance[first + m, k]
    for j in range(size):
        for k in range(size):
            variance[j, k] = half[j, k] * kept[k]
        for k in range(rows):
            total = variance[j, k]
            for m in range(width):
                total += half[j, first + m] * maps[k, m]
            variance[j, k] = total


def within(state: Array, first: int, least: Array, most: Array) -> None:
    """Keep the last states, from `first` on, where they can be."""
    for k in range(len(least)):
        state[first + k] = min(max(state[first + k], least[k]), most[k])
