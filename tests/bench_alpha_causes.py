"""Alpha by scenario, and the part of it that each cause takes, for docs/data/alpha-causes.csv.

    python tests/bench_alpha_causes.py [ROBOT SCENARIO...]

comp-flc drives on the plant planar. Alpha is the ratio of achieved to commanded displacement in
windows of 0.25 s (the paper's equation 8), where all commands exceed 0.1 m/s. Its mean is weighted
by the commanded displacement. In these scenarios, x is forward and y sideways. The effect of a
cause is the rise of the mean without it.
"""

import csv
import sys
from collections.abc import Callable

import numpy as np

import omni_mj as om
from omni_control.kinematics import Array
from omni_mj.config.settings import Settings
from omni_mj.results.alpha_windows import ALPHA_WINDOW_FRAMES, driven_alpha
from omni_mj.studies.alpha import operating_conditions

SCENARIOS = [
    "rect",
    "league",
    "slippery",
    "roller-debris",
    "worn-robots",
    "fault-all",
    "hot-motors",
    "low-battery",
]
PAPER_RANGE = 0.7, 1.0
# Cause -> function that removes it from settings
CAUSES: dict[str, Callable[[Settings], Settings]] = {
    "drag": operating_conditions.CAUSES["drag"],
    "creep": operating_conditions.CAUSES["creep"],
    # Integral action removes what proportional wheel loops lose.
    "wheel loop": lambda settings: settings.replace(firmware={"ki": 20.0}),
    "heat": lambda settings: settings.replace(
        motor={"winding_resistance_per_k": 0.0, "torque_constant_per_k": 0.0}
    ),
    "battery": operating_conditions.CAUSES["battery"],
}


def measure_alpha(scenario: om.Scenario, settings: Settings) -> tuple[Array, float]:
    """Return the mean of alpha along x and y, (2,), and its share in `PAPER_RANGE`."""
    simulation = om.Simulation(scenario.replace(settings=settings), ["comp-flc"])
    simulation.run()
    pose, command = (simulation.log.channel(name)[..., :2] for name in ("pose", "applied"))
    alpha = driven_alpha(pose, command)
    total = np.cumsum(command, axis=0)
    weight = np.abs(total[ALPHA_WINDOW_FRAMES:] - total[:-ALPHA_WINDOW_FRAMES])[: len(alpha)]
    weight[np.isnan(alpha)] = 0.0
    mean = (np.nan_to_num(alpha) * weight).sum((0, 1)) / weight.sum((0, 1))
    known = alpha[~np.isnan(alpha)]
    return mean, float(((known >= PAPER_RANGE[0]) & (known <= PAPER_RANGE[1])).mean())


def format_pair(values: Array, digits: int = 2) -> str:
    """Return values along x and y as text."""
    return " / ".join(f"{value:.{digits}f}" for value in values)


def main() -> None:
    """Print the table."""
    robot, *scenarios = sys.argv[1:] or ["tigers-v2016", *SCENARIOS]
    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow(["scenario", "alpha x / y", "in 0.7 to 1, %", *CAUSES])
    for name in scenarios:
        scenario = om.load_scenario(name, robot=robot, plant="planar", seeds=3)
        mean, share = measure_alpha(scenario, scenario.settings)
        row = [f"`{name}`", format_pair(mean), f"{100 * share:.0f}"]
        for remove_cause in CAUSES.values():
            mean_without, _ = measure_alpha(scenario, remove_cause(scenario.settings))
            row.append(format_pair(mean_without - mean, 3))
        writer.writerow(row)
        sys.stdout.flush()


if __name__ == "__main__":
    main()
