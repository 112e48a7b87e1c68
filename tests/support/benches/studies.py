"""Internals of the studies for their tests, and parts of the limit study."""
# ruff: noqa: F401

from typing import Any

import numpy as np

import omni_mj as om
from omni_control.kinematics import Array
from omni_control.reference import MotionLimits
from omni_mj.config import PERIOD_S
from omni_mj.config.nominal_model import compute_creep_law
from omni_mj.config.settings import Settings
from omni_mj.results.ramp_response import RampResponse
from omni_mj.results.result import Outcome
from omni_mj.studies.alpha import operating_conditions as conditions
from omni_mj.studies.alpha.alpha_study import AlphaResult, AlphaStudy
from omni_mj.studies.identify.robot_logs import read_logs
from omni_mj.studies.limit.deviation_model import DeviationModel
from omni_mj.studies.limit.information_bound import compute_mean_error_bound
from omni_mj.studies.limit.iterative_learning import Runs, learn_run, optimize_commands
from omni_mj.studies.limit.limit_study import remove_noise
from omni_mj.studies.limit.recorded_run_lqr import (
    POSE,
    FeedbackSettings,
    RunTracker,
    regulator_gains,
)
from omni_mj.studies.loop import loop_experiment
from omni_mj.studies.loop.loop_experiment import (
    FREQUENCIES,
    STEP_FRAMES,
    STEP_M,
    WARM_UP_FRAMES,
    LoopExperiment,
)
from omni_mj.studies.loop.loop_metrics import compute_margins, compute_step_metrics
from omni_mj.studies.loop.loop_study import LoopResult, measure_loop
from omni_mj.studies.run_scenario import StoppedError, ignore_frame, no_progress
from omni_mj.studies.slip import slip_fits as fits
from omni_mj.studies.slip import slip_moves as moves
from omni_mj.studies.slip.slip_moves import Move, straight_move
from omni_mj.studies.slip.slip_study import PUBLISHED
from omni_mj.studies.sweep.sweep_plan import SweepPlan, check_axes, parse_axis
from omni_mj.studies.sweep.sweep_study import SweepResult, sweep
from omni_mj.studies.sweep.workers import run_shard


def deviations(model: DeviationModel, commands: Array) -> Array:
    """Return the pose deviations (F, 3) due to changes of the commands (F, 3)."""
    transition, inputs = model.operators()
    return np.linalg.solve(transition.toarray(), inputs @ commands.ravel())[
        : commands.size
    ].reshape(-1, 3)


def planned(model: DeviationModel, limits: MotionLimits, errors: Array) -> tuple[Array, Array]:
    """Return optimal commands and predicted errors (F, 3) for a run without commands."""
    return optimize_commands(model, limits, errors, np.zeros_like(errors))


def predicted_poses(
    scenario: om.Scenario, poses: Array, measured: Array, noise: float, delay: int
) -> Array:
    """Return the predicted final poses (n, 3) of robots that move without commands.

    Args:
        scenario: On the kinematic plant.
        poses: True ones, (F, n, 3).
        measured: Poses that vision reports, (F, n, 3).
        noise: Factor of the filter's process noise.
        delay: Dead time, frames.
    """
    zero = np.zeros_like(poses)
    feedback = [FeedbackSettings(0.1, noise)] * poses.shape[1]
    tracker = RunTracker(
        DeviationModel.prior(len(poses), delay, 0.0), zero, zero, scenario, feedback
    )
    for k in range(len(poses) - delay):
        predicted = tracker.predict(
            measured[k], np.zeros(poses.shape[1]), np.zeros(poses.shape[1:])
        )
    return predicted[:, POSE]


def learned(scenario: om.Scenario, trials: int) -> tuple[Runs, list[dict[Any, float]]]:
    """Return the best run of a robot that learns without noise, and the errors of its trials."""
    history: list[dict[Any, float]] = []
    best, _ = learn_run(remove_noise(scenario), trials, history, lambda title, frames: ignore_frame)
    return best, history
