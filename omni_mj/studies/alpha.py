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
from omni_mj.scenarios.settings import Settings
from omni_mj.studies.alpha_findings import Study
from omni_mj.studies.conditions import CAUSES, CONDITIONS, PROFILE, Conditions, changed, combinations
from omni_mj.studies.drives import DIRECTIONS, Commanded, Drives, Groups, InUse
from omni_mj.studies.outcome import AfterFrame, StoppedError, nothing

TASKS = ("rect", "league")
BASE, COMBINED = "as it is", "causes combined"  # groups of drives, beside those of conditions
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
    profiles = Drives(chosen, _groups(chosen.settings, values))
    paths = {task: InUse(chosen, task) for task in (TASKS if tasks is None else tasks)}
    parts: list[Drives | InUse] = [profiles, *paths.values()]
    result = AlphaResult([Outcome.not_run(chosen)], [Commanded.__name__], seeds=[chosen.seed])
    after_frame, number = begin("alpha", sum(part.frames for part in parts)), itertools.count()
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
    for part in parts:
        log, failures = part.simulation.log, list(part.simulation.failures)
        entry = summary.entry(part.scenario, log, failures, {}, result.wall_s, result.stopped)
        own = measured if part is profiles else {}
        result.outcomes.append(Outcome(part.scenario, entry, part.rows, failures, own))
    del result.outcomes[0]  # that of nothing run
    return result


def _groups(settings: Settings, conditions: Conditions) -> Groups:
    return {
        BASE: [(settings, PROFILE)],
        **{name: [changed(settings, name, value) for value in values] for name, values in conditions.items()},
        COMBINED: [(combined, PROFILE) for combined in combinations(settings)],
    }


def _study(conditions: Conditions, profiles: Drives, body: Response, paths: Mapping[str, InUse]) -> Study:
    changes = profiles.grouped(body)
    base, last = changes.pop(BASE).at(0), changes.pop(COMBINED)
    shape = (2,) * len(CAUSES) + (len(DIRECTIONS),)
    combined = Response(*(getattr(last, name).reshape(shape) for name in NAMES))
    wheels = profiles.grouped(profiles.wheels())[COMBINED].at(-1)
    in_use = {task: path.percentiles() for task, path in paths.items()}
    return Study(conditions, base, changes, combined, wheels, in_use)
