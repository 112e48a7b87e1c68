"""How robots slip: the identification that TIGERs Mannheim publish, done on simulated robots.

`moves` are what is driven and logged, `fits` their fits and what must come out in closed form.

TIGERs Mannheim identified three robots with `matlab/identification/identifyBotModelV2.m` of their
Sumatra; the numbers stand in `robot_impl.c` of their Firmware (`src/main2016` until 2023,
`src/main2019`; TIGERs-Mannheim/Firmware at 2177659 and ef794dd). They are for comparison only. Their
x is our y: K and T of their y are ours forward. Drag was measured in roll-outs forward. Their
firmware takes it for that sideways, 1.28 to 1.30 times that forward, which was not measured; if they
entered it so, forward drag is 3.41, 2.07 and 4.14 N.
"""

import re
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from omni_mj.config import distributions
from omni_mj.config import resolve as described
from omni_mj.config.scenario import Scenario, load_scenario
from omni_mj.results.result import Outcome, Result
from omni_mj.results.result_tables import Table, format_number, format_table
from omni_mj.results.statistics import finite_or_none
from omni_mj.studies.compare import check_scenarios
from omni_mj.studies.slip.slip_fits import SlipFit, fit_moves
from omni_mj.studies.slip.slip_moves import Move, count_frames, drive, identification
from omni_mj.studies.study_runner import StartProgress, no_progress, open_loop_outcome

# Name -> title, unit, digits behind the point, and what was published of each robot of `ROBOTS`.
QUANTITIES: dict[str, tuple[str, str, int, tuple[float, ...]]] = {
    "gain_forward": ("gain K forward", "", 3, (0.90, 1.00, 0.95)),
    "gain_sideways": ("gain K sideways", "", 3, (0.79, 0.95, 0.91)),
    "gain_turning": ("gain K turning", "", 3, ()),
    "time_forward": ("T forward", "s²/m", 4, (0.060, 0.050, 0.038)),
    "time_sideways": ("T sideways", "s²/m", 4, (0.155, 0.095, 0.082)),
    "time_turning": ("T turning", "s²/m", 4, ()),
    "drag_forward": ("roll-out drag forward", "N", 2, (4.44, 2.65, 5.3)),
    "drag_turning": ("roll-out drag turning", "N m", 3, (0.14, 0.097, 0.2)),
}
ROBOTS = {  # with the masses by which decelerations were turned into forces, kg
    "tigers-v2016": ("2016", 2.65),
    "tigers-v2020": ("2020, direct drive", 2.46),
    "tigers-v2020-planetary": ("2020, planetary gear", 2.46),
}
PUBLISHED = {
    robot: {name: values[i] for name, (*_, values) in QUANTITIES.items() if values}
    for i, robot in enumerate(ROBOTS)
}
# Yaw inertia over mass and arm squared, with which decelerations were turned into torques
INERTIA_SHARE = 0.55
DEFINITIONS = {
    "gain, time": "K and T of v' = (K u - v) / (T |u| + 1 ms): least squares over whole moves, mean over moves",
    "u, v": "velocity by encoders, and of the body; in turning T |u| is T l |u|",
    "drag": "mean deceleration of a robot whose motors carry no current, times the mass of the published fit",
    "law": "closed form of the law of creep, which knows the robot's numbers and nothing of the moves",
}


