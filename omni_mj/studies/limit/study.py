"""The study: robots learn the way of a scenario, practise under noise, and show what they can; see `limit`."""

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.measure import metrics, summary
from omni_mj.measure.result import Outcome, Result
from omni_mj.measure.statistics import plain
from omni_mj.measure.table import plus_minus
from omni_mj.measure.verdict import ERRORS, mean
from omni_mj.scenarios import distributions
from omni_mj.scenarios.scenario import Scenario, load
from omni_mj.simulate.log import Log
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies.limit import rivals
from omni_mj.studies.limit.attempts import Learned, Table, Together, led, quiet, row
from omni_mj.studies.limit.learning import Begin, Learner
from omni_mj.studies.limit.plan import AIMS, Aim
from omni_mj.studies.limit.practice import Skill, leader, practise
from omni_mj.studies.outcome import StoppedError, nothing
from omni_mj.studies.run import counted

LIMIT, WITHOUT_NOISE = "limit", "limit without noise"
SEEDS, ATTEMPTS = 20, 16
OWN_SHARE = 4  # one attempt of so many is on the scenario's own wheels, if those before are on faster ones
DEFINITIONS = {
    "limit": "least error found of robots that know the plant, and see no more than any controller: of information",
    "limit without noise": "least error found of robots that nothing disturbs and that see the truth: of the plant",
    "max, mean": "each the least: where another run has a lower mean than that with the lowest maximum, it is its",
    "of": "whose the maximum and mean of the limit are: of robots that learned, or of a controller that was better",
    "attempts": "least maximum and mean of the error in the plane, m, without noise, after each attempt (median robot)",
    "unknowns": "standard deviations per frame of what is not foreseen, by which poses are predicted best",
    "foreseen_m": "root mean square by which positions are off those predicted when commands act: no feedback mends it",
    "practice": "mean over seeds of practice of maximum and mean, m, of runs led along at each weight of feedback",
    "rivals": "the same of the package's controllers that see what any team sees; those that come near, and the best,"
    " drive the seeds of the limit too",
}


@dataclass
class LimitResult(Result):
    """The result of the study; its rows and frames are those of the robots that show what they can.

    Attributes:
        history: without noise, the least maximum and the least mean of the error in the plane so far, m, after each
            attempt.
        own_from: number of the first of them on the scenario's own wheels.
        commands: that were learned, by aim, (F, L, 3), world frame, m/s and rad/s: one robot if all are alike,
            otherwise one per seed.
        skill: what practice under noise left; None of a study that was stopped before.
        whose: the label in the log of those whose errors the limit's are.
    """

    history: Sequence[Mapping[Aim, float]] = ()
    own_from: int = 0
    commands: Mapping[Aim, Array] = field(default_factory=dict)
    skill: Skill | None = None
    whose: Mapping[Aim, str] = field(default_factory=dict)

    def summary(self) -> dict[str, Any]:
        """That of any result, with what was learned as `limit`."""
        learned: dict[str, Any] = {
            "definitions": DEFINITIONS,
            "attempts": [dict(each) for each in self.history],
            "own_wheels_from": self.own_from,
        }
        if self.skill:
            learned["unknowns"] = {name: plain(value) for name, value in asdict(self.skill.unknowns).items()}
            learned["foreseen_m"] = self.skill.foreseen
            learned["practice"] = [{**asdict(policy), **merits} for policy, merits in self.skill.tried.items()]
            learned["rivals"] = self.skill.rivals
            learned["of"] = {aim: self._whose(aim) for aim in self.whose}
            learned["led_along"] = {aim: asdict(policy) for aim, policy in self.skill.policies.items()}
        return super().summary() | {"limit": learned}

    def table(self) -> str:
        """The limits' errors, and how they were found, as lines of text."""
        return "\n".join([super().table(), *self._lines()]) if self.complete else ""

    def _whose(self, aim: Aim) -> str:
        return "learned" if self.whose[aim].startswith(LIMIT) else self.whose[aim]

    def _lines(self) -> Iterator[str]:
        (outcome,) = self.outcomes
        for name, result in outcome.entry["results"].items():
            error = result["error_m"]["distance"]
            if len(error["max"]["seeds"]) > 1:
                both = " / ".join(plus_minus(error[statistic], 100) for statistic in ("max", "mean"))
                yield f"{name}: maximum / mean in the plane, mean over seeds: {both} cm"
        for aim in AIMS:
            if (name := self._whose(aim)) != "learned":
                yield f"the limit of the {ERRORS[aim]} is that of {name}: learning found nothing lower"
        first, last = ((100 * each["max"], 100 * each["mean"]) for each in (self.history[0], self.history[-1]))
        yield (
            f"without noise, in {len(self.history) - 1} attempts: from {first[0]:.2f}/{first[1]:.2f}"
            f" to {last[0]:.4f}/{last[1]:.4f} cm in the plane"
        )
        if self.skill:
            yield f"with noise, places are foreseen within {100 * self.skill.foreseen:.3f} cm rms when a command acts"


