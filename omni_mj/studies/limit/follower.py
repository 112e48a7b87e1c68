"""Robots that are led along runs that are known: what was sent then, and feedback on how they depart from it.

The linear quadratic regulator for a robot without dead time acts on what is predicted at the end of it, which is
optimal (D. L. Kleinman, IEEE Trans. Automatic Control 14, 1969), as it is optimal to act on the best estimate as if it
were the truth. The matrices are new in every frame, and so are the gains.
"""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.studies.limit.deviations import Deviations
from omni_mj.studies.limit.plan import ARM_M
from omni_mj.studies.limit.predictor import POSE, SPEED, Predictor

# What a disturbance does to a command is a share of it, at most 0.2 or so: what as many rounds leave is nothing.
ROUNDS = 5


class Follower:
    """Called once a frame for n robots.

    Args:
        predictor: of the robots, near the runs.
        gains: several, (F, g, 3, 9); see `regulator`.
        which: of them each robot has, (n,).
    """

    def __init__(self, predictor: Predictor, gains: Array, which: np.ndarray) -> None:
        self._predictor, self._gains, self._which = predictor, gains, which
        self._frame = 0

    def __call__(self, measured: Array, heading: Array) -> Array:
        """Commands (n, 3), before the limits; see `Predictor.see`."""
        predictor = self._predictor
        ahead = predictor.see(measured, heading)
        sent, planned = predictor.before
        felt = sent - planned + predictor.disturbed(ahead, sent)
        state = np.concatenate([ahead[:, POSE], ahead[:, SPEED], felt], axis=1)
        gains = self._gains[min(self._frame, len(self._gains) - 1), self._which]
        self._frame += 1
        wanted = command = predictor.planned - (gains * state[:, None]).sum(-1)
        for _ in range(ROUNDS):
            command = wanted - predictor.disturbed(ahead, command)
        return command

    def sent(self, command: Array) -> None:
        """See `Predictor.sent`."""
        self._predictor.sent(command)


def regulator(deviations: Deviations, weight: float) -> Array:
    """Gains K (F, 3, 9) of du(k) = -K(k) [dp, dv, du(k-1)] in the frame in which du(k) acts.

    They make the sum over frames of |dp|^2 + weight |du|^2 least, turning counted at an arm's length.

    Args:
        deviations: of the run.
        weight: s^2; its root is how long a departure takes to be made good, roughly.
    """
    scale = np.array([1.0, 1.0, ARM_M**2])
    state_weight, command_weight = np.zeros((9, 9)), weight * np.diag(scale)
    state_weight[POSE, POSE] = np.diag(scale)
    frames, delay = deviations.frames, deviations.delay
    gains, cost = np.zeros((frames, 3, 9)), state_weight
    for k in range(frames - 1, delay - 1, -1):
        matrix, effect = np.zeros((9, 9)), np.zeros((9, 3))
        matrix[SPEED, SPEED], matrix[SPEED, 6:] = deviations.keep[k], deviations.push[1, k]
        effect[SPEED] = deviations.push[0, k]
        matrix[POSE], effect[POSE] = PERIOD_S * matrix[SPEED], PERIOD_S * effect[SPEED]
        matrix[POSE, POSE] += np.eye(3)
        effect[6:] = np.eye(3)
        gain = np.linalg.solve(command_weight + effect.T @ cost @ effect, effect.T @ cost @ matrix)
        cost = state_weight + matrix.T @ cost @ (matrix - effect @ gain)
        cost = (cost + cost.T) / 2
        gains[k - delay] = gain
    gains[max(frames - delay, 0) :] = gains[max(frames - delay - 1, 0)]
    return gains
