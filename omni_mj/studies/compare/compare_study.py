"""Many scenarios, all with the same controllers and seeds: who wins where."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from omni_control.controllers import list_available_controllers
from omni_control.controllers.base import Controller
from omni_control.errors import OmniError
from omni_mj.config import faults
from omni_mj.config.scenario import Scenario, load
from omni_mj.config.toml_files import builtin
from omni_mj.config.validation import collected, in_one
from omni_mj.results.result import Outcome, Result
from omni_mj.studies.run_scenario import (
    check_subject,
    list_seeds,
    prepare_simulation,
    resolve_scenario,
)
from omni_mj.studies.study_runner import (
    StartProgress,
    StoppedError,
    count_frames,
    list_informed,
    no_progress,
    run_simulation,
)

# Long; all faults at once; maneuvers for a log, which are no task
LEFT_OUT = ("hot-motors", "fault-all", "identify")
SEEDS = 10


def compare(
    scenarios: Sequence[Scenario | str] | None = None,
    controllers: Sequence[str | type[Controller]] | None = None,
    seeds: int | Iterable[int] = SEEDS,
    subject: str | None = None,
    keep_frames: bool = False,
    *,
    start_progress: StartProgress = no_progress,
    after_scenario: Callable[[Result, Outcome], None] = lambda result, outcome: None,
) -> Result:
    """Run controllers on many scenarios and seeds.

    A scenario that cannot be run is noted, and the others go on.

    Args:
        scenarios: what is run, or names. [all that come with the package, but for hot-motors,
            fault-all and identify]
        controllers: names, `file.py:Class`, or classes derived from `Controller`. [all that come
            with the package, but for those that need what is not installed]
        seeds: of the random numbers, or how many, counting up from 0.
        subject: the controller of which verdicts are asked for.
        keep_frames: whether to keep all frames.
        start_progress: called with a title and the number of frames before each scenario is run; what it
            returns is called after each frame, and may raise `StoppedError`.
        after_scenario: called with what there is so far, and the outcome that has come to it, with its
            frames.

    Raises:
        OmniError: there is no such scenario or controller, two scenarios share a name, the subject
            is not compared, or seeds do not count up.
    """
    started = time.perf_counter()
    given = default_scenarios() if scenarios is None else scenarios
    kinds, numbers = (
        list_available_controllers() if controllers is None else controllers,
        list_seeds(seeds),
    )
    all_chosen = [resolve_scenario(each, kinds) for each in given]
    check_scenarios(all_chosen, subject)
    result = Result([Outcome.not_run(each) for each in all_chosen], seeds=numbers, subject=subject)
    if all_chosen:
        result.controllers, result.informed = (
            list(all_chosen[0].labels),
            list_informed(all_chosen[0]),
        )
    try:
        for i, scenario in enumerate(all_chosen):
            outcome = _run(
                scenario, numbers, f"{scenario.name} ({i + 1} of {len(all_chosen)})", start_progress
            )
            result.outcomes[i] = outcome if keep_frames else replace(outcome, log=None)
            result.wall_s = time.perf_counter() - started
            after_scenario(result, outcome)
        result.complete = True
    except StoppedError as error:
        result.stopped = error.reason
    result.wall_s = time.perf_counter() - started
    return result


def default_scenarios(plant: str = "mujoco") -> tuple[str, ...]:
    """The scenarios that are compared unless others are named, but for those with faults that the plant has none of."""
    kinds = faults.known(plant)
    there = (name for name in builtin() if name not in LEFT_OUT)
    return tuple(
        name for name in there if all(fault.kind in kinds for fault in load(name).settings.fault)
    )


def check_scenarios(scenarios: Sequence[Scenario], subject: str | None) -> None:
    """See that scenarios, all with the same controllers, can stand in one table.

    Raises:
        OmniError: two of them share a name, or the subject is none of the controllers; a line for
            each.
    """
    names = [each.name for each in scenarios]
    errors = [
        f"two scenarios are called {name!r}; give each once, or files with another name in them"
        for name in names
        if names.count(name) > 1
    ]
    if scenarios:
        with collected(errors):
            check_subject(scenarios[0], subject)
    in_one(errors)


def _run(
    scenario: Scenario, seeds: Sequence[int], title: str, start_progress: StartProgress
) -> Outcome:
    """Return the outcome of a scenario, or that it cannot be run.

    Raises:
        StoppedError: before its end: half of it would not compare.
    """
    try:
        simulation = prepare_simulation(scenario, seeds=seeds)
    except OmniError as error:
        return Outcome.not_run(scenario, " ".join(str(error).split()))
    outcome = run_simulation(simulation, start_progress(title, count_frames(simulation)))
    if reason := outcome.entry["reason"]:
        raise StoppedError(reason)
    return outcome
