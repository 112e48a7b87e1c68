"""One scenario, all its controllers, side by side."""

from collections.abc import Iterable, Sequence

from omni_control.controllers.base import Controller
from omni_control.errors import OmniError, suggest_names
from omni_mj.config.reference_factory import timed
from omni_mj.config.scenario import Scenario, load
from omni_mj.results.result import Outcome, Result
from omni_mj.robot.backends import choose_backend
from omni_mj.simulation.simulation import Simulation
from omni_mj.studies.study_runner import (
    AfterFrame,
    check_memory,
    ignore_frame,
    list_informed,
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
        scenario: what is run, or its name.
        controllers: names, `file.py:Class`, or classes derived from `Controller`. [the scenario's]
        seeds: of the random numbers, counting up, or how many from 0 on; the same for all
            controllers. [the scenario's]
        subject: the controller of which a verdict is asked for.
        after_frame: called with each frame's number.

    Returns:
        Everything that was recorded, measured; rows that failed are in it up to there.

    Raises:
        OmniError: there is no such scenario or controller, one cannot be run, the subject is not
            run, or seeds that do not count up.
    """
    simulation = prepare_simulation(scenario, controllers, seeds)
    check_subject(simulation.scenario, subject)
    return build_result(simulation, run_simulation(simulation, after_frame), subject)


def prepare_simulation(
    scenario: Scenario | str,
    controllers: Sequence[str | type[Controller]] | None = None,
    seeds: int | Iterable[int] | None = None,
) -> Simulation:
    """The simulation that `run` runs, at its start."""
    found = resolve_scenario(scenario, controllers, seeds)
    robots = len(found.controllers) * found.seeds * len(found.settings.world.start_poses)
    check_memory(robots, timed(found.settings).frames)
    return Simulation(found)


def resolve_scenario(
    scenario: Scenario | str,
    controllers: Sequence[str | type[Controller]] | None = None,
    seeds: int | Iterable[int] | None = None,
) -> Scenario:
    """The scenario, or the one of that name, with these controllers and seeds in place of its own."""
    found = scenario if isinstance(scenario, Scenario) else load(str(scenario))
    if controllers is not None:
        is_one = isinstance(controllers, str | type)
        found = found.replace(controllers=(controllers,) if is_one else tuple(controllers))
    if seeds is not None:
        numbers = list_seeds(seeds)
        found = found.replace(seed=numbers[0], seeds=len(numbers))
    return found


def check_subject(scenario: Scenario, subject: str | None) -> None:
    """Raise OmniError if the controller of which a verdict is asked for is not run."""
    if subject not in (None, *scenario.labels):
        raise OmniError(
            f"the subject {subject!r} is not among the controllers; {suggest_names(subject, scenario.labels)}"
        )


def choose_shared_backend(scenario: Scenario, robots: int) -> Scenario:
    """Return the scenario with the backend that suits so many robots at once, which all its simulations then share."""
    settings = scenario.settings
    if settings.physics.backend != "auto":
        return scenario
    backend = choose_backend("auto", scenario.plant, robots, timed(settings).frames)
    return scenario.replace(settings=settings.replace(physics={"backend": backend}))


def list_seeds(seeds: int | Iterable[int]) -> list[int]:
    """Seeds that count up one by one, from 0 if only their number is given.

    A scenario names them by the first and their number.

    Raises:
        OmniError: these do not.
    """
    given = list(range(seeds) if isinstance(seeds, int) else seeds)
    if not given or given != list(range(given[0], given[0] + len(given))):
        raise OmniError(
            "seeds must count up one by one, as range(5) does, or the scenario's file could not repeat the run,"
            f" unlike {given}; om.Simulation takes any"
        )
    return given


def build_result(simulation: Simulation, outcome: Outcome, subject: str | None = None) -> Result:
    """The result of one simulation."""
    reason = outcome.entry["reason"]
    return Result(
        [outcome],
        list(simulation.log.controllers),
        list_informed(simulation.scenario),
        simulation.log.seeds,
        subject,
        wall_s=outcome.entry["wall_s"],
        stopped=reason,
        complete=reason is None,
    )
