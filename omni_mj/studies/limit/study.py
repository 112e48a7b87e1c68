"""The study of a limit: robots learn a path, practise under noise, and drive next to the package's best controllers."""

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np

from omni_control import controllers
from omni_control.kinematics import Array
from omni_control.registry import CONTROLLERS
from omni_mj.measure import metrics, summary
from omni_mj.measure.result import Outcome, Result
from omni_mj.measure.table import plus_minus
from omni_mj.measure.verdict import ERRORS, mean
from omni_mj.scenarios import distributions
from omni_mj.scenarios.checking import in_one
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.scenario import Scenario, load
from omni_mj.simulate.log import Log
from omni_mj.simulate.simulation import Failure, Simulation
from omni_mj.studies.limit.learning import AIMS, Aim, Begin, Drives, Learner, lead, quiet, simulation
from omni_mj.studies.limit.tracking import Policy, Tracker
from omni_mj.studies.outcome import StoppedError, nothing
from omni_mj.studies.run import counted, with_kernel

LIMIT, WITHOUT_NOISE = "limit", "limit without noise"
SEEDS, ATTEMPTS = 20, 16
PRACTICE_SEEDS, RIVAL_SEEDS, FIRST_SEED = 5, 3, 1_000_000  # seeds of practice count on from the scenario's
WEIGHTS, NOISES = (0.0003, 0.001, 0.003, 0.01, 0.03), (0.1, 0.3, 1.0)  # policies that are tried: all pairs
DEFINITIONS = {
    "limit": "least error found of robots that know the plant, and see no more than any controller: of information",
    "limit without noise": "least error found of robots that nothing disturbs and that see the truth: of the plant",
    "of": "whose the maximum and mean of the limit are: of robots that learned, or of a controller that was better",
    "attempts": "maximum and mean error in the plane, m, of the best run without noise, after each attempt (median)",
}


@dataclass
class LimitResult(Result):
    """The result of the study; its rows and frames are those of the robots that show what they can.

    Attributes:
        history: Maximum and mean error in the plane of the best run without noise, m, after each attempt.
        commands: That were learned, (F, L, 3), world frame, m/s and rad/s: of one robot if all are alike, otherwise of
            one per seed.
        whose: Aim -> label in the log of those whose errors the limit's are.
    """

    history: Sequence[Mapping[Aim, float]] = ()
    commands: Array | None = None
    whose: Mapping[Aim, str] = field(default_factory=dict)

    def summary(self) -> dict[str, Any]:
        """Return that of any result, with what was learned as `limit`."""
        learned = {
            "definitions": DEFINITIONS,
            "attempts": [dict(errors) for errors in self.history],
            "of": {aim: self._winner(aim) for aim in self.whose},
        }
        return super().summary() | {"limit": learned}

    def table(self) -> str:
        """Return the limits' errors, and how they were found, as lines of text."""
        return "\n".join([super().table(), *self._lines()]) if self.complete else ""

    def _winner(self, aim: Aim) -> str:
        return "learned" if self.whose[aim] == LIMIT else self.whose[aim]

    def _lines(self) -> Iterator[str]:
        (outcome,) = self.outcomes
        for name, result in outcome.entry["results"].items():
            error = result["error_m"]["distance"]
            if len(error["max"]["seeds"]) > 1:
                both = " / ".join(plus_minus(error[aim], 100) for aim in AIMS)
                yield f"{name}: maximum / mean in the plane, mean over seeds: {both} cm"
        for aim in AIMS:
            if (name := self._winner(aim)) != "learned":
                yield f"the limit of the {ERRORS[aim]} is that of {name}: learning found nothing lower"
        first, last = ((100 * errors["max"], 100 * errors["mean"]) for errors in (self.history[0], self.history[-1]))
        yield (
            f"without noise, in {len(self.history) - 1} attempts: from {first[0]:.2f}/{first[1]:.2f}"
            f" to {last[0]:.4f}/{last[1]:.4f} cm in the plane"
        )


def limit(
    scenario: Scenario | str = "rect",
    seeds: int | Iterable[int] = SEEDS,
    iterations: int = ATTEMPTS,
    *,
    begin: Begin = lambda title, frames: nothing,
) -> LimitResult:
    """Find out what is possible on a scenario's plant.

    Robots that `[variation]` sets apart learn each for itself: the team knows its robots, but not what noise does.

    Args:
        scenario: What is driven, or its name; its controllers are left out.
        seeds: Of the random numbers under which robots show what they can, or how many, counting up from 0.
        iterations: Attempts, at most.
        begin: Called with a title and the number of frames before robots drive; what it returns is called after each
            frame, and may raise `StoppedError`.

    Returns:
        Errors of "limit", with noise, and of "limit without noise", in the form of any controller's.

    Raises:
        OmniError: There is no such scenario, robots share its world, seeds do not count up, there are fewer than two
            iterations, or no controller comes to the scenario's end.
    """
    started = time.perf_counter()
    chosen = load(scenario) if isinstance(scenario, str) else scenario
    distributions.refuse(chosen.distributions, "limit")
    numbers = counted(range(seeds) if isinstance(seeds, int) else seeds)
    check(chosen, iterations)
    chosen = with_kernel(chosen.replace(seed=numbers[0], seeds=len(numbers)), len(numbers))
    result = LimitResult([Outcome.not_run(chosen)], [LIMIT, WITHOUT_NOISE], seeds=numbers)
    try:
        _find(result, chosen, iterations, begin)
        result.complete = True
    except StoppedError as error:
        result.stopped = error.reason
    result.wall_s = time.perf_counter() - started
    return result


