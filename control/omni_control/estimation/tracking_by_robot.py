"""A frame of vision by a loop over robots, for a compiler: what `Gate` and `KalmanFilter` do by numpy.

To the same bits, for it has their laws and their order, so that each frame may be taken in by either.
"""

import numpy as np

from omni_control.estimation import gate, kalman
from omni_control.kinematics import Array


def take_in(
    known: Array,
    images: Array,
    before: Array,
    axes: Array,
    law: Array,
    shares: Array,
    sent: Array,
    measured: Array,
    after: Array,
) -> bool:
    """Take in a frame in which all robots were seen, just now, where they can be, or not at all.

    Args:
        known: see `Gate`; written.
        images: same.
        before: `KalmanFilter.state`.
        axes: see `KalmanFilter`.
        law: same.
        shares: of commands that acted in the frame just past, (count, n, 1).
        sent: commands up to that frame, (count, n, 3).
        measured: poses seen by vision (n, 3).
        after: the state for `KalmanFilter.take`; written.

    Returns:
        Whether they were; if not, nothing of gate and filter has changed.
    """
    period = law[0]
    for i in range(len(measured)):
        distance, between = _moved(i, known, images, period, measured)
        allowed = gate.reach(known[gate.SPEED, i], between, known[gate.NOISY, i])
        seen = gate.usual(distance, allowed, measured[i, 2] - images[gate.BELIEVED, i, 2])
        if not (seen or np.isnan(measured[i]).all()):
            return False
    for i in range(len(measured)):
        distance, between = _moved(i, known, images, period, measured)
        if np.isnan(measured[i, 0]):
            known[gate.SINCE, i] += period
        else:
            known[gate.PACE, i], known[gate.AGE, i], known[gate.SINCE, i] = distance / between, 0.0, 0.0
            known[gate.ELSEWHERE, i] = known[gate.BACKWARDS, i] = known[gate.FROZEN, i] = 0.0
            for k in range(3):
                images[gate.SHOWN, i, k] = images[gate.BELIEVED, i, k] = measured[i, k]
        for k in range(3):
            displaced = shares[0, i, 0] * sent[0, i, k]
            for j in range(1, len(sent)):
                displaced += shares[j, i, 0] * sent[j, i, k]
            found = kalman.filtered(
                (law[0], law[1], law[2], law[3]),
                (
                    before[kalman.POSE, i, k],
                    before[kalman.DRIFT, i, k],
                    before[kalman.XX, i, k],
                    before[kalman.XB, i, k],
                    before[kalman.BB, i, k],
                ),
                before[kalman.SCALE, i, k],
                displaced * period,
                measured[i, k],
                axes[kalman.WANDER, i, k],
                axes[kalman.NOISE, i, k],
                k == 2,
            )
            for row in range(len(found)):
                after[row, i, k] = found[row]
    return True


def _moved(i: int, known: Array, images: Array, period: float, measured: Array) -> tuple[float, float]:
    """How far a robot's image is from the last that was believed, m, and how much later, s."""
    x, y = measured[i, 0] - images[gate.BELIEVED, i, 0], measured[i, 1] - images[gate.BELIEVED, i, 1]
    return np.hypot(x, y), (known[gate.SINCE, i] + period) + abs(0.0 - known[gate.AGE, i])
