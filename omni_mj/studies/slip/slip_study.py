"""Slip study: the identification that TIGERs Mannheim publish, applied to simulated robots.

`slip_moves` drives the published moves, `slip_fits` fits them.

TIGERs Mannheim identified three robots with `matlab/identification/identifyBotModelV2.m` of their
Sumatra. The results are in `robot_impl.c` of their Firmware (`src/main2016` until 2023,
`src/main2019`; TIGERs-Mannheim/Firmware at 2177659 and ef794dd). They are for comparison only.
Their x-axis is our y-axis, so K and T of their y are our K and T forward. They measured drag in
roll-outs forward. But their firmware uses this value as sideways drag, and 1/1.28 to 1/1.30 of it
as forward drag, which was not measured. If the firmware is right, forward drag is 3.41, 2.07 and
4.14 N.
"""

import re
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from omni_control.arguments import check_types
from omni_control.errors import OmniError
from omni_mj.config import distributions
from omni_mj.config.resolve import Robot
from omni_mj.config.scenario import Scenario, load_scenario
from omni_mj.results.result import Outcome, Result
from omni_mj.results.seed_statistics import finite_or_none
from omni_mj.results.text_table import Table, format_number, format_table
from omni_mj.studies.compare_study import check_scenarios
from omni_mj.studies.run_scenario import StartProgress, no_progress
from omni_mj.studies.slip.slip_fits import SlipFit, fit_moves
from omni_mj.studies.slip.slip_moves import Move, identification_moves, record_moves

# Name -> title, unit, decimal places, and the published value of each robot of `ROBOTS`
QUANTITIES: dict[str, tuple[str, str, int, tuple[float, ...]]] = {
    "gain_forward": ("gain K forward", "", 3, (0.90, 1.00, 0.95)),
    "gain_sideways": ("gain K sideways", "", 3, (0.79, 0.95, 0.91)),
    "gain_turning": ("gain K turning", "", 3, ()),
    "time_forward": ("slip time T forward", "s²/m", 4, (0.060, 0.050, 0.038)),
    "time_sideways": ("slip time T sideways", "s²/m", 4, (0.155, 0.095, 0.082)),
    "time_turning": ("slip time T turning", "s²/m", 4, ()),
    "drag_forward": ("roll-out drag forward", "N", 2, (4.44, 2.65, 5.3)),
    "drag_sideways": ("roll-out drag sideways", "N", 2, ()),
    "drag_turning": ("roll-out drag turning", "N m", 3, (0.14, 0.097, 0.2)),
}
# Name -> label, and the mass with which TIGERs Mannheim turned decelerations into forces, kg
ROBOTS = {
    "tigers-v2016": ("2016", 2.65),
    "tigers-v2020": ("2020, direct drive", 2.46),
    "tigers-v2020-planetary": ("2020, planetary gear", 2.46),
}
PUBLISHED = {
    robot: {name: values[i] for name, (*_, values) in QUANTITIES.items() if values}
    for i, robot in enumerate(ROBOTS)
}
# Their yaw inertia / (mass x arm^2), which turned angular decelerations into torques
INERTIA_RATIO = 0.55
DEFINITIONS = {
    "gain, time": (
        "K and T of v' = (K u - v) / (T |u| + 1 ms): least squares over whole moves, "
        "mean over moves"
    ),
    "u, v": (
        "speed of the wheels by encoder, and of the body; for turning, T |u| is T l |u| with the "
        "arm l"
    ),
    "drag": (
        "mean deceleration of a robot without motor force, times the mass of the published fit"
    ),
    "closed_form": "closed form of the slip model, from the robot's parameters alone",
}


