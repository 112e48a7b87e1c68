"""What the tests of `p`, `smith`, `lqr` and `oracle` share: the loop around robots with dead time and lag."""

from dataclasses import dataclass
from math import ceil

import numpy as np
from hypothesis import settings

from omni_control.controllers.base import Controller, Seen, Told
from omni_control.delay import CommandsInFlight
from omni_control.estimation.kalman import KalmanFilter
from omni_control.kinematics import Array, wrap_angle
from omni_control.reference.timed import IteratedReference, MotionLimits, Reference, TimedReference

LAW = settings(deadline=None, max_examples=12, derandomize=True)
T = 1 / 60
PATH = np.array([[0.0, 0.0, 0.0], [0.8, 0.3, 1.0], [0.2, 0.6, -0.5]])
LIMITS = MotionLimits()
REST = TimedReference([[0, 0, 0]], LIMITS, T)
TIMED = TimedReference(PATH.tolist(), LIMITS, T)


def along(kind: str, n: int = 1, side: Array | float = 1.0) -> Reference:
    """The way along `side` times PATH, "timed", known in advance, or "iterated", planned anew in each frame."""
    if kind == "timed":
        return TIMED if np.all(side == 1) else TimedReference((side * PATH).tolist(), LIMITS, T)
    return IteratedReference((side * PATH).tolist(), LIMITS, T, n)


def told(delay: int, lag: float = 0.02, noisy: bool = False) -> Told:
    """What a tracker knows of robots with this dead time, frames, and lag, s; it trusts vision that is not `noisy`."""
    return Told(T, delay, lag, *((0.0013, 0.01) if noisy else (0.0, 0.0)))


@dataclass
class Run:
    """What happened in each frame: true poses and twists, predicted poses and commands sent, (frames, n, 3)."""

    pose: Array
    twist: Array
    predicted: Array
    sent: Array


def drive(
    tracker: Controller,
    start: Array,
    frames: int,
    *,
    delay: int | None = None,
    alpha: Array | float = 1.0,
    first_frame: int = 0,
    noise: Array | None = None,
) -> Run:
    """Close the loop around robots with x' = v, v' = (alpha u(t - delay T) - v) / lag that start at rest.

    Dead time and lag are those told, unless another `delay` is given. With `noise` (frames, n, 3) poses pass through
    the filter, as in the simulation; without, all is known exactly.
    """
    known = tracker.settings
    delay, lag = known.delay_frames if delay is None else delay, known.lag_s
    pose, twist, command = np.array(start, float), np.zeros_like(start), np.zeros_like(start)
    flying = [command] * delay
    felt = CommandsInFlight(len(start), ceil(known.latency_frames) + 1)
    kalman = KalmanFilter(start, T, known.vision_noise)
    rows = []
    for k in range(frames):
        felt.push(command)
        moved = felt.felt(known.latency_frames)
        seen = Seen(pose, twist, pose)
        if noise is not None and not tracker.knows_truth:
            measured = pose + noise[k]
            measured[:, 2] = wrap_angle(measured[:, 2])
            estimate = kalman.update(measured, moved * T)
            seen = Seen(estimate, kalman.twist, measured)
        command = tracker.command(first_frame + k, seen, command)
        rows.append((pose, twist, tracker.predicted.copy(), command))
        flying.append(command)
        # The closed form: towards the new speed, the difference dying out with the lag's time constant.
        speed = alpha * flying.pop(0)
        left = np.exp(-T / lag) if lag else 0.0
        pose = pose + speed * T + (twist - speed) * lag * (1 - left)
        twist = speed + (twist - speed) * left
    return Run(*(np.array(column) for column in zip(*rows, strict=True)))
