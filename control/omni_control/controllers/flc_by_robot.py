"""What FLC and comp-FLC command, by loops over robots, for a compiler: what they do by numpy.

To the same bits, by the same laws in the same order.
"""

from omni_control.delay import caused, left
from omni_control.estimation.alpha import ratio
from omni_control.fuzzy.by_robot import velocity
from omni_control.fuzzy.tables import Tables
from omni_control.kinematics import Array, wrapped


def predict(
    pose: Array,
    sent: Array,
    latency: float,
    period: float,
    first: Array,
    frames: int,
    delay: int,
    law: tuple[float, float, float],
    alpha: Array,
    predicted: Array,
) -> None:
    """Estimate alpha, and predict poses to the end of the dead time; see `CompFlc`.

    Args:
        pose: filtered poses (n, 3).
        sent: commands up to the frame before, (count, n, 3).
        latency: that is compensated, frames.
        period: length of a frame, s.
        first: positions at the beginning of alpha's window, (n, 2).
        frames: of that window.
        delay: dead time of alpha, frames.
        law: of alpha, see `AlphaEstimator`.
        alpha: (n, 2); written.
        predicted: poses (n, 3); written.
    """
    count = len(sent)
    for i in range(len(pose)):
        for k in range(3):
            factor = 1.0
            if k < 2:
                commanded = 0.0
                for j in range(count - delay - frames, count - delay):
                    commanded += sent[j, i, k]
                factor = ratio(pose[i, k] - first[i, k], commanded * period, alpha[i, k], law[0], law[1], law[2])
                alpha[i, k] = factor
            in_flight = 0.0
            for j in range(count):
                in_flight += left(latency, count - 1.0 - j) * sent[j, i, k]
            predicted[i, k] = pose[i, k] + caused(in_flight, factor, period)


def correct(t: Tables, ranges: tuple[float, float], gain: float, error: Array, command: Array) -> None:
    """Add to commands what brings robots to the reference; see `Flc.track`.

    Args:
        t: the fuzzy rules.
        ranges: of errors and speeds, see `FuzzyLaw`.
        gain: of the heading hold, 1/s.
        error: of poses (n, 3).
        command: (n, 3); written.
    """
    for i in range(len(error)):
        x, y = velocity(t, ranges, error[i, 0], error[i, 1])
        command[i, 0] += x
        command[i, 1] += y
        command[i, 2] += gain * wrapped(error[i, 2])
