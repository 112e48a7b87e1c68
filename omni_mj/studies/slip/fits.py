"""The fits of TIGERs Mannheim (`identifyBotModelV2.m` of Sumatra), on samples of one move.

u is what the wheels do, v what the robot does along a move; both are sampled in the middle of each frame.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded
from scipy.optimize import least_squares

from omni_control.kinematics import Array

FLOOR_S = 0.001  # beside T |u|, in their law
SUBSTEPS = 4  # of a frame
SETTLING = 3  # samples that are left out after a change: 50 ms
AT_REST = 0.05  # m/s: a roll-out is looked at until then


@dataclass(frozen=True)
class Law:
    """v' = (K u - v) / (T |u| + 1 ms): gain K, and T in s^2/m."""

    gain: float
    time: float


def follow(law: Law, u: Array, speed: Array, period: float) -> Array:
    """What the law makes of wheels that start at rest.

    Between two samples wheels are taken to speed up evenly; in each quarter of a frame the law is solved exactly, with
    the T |u| of its middle.

    Args:
        law: gain and time.
        u: velocity by the wheels along one axis, (F,).
        speed: magnitude of the wheels' velocity, m/s, (F,).
        period: of the samples, s.

    Returns:
        v, (F,).
    """
    frames, step = np.arange(len(u)), period / SUBSTEPS
    edges = np.arange(SUBSTEPS * (len(u) - 1) + 1) / SUBSTEPS
    wanted, travelled = law.gain * np.interp(edges, frames, u), np.interp(edges, frames, speed)
    lag = law.time * (travelled[1:] + travelled[:-1]) / 2 + FLOOR_S
    kept = np.exp(-step / lag)
    gained = wanted[1:] - kept * wanted[:-1] - lag / step * (1 - kept) * np.diff(wanted)
    bands = np.ones((2, len(edges)))  # v_1 - kept v_0 = gained, for all steps at once
    bands[1, :-1] = -kept
    v: Array = solve_banded((1, 0), bands, np.append(0.0, gained))
    return v[::SUBSTEPS]


def fit_law(u: Array, speed: Array, v: Array, period: float) -> Law:
    """K and T by least squares over the whole move, from standing still to standing still again; see `follow`."""

    def wrong_by(parameters: Array) -> Array:
        return follow(Law(*parameters), u, speed, period) - v

    return Law(*map(float, least_squares(wrong_by, [1.0, 0.1], bounds=(0.0, np.inf)).x))


def fit_drag(v: Array, free: np.ndarray, period: float, at_rest: float = AT_REST) -> float:
    """Return the mean deceleration of a robot that rolls out; not a number if there are too few samples.

    Args:
        v: speed along the move, (F,), positive.
        free: in which samples the motors carry no current, (F,).
        period: of the samples, s.
        at_rest: speed below which nothing is looked at.
    """
    rolling = v[free][SETTLING:]
    slow = np.flatnonzero(rolling < at_rest)
    rolling = rolling[: slow[0]] if slow.size else rolling
    return float((rolling[0] - rolling[-1]) / (len(rolling) - 1) / period) if len(rolling) >= SETTLING else float("nan")


def efficiency(
    v: Array, force: Array, holding: np.ndarray, accelerating: np.ndarray, drag: float, mass: float, period: float
) -> float:
    """Return the share of the force by the motors' currents that moves the body.

    It is the mean of the share while speed is held and of that while it grows.

    Held: drag over mean force. Growing: mean of (mass acceleration + drag) / force. The drag is that of a roll-out,
    with motors and gears in it.

    Args:
        v: speed along the move, (F,), positive.
        force: magnitude of the force by the currents, (F,).
        holding: in which samples the speed is held, (F,).
        accelerating: in which it grows, (F,).
        drag: N.
        mass: kg; or of a turning robot a torque, and its inertia.
        period: of the samples, s.
    """
    held = np.flatnonzero(holding)[SETTLING:]
    growing = np.flatnonzero(accelerating)[SETTLING:]
    growth = (v[growing] - v[growing - 1]) / period
    # Mean force of the two frames between whose middles the speed grew.
    pulling = (force[growing] + force[growing - 1]) / 2
    return float(drag / force[held].mean() + ((mass * growth + drag) / pulling).mean()) / 2
