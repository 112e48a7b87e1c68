"""How robots follow their commands, and why not better: gain and lag apart, and where they come from.

The paper's motor correction factor alpha is a ratio of ways, achieved over commanded, in a window of time. A robot that
is late shows a small one whenever it speeds up, however much of its speed it reaches in the end: alpha alone does not
tell gain from lag. So robots drive standard profiles, from which both are measured apart (`measure.response`):

- under conditions that are changed one by one;
- worn, with every combination of causes, which says how much of gain and lag each takes (`conditions.shares`);

and a controller drives robots around paths, which shows the alpha that a team would see (`in_use`).
"""

import itertools
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from omni_mj.measure import summary
from omni_mj.measure.response import NAMES, Response
from omni_mj.measure.result import Outcome, Result
from omni_mj.scenarios import distributions
from omni_mj.scenarios.scenario import Scenario, load
from omni_mj.studies import drives, in_use
from omni_mj.studies.alpha_findings import Study
from omni_mj.studies.conditions import CAUSES, CONDITIONS, PROFILE, Conditions, changed, combinations
from omni_mj.studies.drives import DIRECTIONS, Commanded, Drives
from omni_mj.studies.in_use import InUse
from omni_mj.studies.outcome import AfterFrame, StoppedError, nothing

TASKS = ("rect", "league")
BASE, COMBINED = "as it is", "causes combined"  # groups of drives, beside those of conditions


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
    after_frame: AfterFrame = nothing,
) -> AlphaResult:
    """Study how robots follow their commands.

    Args:
        scenario: the robot and all its settings, or its name. Its reference is left out, and of the standard profiles
            its radio and the camera's noise as well.
        conditions: those that are changed one by one, with their values. [`CONDITIONS`]
        tasks: scenarios around whose paths a controller drives robots under usual conditions. [`TASKS`]
        after_frame: called after each frame with its number of `total_frames`.

    Returns:
        Gain and lag, not a number for robots that failed, their causes, and alpha in use.

    Raises:
        OmniError: there is no such scenario or condition, or the plant has no wheels.
    """
    started, values = time.perf_counter(), CONDITIONS if conditions is None else conditions
    chosen = _named(load(scenario) if isinstance(scenario, str) else scenario)
    distributions.refuse(chosen.distributions, "alpha")
    profiles = Drives(chosen, _groups(chosen, values))
    paths = {task: InUse(chosen, task) for task in (TASKS if tasks is None else tasks)}
    parts: list[Drives | InUse] = [profiles, *paths.values()]
    result = AlphaResult([Outcome.not_run(chosen)], [Commanded.__name__], seeds=[chosen.seed])
    number = itertools.count()
    try:
        for part in parts:
            part.run(lambda _: after_frame(next(number)))
    except StoppedError as error:
        result.stopped = error.reason
    result.wall_s = time.perf_counter() - started
    result.complete = result.stopped is None
    measured = dict(profiles.driven)
    if result.complete:
        body = profiles.body()
        result.study = _study(values, profiles, body, paths)
        measured |= {name: getattr(body, name) for name in NAMES}
    result.outcomes = [_outcome(part, result, measured if part is profiles else {}) for part in parts]
    return result


def total_frames(scenario: Scenario, conditions: Conditions | None = None, tasks: Sequence[str] | None = None) -> int:
    """How many frames `alpha` simulates, one after the other."""
    groups = _groups(scenario, CONDITIONS if conditions is None else conditions)
    return drives.frames(groups) + sum(in_use.frames(scenario, task) for task in (TASKS if tasks is None else tasks))


def _groups(scenario: Scenario, conditions: Conditions) -> drives.Groups:
    settings = scenario.settings
    return {
        BASE: [(settings, PROFILE)],
        **{name: [changed(settings, name, value) for value in values] for name, values in conditions.items()},
        COMBINED: [(each, PROFILE) for each in combinations(settings)],
    }


def _study(conditions: Conditions, profiles: Drives, body: Response, paths: Mapping[str, InUse]) -> Study:
    found = profiles.grouped(body)
    base = found.pop(BASE).at(0)
    shape = (2,) * len(CAUSES) + (len(DIRECTIONS),)
    last = found.pop(COMBINED)
    combined = Response(*(getattr(last, name).reshape(shape) for name in NAMES))
    wheels = profiles.grouped(profiles.wheels())[COMBINED].at(-1)
    return Study(conditions, base, found, combined, wheels, {task: path.percentiles() for task, path in paths.items()})


def _named(scenario: Scenario) -> Scenario:
    return scenario.replace(name="alpha", description="gain and lag, and their causes", paper_table=0, seeds=1)


def _outcome(part: Drives | InUse, result: AlphaResult, measured: Mapping[str, np.ndarray]) -> Outcome:
    log, failures = part.simulation.log, list(part.simulation.failures)
    entry = summary.entry(part.scenario, log, failures, {}, result.wall_s, result.stopped)
    return Outcome(part.scenario, entry, part.rows, failures, measured)
