"""The package's own controllers under noise: none of them may be better than what is called the limit.

All that are not told the truth drive the seeds of practice. Those that come near what learned robots did there show
what they can beside them; where one is better, its error is the limit.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from omni_control import controllers
from omni_control.registry import CONTROLLERS
from omni_mj.scenarios.scenario import Scenario
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies.limit.attempts import of, row
from omni_mj.studies.limit.learning import Begin, merits
from omni_mj.studies.limit.plan import AIMS, Aim

SEEDS = 3  # of practice, which tell within a factor of two what a controller can
NEAR = 2.0  # times what learned robots did in practice, within which a controller must show what it can
Merits = Mapping[Aim, float]


def competitors() -> list[str]:
    """Names of the package's controllers that see no more than any team."""
    return [name for name in CONTROLLERS if not controllers.find(name).knows_truth]


def tried(scenario: Scenario, seeds: Sequence[int], begin: Begin) -> dict[str, dict[Aim, float]]:
    """The mean over the first of the seeds of each competitor's merits, m; infinite where one of them failed."""
    names, seeds = competitors(), seeds[:SEEDS]
    rows = [row(scenario, i, seed, name) for i, (name, seed) in enumerate((n, s) for n in names for s in seeds)]
    simulation = Simulation(scenario, names, rows=rows)
    frames = max(reference.frames for reference in simulation.references)
    simulation.run(begin("controllers, with noise", frames))
    log = simulation.log
    made = of(simulation, log.channel("command"), log.channel("vision"), log.channel("vision")[..., 2])
    found = {aim: merits(made.errors, aim).reshape(len(names), -1).mean(1) for aim in AIMS}
    return {name: {aim: float(found[aim][i]) for aim in AIMS} for i, name in enumerate(names)}


def near(rivals: Mapping[str, Merits], learned: Sequence[Merits]) -> list[str]:
    """Those that come near the least of what was learned, by any aim; and the best by each, however far."""
    least = {aim: min(each[aim] for each in learned) for aim in AIMS}
    best = [min(rivals, key=lambda name: rivals[name][aim]) for aim in AIMS]
    return [
        name
        for name, own in rivals.items()
        if name in best or any(own[aim] <= NEAR * least[aim] and np.isfinite(own[aim]) for aim in AIMS)
    ]
