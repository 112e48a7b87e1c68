"""What is believed of a robot before it drives: its parameters, how sure that is, and how they wander and return."""

from typing import NamedTuple

import numpy as np

from omni_control.estimation import evidence, motion
from omni_control.kinematics import Array

KEPT_S = 12.0  # after which parameters are what was believed
COMPASS_S = 2.0  # same, of the compass error, which a robot's own filter corrects
COMPASS_RAD = 0.02  # its standard deviation
EFFORT, EFFORTS_ALIKE, CREEPS_ALIKE = 1.1, 0.5, 0.8  # alpha 0.8 to 1, where nobody tells it
FRICTION = 0.8  # of what it is told to be at most
LATENCY_FRAMES = 1.2  # standard deviation of what the dead time is told wrong by
LAG_SHARE = 0.75  # lag forward of the mean over all directions
PUSH_M_S, PUSH_S = 0.02, 0.5  # standard deviation of b, and the time after which it is forgotten
REACH_FRAMES = 4, 5  # how far the latency may be below and above what it is told
LEAST_LAG_S = 1e-3
STATES = 6 + motion.COUNT  # position, velocity, push; parameters


class Doubt(NamedTuple):
    """Standard deviations of what is told: of efforts; of creep, dry friction and lag relative to them."""

    effort: float
    creep: float
    friction: float
    lag: float


ANY = Doubt(0.12, 0.35, 0.4, 0.5)  # creep of four published robots: 20 % forward and 30 % sideways
# Of a robot whose numbers are known: what fits find of six robots is off their laws in closed form by up to 0.04, 8, 20
# and 30 %; heat, an empty battery and wear change efforts by 0.04.
KNOWN = Doubt(0.07, 0.2, 0.3, 0.35)


class Belief(NamedTuple):
    """What `believed` returns; parameters in the order of `motion`.

    Args:
        parameters: as they are believed, (8,).
        lowest, highest: within which they are kept, (8,).
        variance: of them, (8, 8).
        passing: what a frame keeps of each state, (14,), what it adds, (14,), and the variance that this renews, (14,
            14); that of velocity and push, which wander besides, (4,).
    """

    parameters: Array
    lowest: Array
    highest: Array
    variance: Array
    passing: tuple[Array, Array, Array, Array]


def believed(
    period: float,
    delay_frames: int,
    lag: float,
    creep: tuple[float, float],
    friction: float,
    alpha: tuple[float, float] | None = None,
) -> Belief:
    """What is believed of a robot: what is told of it, as far as a robot can be so.

    Args:
        period: length of a frame T, s.
        delay_frames: dead time as it is told.
        lag: of wheel loops, as it is told, s.
        creep: forward and sideways, same, s^2/m.
        friction: same, at most, m/s.
        alpha: ahead and aside, as they are told; None where nobody knows the robot, of which all is doubted more.
    """
    doubt, efforts = (ANY, (EFFORT, EFFORT)) if alpha is None else (KNOWN, (1 / alpha[0], 1 / alpha[1]))
    lag = max(LAG_SHARE * lag, LEAST_LAG_S)
    below, above = min(REACH_FRAMES[0], delay_frames), REACH_FRAMES[1]
    lowest = np.array([-0.2, 0.85, 0.85, 0, 0, 0, -below, LEAST_LAG_S])
    highest = np.array([0.2, 1.9, 1.9, 0.2, 0.35, 0.15, above, 0.1])
    parameters = np.clip([0, *efforts, *creep, FRICTION * friction, 0, lag], lowest, highest)
    creeps = doubt.creep * parameters[motion.CREEP] + 1e-6
    rubs, lags = doubt.friction * friction + 1e-6, doubt.lag * (lag - LEAST_LAG_S) + 1e-6
    sigma = np.array([COMPASS_RAD, doubt.effort, doubt.effort, *creeps, rubs, LATENCY_FRAMES, lags])
    alike = np.eye(motion.COUNT)
    alike[1, 2] = alike[2, 1] = EFFORTS_ALIKE
    alike[3, 4] = alike[4, 3] = CREEPS_ALIKE
    variance = alike * np.outer(sigma, sigma)

    lasting = np.full(motion.COUNT, KEPT_S)
    lasting[motion.COMPASS] = COMPASS_S
    keep, keep_push = np.exp(-period / lasting), np.exp(-period / PUSH_S)
    renewed, forget = np.sqrt(1 - keep**2), np.zeros((STATES, STATES))
    forget[6:, 6:] = variance * np.outer(renewed, renewed)
    restless = np.array([evidence.ACCELERATION_M_S2 * period, PUSH_M_S * np.sqrt(1 - keep_push**2)]) ** 2
    kept = np.concatenate([[1, 1, 0, 0], [keep_push] * 2, keep])
    returns = np.concatenate([np.zeros(6), (1 - keep) * parameters])
    return Belief(parameters, lowest, highest, variance, (kept, returns, forget, np.repeat(restless, 2)))