@dataclass
class SlipResult(Result):
    """The result of the study; its rows hold each move and what was fitted to it.

    Attributes:
        robots: What came out of those that were driven, by name.
    """

    robots: dict[str, SlipFit] = field(default_factory=dict)

    def summary(self) -> dict[str, Any]:
        """Return that of any result, with the figures as `slip`."""
        robots = {
            name: {"source": _source(name), "quantities": self._quantities(name)}
            for name in self.robots
        }
        return super().summary() | {"slip": {"definitions": DEFINITIONS, "robots": robots}}

    def table(self) -> str:
        """Return the figures of each robot beside what the law says and what was published, as lines of text."""
        return "\n".join(map(self._text, self.robots))

    def _quantities(self, name: str) -> dict[str, dict[str, Any]]:
        robot, result = self.robots[name], {}
        for quantity, (_, unit, _, _) in QUANTITIES.items():
            measured, published = robot.measured[quantity], PUBLISHED.get(name, {}).get(quantity)
            result[quantity] = {
                "unit": unit,
                "measured": finite_or_none(measured),
                "law": finite_or_none(robot.law.get(quantity, np.nan)),
                "published": published,
                "deviation_percent": None
                if published is None
                else finite_or_none(100 * (measured / published - 1)),
            }
        return result

    def _text(self, name: str) -> str:
        rows = []
        for quantity, figures in self._quantities(name).items():
            title, unit, digits, _ = QUANTITIES[quantity]
            cells = [
                format_number(figures[key], digits=digits)
                for key in ("measured", "law", "published")
            ]
            deviation = figures["deviation_percent"]
            rows.append([title, unit, *cells, "" if deviation is None else f"{deviation:+.0f}"])
        source = _source(name)
        title = f"{name}; published: {source}" if source else f"{name}; nothing published"
        return format_table(
            Table(title, ["", "unit", "measured", "law", "published", "deviation, %"], rows, 2)
        )


def measure_slip(
    robots: Sequence[Scenario | described.Robot | str] | None = None,
    moves: Sequence[Move] | None = None,
    *,
    start_progress: StartProgress = no_progress,
) -> SlipResult:
    """Identify how robots slip, as TIGERs Mannheim identified theirs.

    Args:
        robots: Names or files of robots; or scenarios, whose robot, settings and seed are meant.
            [those that were measured, on the faster wheels]
        moves: That each robot drives. [`identification()`]
        start_progress: Called with each robot's name and the number of frames to come; what it returns is
            called after each frame, and may raise `StoppedError`.

    Raises:
        OmniError: There is no such robot, or one is named twice.
    """
    began, driven = time.perf_counter(), list(identification() if moves is None else moves)
    chosen = [prepare_slip_scenario(robot) for robot in (ROBOTS if robots is None else robots)]
    check_scenarios(chosen, None)
    result = SlipResult([Outcome.not_run(robot) for robot in chosen], ["Controller"])
    result.seeds = list(dict.fromkeys(robot.seed for robot in chosen))
    for i, robot in enumerate(chosen):
        started, settings, name = time.perf_counter(), robot.settings, robot.name
        record = drive(robot, driven, start_progress(name, count_frames(driven) + 1))
        columns: dict[str, np.ndarray] = {}
        if record.stopped is None:
            mass, inertia = settings.body.mass_kg, settings.body.yaw_inertia_kg_m2
            if name in ROBOTS:
                mass = ROBOTS[name][1]
                inertia = INERTIA_SHARE * mass * settings.wheels.arm_m**2
            result.robots[name] = fit_moves(settings, driven, record, mass, inertia)
            columns = {
                "move": np.array([move.kind for move in driven]),
                **result.robots[name].fitted,
            }
            columns |= {
                key: np.array([getattr(move, key) for move in driven])
                for key in ("speed", "rolls_out")
            }
        simulation = record.simulation
        result.outcomes[i] = open_loop_outcome(
            simulation.scenario, simulation, started, record.stopped, columns
        )
        result.stopped = record.stopped
        if record.stopped:
            break
    result.complete = result.stopped is None
    result.wall_s = time.perf_counter() - began
    return result


def prepare_slip_scenario(robot: Scenario | described.Robot | str) -> Scenario:
    """Return the scenario that is driven, with the name of its robot."""
    if not isinstance(robot, Scenario):
        robot = load_scenario("rect", robot=robot, wheels={"model": "two-rollers"})
    distributions.refuse(robot.distributions, "slip")
    name = re.sub(
        r"[^\w.-]+", "-", Path(robot.robot).stem if robot.robot.endswith(".toml") else robot.robot
    )
    return robot.replace(name=name, description="how it slips")


def _source(name: str) -> str | None:
    return (
        f"TIGERs Mannheim, Firmware, robot_impl.c ({ROBOTS[name][0]})" if name in ROBOTS else None
    )
