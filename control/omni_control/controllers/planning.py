"""What adaptive-comp-flc commands, by loops over robots, for a compiler; by the same laws as there."""

import numpy as np

from omni_control.estimation import turning
from omni_control.estimation.arrays import GivesArrays, PlantArrays, TurningArrays
from omni_control.estimation.by_robot import Axes, axes
from omni_control.estimation.motion import Plane, starting
from omni_control.estimation.turning_by_robot import answer, pulled
from omni_control.fuzzy.by_robot import velocity
from omni_control.fuzzy.tables import Tables
from omni_control.kinematics import Array, Number, wrapped


def lead(effort: Number, late: Number, stiffness: float) -> Number:
    """Lead times T, s, of efforts g and time constants lag / g, for a correction of a stiffness k, 1/s."""
    lag = effort * late
    return 2 * lag / (effort + np.sqrt(effort**2 + 2 * stiffness * lag))


def ask(law: Axes, before: complex, after: complex, heading: complex, duration: float) -> complex:
    """See `Motion.ask`."""
    back, speed, mean = heading.conjugate(), abs(before), (before + after) / 2
    v, later, towards = before * back, after * back, mean * back / starting(abs(mean))
    decay_0 = np.exp(-duration / (law.still[0] + law.slower[0] * speed))
    decay_1 = np.exp(-duration / (law.still[1] + law.slower[1] * speed))
    ahead = ((later.real - decay_0 * v.real) / (1 - decay_0) + law.rubbed[0] * towards.real) * law.effort[0]
    aside = ((later.imag - decay_1 * v.imag) / (1 - decay_1) + law.rubbed[1] * towards.imag) * law.effort[1]
    return complex(ahead, aside) * heading


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
    """Commands; see `AdaptiveCompFlc`.

    Args:
        t: headings, as identified.
        p: positions and their law, same.
        g: how wheels give way.
        poses: of the reference from some frames before the command acts until as many after it, (frames, n, 3).
        twists: same.
        position: that robots will have, (n,) m.
        reached: velocity, same, m/s.
        heading: same, rad.
        rules: of the correction.
        ranges: of it, see `FuzzyLaw`.
        stiffness: same, 1/s.
        step: by which planned commands may change per frame, m/s.
        gain: of the heading hold, 1/s.
        wanted: commands (n, 3); written.
    """
    now, period = len(poses) // 2, p.period
    for i in range(len(wanted)):
        law, state = axes(i, p), p.state[i]
        otherwise = heading[i] - poses[now, i, 2]  # facing as the robot will, not as it should
        low_x, low_y, high_x, high_y = -np.inf, -np.inf, np.inf, np.inf
        edge, leaving, face = 0j, 0j, 0j
        for k in range(1, 2 * now):
            there, past = complex(twists[k, i, 0], twists[k, i, 1]), complex(twists[k - 1, i, 0], twists[k - 1, i, 1])
            before, after = (past + there) / 2, (there + complex(twists[k + 1, i, 0], twists[k + 1, i, 1])) / 2
            facing = np.exp(1j * (poses[k, i, 2] + twists[k, i, 2] * (period / 2) + otherwise))
            asked, reach = ask(law, before, after, facing, period), step * abs(k - now)
            low_x, low_y = max(low_x, asked.real - reach), max(low_y, asked.imag - reach)
            high_x, high_y = min(high_x, asked.real + reach), min(high_y, asked.imag + reach)
            if k == now:
                edge, leaving, face = before, after, facing
        planned = complex((high_x + low_x) / 2, (high_y + low_y) / 2)

        behind, speed = (edge - reached[i]) * face.conjugate(), abs(edge)
        ahead = lead(law.effort[0], law.still[0] + law.slower[0] * speed, stiffness) * behind.real
        aside = lead(law.effort[1], law.still[1] + law.slower[1] * speed, stiffness) * behind.imag
        error = complex(poses[now, i, 0], poses[now, i, 1]) - position[i] + complex(ahead, aside) * face
        x, y = velocity(rules, ranges, error.real, error.imag)
        command = planned + complex(x, y)
        sent = (command - complex(state[4], state[5])) * np.exp(1j * state[6])

        along, missing = edge * face.conjugate(), (planned - edge) * face.conjugate()
        gained = (leaving - edge) * face.conjugate() / period
        first = (twists[now - 1, i, 2] + twists[now, i, 2]) / 2
        then = (twists[now, i, 2] + twists[now + 1, i, 2]) / 2
        slow, _, rubbing = answer(i, t, (first + then) / 2, abs(edge), missing)
        turned = turning.driven(t.state[i, 2], t.state[i, 6], t.state[i, 7], missing)
        turn = turning.asked(first, then, np.exp(-period / slow), t.state[i, 4], turned, t.state[i, 5] * rubbing)
        turn -= pulled(g, along, (first + then) / 2, gained, missing, state[13], t.creep[i])
        wanted[i, 0], wanted[i, 1] = sent.real, sent.imag
        wanted[i, 2] = turn + gain * wrapped(poses[now, i, 2] - heading[i])
