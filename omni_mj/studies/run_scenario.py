"""Run one scenario with all its controllers, and compare them; functions that all studies use."""

import sys
import time
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from omni_control.arguments import check_integer, check_types
from omni_control.controllers.registry import list_available_controllers
from omni_control.errors import OmniError, suggest_names
from omni_mj.config.plugins import ControllerSpec, find_controller, label_controller
from omni_mj.config.reference_factory import build_timed_reference
from omni_mj.config.scenario import MAX_SEEDS, Scenario, load_with_overrides
from omni_mj.io.free_memory import measure_free_bytes
from omni_mj.results import metrics, summary
from omni_mj.results.result import Outcome, Result
from omni_mj.robot.numpy_and_jax_backends import choose_backend
from omni_mj.simulation.simulation import Simulation

AfterFrame = Callable[[int], None]  # called with the number of each frame
StartProgress = Callable[[str, int], AfterFrame]  # called with a title and the number of frames
# Memory per robot and frame, bytes: reference, and the log if the disk has no room for it
FRAME_BYTES = 700


class StoppedError(Exception):
    """Raised by a callback between two frames to end a study; results so far are kept.

    Its text is the reason in one word, such as "interrupted".
    """


def ignore_frame(_: object) -> None:
    """Do nothing after a frame."""


def no_progress(title: str, frames: int) -> AfterFrame:
    """Return `ignore_frame`, for studies whose progress is not shown."""
    return ignore_frame


@check_types
def run(
    scenario: Scenario | str,
    controllers: ControllerSpec | Sequence[ControllerSpec] | None = None,
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
    scenario = resolve_scenario(scenario, controllers, seeds)
    check_subject(scenario, subject)
    outcome = run_simulation(prepare_simulation(scenario), after_frame)
    return build_result(outcome, subject)


def prepare_simulation(scenario: Scenario) -> Simulation:
    """Return the simulation of a scenario at its start, if there is enough memory for it."""
    settings = scenario.settings
    robots = len(scenario.controllers) * scenario.seeds * len(settings.world.start_poses)
    check_memory(robots, build_timed_reference(settings).frames)
    return Simulation(scenario)


def run_simulation(simulation: Simulation, after_frame: AfterFrame = ignore_frame) -> Outcome:
    """Run a simulation and compute the metrics of its rows.

    Args:
        simulation: At its start.
        after_frame: Called with each frame's number; it may raise `StoppedError`.

    Returns:
        The outcome with its log, up to the last frame if the run was stopped.
    """
    start_time, stopped = time.perf_counter(), None
    try:
        simulation.run(after_frame)
    except StoppedError as error:
        stopped = str(error)
    log, drawn = simulation.log, simulation.drawn_parameters
    # The order of failures must not depend on how rows were split into batches.
    failures = sorted(simulation.failures, key=lambda failure: (failure.time_s, failure.row))
    row_metrics = metrics.row_metrics(log, failures)
    wall_s = time.perf_counter() - start_time
    entry = summary.scenario_entry(
        simulation.scenario, log, failures, row_metrics, wall_s, stopped, drawn
    )
    return Outcome(simulation.scenario, entry, log.rows, failures, row_metrics, log, drawn)


def build_result(outcome: Outcome, subject: str | None = None) -> Result:
    """Return the result of one scenario."""
    scenario, reason = outcome.scenario, outcome.entry["reason"]
    return Result(
        [outcome],
        list(scenario.labels),
        list_privileged(scenario),
        scenario.seed_list,
        subject,
        wall_s=outcome.entry["wall_s"],
        stopped=reason,
        complete=outcome.was_run,
    )


def resolve_scenario(
    scenario: Scenario | str,
    controllers: ControllerSpec | Sequence[ControllerSpec] | None = None,
    seeds: int | Iterable[int] | None = None,
) -> Scenario:
    """Return a scenario with other controllers and seeds, if they are given.

    Args:
        scenario: The scenario, or the name of one to load.
        controllers: See `run`.
        seeds: See `run`.
    """
    scenario = scenario if isinstance(scenario, Scenario) else load_with_overrides(str(scenario))
    if controllers is not None:
        if isinstance(controllers, str | type):
            controllers = (controllers,)
        scenario = scenario.replace(controllers=tuple(controllers))
    if seeds is not None:
        seed_list = list_seeds(seeds)
        scenario = scenario.replace(seed=seed_list[0], seeds=len(seed_list))
    return scenario


def list_seeds(seeds: int | Iterable[int]) -> list[int]:
    """Return a list of consecutive seeds.

    Args:
        seeds: The seeds, or the number of seeds that start at 0.

    Raises:
        OmniError: The seeds are not consecutive.
    """
    if isinstance(seeds, int | np.integer):
        seeds = range(check_integer("seeds", seeds, 1, MAX_SEEDS))
    seed_list = list(seeds)
    if not seed_list or seed_list != list(range(seed_list[0], seed_list[0] + len(seed_list))):
        raise OmniError(
            f"seeds must be consecutive, such as range(5), got {seed_list}: a scenario's file "
            "holds only the first seed and their number; om.Simulation takes any seeds"
        )
    return seed_list


def choose_shared_backend(scenario: Scenario, robots: int) -> Scenario:
    """Replace the backend "auto" of a scenario by the one for a number of robots.

    All simulations of a study need the same backend, because backends differ in the last bits.
    """
    settings = scenario.settings
    frames = build_timed_reference(settings).frames
    backend = choose_backend(settings.physics.backend, scenario.plant, robots, frames)
    return scenario.replace(settings=settings.replace(physics={"backend": backend}))


def check_subject(scenario: Scenario, subject: str | None) -> None:
    """Raise OmniError if the subject of a verdict is not among the scenario's controllers."""
    if subject not in (None, *scenario.labels):
        choices = suggest_names(subject, scenario.labels)
        raise OmniError(f"the subject {subject!r} is not among the controllers; {choices}")


def check_memory(robots: int, frames: int) -> None:
    """Raise OmniError if robots that are simulated together need more memory than is free."""
    needed_b, free_b = robots * frames * FRAME_BYTES, measure_free_bytes()
    if needed_b > free_b:
        raise OmniError(
            f"{robots} robots at once for {frames} frames take about {needed_b / 1e9:.2g} GB of "
            f"memory, but only {free_b / 1e9:.2g} GB are free; "
            "run fewer at a time, or a shorter scenario"
        )


def count_frames(simulation: Simulation) -> int:
    """Return the number of frames of a simulation from start to end."""
    return max(reference.frames for reference in simulation.references)


def list_privileged(scenario: Scenario) -> list[str]:
    """Return the labels of the scenario's controllers that know the true state."""
    return [
        label_controller(kind) for kind in scenario.controllers if find_controller(kind).knows_truth
    ]


def list_competitors() -> tuple[str, ...]:
    """Return the package's controllers except those that know the true state."""
    return tuple(
        name for name in list_available_controllers() if not find_controller(name).knows_truth
    )


def quiet_mujoco() -> None:
    """Turn off MuJoCo's warnings if it is loaded. Rows report relevant ones as failures."""
    if "mujoco" in sys.modules:
        import mujoco

        log = mujoco.MjLogConfig.get()
        log.logto_file = log.logto_console = False
        log.set()