def limit(
    scenario: Scenario | str = "rect",
    seeds: int | Iterable[int] = SEEDS,
    iterations: int = ATTEMPTS,
    *,
    begin: Begin = lambda title, frames: nothing,
) -> LimitResult:
    """Find out what is possible on a scenario's plant.

    Robots that `[variation]` sets apart learn each for itself: the team knows its robots. What noise does is not known.

    Args:
        scenario: what is driven, or its name; its controllers are left out.
        seeds: of the random numbers under which robots show what they can, or how many, counting up from 0.
        iterations: attempts, at the most.
        begin: called with a title and the number of frames before robots drive; what it returns is called after each
            frame, and may raise `StoppedError`.

    Returns:
        Errors of "limit", with noise, and of "limit without noise", in the form of any controller's.

    Raises:
        OmniError: there is no such scenario, robots share its world, seeds do not count up, or fewer than two
            iterations.
    """
    started = time.perf_counter()
    chosen = load(scenario) if isinstance(scenario, str) else scenario
    distributions.refuse(chosen.distributions, "limit")
    numbers = counted(range(seeds) if isinstance(seeds, int) else seeds)
    check(chosen, iterations)
    chosen = chosen.replace(seed=numbers[0], seeds=len(numbers))
    result = LimitResult([Outcome.not_run(chosen)], [LIMIT, WITHOUT_NOISE], seeds=numbers)
    try:
        _study(result, chosen, numbers, iterations, begin)
        result.complete = True
    except StoppedError as error:
        result.stopped = error.reason
    result.wall_s = time.perf_counter() - started
    return result


def check(scenario: Scenario, iterations: int) -> None:
    """See that the limit of a scenario can be found.

    Raises:
        OmniError: it cannot; all that is wrong, a line each.
    """
    wrong = []
    if len(scenario.settings.world.places) > 1:
        wrong.append(
            f"the limit is that of a robot alone, and world.places of {scenario.name!r} has "
            f"{len(scenario.settings.world.places)} places; give one: --set world.places=[[0,0,0]]"
        )
    if iterations < 2:
        wrong.append(f"the limit takes at least 2 iterations to find, not {iterations}")
    if wrong:
        raise OmniError("\n".join(wrong))


