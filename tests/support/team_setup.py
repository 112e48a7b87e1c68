"""References, models, controllers and plants for tests of teams and controllers."""

from typing import Any

import numpy as np
from closed_loop import CreepingPlant, LaggedPlant, Plant, T, make_vision_noise, run_controller

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


def assert_dead_time_only_delays(
    controller_class: type[Controller],
    mode: str,
    start: tuple[float, ...],
    delay: int,
    lag: float,
    frames: int,
    tolerance: float,
) -> None:
    """Assert that dead time delays the motion of a nominal robot by `delay` frames, no more.

    Args:
        controller_class: Controller of the robot.
        mode: Mode of the reference.
        start: Pose at the start.
        delay: Dead time, frames.
        lag: Time constant, s.
        frames: Duration.
        tolerance: Largest difference of poses.
    """

    def follow(delay: int, frames: int, first_frame: int) -> Array:
        return run_controller(
            controller_class(make_model(delay, lag), make_reference(mode), 1),
            LaggedPlant([start], delay, lag),
            frames,
            first_frame=first_frame,
        ).pose

    late, prompt = follow(delay, frames, 0), follow(0, frames - delay, delay)
    assert (late[:delay] == start).all()
    np.testing.assert_allclose(late[delay:], prompt, rtol=0, atol=tolerance)


FRAMES = 14
TIGHT = MotionLimits(0.25, 3.0, 1.0, 5.0)


class Follower(Controller):
    """Follow a reference with proportional feedback, and store the observations."""

    gain: float = 2.0

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.observations: list[Observation] = []

    def command(self, frame: int, observation: Observation) -> Array:
        self.observations.append(observation)
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
