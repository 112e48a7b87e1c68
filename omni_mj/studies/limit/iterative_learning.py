"""Iterative learning control (ILC) without noise: the best run of a robot that repeats its path.

A trial simulates several rows. Some track commands that are optimized from the best run so far.
They need feedback, because rolling contacts do not repeat exactly. The others track the best run
with random changes of its commands. Differences between rows identify a linear model of the
deviations, dp = G du (`deviation_model`). For the best run with errors e and commands u, the
next change of commands du minimizes

    |e + G du|^2 + rho |du|^2    subject to    |u + du| <= v,   |change of u + du in a frame| <= a T

The limits v and a apply to lengths of vectors in the plane, and to turn rates separately.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from omni_control.controllers.base import Controller, Observation
from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.reference import MotionLimits
from omni_mj.config import PERIOD_S, reference_factory
from omni_mj.config.rows import build_single_robot_rows
from omni_mj.config.scenario import Scenario
from omni_mj.results.paired_comparison import STATISTIC_LABELS
from omni_mj.simulation.simulation import Simulation
from omni_mj.studies.limit.deviation_model import SCALE, DeviationModel
from omni_mj.studies.limit.recorded_run_lqr import FeedbackSettings, RunTracker
from omni_mj.studies.run_scenario import AfterFrame, StartProgress

ADMM_ITERATIONS = 400
RELAXATION = 1.6  # of ADMM; Boyd et al., section 3.4.3
RHO = 2e-8  # weight of command changes, s^2
# Penalties of ADMM on commands and their changes, s^2; they only affect the speed of convergence
COMMAND_PENALTY, CHANGE_PENALTY = 2e-5, 2e-4

CommandFunction = Callable[[Observation], Array]
INITIAL_CONTROLLERS = ("comp-flc", "adaptive-comp-flc")  # learning starts from their best run
# Rows of a trial: fraction of the optimized change that they apply, and command weight of the
# regulator, s^2. Rows with the fraction 0 apply random changes instead.
ROWS = ((1.0, 0.03), (1.0, 0.003), (0.3, 0.03), (0.3, 0.003), (0.0, 0.1), (0.0, 0.1), (0.0, 0.1))
EXPLORATION_STD = np.array([0.1, 0.1, 0.5])  # of random changes, m/s and rad/s
# A row is not used to fit the deviation model if its maximum error exceeds both limits.
MAX_ERROR_RATIO, MAX_ERROR_M = 4.0, 0.05  # relative to the best row; absolute
HEADING_WEIGHT_M = 0.01  # position error that counts as much as a heading error of 1 rad
# A trial is idle if the cost falls by less than either limit. Learning ends after three in a row.
MAX_IDLE_TRIALS = 3
MIN_IMPROVEMENT, MIN_IMPROVEMENT_M = 0.04, 2e-5  # fraction of the cost; absolute


@dataclass(frozen=True, eq=False)
class Runs:
    """Runs of n rows over F frames.

    Attributes:
        sent: Sent commands, after the limits, (F, n, 3).
        poses: True poses, (F, n, 3).
        errors: Poses minus the reference, (F, n, 3); infinite for a row that failed.
    """

    sent: Array
    poses: Array
    errors: Array

    @classmethod
    def simulate(cls, simulation: Simulation, after_frame: AfterFrame) -> "Runs":
        """Run a simulation to its end, and return its runs."""
        log = simulation.run(after_frame)
        poses, sent = log.channel("pose"), log.channel("command")
        errors = poses - log.channel("ref")
        errors[:, [failure.row for failure in simulation.failures]] = np.inf
        return cls(sent, poses, errors)

    @property
    def best(self) -> "Runs":
        """The row with the lowest cost, with n = 1."""
        row = [int(self.cost.argmin())]
        return Runs(*(values[:, row] for values in (self.sent, self.poses, self.errors)))

    def error(self, statistic: str, heading_weight_m: float = HEADING_WEIGHT_M) -> Array:
        """Return the maximum or mean over the frames of the weighted error, (n,) m.

        The error of a frame is the position error plus `heading_weight_m` per rad of heading error.
        """
        position = np.hypot(self.errors[..., 0], self.errors[..., 1])
        error = position + heading_weight_m * np.abs(self.errors[..., 2])
        return error.max(0) if statistic == "max" else error.mean(0)

    @property
    def cost(self) -> Array:
        """The cost that learning minimizes: (maximum error + mean error) / 2, (n,) m."""
        return (self.error("max") + self.error("mean")) / 2


def controller_from_function(label: str, function: CommandFunction) -> type[Controller]:
    """Return a controller class, named `label`, that sends the commands of a function."""
    attributes = {"command": lambda self, frame, observation: function(observation)}
    return type(label, (Controller,), attributes)


def run_function(
    scenario: Scenario, seeds: Sequence[int], function: CommandFunction, after_frame: AfterFrame
) -> Runs:
    """Run one robot per seed, each in its own world, with the commands of a function."""
    label = "tracking"
    runs = [(label, seed, scenario.settings) for seed in seeds]
    rows = build_single_robot_rows(runs, scenario.robot)
    simulation = Simulation(scenario, [controller_from_function(label, function)], rows=rows)
    return Runs.simulate(simulation, after_frame)


def learn_run(
    scenario: Scenario,
    max_trials: int,
    history: list[dict[str, float]],
    start_progress: StartProgress,
) -> tuple[Runs, DeviationModel]:
    """Learn the commands of a scenario without noise.

    Args:
        scenario: Scenario without noise; its first seed is used.
        max_trials: Maximum number of trials. Learning ends earlier if it no longer improves.
        history: Empty list. It receives the maximum and mean position error of the best run, m,
            before the first trial and after each trial.
        start_progress: Called with a title and the number of frames before each trial. It returns a
            function that is called with each frame's number and may raise `StoppedError`.

    Returns:
        The best run, and the deviation model for changes of its commands.

    Raises:
        OmniError: No controller reaches the end of the scenario.
    """
    settings, seed = scenario.settings, scenario.seed
    reference = reference_factory.build_timed_reference(
        settings, settings.world.start_poses[0]
    ).poses
    limits = reference_factory.build_motion_limits(settings.control)
    n_frames, delay = len(reference), int(settings.radio.delay_frames)
    model = DeviationModel.prior(n_frames, delay, 2 * settings.control.assumed_lag_s)
    best = _initial_run(scenario, start_progress("controllers", n_frames))
    feedback = [FeedbackSettings(weight) for _, weight in ROWS]
    fractions = np.array([[fraction] for fraction, _ in ROWS])
    random, idle_trials = np.random.default_rng(0), 0
    for trial in range(max_trials + 1):
        history.append({name: float(best.error(name, 0.0)[0]) for name in STATISTIC_LABELS})
        if trial == max_trials or idle_trials == MAX_IDLE_TRIALS:
            break
        optimized, predicted = optimize_commands(model, limits, best.errors[:, 0], best.sent[:, 0])
        commands = best.sent + fractions * (optimized[:, None] - best.sent)
        poses = best.poses + fractions * (predicted[:, None] - best.errors)
        tracker = RunTracker(model, commands, poses, scenario, feedback)
        exploration = _draw_changes(random, n_frames, len(feedback))
        changes = np.where(fractions == 0, exploration, 0.0)
        function = _explore(tracker, changes)
        after_frame = start_progress(f"trial {trial + 1}", n_frames)
        runs = run_function(scenario, [seed] * len(feedback), function, after_frame)
        model = _refit_model(model, reference, runs)
        candidate = runs.best
        improvement = float((best.cost - candidate.cost)[0])
        is_idle = improvement <= max(MIN_IMPROVEMENT * float(best.cost[0]), MIN_IMPROVEMENT_M)
        idle_trials = idle_trials + 1 if is_idle else 0
        best = candidate if improvement > 0 else best
    return best, model


def optimize_commands(
    model: DeviationModel, limits: MotionLimits, errors: Array, commands: Array
) -> tuple[Array, Array]:
    """Return the commands that minimize the errors of a run.

    The alternating direction method of multipliers (ADMM; S. Boyd et al., Distributed optimization
    and statistical learning via ADMM, 2011, chapter 5) splits the problem of this module into a
    sparse linear system with constant coefficients and projections in closed form.

    Args:
        model: Deviation model of the run.
        limits: Limits of the commands.
        errors: Poses of the run minus the reference, (F, 3).
        commands: Sent commands of the run, (F, 3).

    Returns:
        The optimal commands (F, 3), and the predicted errors (F, 3).
    """
    size = errors.size
    motion, inputs = model.operators()
    weights = sp.diags(np.tile(SCALE**2, len(errors)))
    differences = sp.eye(size) - sp.eye(size, k=-3)  # from frame to frame
    constrained = sp.vstack([sp.eye(size), differences])
    penalty = sp.hstack([COMMAND_PENALTY * weights, CHANGE_PENALTY * differences.T @ weights])
    no_cost = sp.csc_matrix((size, size))
    cost = sp.block_diag([RHO * weights + penalty @ constrained, weights, no_cost])
    constraint = sp.hstack([-inputs, motion])
    solve = splu(sp.bmat([[cost, constraint.T], [constraint, None]]).tocsc()).solve
    start = constrained @ commands.ravel()
    projection, dual, right_side = start, np.zeros(2 * size), np.zeros(5 * size)
    right_side[size : 2 * size] = -weights @ errors.ravel()
    for _ in range(ADMM_ITERATIONS):
        right_side[:size] = penalty @ (projection - dual - start)
        solution = solve(right_side)
        updated = start + constrained @ solution[:size]
        relaxed = RELAXATION * updated + (1 - RELAXATION) * projection + dual
        projection = _project(relaxed, limits)
        dual = relaxed - projection
    command_change = solution[:size].reshape(-1, 3)
    deviation = solution[size : 2 * size].reshape(-1, 3)
    return commands + command_change, errors + deviation


def _project(vectors: Array, limits: MotionLimits) -> Array:
    """Project commands and their changes per frame, stacked in (6F,), onto the limits."""
    max_lengths = np.array([[limits.speed], [limits.acceleration * PERIOD_S]])
    turn = np.array([limits.turn_rate, limits.turn_acceleration * PERIOD_S])[:, None, None]
    vectors = vectors.reshape(2, -1, 3)
    lengths = np.maximum(np.hypot(vectors[..., 0], vectors[..., 1]), 1e-12)
    translation = vectors[..., :2] * np.minimum(1.0, max_lengths / lengths)[..., None]
    return np.concatenate([translation, np.clip(vectors[..., 2:], -turn, turn)], axis=2).ravel()


def _initial_run(scenario: Scenario, after_frame: AfterFrame) -> Runs:
    """Return the best run of `INITIAL_CONTROLLERS`.

    Raises:
        OmniError: No controller reaches the end of the scenario.
    """
    simulation = Simulation(scenario, INITIAL_CONTROLLERS, [scenario.seed])
    best = Runs.simulate(simulation, after_frame).best
    if not np.isfinite(best.cost).all():
        raise OmniError(
            f"no controller reaches the end of {scenario.name!r}, so there is nothing to learn from"
        )
    return best


def _explore(tracker: CommandFunction, changes: Array) -> CommandFunction:
    """Return a function that adds changes (F, n, 3) to the commands of a tracker."""
    changes_by_frame = iter(changes)
    return lambda observation: tracker(observation) + next(changes_by_frame)


def _draw_changes(random: np.random.Generator, n_frames: int, n_rows: int) -> Array:
    """Draw random changes of commands, smoothed over two frames, (n_frames, n_rows, 3)."""
    changes = EXPLORATION_STD * random.standard_normal((n_frames, n_rows, 3))
    changes[1:] += changes[:-1].copy()
    return changes / np.sqrt(2)


def _refit_model(model: DeviationModel, reference: Array, runs: Runs) -> DeviationModel:
    """Fit the model to the differences between the best run and the runs near it.

    Returns:
        The fitted model, or `model` if fewer than three runs are near the best one.
    """
    max_error = runs.error("max")
    rows = np.argsort(max_error, kind="stable")
    near = rows[max_error[rows] < max(MAX_ERROR_RATIO * max_error[rows[0]], MAX_ERROR_M)]
    if len(near) < 3:
        return model
    poses, commands = (
        values[:, near[1:]] - values[:, near[:1]] for values in (runs.poses, runs.sent)
    )
    return DeviationModel.fit(reference, model.delay, poses, commands)
