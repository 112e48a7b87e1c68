"""Run one scenario with all its controllers and compare them."""

from collections.abc import Iterable, Sequence

from omni_control.controllers.base import Controller
from omni_control.errors import OmniError, suggest_names
from omni_mj.config.reference_factory import build_timed_reference
from omni_mj.config.scenario import Scenario, load_with_overrides
from omni_mj.results.result import Outcome, Result
from omni_mj.robot.backends import choose_backend
from omni_mj.simulation.simulation import Simulation
from omni_mj.studies.study_runner import (
    AfterFrame,
    check_memory,
    ignore_frame,
    list_privileged,
    run_simulation,
)


def run(
    scenario: Scenario | str,
    controllers: Sequence[str | type[Controller]] | None = None,
    seeds: int | Iterable[int] | None = None,
    *,
    subject: str | None = None,
    after_frame: AfterFrame = ignore_frame,
) -> Result:
    """Run a scenario with one or several controllers and compare them.

    Args:
        scenario: The scenario or its name.
        controllers: Names, `file.py:Class`, or classes derived from `Controller`. Default: the
            scenario's.
        seeds: Consecutive seeds, or a number of seeds that start at 0; the same for all
            controllers. Default: the scenario's.
        subject: Controller that the verdict is about. Default: no verdict.
        after_frame: Called with each frame's number.

    Returns:
        Recorded frames and metrics. Rows that failed end with their failure.

    Raises:
        OmniError: The scenario or a controller does not exist, a controller cannot be run, the
            subject is not among the controllers, or the seeds are not consecutive.
    """
    simulation = prepare_simulation(scenario, controllers, seeds)
    check_subject(simulation.scenario, subject)
    return build_result(simulation, run_simulation(simulation, after_frame), subject)


def prepare_simulation(
    scenario: Scenario | str,
    controllers: Sequence[str | type[Controller]] | None = None,
    seeds: int | Iterable[int] | None = None,
) -> Simulation:
    """Return the simulation that `run` runs, at its start."""
    scenario = resolve_scenario(scenario, controllers, seeds)
    settings = scenario.settings
    robots = len(scenario.controllers) * scenario.seeds * len(settings.world.start_poses)
    check_memory(robots, build_timed_reference(settings).frames)
    return Simulation(scenario)


def resolve_scenario(
    scenario: Scenario | str,
    controllers: Sequence[str | type[Controller]] | None = None,
    seeds: int | Iterable[int] | None = None,
) -> Scenario:
    """Return a scenario, loaded if it is a name, with other controllers and seeds if given."""
    scenario = scenario if isinstance(scenario, Scenario) else load_with_overrides(str(scenario))
    if controllers is not None:
        is_one = isinstance(controllers, str | type)
        scenario = scenario.replace(controllers=(controllers,) if is_one else tuple(controllers))
    if seeds is not None:
        seed_list = list_seeds(seeds)
        scenario = scenario.replace(seed=seed_list[0], seeds=len(seed_list))
    return scenario


def check_subject(scenario: Scenario, subject: str | None) -> None:
    """Raise OmniError if the subject of a verdict is not among the scenario's controllers."""
    if subject not in (None, *scenario.labels):
        choices = suggest_names(subject, scenario.labels)
        raise OmniError(f"the subject {subject!r} is not among the controllers; {choices}")


def choose_shared_backend(scenario: Scenario, robots: int) -> Scenario:
    """Return the scenario with the backend for this many robots, if its backend is "auto".

    Simulations of one study share a backend, because backends differ in the last bits.
    """
    settings = scenario.settings
    if settings.physics.backend != "auto":
        return scenario
    backend = choose_backend("auto", scenario.plant, robots, build_timed_reference(settings).frames)
    return scenario.replace(settings=settings.replace(physics={"backend": backend}))


def list_seeds(seeds: int | Iterable[int]) -> list[int]:
    """Return consecutive seeds, from 0 on if only their number is given.

    A scenario's file stores the first seed and their number.

    Raises:
        OmniError: The seeds are not consecutive.
    """
    seed_list = list(range(seeds) if isinstance(seeds, int) else seeds)
    if not seed_list or seed_list != list(range(seed_list[0], seed_list[0] + len(seed_list))):
        raise OmniError(
            f"seeds must count up one by one, such as range(5), got {seed_list}: a scenario's file "
            "could not repeat the run; om.Simulation takes any seeds"
        )
    return seed_list


def build_result(simulation: Simulation, outcome: Outcome, subject: str | None = None) -> Result:
    """Return the result of one simulation."""
    reason = outcome.entry["reason"]
    return Result(
        [outcome],
        list(simulation.log.controllers),
        list_privileged(simulation.scenario),
        simulation.log.seeds,
        subject,
        wall_s=outcome.entry["wall_s"],
        stopped=reason,
        complete=reason is None,
    )