@dataclass
class SlipResult(Result):
    """Result of the slip study. Its rows hold each move and its fit.

    Attributes:
        robots: Name of a robot that was driven -> its fits.
    """

    robots: dict[str, SlipFit] = field(default_factory=dict)

    def summary(self) -> dict[str, Any]:
        """Return the summary of any result, with the fits as `slip`."""
        robots = {
            name: {"source": _published_source(name), "quantities": self._quantities(name)}
            for name in self.robots
        }
        return super().summary() | {"slip": {"definitions": DEFINITIONS, "robots": robots}}

    def table(self) -> str:
        """Return measured, closed-form and published values of each robot as lines of text."""
        return "\n".join(map(self._format_robot, self.robots))

    def _quantities(self, name: str) -> dict[str, dict[str, Any]]:
        """Return quantity -> unit and values of a robot; None for a value that does not exist."""
        robot, quantities = self.robots[name], {}
        for quantity, (_, unit, _, _) in QUANTITIES.items():
            measured = robot.measured[quantity]
            published = PUBLISHED.get(name, {}).get(quantity, np.nan)
            values = {
                "measured": measured,
                "closed_form": robot.closed_form[quantity],
                "published": published,
                "deviation_percent": 100 * (measured / published - 1),
            }
            quantities[quantity] = {"unit": unit} | finite_or_none(values)
        return quantities

    def _format_robot(self, name: str) -> str:
        rows = []
        for quantity, values in self._quantities(name).items():
            title, unit, digits, _ = QUANTITIES[quantity]
            formatted = [
                format_number(values[key], digits=digits)
                for key in ("measured", "closed_form", "published")
            ]
            deviation = values["deviation_percent"]
            rows.append([title, unit, *formatted, "" if deviation is None else f"{deviation:+.0f}"])
        source = _published_source(name)
        title = f"{name}; published: {source}" if source else f"{name}; nothing published"
        headings = ["", "unit", "measured", "closed form", "published", "deviation, %"]
        return format_table(Table(title, headings, rows, 2))


@check_types
def measure_slip(
    robots: Sequence[Scenario | Robot | str] | None = None,
    moves: Sequence[Move] | None = None,
    *,
    start_progress: StartProgress = no_progress,
) -> SlipResult:
    """Identify gain, slip and drag of robots as TIGERs Mannheim did with theirs.

    Args:
        robots: Names or files of robots; or scenarios, whose robot, settings and seed are used.
            Default: the robots with published values, on two-roller wheels.
        moves: Moves that each robot drives. Default: `identification_moves()`.
        start_progress: Called with each robot's name and its number of frames. It returns a
            function that is called with each frame's number and may raise `StoppedError`.

    Raises:
        OmniError: A robot does not exist, or two have the same name.
    """
    start_time = time.perf_counter()
    moves = list(identification_moves() if moves is None else moves)
    if not moves:
        raise OmniError("moves must have at least one move")
    scenarios = [prepare_slip_scenario(robot) for robot in (ROBOTS if robots is None else robots)]
    check_scenarios(scenarios, None)
    outcomes = [Outcome.not_run(scenario) for scenario in scenarios]
    result = SlipResult(outcomes, ["Controller"])
    result.seeds = list(dict.fromkeys(scenario.seed for scenario in scenarios))
    for i, scenario in enumerate(scenarios):
        record = record_moves(scenario, moves, start_progress)
        result.outcomes[i] = record.outcome
        result.stopped = record.outcome.entry["reason"]
        if result.stopped:
            break
        fit = fit_moves(scenario.settings, moves, record, *_masses(scenario))
        result.robots[scenario.name] = fit
        columns = {
            "move": np.array([move.axis for move in moves]),
            **fit.fitted,
            "speed": np.array([move.speed for move in moves]),
            "rolls_out": np.array([move.rolls_out for move in moves]),
        }
        result.outcomes[i] = replace(record.outcome, metrics=columns)
    result.complete = result.stopped is None
    result.wall_s = time.perf_counter() - start_time
    return result


def prepare_slip_scenario(robot: Scenario | Robot | str) -> Scenario:
    """Return the scenario of a robot's moves; it has the robot's name."""
    if not isinstance(robot, Scenario):
        robot = load_scenario("rect", robot=robot, wheels={"model": "two-rollers"})
    distributions.require_fixed_settings(robot.distributions, "slip")
    name = Path(robot.robot).stem if robot.robot.endswith(".toml") else robot.robot
    file_name = re.sub(r"[^\w.-]+", "-", name)
    return robot.replace(name=file_name, description="identification of slip")


def _masses(scenario: Scenario) -> tuple[float, float]:
    """Return the mass in kg and yaw inertia in kg m^2 that turn decelerations into drag."""
    settings, name = scenario.settings, scenario.name
    if name not in ROBOTS:
        return settings.body.mass_kg, settings.body.yaw_inertia_kg_m2
    mass = ROBOTS[name][1]
    return mass, INERTIA_RATIO * mass * settings.wheels.arm_m**2


def _published_source(name: str) -> str | None:
    if name not in ROBOTS:
        return None
    return f"TIGERs Mannheim, Firmware, robot_impl.c ({ROBOTS[name][0]})"
