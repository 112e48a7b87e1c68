"""alpha of robots that a controller drives around a path, under the conditions that robots meet."""

import numpy as np

from omni_mj.measure import metrics
from omni_mj.scenarios import references
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.scenario import Scenario, load
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies import conditions
from omni_mj.studies.outcome import AfterFrame

CONTROLLER = "comp-flc"  # the paper's
AXES = ("forward", "sideways")


class InUse:
    """One robot for each of the usual conditions, around the path of a scenario.

    Args:
        scenario: everything but the path.
        task: name of the scenario whose path it is; robots must face along x on it, so that forward is x.
    """

    def __init__(self, scenario: Scenario, task: str) -> None:
        self.scenario = _on_path(scenario, task)
        self.rows = [
            Row(world, 0, CONTROLLER, scenario.seed, settings, scenario.robot)
            for world, settings in enumerate(conditions.usual(self.scenario.settings))
        ]
        self.simulation = Simulation(self.scenario, rows=self.rows)

    def run(self, after_frame: AfterFrame) -> None:
        """Drive; `after_frame` is called with each frame's number."""
        self.simulation.run(after_frame)

    def percentiles(self) -> dict[str, dict[str, float]]:
        """Of alpha, over all robots and windows in which they are driven: axis -> percentiles; none without any."""
        log = self.simulation.log
        alpha = metrics.driven_alpha(log.channel("pose")[..., :2], log.channel("applied")[..., :2])
        found: dict[str, dict[str, float]] = {}
        for j, axis in enumerate(AXES):
            known = alpha[..., j][~np.isnan(alpha[..., j])]
            levels = metrics.ALPHA_PERCENTILES if known.size else ()
            found[axis] = {f"p{p}": round(float(np.percentile(known, p)), 6) for p in levels}
        return found


def frames(scenario: Scenario, task: str) -> int:
    """How many frames it takes."""
    return references.timed(_on_path(scenario, task).settings).frames


def _on_path(scenario: Scenario, task: str) -> Scenario:
    settings = scenario.settings.replace(
        reference=load(task).settings.reference, world={"places": [[0, 0, 0]]}, fault=()
    )
    return scenario.replace(name=task, controllers=(CONTROLLER,), paper_table=0, settings=settings, seeds=1)
