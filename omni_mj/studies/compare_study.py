"""Compare controllers on many scenarios with the same seeds."""

import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace

from omni_control.arguments import check_types
from omni_control.controllers.registry import list_available_controllers
from omni_control.errors import OmniError
from omni_mj.config import fault_checks
from omni_mj.config.plugins import ControllerSpec
from omni_mj.config.scenario import Scenario, load_with_overrides
from omni_mj.config.toml_files import find_builtin_files
from omni_mj.results.result import Outcome, Result
from omni_mj.studies.run_scenario import (
    StartProgress,
    StoppedError,
    check_subject,
    choose_shared_backend,
    count_frames,
    list_privileged,
    list_seeds,
    no_progress,
    prepare_simulation,
    resolve_scenario,
    run_simulation,
)

# Scenarios excluded by default: a long one, all faults at once, and maneuvers for identification
EXCLUDED = ("hot-motors", "fault-all", "identify")
SEEDS = 10  # default number of seeds


@check_types
def compare(
    scenarios: Sequence[Scenario | str] | None = None,
    controllers: ControllerSpec | Sequence[ControllerSpec] | None = None,
    seeds: int | Iterable[int] = SEEDS,
    subject: str | None = None,
    keep_frames: bool = False,
    *,
    start_progress: StartProgress = no_progress,
    after_scenario: Callable[[Result, Outcome], None] = lambda result, outcome: None,
) -> Result:
    """Run the same controllers and seeds on many scenarios.

    A scenario that cannot be run is reported in the result, and the others are still run.

    Args:
        scenarios: Scenarios or their names. Default: all built-in scenarios except hot-motors,
            fault-all and identify.
        controllers: Names, `file.py:Class`, or classes derived from `Controller`. Default: all
            built-in controllers whose packages are installed.
        seeds: Consecutive seeds, or a number of seeds that start at 0.
        subject: Controller that the verdicts are about. Default: no verdicts.
        keep_frames: Whether the result keeps the frames of all rows.
        start_progress: Called with a title and the number of frames before each scenario. It
            returns a function that is called with each frame's number and may raise
            `StoppedError`.
        after_scenario: Called after each scenario with the result so far and the outcome of this
            scenario, with its frames.

    Raises:
        OmniError: A scenario or controller does not exist, two scenarios share a name, the
            subject is not among the controllers, or the seeds are not consecutive.
    """
    start_time, seed_list = time.perf_counter(), list_seeds(seeds)
    names = default_scenarios() if scenarios is None else scenarios
    controllers = list_available_controllers() if controllers is None else controllers
    resolved = [resolve_scenario(name, controllers, seed_list) for name in names]
    check_scenarios(resolved, subject)
    outcomes = [Outcome.not_run(scenario) for scenario in resolved]
    result = Result(outcomes, seeds=seed_list, subject=subject)
    if resolved:
        result.controllers = list(resolved[0].labels)
        result.privileged = list_privileged(resolved[0])
    try:
        for i, scenario in enumerate(resolved):
            title = f"{scenario.name} ({i + 1} of {len(resolved)})"
            outcome = _run_to_end(scenario, title, start_progress)
            result.outcomes[i] = outcome if keep_frames else replace(outcome, log=None)
            result.wall_s = time.perf_counter() - start_time
            after_scenario(result, outcome)
        result.complete = all(outcome.was_run for outcome in result.outcomes)
    except StoppedError as error:
        result.stopped = str(error)
    result.wall_s = time.perf_counter() - start_time
    return result


def default_scenarios(plant: str = "mujoco") -> tuple[str, ...]:
    """Return the scenarios that are compared by default; all faults in them suit the plant."""
    kinds = fault_checks.list_supported_kinds(plant)
    names = (name for name in find_builtin_files("scenarios") if name not in EXCLUDED)
    return tuple(
        name
        for name in names
        if all(fault.kind in kinds for fault in load_with_overrides(name).settings.fault)
    )


def fix_backend(scenario: Scenario) -> Scenario:
    """Return a scenario with a backend in place of "auto"; unchanged if it cannot be run."""
    n_robots = len(scenario.controllers) * scenario.seeds * len(scenario.settings.world.start_poses)
    with suppress(OmniError):
        return choose_shared_backend(scenario, n_robots)
    return scenario


def check_scenarios(scenarios: Sequence[Scenario], subject: str | None) -> None:
    """Check that scenarios, all with the same controllers, can be compared in one table.

    Raises:
        OmniError: Two of them share a name, or the subject is not among the controllers.
    """
    names = [scenario.name for scenario in scenarios]
    for name in names:
        if names.count(name) > 1:
            raise OmniError(
                f"two scenarios are called {name!r}; give each scenario once, and files with "
                "different names"
            )
    if scenarios:
        check_subject(scenarios[0], subject)


def _run_to_end(scenario: Scenario, title: str, start_progress: StartProgress) -> Outcome:
    """Run a scenario to its end; if it cannot be run, return an outcome with the reason.

    Raises:
        StoppedError: The run was stopped. Metrics of a part of it would not be comparable.
    """
    try:
        simulation = prepare_simulation(scenario)
    except OmniError as error:
        return Outcome.not_run(scenario, " ".join(str(error).split()))
    outcome = run_simulation(simulation, start_progress(title, count_frames(simulation)))
    if reason := outcome.entry["reason"]:
        raise StoppedError(reason)
    return outcome
