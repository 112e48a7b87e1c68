"""Limit study: the smallest error that is possible on a plant, and the errors of controllers.

A robot learns the commands of its path without noise (`iterative_learning`). Then feedback is added
(`recorded_run_lqr`) and tuned under noise, on other seeds than the scenario's. Last, the robot and
the package's controllers drive the scenario with the same seeds.
"""

import time
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import product, starmap
from typing import Any

from omni_control.arguments import check_types
from omni_control.errors import OmniError
from omni_mj.config import distributions
from omni_mj.config.plugins import ControllerSpec
from omni_mj.config.rows import build_single_robot_rows
from omni_mj.config.scenario import Scenario
from omni_mj.config.world_settings import RandomizationSettings
from omni_mj.io.printable_text import format_count
from omni_mj.results.paired_comparison import STATISTIC_LABELS, mean_position_error
from omni_mj.results.result import Outcome, Result
from omni_mj.results.result_tables import describe_plant, format_mean_cm
from omni_mj.results.text_table import Table, format_table
from omni_mj.simulation.simulation import Simulation
from omni_mj.studies.limit.deviation_model import DeviationModel
from omni_mj.studies.limit.information_bound import compute_mean_error_bound
from omni_mj.studies.limit.iterative_learning import (
    Runs,
    controller_from_function,
    learn_run,
    run_function,
)
from omni_mj.studies.limit.recorded_run_lqr import FeedbackSettings, RunTracker
from omni_mj.studies.run_scenario import (
    StartProgress,
    StoppedError,
    choose_shared_backend,
    list_competitors,
    no_progress,
    resolve_scenario,
    run_simulation,
)

LIMIT, WITHOUT_NOISE = "limit", "limit without noise"
SEEDS, ITERATIONS = 20, 16  # defaults
# The feedback is tuned on this many seeds, counted from the scenario's seed plus an offset.
TUNING_SEEDS, TUNING_SEED_OFFSET = 5, 1_000_000
TUNING_GRID = tuple(
    starmap(FeedbackSettings, product((0.0003, 0.001, 0.003, 0.01, 0.03), (0.1, 0.3, 1.0)))
)
DEFINITIONS = {
    "limit": (
        "smallest error found for robots that know the plant and get the same measurements as any "
        "controller: the limit of information"
    ),
    "limit without noise": (
        "smallest error found for robots without noise and disturbances: the limit of the plant"
    ),
    "trials": (
        "maximum and mean position error, m, of the best run without noise, before the first trial "
        "and after each trial"
    ),
}


@dataclass
class LimitResult(Result):
    """Result of the limit study. Its rows and frames are those of the final comparison.

    Attributes:
        history: Maximum and mean position error, m, of the best run without noise, before the first
            trial and after each trial.
    """

    history: list[dict[str, float]] = field(default_factory=list)

    def summary(self) -> dict[str, Any]:
        """Return the summary of any result, with the trials as `limit`."""
        return super().summary() | {"limit": {"definitions": DEFINITIONS, "trials": self.history}}

    def table(self) -> str:
        """Return limits and errors of controllers as lines of text; empty if incomplete."""
        if not self.complete:
            return ""
        ((name, entry),) = self.summary()["scenarios"].items()
        limit, rows = entry["results"][LIMIT], []
        for label, result in entry["results"].items():
            errors = [format_mean_cm(result["error_m"]["position"][s]) for s in STATISTIC_LABELS]
            ratios = [
                f"{mean_position_error(result, s) / mean_position_error(limit, s):.1f}"
                for s in STATISTIC_LABELS
            ]
            rows.append([label, *errors, "/".join(ratios)])
        error_headings = [f"{label}, cm" for label in STATISTIC_LABELS.values()]
        headings = ["", *error_headings, "times the limit"]
        seeds = f"mean of {format_count(len(self.seeds), 'seed')}"
        title = f"{name}, {describe_plant(entry)}: position error, {seeds}"
        start, end = (
            " / ".join(f"{100 * self.history[i][s]:.4f}" for s in STATISTIC_LABELS) for i in (0, -1)
        )
        trials = format_count(len(self.history) - 1, "trial")
        comparison = format_table(Table(title, headings, rows, 1))
        bound = 100 * compute_mean_error_bound(self.outcomes[0].scenario)
        bound_line = f"\nbound of the mean by noise and dead time: {bound:.4f} cm" if bound else ""
        return f"{comparison}\nwithout noise, in {trials}: from {start} to {end} cm{bound_line}"


