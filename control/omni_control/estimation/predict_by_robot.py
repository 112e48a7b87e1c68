"""Prediction by loops over robots, for a compiler: what `controllers.identifying` does by numpy; see `by_robot`."""

import numpy as np

from omni_control.estimation import turning
from omni_control.estimation.arrays import GivesArrays, LateArrays, PlantArrays, TurningArrays
from omni_control.estimation.by_robot import LEAST_S, axes, step, world
from omni_control.estimation.motion import Plane
from omni_control.estimation.turning_by_robot import answer, pulled
from omni_control.kinematics import Array


def predict(
    t: TurningArrays,
    p: PlantArrays,
    g: GivesArrays,
    late: LateArrays,
    sent: Array,
    position: Plane,
    velocity: Plane,
    heading: Array,
) -> None:
    """How the commands that are still to act leave the robots; see `Identifying._predict`.

    Args:
        t: headings.
        p: positions; what is `arriving` is written.
        g: how wheels give way.
        late: how far filters are behind.
        sent: commands up to the frame before, (count, n, 3).
        position: at the end, (n,) m; written.
        velocity: same, m/s; written.
        heading: same, rad; written.
    """
    count = len(sent)
    for i in range(len(position)):
        state, law = p.state[i], axes(i, p)
        t.creep[i] = state[7] ** 2 * state[9]
        place, v, push = complex(state[0], state[1]), complex(state[2], state[3]), complex(state[4], state[5])
        began, angle, rate, now = v, t.state[i, 0], t.state[i, 1], t.state[i, 0]
        latency, compass = p.delay + state[12] + late.behind[i], np.exp(-1j * state[6])
        whole = max(latency * p.period, LEAST_S)
        first, until = count - int(np.ceil(latency)), whole
        for j in range(max(first, 0), count):
            duration = min(max(latency - (count - 1 - j), 0.0), 1.0) * p.period
            across, turn = complex(sent[j, i, 0], sent[j, i, 1]), sent[j, i, 2]
            going = p.arriving[i] + (began - p.arriving[i]) * (until / whole)
            facing = np.exp(-1j * (now + t.state[i, 1] * (whole - until)))
            gained, shortfall = (p.arriving[i] - began) / whole * facing, (across * compass - going) * facing
            turn += pulled(g, going * facing, t.state[i, 1], gained, shortfall, state[13], t.creep[i])
            slow, final, _ = answer(i, t, turn, abs(across), shortfall)
            moved, rate, _ = turning.go_on(rate, final, slow, duration)
            middle = np.exp(1j * (angle + moved / 2))
            angle += moved
            gone = step(law, v, across * compass + push, middle, duration)
            place += world(gone.moved, middle)
            v = world(gone.velocity, middle)
            until -= duration
        position[i], velocity[i], heading[i], p.arriving[i] = place, v, angle, v
