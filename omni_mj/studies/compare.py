"""Many scenarios, all with the same controllers and seeds: who wins where."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import isfinite

from omni_control.controllers.base import Controller
from omni_control.errors import OmniError, choose
from omni_control.registry import available
from omni_mj.measure import limits
from omni_mj.measure.result import Outcome, Result
from omni_mj.measure.statistics import precise
from omni_mj.measure.verdict import errors_of
from omni_mj.scenarios import faults
from omni_mj.scenarios.checking import in_one
from omni_mj.scenarios.library import builtin
from omni_mj.scenarios.scenario import Scenario, load
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies.outcome import AfterFrame, StoppedError, drive, informed, joined, nothing
from omni_mj.studies.run import counted, prepare, with_kernel

LEFT_OUT = ("heat", "storm")  # many times as long as the others, and one in which everything happens at once
MOST_SEEDS, BLOCK = 20, 5  # of a scenario, and how many more at a time
# Of a mean: enough to tell apart two that differ by 7 %, or by less where they share their noise. With 10 % `worn`
# would stop at 5 seeds, before the first robot (of seed 8) that is so worn that errors are ten times as large.
HALF_WIDTH = 0.05
BeforeBlock = Callable[[Simulation], AfterFrame]


@dataclass(frozen=True)
class Watch:
    """Callbacks of a comparison.

    Attributes:
        before: Called with each simulation before it is run; what it returns is called after each frame, and may raise
            `StoppedError`.
        after: Called with what there is so far, and the outcome that has come to it or has grown, with its frames.
    """

    before: BeforeBlock = lambda simulation: nothing
    after: Callable[[Result, Outcome], None] = lambda result, outcome: None


def compare(
    scenarios: Sequence[Scenario | str] | None = None,
    controllers: Sequence[str | type[Controller]] | None = None,
    seeds: int | Iterable[int] = MOST_SEEDS,
    subject: str | None = None,
    keep: bool = False,
    *,
    half_width: float = HALF_WIDTH,
    known: Iterable[limits.Study] = (),
    watch: "Watch | None" = None,
) -> Result:
    """Run controllers on many scenarios and seeds.

    Each scenario is run with blocks of 5 seeds, until the competitors' maximum and mean errors in the plane are known
    as well as asked for, or there are no more; its numbers are those of all these seeds at once. A scenario that cannot
    be run is noted, and the others go on.

    Args:
        scenarios: what is run, or names. [all that come with the package, but for the long heat]
        controllers: names, `file.py:Class`, or classes derived from `Controller`. [all that come with the package, but
            for those that need what is not installed]
        seeds: of the random numbers, or how many, counting up from 0: as many as there may be.
        subject: the controller of which verdicts are asked for.
        keep: whether to keep all frames.
        half_width: half the 95 % interval of a mean, as a share of it, that is good enough; 0 for all seeds.
        known: summaries of studies that found the limits of scenarios, to stand beside: `om.limit(...).summary()`.
        watch: called before and after each block of seeds.

    Raises:
        OmniError: there is no such scenario or controller, two scenarios share a name, the subject is not compared,
            seeds do not count up, the half width is none, or a limit is that of something else.
    """
    started, watch = time.perf_counter(), watch or Watch()
    given = usual() if scenarios is None else scenarios
    kinds = tuple(available() if controllers is None else controllers)
    numbers = counted(range(seeds) if isinstance(seeds, int) else seeds)
    chosen = [(load(each) if isinstance(each, str) else each).replace(controllers=kinds) for each in given]
    check(chosen, subject, half_width)
    studies = limits.known(known, chosen)
    result = Result([Outcome.not_run(each) for each in chosen], seeds=numbers)
    result.subject, result.half_width = subject, half_width
    if chosen:
        result.controllers, result.informed = list(chosen[0].labels), informed(chosen[0])
    try:
        for i, each in enumerate(chosen):
            for grown in _growing(each, numbers, half_width, watch.before):
                outcome = _with(grown, studies[i])
                result.outcomes[i] = outcome if keep else replace(outcome, log=None)
                result.wall_s = time.perf_counter() - started
                watch.after(result, outcome)
        result.complete = True
    except StoppedError as error:
        result.stopped = error.reason
    result.wall_s = time.perf_counter() - started
    return result


def usual(plant: str = "mujoco") -> tuple[str, ...]:
    """The scenarios that are compared unless others are named, but for those with faults that the plant has none of."""
    kinds = faults.known(plant)
    there = (name for name in builtin() if name not in LEFT_OUT)
    return tuple(name for name in there if all(fault.kind in kinds for fault in load(name).settings.fault))


def check(chosen: Sequence[Scenario], subject: str | None, half_width: float = HALF_WIDTH) -> None:
    """See that scenarios, all with the same controllers, can stand in one table.

    Raises:
        OmniError: two of them share a name, the subject is none of the controllers, or the half width is no share; a
            line for each.
    """
    names = [each.name for each in chosen]
    errors = [
        f"two scenarios are called {name!r}; give each once, or files with another name in them"
        for name in names
        if names.count(name) > 1
    ]
    if subject is not None and chosen and subject not in chosen[0].labels:
        errors.append(f"the subject {subject!r} is not among the controllers; {choose(subject, chosen[0].labels)}")
    if not isfinite(half_width) or half_width < 0:
        errors.append(f"the half width must be a share of the mean such as 0.05, or 0 for all seeds, not {half_width}")
    in_one(errors)


def _growing(scenario: Scenario, seeds: Sequence[int], half_width: float, before: BeforeBlock) -> Iterator[Outcome]:
    """What there is of a scenario after each block of seeds, up to those that are enough, or that it cannot be run.

    Raises:
        StoppedError: in a block, which then counts for nothing.
    """
    block = BLOCK if half_width else len(seeds)
    scenario, parts = with_kernel(scenario, block * len(scenario.controllers)), list[Outcome]()
    for first in range(0, len(seeds), block):
        try:
            simulation = prepare(scenario, seeds=seeds[first : first + block])
        except OmniError as error:
            yield Outcome.not_run(scenario, " ".join(str(error).split()))
            return
        parts.append(drive(simulation, before(simulation)))
        if stopped := parts[-1].entry["reason"]:  # not all of it was run: its numbers would not compare
            raise StoppedError(stopped)
        outcome, run = joined(parts), first + len(parts[-1].entry["seeds"])
        if run == len(seeds) or precise(errors_of(outcome.entry["results"], informed(scenario)), half_width):
            yield outcome
            return
        unfinished = {"status": "stopped", "reason": f"{run} of at most {len(seeds)} seeds were run"}
        yield replace(outcome, entry=outcome.entry | unfinished)


def _with(outcome: Outcome, study: limits.Entry | None) -> Outcome:
    """The outcome, with the limits that are known of its scenario."""
    return replace(outcome, entry=outcome.entry | limits.beside(study, outcome.entry["seeds"]))
