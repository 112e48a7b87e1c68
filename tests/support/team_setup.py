"""References, models, controllers and plants for tests of teams and controllers."""

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


def make_reference(mode: str, n: int = 1, scale: Array | float = 1.0) -> Reference:
    """Return the reference of a mode for n robots through `scale` times PATH."""
    if mode == "timed":
        if np.all(scale == 1):
            return TIMED
        return TimedReference((scale * PATH).tolist(), LIMITS, T)
    return IteratedReference((scale * PATH).tolist(), LIMITS, T, n)


def make_model(delay: int, lag: float = 0.02, noisy: bool = False) -> TeamModel:
    """Return the model of robots with a dead time (frames) and a lag (s), and vision with noise."""
    noise = (0.0013, 0.01) if noisy else (0.0, 0.0)
    return TeamModel(T, delay, lag, *noise)


FRAMES = 14
TIGHT = MotionLimits(0.25, 3.0, 1.0, 5.0)


class Follower(Controller):
    """Follow a reference with proportional feedback."""

    gain: float = 2.0

    def command(self, frame: int, observation: Observation) -> Array:
        observation.sent_commands.get_latest(self.memory_frames)  # as many are stored
        self.predicted_pose = observation.predicted_pose
        target, twist = self.reference.at(frame, observation.pose)
        return twist + self.gain * (target - observation.predicted_pose)


class TruthFollower(Follower):
    """The same with true poses."""

    knows_truth = True


def make_noise(n: int, frames: int = FRAMES) -> Array:
    return make_vision_noise(np.random.default_rng(0), frames, n, gaps=0.02)


def make_plant(start: Array, rows: Any = slice(None)) -> Plant:
    """Return some rows of robots with different latencies and alphas."""
    rng, n = np.random.default_rng(1), len(start)
    latency, alpha = rng.integers(3, 8, n), rng.uniform(0.7, 1.1, (n, 3))
    return CreepingPlant(start[rows], latency[rows], creep=0.0, alpha=alpha[rows])


def make_start_poses(n: int) -> Array:
    return np.random.default_rng(2).uniform(-0.1, 0.1, (n, 3))
