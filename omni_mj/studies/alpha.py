"""How robots follow their commands, and why not better: gain and lag apart, and where they come from.

The paper's motor correction factor alpha is a ratio of ways, achieved over commanded, in a window of time. A robot that
is late shows a small one whenever it speeds up, however much of its speed it reaches in the end: alpha alone does not
tell gain from lag. So robots drive standard profiles, from which both are measured apart (`measure.response`):

- under conditions that are changed one by one;
- worn, with every combination of causes, which says how much of gain and lag each takes (`conditions.shares`);

and a controller drives robots around paths, which shows the alpha that a team would see (`drives`).
"""

import itertools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omni_mj.measure import summary
from omni_mj.measure.response import NAMES, Response
from omni_mj.measure.result import Outcome, Result
from omni_mj.scenarios import distributions
from omni_mj.scenarios.scenario import Scenario, load
from omni_mj.studies.alpha_findings import Study
from omni_mj.studies.conditions import CAUSES, CONDITIONS, PROFILE, Conditions, changed, combinations
from omni_mj.studies.drives import DIRECTIONS, Commanded, Drives, alpha_percentiles, path_simulation
from omni_mj.studies.outcome import AfterFrame, StoppedError, nothing, total_frames

TASKS = ("rect", "league")
Begin = Callable[[str, int], AfterFrame]


@dataclass
class AlphaResult(Result):
    """The result of the study; its rows hold settings, direction, profile and response of each drive.

    Attributes:
        study: what was found; None of a study that was stopped.
    """

    study: Study | None = None

    def summary(self) -> dict[str, Any]:
        """That of any result, with the study as `alpha`."""
        return super().summary() | {"alpha": self.study.report() if self.study else None}

    def table(self) -> str:
        """What was found, as lines of text."""
        return self.study.text() if self.study else ""


def alpha(
    scenario: Scenario | str = "rect",
    conditions: Conditions | None = None,
    tasks: Sequence[str] | None = None,
    *,
    begin: Begin = lambda title, frames: nothing,
) -> AlphaResult:
    """Study how robots follow their commands.

    Args:
        scenario: the robot and all its settings, or its name. Its reference is left out, and of the standard profiles
            its radio and the camera's noise as well.
        conditions: those that are changed one by one, with their values. [`CONDITIONS`]
        tasks: scenarios around whose paths a controller drives robots under usual conditions. [`TASKS`]
        begin: called with a title and the number of frames to come; what it returns is called after each frame with
            its number.

    Returns:
        Gain and lag, not a number for robots that failed, their causes, and alpha in use.

    Raises:
        OmniError: there is no such scenario or condition, or the plant has no wheels.
    """
    started, values = time.perf_counter(), CONDITIONS if conditions is None else conditions
    chosen = load(scenario) if isinstance(scenario, str) else scenario
    chosen = chosen.replace(name="alpha", description="gain and lag, and their causes", paper_table=0, seeds=1)
    distributions.refuse(chosen.distributions, "alpha")
    drives = [(chosen.settings, PROFILE)]
    drives += [changed(chosen.settings, name, value) for name, tried in values.items() for value in tried]
    drives += [(combined, PROFILE) for combined in combinations(chosen.settings)]
    profiles = Drives(chosen, drives)
    paths = {task: path_simulation(chosen, task) for task in (TASKS if tasks is None else tasks)}
    result = AlphaResult([Outcome.not_run(chosen)], [Commanded.__name__], seeds=[chosen.seed])
    after_frame, number = begin("alpha", profiles.frames + sum(map(total_frames, paths.values()))), itertools.count()

    def count(_: int) -> None:
        after_frame(next(number))

    try:
        profiles.run(count)
        for simulation in paths.values():
            simulation.run(count)
        result.complete = True
    except StoppedError as error:
        result.stopped = error.reason
    result.wall_s = time.perf_counter() - started
    measured = dict(profiles.labels)
    if result.complete:
        body = profiles.body()
        in_use = {task: alpha_percentiles(simulation.log) for task, simulation in paths.items()}
        result.study = _study(values, body, profiles.wheels().at(-1), in_use)
        measured |= {name: getattr(body, name).ravel() for name in NAMES}
    result.outcomes.clear()
    for simulation in (profiles.simulation, *paths.values()):
        failures = list(simulation.failures)
        entry = summary.entry(simulation.scenario, simulation.log, failures, {}, result.wall_s, result.stopped)
        result.outcomes.append(Outcome(simulation.scenario, entry, simulation.rows, failures, measured))
        measured = {}  # only the standard profiles have responses
    return result


def _study(
    conditions: Conditions, body: Response, wheels: Response, in_use: Mapping[str, Mapping[str, Mapping[str, float]]]
) -> Study:
    """Return the study for responses (drives, directions): unchanged, conditions one by one, combined causes."""
    start, changes = 1, {}
    for name, values in conditions.items():
        changes[name] = body.at(slice(start, start + len(values)))
        start += len(values)
    shape = (2,) * len(CAUSES) + (len(DIRECTIONS),)
    combined = Response(*(getattr(body, name)[start:].reshape(shape) for name in NAMES))
    return Study(conditions, body.at(0), changes, combined, wheels, in_use)