def _study(result: LimitResult, chosen: Scenario, seeds: Sequence[int], iterations: int, begin: Begin) -> None:
    """Put into the result what comes out; raise StoppedError if it was stopped."""
    started, faster = time.perf_counter(), _faster(chosen)
    learner = Learner(quiet(faster), _robots(chosen, seeds), begin)
    result.history = learner.history
    own = max(iterations // OWN_SHARE, 1) if faster is not chosen else 0
    learner.learn(iterations - own)
    skill = practise(faster, learner.deviations, learner.best, begin)
    result.own_from = len(learner.history)
    if own:
        learner.learn_on(quiet(chosen), own - 1)
    result.skill, result.commands = skill, {aim: best.asked for aim, best in learner.best.items()}
    outcome, result.whose = _shown(chosen, seeds, learner, skill, begin, started)
    result.outcomes, result.controllers = [outcome], list(outcome.entry["results"])


def _faster(scenario: Scenario) -> Scenario:
    """The same robot on wheels that are computed in a third of the time, if there are."""
    wheels = scenario.settings.wheels
    if scenario.plant != "mujoco" or (wheels.model, wheels.creep) != ("rollers", "on"):
        return scenario
    return scenario.replace(settings=scenario.settings.replace(wheels={"model": "two-rollers"}))


def _robots(scenario: Scenario, seeds: Sequence[int]) -> list[int]:
    """Seeds of the robots that learn: all, or one if all robots are alike."""
    apart = Simulation(scenario, [Learned], rows=[row(scenario, 0, seeds[0])]).drawn
    return list(seeds) if apart else [seeds[0]]


def _shown(
    chosen: Scenario, seeds: Sequence[int], learner: Learner, skill: Skill, begin: Begin, started: float
) -> tuple[Outcome, dict[Aim, str]]:
    """Have robots show what they can: under noise, each seed, and without, each robot that learned; and rivals."""
    calm, robots = quiet(chosen), np.arange(len(seeds)) % len(learner.seeds)
    policies = list(dict.fromkeys(skill.policies.values()))
    labels = [LIMIT, f"{LIMIT}, mean"][: len(policies)]
    rows = [(chosen, seed, label) for label in labels for seed in seeds]
    still = [WITHOUT_NOISE, f"{WITHOUT_NOISE}, mean"]
    rows += [(calm, seed, label) for label in still for seed in learner.seeds]
    leads = leader(chosen, skill.deviations, skill.unknowns, learner.best, policies, robots)
    tables = Table(np.concatenate([learner.best[aim].asked for aim in AIMS], axis=1))
    kinds = [type(label, (Learned,), {}) for label in (*labels, *still)]
    simulation = Simulation(
        chosen, kinds, rows=[row(each, i, seed, label) for i, (each, seed, label) in enumerate(rows)]
    )
    both = Together([(leads, len(policies) * len(seeds)), (tables, len(still) * len(learner.seeds))])
    led(simulation, both, begin("limits", len(learner.reference)))
    names = rivals.near(skill.rivals, list(skill.tried.values()))
    beside = Simulation(chosen, names, seeds=seeds)
    beside.run(begin("controllers", len(learner.reference)))

    parts, table = (simulation, beside), [*simulation.rows]
    table += [replace(each, world=i) for i, each in enumerate(beside.rows, len(table))]
    log = Log.joined([part.log for part in parts], table)
    failures = [*simulation.failures]
    failures += [replace(failure, row=failure.row + len(simulation.rows)) for failure in beside.failures]
    drawn = {name: np.concatenate([part.drawn[name] for part in parts]) for name in simulation.drawn}
    measured, wall = metrics.row_metrics(log, failures), time.perf_counter() - started
    entry = summary.entry(chosen, log, failures, measured, wall, None, drawn=drawn)
    results = {name: {**result, "reduction_percent": None} for name, result in entry["results"].items()}
    least, whose = _least(results, [*labels, *names])
    found = {LIMIT: least, WITHOUT_NOISE: _least(results, still)[0], **{name: results[name] for name in names}}
    entry |= {"results": found, "verdict": None}
    return Outcome(chosen, entry, table, failures, {**measured, **drawn}, log), whose


def _least(results: Mapping[str, Any], names: Sequence[str]) -> tuple[dict[str, Any], dict[Aim, str]]:
    """What was found by both aims: the maximum of the one, all else of errors of the other; and who these are."""
    whose: dict[Aim, str] = {aim: min(names, key=lambda name: mean(results[name], aim)) for aim in AIMS}
    one, other = results[whose["max"]], results[whose["mean"]]
    found = {**one}
    for key in ("error_m", "error_rad"):
        found[key] = {axis: other[key][axis] | {"max": one[key][axis]["max"]} for axis in one[key]}
    return found, whose
