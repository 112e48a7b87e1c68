"""The ways along which tests of controllers drive, and what the controllers are told."""

from typing import Any

import numpy as np
from closed_loop import CreepingPlant, Plant, T, make_vision_noise

from omni_control import (
    Controller,
    IteratedReference,
    MotionLimits,
    Observation,
    TeamModel,
    TimedReference,
)
from omni_control.kinematics import Array
from omni_control.reference import Reference

PATH = np.array([[0.0, 0.0, 0.0], [0.8, 0.3, 1.0], [0.2, 0.6, -0.5]])
STRAIGHT = [[0, 0, 0], [20, 0, 0]]
LIMITS = MotionLimits()
REST = TimedReference([[0, 0, 0]], LIMITS, T)
TIMED = TimedReference(PATH.tolist(), LIMITS, T)
MODES = ("timed", "iterated")


def make_reference(kind: str, n: int = 1, side: Array | float = 1.0) -> Reference:
    """The way along `side` times PATH, "timed", known in advance, or "iterated", planned anew in each frame."""
    if kind == "timed":
        return TIMED if np.all(side == 1) else TimedReference((side * PATH).tolist(), LIMITS, T)
    return IteratedReference((side * PATH).tolist(), LIMITS, T, n)


def make_model(delay: int, lag: float = 0.02, noisy: bool = False) -> TeamModel:
    """What is told of robots with this dead time, frames, and lag, s; vision that is not `noisy` is trusted."""
    noise = (0.0013, 0.01) if noisy else (0.0, 0.0)
    return TeamModel(T, delay, lag, *noise)


FRAMES = 14
TIGHT = MotionLimits(0.25, 3.0, 1.0, 5.0)


class Follower(Controller):
    """Drives as the reference does, and notes what it saw."""

    gain: float = 2.0

    def __init__(self, *known: Any) -> None:
        super().__init__(*known)
        self.observations: list[Observation] = []

    def command(self, frame: int, observation: Observation) -> Array:
        self.observations.append(observation)
        self.predicted_pose = observation.predicted_pose
        target, speed = self.reference.at(frame, observation.pose)
        return speed + self.gain * (target - observation.predicted_pose)


class TruthFollower(Follower):
    """The same with the truth."""

    knows_truth = True


def make_noise(n: int, frames: int = FRAMES) -> Array:
    return make_vision_noise(np.random.default_rng(0), frames, n, gaps=0.02)


def make_plant(start: Array, rows: Any = slice(None)) -> Plant:
    """Some of robots of which each answers in a way of its own."""
    rng, n = np.random.default_rng(1), len(start)
    latency, alpha = rng.integers(3, 8, n), rng.uniform(0.7, 1.1, (n, 3))
    return CreepingPlant(start[rows], latency[rows], creep=0.0, alpha=alpha[rows])


def make_start_poses(n: int) -> Array:
    return np.random.default_rng(2).uniform(-0.1, 0.1, (n, 3))