@check_types
def find_limit(
    scenario: Scenario | str = "rect",
    seeds: int | Iterable[int] = SEEDS,
    iterations: int = ITERATIONS,
    *,
    start_progress: StartProgress = no_progress,
) -> LimitResult:
    """Find the smallest error that is possible in a scenario on its plant.

    The robot has its nominal parameters; `[randomization]` is ignored.

    Args:
        scenario: Scenario or its name; its controllers are ignored.
        seeds: Seeds of the comparison: consecutive seeds, or a number of seeds that start at 0.
        iterations: Maximum number of learning trials, at least 2.
        start_progress: Called with a title and the number of frames before each run. It returns a
            function that is called with each frame's number and may raise `StoppedError`.

    Returns:
        Errors of "limit" (with noise), of "limit without noise", and of the package's controllers
        except those that know the true state.

    Raises:
        OmniError: The scenario does not exist, has several robots per world, the seeds are not
            consecutive, there are fewer than two iterations, or no controller reaches the end.
    """
    start_time = time.perf_counter()
    scenario = resolve_scenario(scenario, seeds=seeds)
    check_limit(scenario, iterations)
    settings = scenario.settings.replace(randomization=RandomizationSettings().model_dump())
    scenario = choose_shared_backend(scenario.replace(settings=settings), scenario.seeds)
    result = LimitResult(
        [Outcome.not_run(scenario)], [LIMIT, WITHOUT_NOISE], seeds=scenario.seed_list
    )
    try:
        _learn_and_compare(result, scenario, iterations, start_progress)
        result.complete = True
    except StoppedError as error:
        result.stopped = str(error)
    result.wall_s = time.perf_counter() - start_time
    return result


def check_limit(scenario: Scenario, iterations: int) -> None:
    """Raise OmniError if the limit of a scenario cannot be found."""
    distributions.require_fixed_settings(scenario.distributions, "limit")
    n_robots = len(scenario.settings.world.start_poses)
    if n_robots > 1:
        raise OmniError(
            f"the limit study needs one robot, but world.start_poses of {scenario.name!r} has "
            f"{n_robots} poses; give one: --set world.start_poses=[[0,0,0]]"
        )
    if (radio := scenario.settings.radio).kind != "fixed":
        raise OmniError(f'the limit study needs radio.kind = "fixed", not {radio.kind}')
    if iterations < 2:
        raise OmniError(f"iterations must be at least 2, got {iterations}")


def remove_noise(scenario: Scenario) -> Scenario:
    """Return the scenario without noise, losses, disturbances, jitter and changes of alpha."""
    kinematic = scenario.settings.kinematic
    mean_alpha = (kinematic.alpha_low + kinematic.alpha_high) / 2
    settings = scenario.settings.replace(
        vision={
            "position_noise_m": 0,
            "heading_noise_rad": 0,
            "miss_probability": 0,
            "dropout_fraction": 0,
        },
        sensors={"gyro_noise_rad_s": 0, "gyro_bias_rad_s": 0},
        disturbance={"force_n": 0, "velocity_m_s": 0},
        radio={"jitter_frames": 0, "loss_probability": 0, "burst_loss_probability": 0},
        kinematic={
            "alpha_low": mean_alpha,
            "alpha_high": mean_alpha,
            "alpha_correlation_time_s": 0,
        },
    )
    return scenario.replace(settings=settings)


def _learn_and_compare(
    result: LimitResult, scenario: Scenario, iterations: int, start_progress: StartProgress
) -> None:
    """Learn a run, tune its feedback, compare it with the controllers, and fill in the result.

    Raises:
        StoppedError: The study was stopped.
    """
    noiseless = remove_noise(scenario)
    run, model = learn_run(noiseless, iterations, result.history, start_progress)
    feedback = _tune_feedback(scenario, run, model, start_progress)
    seeds, names = scenario.seed_list, list_competitors()
    tracker = RunTracker(model, run.sent, run.poses, scenario, [feedback] * len(seeds))
    commands = iter(run.sent)
    controllers: list[ControllerSpec] = [
        controller_from_function(LIMIT, tracker),
        controller_from_function(WITHOUT_NOISE, lambda observation: next(commands)),
        *names,
    ]
    runs = [(LIMIT, seed, scenario.settings) for seed in seeds]
    runs += [(WITHOUT_NOISE, seeds[0], noiseless.settings)]
    runs += [(name, seed, scenario.settings) for name in names for seed in seeds]
    rows = build_single_robot_rows(runs, scenario.robot)
    simulation = Simulation(scenario, controllers, rows=rows)
    outcome = run_simulation(simulation, start_progress("limit and controllers", model.frames))
    if outcome.entry["reason"]:
        raise StoppedError(outcome.entry["reason"])
    result.outcomes = [replace(outcome, scenario=scenario)]
    result.controllers = list(outcome.entry["results"])


def _tune_feedback(
    scenario: Scenario, run: Runs, model: DeviationModel, start_progress: StartProgress
) -> FeedbackSettings:
    """Return the feedback settings with the smallest errors on the tuning seeds.

    Maximum and mean error count equally, each relative to its smallest value.
    """
    seeds = [scenario.seed + TUNING_SEED_OFFSET + i for i in range(TUNING_SEEDS)]
    feedback = [settings for settings in TUNING_GRID for _ in seeds]
    tracker = RunTracker(model, run.sent, run.poses, scenario, feedback)
    after_frame = start_progress("feedback", model.frames)
    runs = run_function(scenario, seeds * len(TUNING_GRID), tracker, after_frame)
    errors = [runs.error(name).reshape(len(TUNING_GRID), -1).mean(1) for name in STATISTIC_LABELS]
    return TUNING_GRID[int(sum(error / error.min() for error in errors).argmin())]
