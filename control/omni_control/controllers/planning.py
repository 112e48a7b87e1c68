"""Commands that set out in time; and what adaptive-comp-flc commands, by loops over robots, for a compiler."""

from typing import Any

import numpy as np

from omni_control.estimation import turning
from omni_control.estimation.arrays import GivesArrays, PlantArrays, TurningArrays
from omni_control.estimation.by_robot import Axes, axes
from omni_control.estimation.motion import Plane, pairs, plane, starting
from omni_control.estimation.turning_by_robot import answer, pulled
from omni_control.fuzzy.by_robot import velocity
from omni_control.fuzzy.tables import Tables
from omni_control.kinematics import Array, Number, wrapped

NONE_M = 1e-12  # an error that is none


def in_time(coming: Plane, step: float) -> Plane:
    """The command of now from which those that come are missed by least, if it changes by `step` a frame at most.

    A command of the k-th frame from now is missed by as much as it is farther than k steps. Where none would be missed,
    the command of now is as it is wanted. Otherwise it is the one that halves the largest miss, between what is wanted
    now and what will be: the middle of the highest and the lowest that come, each less what can be made up for until
    then. That is done along the direction in which most would be missed, and across it.

    Args:
        coming: commands that are wanted, now first, (frames, n) m/s.
        step: largest change in a frame, m/s.

    Returns:
        (n,) m/s.
    """
    ways, reach = coming - coming[0], step * np.arange(len(coming))[:, None]
    sizes = np.abs(ways)
    worst = (sizes - reach).argmax(0), np.arange(coming.shape[1])
    along = np.divide(ways[worst], sizes[worst], out=np.ones_like(coming[0]), where=sizes[worst] > 0)
    parts, reach = pairs(ways * along.conj()), reach[..., None]
    return coming[0] + plane((parts + reach).min(0) + (parts - reach).max(0)) / 2 * along


def lead(effort: Number, late: Number, stiffness: float) -> Number:
    """Lead times T, s, of efforts g and time constants lag / g, for a correction of a stiffness k, 1/s."""
    lag = effort * late
    return 2 * lag / (effort + np.sqrt(effort**2 + 2 * stiffness * lag))


def fade(correction: Any, error: Any, period: float) -> Number:
    """What a period leaves of a correction, m/s, as it takes an error away, m: fast near none, and slowly from afar."""
    return np.exp(-period * np.abs(correction) / np.maximum(np.abs(error), NONE_M))


def ask(law: Axes, before: complex, after: complex, heading: complex, duration: float) -> complex:
    """See `Motion.ask`."""
    back, speed, mean = heading.conjugate(), abs(before), (before + after) / 2
    v, later, towards = before * back, after * back, mean * back / starting(abs(mean))
    decay_0 = np.exp(-duration / (law.still[0] + law.slower[0] * speed))
    decay_1 = np.exp(-duration / (law.still[1] + law.slower[1] * speed))
    ahead = ((later.real - decay_0 * v.real) / (1 - decay_0) + law.rubbed[0] * towards.real) * law.effort[0]
    aside = ((later.imag - decay_1 * v.imag) / (1 - decay_1) + law.rubbed[1] * towards.imag) * law.effort[1]
    return complex(ahead, aside) * heading


def _in_time(coming: Plane, step: float) -> complex:
    """See `in_time`; of one robot, (frames,)."""
    worst, along = 0.0, complex(1.0)
    for k in range(1, len(coming)):
        size = abs(coming[k] - coming[0])
        if size - step * k > worst:
            worst, along = size - step * k, (coming[k] - coming[0]) / size
    low_x, low_y, high_x, high_y = 0.0, 0.0, 0.0, 0.0
    for k in range(1, len(coming)):
        way, reach = (coming[k] - coming[0]) * along.conjugate(), step * k
        low_x, low_y = max(low_x, way.real - reach), max(low_y, way.imag - reach)
        high_x, high_y = min(high_x, way.real + reach), min(high_y, way.imag + reach)
    return coming[0] + complex((high_x + low_x) / 2, (high_y + low_y) / 2) * along


def plan(
    t: TurningArrays,
    p: PlantArrays,
    g: GivesArrays,
    poses: Array,
    twists: Array,
    position: Plane,
    reached: Plane,
    heading: Array,
    rules: Tables,
    ranges: tuple[float, float],
    stiffness: float,
    step: float,
    gain: float,
    wanted: Array,
) -> None:
    """Commands; see `AdaptiveCompFlc`, by the same laws as there.

    Args:
        t: headings, as identified.
        p: positions and their law, same.
        g: how wheels give way.
        poses: of the reference, from the frame before the one in which the command acts, (frames + 2, n, 3).
        twists: same.
        position: that robots will have, (n,) m.
        reached: velocity, same, m/s.
        heading: same, rad.
        rules: of the correction.
        ranges: of it, see `FuzzyLaw`.
        stiffness: same, 1/s.
        step: by which commands may change per frame, m/s.
        gain: of the heading hold, 1/s.
        wanted: commands (n, 3); written.
    """
    frames, period = len(poses) - 2, p.period
    coming = np.empty(frames, np.complex128)
    for i in range(len(wanted)):
        law, state = axes(i, p), p.state[i]
        otherwise = heading[i] - poses[1, i, 2]  # facing as the robot will, not as it should
        edge, leaving, face = 0j, 0j, 0j
        for k in range(frames):
            there, past = complex(twists[k + 1, i, 0], twists[k + 1, i, 1]), complex(twists[k, i, 0], twists[k, i, 1])
            before, after = (past + there) / 2, (there + complex(twists[k + 2, i, 0], twists[k + 2, i, 1])) / 2
            facing = np.exp(1j * (poses[k + 1, i, 2] + twists[k + 1, i, 2] * (period / 2) + otherwise))
            coming[k] = ask(law, before, after, facing, period)
            if k == 0:
                edge, leaving, face = before, after, facing

        behind, speed = (edge - reached[i]) * face.conjugate(), abs(edge)
        ahead = lead(law.effort[0], law.still[0] + law.slower[0] * speed, stiffness) * behind.real
        aside = lead(law.effort[1], law.still[1] + law.slower[1] * speed, stiffness) * behind.imag
        error = complex(poses[1, i, 0], poses[1, i, 1]) - position[i] + complex(ahead, aside) * face
        correction = complex(*velocity(rules, ranges, error.real, error.imag))
        fading = fade(correction, error, period)
        for k in range(frames):
            coming[k] += fading**k * correction
        command = _in_time(coming, step)
        planned = command - correction
        sent = (command - complex(state[4], state[5])) * np.exp(1j * state[6])

        along, missing = edge * face.conjugate(), (planned - edge) * face.conjugate()
        gained = (leaving - edge) * face.conjugate() / period
        first = (twists[0, i, 2] + twists[1, i, 2]) / 2
        last = (twists[1, i, 2] + twists[2, i, 2]) / 2
        slow, _, rubbing = answer(i, t, (first + last) / 2, abs(edge), missing)
        turned = turning.driven(t.state[i, 2], t.state[i, 6], t.state[i, 7], missing)
        turn = turning.asked(first, last, np.exp(-period / slow), t.state[i, 4], turned, t.state[i, 5] * rubbing)
        turn -= pulled(g, along, (first + last) / 2, gained, missing, state[13], t.creep[i])
        wanted[i, 0], wanted[i, 1] = sent.real, sent.imag
        wanted[i, 2] = turn + gain * wrapped(poses[1, i, 2] - heading[i])
