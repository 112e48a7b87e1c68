"""Many scenarios, all with the same controllers and seeds: who wins where."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

from omni_control.controllers.base import Controller
from omni_control.errors import OmniError, choose
from omni_control.registry import CONTROLLERS
from omni_mj.measure.result import Outcome, Result
from omni_mj.scenarios.faults import known
from omni_mj.scenarios.library import builtin
from omni_mj.scenarios.scenario import Scenario, load
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies.outcome import AfterFrame, StoppedError, drive, limits, nothing
from omni_mj.studies.run import counted, prepare

LEFT_OUT = ("heat",)  # many times as long as the others
BeforeScenario = Callable[[Simulation], AfterFrame]


def compare(
    scenarios: Sequence[Scenario | str] | None = None,
    controllers: Sequence[str | type[Controller]] | None = None,
    seeds: int | Iterable[int] = 5,
    subject: str | None = None,
    keep: bool = False,
    *,
    before_scenario: BeforeScenario = lambda simulation: nothing,
    after_scenario: Callable[[Result, Outcome], None] = lambda result, outcome: None,
) -> Result:
    """Run controllers on many scenarios and seeds.

    A scenario that cannot be run is noted, and the others go on.

    Args:
        scenarios: what is run, or names. [all that come with the package, but for the long heat]
        controllers: names, `file.py:Class`, or classes derived from `Controller`. [all that come with the package]
        seeds: of the random numbers, or how many, counting up from 0.
        subject: the controller of which verdicts are asked for.
        keep: whether to keep all frames.
        before_scenario: called with each simulation before it is run; what it returns is called after each frame, and
            may raise `StoppedError`.
        after_scenario: called with what there is so far, and the outcome that has come to it, with its frames.

    Raises:
        OmniError: there is no such scenario or controller, two scenarios share a name, the subject is not compared, or
            seeds do not count up.
    """
    started = time.perf_counter()
    given = usual() if scenarios is None else scenarios
    kinds = tuple(CONTROLLERS if controllers is None else controllers)
    numbers = counted(range(seeds) if isinstance(seeds, int) else seeds)
    chosen = [(load(each) if isinstance(each, str) else each).replace(controllers=kinds) for each in given]
    result = Result([Outcome.not_run(each) for each in chosen], seeds=numbers, subject=subject)
    if chosen:
        result.controllers, result.limits = list(chosen[0].labels), limits(chosen[0])
    check(chosen, subject)
    try:
        for i, outcome in enumerate(_outcomes(chosen, numbers, subject, before_scenario)):
            result.outcomes[i] = outcome if keep else replace(outcome, log=None)
            result.wall_s = time.perf_counter() - started
            after_scenario(result, outcome)
        result.complete = True
    except StoppedError as error:
        result.stopped = error.reason
    result.wall_s = time.perf_counter() - started
    return result


def usual(plant: str = "mujoco") -> tuple[str, ...]:
    """The scenarios that are compared unless others are named, but for those with faults that the plant has none of."""
    kinds = known(plant)
    there = (name for name in builtin() if name not in LEFT_OUT)
    return tuple(name for name in there if all(fault.kind in kinds for fault in load(name).settings.fault))


def check(chosen: Sequence[Scenario], subject: str | None) -> None:
    """See that scenarios, all with the same controllers, can stand in one table.

    Raises:
        OmniError: two of them share a name, or the subject is none of the controllers.
    """
    names = [each.name for each in chosen]
    for name in names:
        if names.count(name) > 1:
            raise OmniError(f"two scenarios are called {name!r}; give each once, or files with another name in them")
    if subject is not None and chosen and subject not in chosen[0].labels:
        raise OmniError(f"the subject {subject!r} is not among the controllers; {choose(subject, chosen[0].labels)}")


def _outcomes(
    chosen: Iterable[Scenario], seeds: Sequence[int], subject: str | None, before: BeforeScenario
) -> Iterator[Outcome]:
    """Those of the scenarios that are run to their end, or cannot be, one after the other."""
    for each in chosen:
        try:
            simulation = prepare(each, seeds=seeds)
        except OmniError as error:
            yield Outcome.not_run(each, " ".join(str(error).split()))
            continue
        outcome = drive(simulation, before(simulation), subject)
        if stopped := outcome.entry["reason"]:  # not all of it was run: its numbers would not compare
            raise StoppedError(stopped)
        yield outcome
