"""The study: robots drive the moves, and what TIGERs Mannheim fit to theirs is fitted to them; see `slip`."""

import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from omni_control.errors import OmniError
from omni_mj.measure import summary
from omni_mj.measure.result import Outcome, Result
from omni_mj.measure.table import DASH, Table, text
from omni_mj.scenarios import distributions
from omni_mj.scenarios import resolve as described
from omni_mj.scenarios.scenario import Scenario, scenario
from omni_mj.studies.outcome import AfterFrame, StoppedError, nothing
from omni_mj.studies.slip.figures import QUANTITIES, Robot, figures
from omni_mj.studies.slip.moves import Move, identification, longest
from omni_mj.studies.slip.published import PUBLISHED
from omni_mj.studies.slip.record import Moves, drive

BeforeRobot = Callable[[str, int], AfterFrame]
DEFINITIONS = {
    "gain, time": "K and T of v' = (K u - v) / (T |u| + 1 ms): least squares over whole moves, mean over moves",
    "u, v": "velocity by encoders, and of the body; in turning T |u| is T l |u|",
    "drag": "mean deceleration of a robot whose motors carry no current, times the mass of the published fit",
    "efficiency": "(mass acceleration + drag) / force by motor currents; mean of holding a speed and of reaching it",
    "law": "closed form of the law of creep, which knows the robot's numbers and nothing of the moves",
}


@dataclass
class SlipResult(Result):
    """The result of the study; its rows hold each move and what was fitted to it.

    Attributes:
        robots: figures of those that were driven, by name.
    """

    robots: dict[str, Robot] = field(default_factory=dict)

    def summary(self) -> dict[str, Any]:
        """That of any result, with the figures as `slip`."""
        found = {name: robot.report() for name, robot in self.robots.items()}
        return super().summary() | {"slip": {"definitions": DEFINITIONS, "robots": found}}

    def table(self) -> str:
        """The figures of each robot beside what the law says and what was published, as lines of text."""
        return "\n".join(_text(name, robot) for name, robot in self.robots.items())


def slip(
    robots: Sequence[Scenario | described.Robot | str] | None = None,
    moves: Sequence[Move] | None = None,
    *,
    before_robot: BeforeRobot = lambda name, frames: nothing,
) -> SlipResult:
    """Identify how robots slip, as TIGERs Mannheim identified theirs.

    Args:
        robots: names or files of robots; or scenarios, whose robot, settings and seed are meant. [those that
            were measured, on the faster wheels]
        moves: that each robot drives. [`identification()`]
        before_robot: called with each robot's name and the number of frames to come; what it returns is called after
            each frame, and may raise `StoppedError`.

    Raises:
        OmniError: there is no such robot, or one is named twice.
    """
    started, driven = time.perf_counter(), list(identification() if moves is None else moves)
    chosen = [named(each) for each in (PUBLISHED if robots is None else robots)]
    names = [each.name for each in chosen]
    for name in names:
        if names.count(name) > 1:
            raise OmniError(f"robot {name!r} is named twice; name each once, or files with another name")
    result = SlipResult([Outcome.not_run(each) for each in chosen], [Moves.__name__])
    result.seeds = list(dict.fromkeys(each.seed for each in chosen))
    try:
        for i, each in enumerate(chosen):
            _identify(result, i, each, driven, before_robot(each.name, longest(driven) + 1))
        result.complete = True
    except StoppedError as error:
        result.stopped = error.reason
    result.wall_s = time.perf_counter() - started
    return result


def _identify(result: SlipResult, i: int, chosen: Scenario, moves: Sequence[Move], after_frame: AfterFrame) -> None:
    """Drive one robot and put what comes out into the result; raise StoppedError if it was stopped."""
    frames, started = longest(moves), time.perf_counter()
    commands = np.stack([move.commands(frames) for move in moves], axis=1)
    free = np.stack([move.free(frames) for move in moves], axis=1)
    record = drive(chosen, commands, free, after_frame)
    measured: dict[str, np.ndarray] = {}
    if record.stopped is None:
        robot = result.robots[chosen.name] = figures(chosen.name, chosen.settings, moves, record)
        names = {"move": "kind", "speed": "speed", "rolls_out": "rolls_out"}
        measured = {name: np.array([getattr(m, of) for m in moves]) for name, of in names.items()} | dict(robot.fitted)
    simulation, wall_s = record.simulation, time.perf_counter() - started
    entry = summary.entry(simulation.scenario, simulation.log, simulation.failures, {}, wall_s, record.stopped)
    result.outcomes[i] = Outcome(simulation.scenario, entry, simulation.rows, simulation.failures, measured)
    if record.stopped:
        raise StoppedError(record.stopped)


def named(robot: Scenario | described.Robot | str) -> Scenario:
    """Return the scenario that is driven, with the name of its robot."""
    if not isinstance(robot, Scenario):
        robot = scenario("rect", robot=robot, wheels={"model": "two-rollers"})
    distributions.refuse(robot.distributions, "slip")
    name = re.sub(r"[^\w.-]+", "-", Path(robot.robot).stem if robot.robot.endswith(".toml") else robot.robot)
    return robot.replace(name=name, description="how it slips")


def _text(name: str, robot: Robot) -> str:
    rows = []
    for quantity, (title, unit, digits) in QUANTITIES.items():
        values = robot.measured[quantity], robot.law.get(quantity), robot.published.get(quantity)
        cells = [DASH if value is None or np.isnan(value) else f"{value:.{digits}f}" for value in values]
        deviation = robot.deviation(quantity)
        rows.append([title, unit, *cells, "" if np.isnan(deviation) else f"{deviation:+.0f}"])
    source = robot.report()["source"]
    title = f"{name}; published: {source}" if source else f"{name}; nothing published"
    return text(Table(title, ["", "unit", "measured", "law", "published", "deviation, %"], rows, 2))
