"""The study of a limit: a robot learns a path, practises under noise, and drives next to the package's controllers."""

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

from omni_control.controllers.base import Controller
from omni_control.errors import OmniError
from omni_mj.config import distributions
from omni_mj.config.robot_settings import VariationSettings
from omni_mj.config.rows import Row
from omni_mj.config.scenario import Scenario
from omni_mj.results.result import Outcome, Result
from omni_mj.results.result_tables import Table, describe_plant, format_mean, format_table
from omni_mj.results.statistics import STATISTIC_LABELS, mean_position_error
from omni_mj.simulation.simulation import Simulation
from omni_mj.studies.limit.iterative_learning import AIMS, Aim, lead, learn, led
from omni_mj.studies.limit.lqr_tracking import Policy, Tracker
from omni_mj.studies.run_scenario import choose_shared_backend, resolve_scenario
from omni_mj.studies.study_runner import (
    StartProgress,
    StoppedError,
    list_competitors,
    no_progress,
    run_simulation,
)

LIMIT, WITHOUT_NOISE = "limit", "limit without noise"
SEEDS, ATTEMPTS = 20, 16
PRACTICE_SEEDS, FIRST_SEED = 5, 1_000_000  # seeds of practice count on from the scenario's
POLICIES = tuple(
    Policy(*pair) for pair in product((0.0003, 0.001, 0.003, 0.01, 0.03), (0.1, 0.3, 1.0))
)
DEFINITIONS = {
    "limit": "least error found of robots that know the plant, and see no more than any controller: of information",
    "limit without noise": "least error found of robots that nothing disturbs and that see the truth: of the plant",
    "attempts": "maximum and mean error in the plane, m, of the best run without noise, after each attempt",
}


@dataclass
class LimitResult(Result):
    """The result of the study; its rows and frames are those of the robots that show what they can.

    Attributes:
        history: Maximum and mean error in the plane of the best run without noise, m, after each
            attempt.
    """

    history: list[dict[Aim, float]] = field(default_factory=list)

    def summary(self) -> dict[str, Any]:
        """Return that of any result, with what was learned as `limit`."""
        return super().summary() | {"limit": {"definitions": DEFINITIONS, "attempts": self.history}}

    def table(self) -> str:
        """Return the limits' errors, controllers', and how they were found, as lines of text."""
        if not self.complete:
            return ""
        ((name, entry),) = self.summary()["scenarios"].items()
        results, rows = entry["results"], []
        for label, result in results.items():
            errors = [format_mean(result["error_m"]["position"][aim], 100) for aim in AIMS]
            ratios = (
                mean_position_error(result, aim) / mean_position_error(results[LIMIT], aim)
                for aim in AIMS
            )
            rows.append([label, *errors, "/".join(f"{ratio:.1f}" for ratio in ratios)])
        headings = ["", *(f"{STATISTIC_LABELS[aim]}, cm" for aim in AIMS), "times the limit"]
        title = (
            f"{name}, {describe_plant(entry)}: error in the plane, mean of {len(self.seeds)} seeds"
        )
        first, last = (
            " / ".join(f"{100 * self.history[i][aim]:.4f}" for aim in AIMS) for i in (0, -1)
        )
        learned = f"without noise, in {len(self.history) - 1} attempts: from {first} to {last} cm"
        return f"{format_table(Table(title, headings, rows, 1))}\n{learned}"