def check(scenario: Scenario, iterations: int) -> None:
    """Raise OmniError, with all reasons, if the limit of a scenario cannot be found."""
    wrong = []
    if (places := len(scenario.settings.world.places)) > 1:
        wrong.append(
            f"the limit is that of a robot alone, and world.places of {scenario.name!r} has {places} places;"
            " give one: --set world.places=[[0,0,0]]"
        )
    if iterations < 2:
        wrong.append(f"the limit takes at least 2 iterations to find, not {iterations}")
    in_one(wrong)


def _find(result: LimitResult, chosen: Scenario, iterations: int, begin: Begin) -> None:
    """Fill in the result; raise StoppedError if it is stopped."""
    started, seeds = time.perf_counter(), chosen.seed_list
    apart = bool(simulation(chosen, (), seeds[:1]).drawn)  # by [variation]
    learner = Learner(quiet(chosen), seeds if apart else seeds[:1], begin)
    result.history, frames = learner.history, len(learner.reference)
    learner.learn(iterations)
    result.commands = learner.best.asked

    own = np.arange(PRACTICE_SEEDS) % len(seeds) if apart else np.zeros(PRACTICE_SEEDS, int)
    training = [seeds[i] for i in own] if apart else [seeds[0] + FIRST_SEED + i for i in range(PRACTICE_SEEDS)]
    policies = [Policy(*pair) for pair in product(WEIGHTS, NOISES)]
    made = _track(chosen, training, learner, own, policies, begin)[1]
    practice = {aim: made.size(aim).reshape(len(policies), -1).mean(1) for aim in AIMS}
    policy = policies[int(sum(errors / errors.min() for errors in practice.values()).argmin())]
    names = [name for name in CONTROLLERS if not controllers.find(name).knows_truth]
    rivals = simulation(chosen, names, training[:RIVAL_SEEDS])
    rivals.run(begin("controllers, with noise", frames))
    theirs = Drives.of(rivals, rivals.log.channel("command"))
    best = list(dict.fromkeys(names[theirs.size(aim).reshape(len(names), -1).mean(1).argmin()] for aim in AIMS))

    led = _track(chosen, seeds, learner, np.arange(len(seeds)) % len(learner.seeds), [policy], begin)[0]
    still = simulation(learner.scenario, (), learner.seeds)
    commands = iter(learner.best.asked)
    lead(still, lambda measured, heading, last: next(commands), begin("limit without noise", frames))
    beside = simulation(chosen, best, seeds)
    beside.run(begin("best controllers", frames))
    outcome = _outcome(chosen, [(led, LIMIT), (still, WITHOUT_NOISE), (beside, None)], started)
    results = outcome.entry["results"]
    result.whose = {aim: min((LIMIT, *best), key=lambda name: mean(results[name], aim)) for aim in AIMS}
    results[LIMIT] = _least(results, result.whose)
    result.outcomes, result.controllers = [outcome], list(results)


def _track(
    scenario: Scenario, seeds: Sequence[int], learner: Learner, own: np.ndarray, policies: Sequence[Policy],
    begin: Begin,
) -> tuple[Simulation, Drives]:  # fmt: skip
    """Lead a robot of each seed by each policy along the runs that were learned, by their numbers `own`."""
    runs = np.tile(own, len(policies))
    tracker = Tracker(
        learner.model, learner.best.sent[:, runs], learner.best.poses[:, runs], scenario,
        [policy for policy in policies for _ in seeds],
    )  # fmt: skip
    robots = simulation(scenario, (), list(seeds) * len(policies))
    return robots, lead(robots, tracker, begin("feedback", len(learner.reference)))


def _outcome(chosen: Scenario, parts: Sequence[tuple[Simulation, str | None]], started: float) -> Outcome:
    """Return the outcome of simulations as if all their rows, renamed if a name is given, had run together."""
    rows, failures = list[Row](), list[Failure]()
    for part, name in parts:
        part.log.rows = [replace(row, controller=name or row.controller) for row in part.log.rows]
        failures += [replace(f, row=f.row + len(rows), controller=name or f.controller) for f in part.failures]
        rows += [replace(row, world=len(rows) + i) for i, row in enumerate(part.log.rows)]
    log = Log.joined([part.log for part, _ in parts], rows)
    drawn = {name: np.concatenate([part.drawn[name] for part, _ in parts]) for name in parts[0][0].drawn}
    measured, wall_s = metrics.row_metrics(log, failures), time.perf_counter() - started
    entry = summary.entry(chosen, log, failures, measured, wall_s, None, drawn=drawn)
    entry["results"] = {name: {**found, "reduction_percent": None} for name, found in entry["results"].items()}
    return Outcome(chosen, entry, rows, failures, {**measured, **drawn}, log)


def _least(results: Mapping[str, Any], whose: Mapping[Aim, str]) -> dict[str, Any]:
    """Return the result of those with the least maximum, with all other errors of those with the least mean."""
    worst, usual = results[whose["max"]], results[whose["mean"]]
    errors = {
        key: {axis: usual[key][axis] | {"max": worst[key][axis]["max"]} for axis in worst[key]}
        for key in ("error_m", "error_rad")
    }
    return {**worst, **errors}
