"""What a robot can do that has learned the way, and then drives under noise: how far feedback is to be trusted.

Robots practise with seeds of their own. What was not foreseen in their runs tells how much of each unknown there is:
that for which the poses in which commands act are predicted best. Which of the learned runs is best led along, and how
stiffly, is tried.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from omni_control.kinematics import Array
from omni_mj.scenarios.faults import ON_WHEELS
from omni_mj.scenarios.scenario import Scenario
from omni_mj.studies.limit import rivals
from omni_mj.studies.limit.attempts import Attempts, Leader, attempt
from omni_mj.studies.limit.deviations import Deviations
from omni_mj.studies.limit.follower import Follower, regulator
from omni_mj.studies.limit.learning import Begin, Best, merits
from omni_mj.studies.limit.plan import AIMS, ARM_M, Aim
from omni_mj.studies.limit.predictor import POSE, Predictor
from omni_mj.studies.limit.unknowns import TUNED, Unknowns

SEEDS, FIRST_SEED = 5, 1_000_000  # of practice, counted on from the scenario's
WEIGHTS = (0.001, 0.003, 0.01, 0.03)  # of the regulator, that are tried first
# Beyond them, where the best is at an end and better than the next by such a share: by which factor, and how far.
FARTHER, LEAST, MOST, WORTH_TRYING = 10**0.5, 1e-5, 0.3, 0.02
USUAL = 0.01
ALIKE_M = 2e-4  # maxima of runs that are no farther apart are alike under noise
# By which factor an unknown is made larger or smaller, how often at the most, and for what gain.
FACTOR, ROUNDS, WORTH = 4.0, 6, 0.005


@dataclass(frozen=True)
class Policy:
    """How robots are led under noise.

    Attributes:
        run: the aim by which the run was learned along which they are led.
        weight: of the regulator.
    """

    run: Aim
    weight: float


@dataclass(frozen=True, eq=False)
class Skill:
    """What practice leaves.

    Attributes:
        deviations: near the runs.
        unknowns: how much of what is unknown.
        policies: the best by each aim.
        tried: the aims' merits of each policy in practice, m.
        rivals: the same of the package's controllers.
        foreseen: root mean square, m, by which positions in which commands act are off those predicted: what is left is
            not for feedback to mend.
    """

    deviations: Deviations
    unknowns: Unknowns
    policies: dict[Aim, Policy]
    tried: dict[Policy, dict[Aim, float]]
    rivals: dict[str, dict[Aim, float]]
    foreseen: float


def leader(
    scenario: Scenario, deviations: Deviations, unknowns: Unknowns, best: dict[Aim, Best],
    policies: Sequence[Policy], robots: np.ndarray,
) -> Leader:  # fmt: skip
    """Who leads, by several policies one after the other, the `robots` whose runs were learned, by their numbers."""
    commands = np.concatenate([best[policy.run].sent[:, robots] for policy in policies], axis=1)
    poses = np.concatenate([best[policy.run].poses[:, robots] for policy in policies], axis=1)
    gains = np.stack([regulator(deviations, policy.weight) for policy in policies], axis=1)
    firmware = scenario.plant in ON_WHEELS
    predictor = Predictor(deviations, commands, poses, scenario.settings, unknowns, firmware)
    return Follower(predictor, gains, np.repeat(np.arange(len(policies)), len(robots)))


def practise(scenario: Scenario, deviations: Deviations, best: dict[Aim, Best], begin: Begin) -> Skill:
    """Find out how to drive a scenario with noise, of which the runs without are known.

    Args:
        scenario: with noise.
        deviations: near the runs.
        best: the runs of L robots: all alike if there is one, otherwise those of the scenario's seeds, who practise
            with them.
        begin: see `Learner`.
    """
    several = best["max"].merit.size > 1
    robots = np.arange(SEEDS) % best["max"].merit.size if several else np.zeros(SEEDS, int)
    first = scenario.seed + (0 if several else FIRST_SEED)
    seeds = [first + int(i) for i in (robots if several else np.arange(SEEDS))]
    unknowns = Unknowns.of(scenario.settings, scenario.plant)
    usual = Policy("mean", USUAL)
    frames = deviations.frames
    made = attempt(
        scenario, seeds, leader(scenario, deviations, unknowns, best, [usual], robots), begin("noise", frames)
    )
    unknowns = tuned(scenario, deviations, best["mean"], robots, made, unknowns)
    foreseen = foresight(scenario, deviations, best["mean"], robots, made, [unknowns], arm=0.0)
    tried: dict[Policy, dict[Aim, float]] = {}
    policies = [Policy(aim, weight) for aim in _distinct(best) for weight in WEIGHTS]
    while policies:
        leads = leader(scenario, deviations, unknowns, best, policies, robots)
        made = attempt(scenario, seeds * len(policies), leads, begin("feedback", frames))
        found = {aim: merits(made.errors, aim).reshape(len(policies), -1).mean(1) for aim in AIMS}
        tried |= {policy: {aim: float(found[aim][i]) for aim in AIMS} for i, policy in enumerate(policies)}
        chosen = {aim: min(tried, key=lambda policy: tried[policy][aim]) for aim in AIMS}
        policies = _farther(tried)
    return Skill(deviations, unknowns, chosen, tried, rivals.tried(scenario, seeds, begin), float(foreseen[0]))


def _farther(tried: Mapping[Policy, Mapping[Aim, float]]) -> list[Policy]:
    """Policies beyond those tried, where the best is at an end and better than what is next to it."""
    more = []
    for aim in AIMS:
        best = min(tried, key=lambda policy: tried[policy][aim])
        alike = sorted((policy for policy in tried if policy.run == best.run), key=lambda policy: policy.weight)
        for end, by in ((alike, 1 / FARTHER), (alike[::-1], FARTHER)):
            gains = tried[best][aim] < (1 - WORTH_TRYING) * tried[end[1]][aim]
            if best == end[0] and gains and LEAST < best.weight * by < MOST:
                more.append(replace(best, weight=best.weight * by))
    return list(dict.fromkeys(more))


def _distinct(best: dict[Aim, Best]) -> tuple[Aim, ...]:
    """The aims, of which one is enough where its run is as good by the other."""
    worse = merits(best["mean"].errors, "max") - best["max"].merit
    return AIMS if (worse > ALIKE_M).any() else ("mean",)


def tuned(
    scenario: Scenario, deviations: Deviations, best: Best, robots: np.ndarray, made: Attempts, unknowns: Unknowns
) -> Unknowns:
    """Make the five unknowns of a plant larger and smaller, as long as that predicts better what was made.

    Args:
        scenario: with noise.
        deviations: near the runs.
        best: the runs.
        robots: numbers of those along whose runs robots were led, (n,).
        made: what came of that.
        unknowns: to begin with.
    """
    for _ in range(ROUNDS):
        tried = [unknowns]
        for name in TUNED:
            tried += [replace(unknowns, **{name: getattr(unknowns, name) * factor}) for factor in (1 / FACTOR, FACTOR)]
        surprise = foresight(scenario, deviations, best, robots, made, tried)
        if surprise[0] - surprise.min() < WORTH * surprise[0]:
            break
        unknowns = tried[int(surprise.argmin())]
    return unknowns


def foresight(
    scenario: Scenario, deviations: Deviations, best: Best, robots: np.ndarray, made: Attempts,
    tried: Sequence[Unknowns], arm: float = ARM_M,
) -> Array:  # fmt: skip
    """Root mean square, m, of what poses in which commands act were off those predicted, for each of some unknowns.

    Headings count at the length of an `arm`, m.
    """
    n, several, delay = len(robots), len(tried), deviations.delay
    repeat = np.tile(np.arange(n), several)
    commands, poses = best.sent[:, robots[repeat]], best.poses[:, robots[repeat]]
    firmware = scenario.plant in ON_WHEELS
    predictor = Predictor(deviations, commands, poses, scenario.settings, Unknowns.stacked(tried, n), firmware)
    squares = np.zeros(several * n)
    counted = 0
    for k in range(deviations.frames - delay - 1):
        ahead = predictor.see(made.measured[k, repeat], made.headings[k, repeat])[:, POSE]
        predictor.sent(made.sent[k, repeat])
        off = made.poses[k + delay, repeat] - poses[k + delay] - ahead
        squares += (off[:, :2] ** 2).sum(1) + (arm * off[:, 2]) ** 2
        counted += 1
    return np.sqrt(squares.reshape(several, n).mean(1) / max(counted, 1))