def find_limit(
    scenario: Scenario | str = "rect",
    seeds: int | Iterable[int] = SEEDS,
    iterations: int = ATTEMPTS,
    *,
    start_progress: StartProgress = no_progress,
) -> LimitResult:
    """Find out what is possible on a scenario's plant.

    The robot is the nominal one: `[variation]` is left out.

    Args:
        scenario: What is driven, or its name; its controllers are left out.
        seeds: Of the random numbers under which robots show what they can, or how many, counting up
            from 0.
        iterations: Attempts, at most.
        start_progress: Called with a title and the number of frames before robots drive; what it returns is
            called after each frame, and may raise `StoppedError`.

    Returns:
        Errors of "limit", with noise, of "limit without noise", and of the package's controllers
        that see no more.

    Raises:
        OmniError: There is no such scenario, robots share its world, seeds do not count up, there
            are fewer than two iterations, or no controller comes to the scenario's end.
    """
    started = time.perf_counter()
    driven = resolve_scenario(scenario, seeds=seeds)
    check_limit(driven, iterations)
    settings = driven.settings.replace(variation=VariationSettings().model_dump())
    driven = choose_shared_backend(driven.replace(settings=settings), driven.seeds)
    result = LimitResult([Outcome.not_run(driven)], [LIMIT, WITHOUT_NOISE], seeds=driven.seed_list)
    try:
        _find(result, driven, iterations, start_progress)
        result.complete = True
    except StoppedError as error:
        result.stopped = error.reason
    result.wall_s = time.perf_counter() - started
    return result


def check_limit(scenario: Scenario, iterations: int) -> None:
    """Raise OmniError if the limit of a scenario cannot be found."""
    distributions.refuse(scenario.distributions, "limit")
    if (places := len(scenario.settings.world.start_poses)) > 1:
        raise OmniError(
            f"the limit is that of a robot alone, and world.start_poses of {scenario.name!r} has {places} places;"
            " give one: --set world.start_poses=[[0,0,0]]"
        )
    if iterations < 2:
        raise OmniError(f"the limit takes at least 2 iterations to find, not {iterations}")


def quiet(scenario: Scenario) -> Scenario:
    """Return the scenario without noise, disturbance and jitter."""
    kinematic = scenario.settings.kinematic
    middle = (kinematic.alpha_low + kinematic.alpha_high) / 2
    settings = scenario.settings.replace(
        vision={"position_noise_m": 0, "heading_noise_rad": 0, "miss_probability": 0},
        sensors={"gyro_noise_rad_s": 0, "gyro_bias_rad_s": 0},
        disturbance={"force_n": 0, "velocity_m_s": 0},
        radio={"jitter_frames": 0},
        kinematic={"alpha_low": middle, "alpha_high": middle, "alpha_time_s": 0},
    )
    return scenario.replace(settings=settings)


def _find(
    result: LimitResult, scenario: Scenario, iterations: int, start_progress: StartProgress
) -> None:
    """Fill in the result; raise StoppedError if it is stopped."""
    calm, seeds = quiet(scenario), scenario.seed_list
    run, model = learn(calm, iterations, result.history, start_progress)

    def tracker(policies: Sequence[Policy]) -> Tracker:
        return Tracker(model, run.sent, run.poses, scenario, policies)

    training = [seeds[0] + FIRST_SEED + i for i in range(PRACTICE_SEEDS)]
    practice = tracker([policy for policy in POLICIES for _ in training])
    made = lead(
        scenario, training * len(POLICIES), practice, start_progress("feedback", model.frames)
    )
    errors = [made.size(aim).reshape(len(POLICIES), -1).mean(1) for aim in AIMS]
    policy = POLICIES[int(sum(error / error.min() for error in errors).argmin())]

    names = list_competitors()
    commands = iter(run.sent)
    kinds: list[str | type[Controller]] = [
        led(LIMIT, tracker([policy] * len(seeds))),
        led(WITHOUT_NOISE, lambda *seen: next(commands)),
        *names,
    ]
    table = [(LIMIT, seed, scenario) for seed in seeds] + [(WITHOUT_NOISE, seeds[0], calm)]
    table += [(name, seed, scenario) for name in names for seed in seeds]
    rows = [
        Row(i, 0, name, seed, each.settings, scenario.robot)
        for i, (name, seed, each) in enumerate(table)
    ]
    outcome = run_simulation(
        Simulation(scenario, kinds, rows=rows),
        start_progress("limit and controllers", model.frames),
    )
    if outcome.entry["reason"]:
        raise StoppedError(outcome.entry["reason"])
    result.outcomes, result.controllers = (
        [replace(outcome, scenario=scenario)],
        list(outcome.entry["results"]),
    )
