"""The study: robots drive the moves, and what TIGERs Mannheim fit to theirs is fitted to them; see `slip`."""

import re
import time
from collections.abc import Callable, Iterator, Sequence
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
from omni_mj.studies.slip.checks import FRAMES, Checks, checks
from omni_mj.studies.slip.figures import QUANTITIES, Robot, figures
from omni_mj.studies.slip.moves import Move, identification, longest
from omni_mj.studies.slip.published import PUBLISHED
from omni_mj.studies.slip.record import Moves, Record, drive

BeforeRobot = Callable[[str, int], AfterFrame]
DEFINITIONS = {
    "gain, time": "K and T of v' = (K u - v) / (T |u| + 1 ms): least squares over whole moves, mean over moves",
    "u, v": "velocity by encoders, and of the body by acceleration that vision corrects; in turning T |u| is T l |u|",
    "drag": "mean deceleration of a robot whose motors carry no current, times the mass of the published fit",
    "efficiency": "(mass acceleration + drag) / force by motor currents; mean of holding a speed and of reaching it",
    "law": "closed form of the law of creep, which knows the robot's numbers and nothing of the moves",
    "open_loop": "acceleration under currents by a model of mass and drag, against that wanted",
    "wheels_ahead_m": "way by encoders less that of the body, after speeding up to 1.5 m/s",
}


@dataclass
class SlipResult(Result):
    """The result of the study; its rows hold each move and what was fitted to it.

    Attributes:
        robots: figures of those that were driven, by name.
        checks: what other teams' figures were held against, by robot.
    """

    robots: dict[str, Robot] = field(default_factory=dict)
    checks: dict[str, Checks] = field(default_factory=dict)

    def summary(self) -> dict[str, Any]:
        """That of any result, with the figures as `slip`."""
        found = {name: robot.report() for name, robot in self.robots.items()}
        for name, checked in self.checks.items():
            found[name] |= {"checks": checked.report()}
        return super().summary() | {"slip": {"definitions": DEFINITIONS, "robots": found}}

    def table(self) -> str:
        """The figures of each robot beside what the law says and what was published, as lines of text."""
        return "\n".join(self.lines())

    def lines(self) -> Iterator[str]:
        """See `table`."""
        for name, robot in self.robots.items():
            source = robot.report()["source"]
            title = f"{name}; published: {source}" if source else f"{name}; nothing published"
            yield text(Table(title, ["", "unit", "measured", "law", "published", "deviation, %"], _cells(robot), 2))
            if name in self.checks:
                yield from self.checks[name].lines()


def slip(
    robots: Sequence[Scenario | described.Robot | str] | None = None,
    moves: Sequence[Move] | None = None,
    *,
    check: bool = True,
    before_robot: BeforeRobot = lambda name, frames: nothing,
) -> SlipResult:
    """Identify how robots slip, as TIGERs Mannheim identified theirs.

    Args:
        robots: names or files of robots; or scenarios, whose robot, settings and seed are meant. [those that
            were measured, on the faster wheels]
        moves: that each robot drives. [`identification()`]
        check: whether to try what other teams tell of acceleration, too; it takes drag and efficiency forward.
        before_robot: called with each robot's name and the number of frames to come; what it returns is called after
            each frame, and may raise `StoppedError`.

    Raises:
        OmniError: there is no such robot, or one is named twice.
    """
    started, driven = time.perf_counter(), list(identification() if moves is None else moves)
    chosen = [_chosen(each) for each in (PUBLISHED if robots is None else robots)]
    names = [each.name for each in chosen]
    for name in names:
        if names.count(name) > 1:
            raise OmniError(f"robot {name!r} is named twice; name each once, or files with another name")
    result = SlipResult([Outcome.not_run(each) for each in chosen], [Moves.__name__])
    result.seeds = list(dict.fromkeys(each.seed for each in chosen))
    try:
        for i, each in enumerate(chosen):
            frames = longest(driven) + 1 + check * (FRAMES + 1)
            _identify(result, i, each, driven, check, before_robot(each.name, frames))
        result.complete = True
    except StoppedError as error:
        result.stopped = error.reason
    result.wall_s = time.perf_counter() - started
    return result


def _identify(
    result: SlipResult, i: int, chosen: Scenario, moves: Sequence[Move], check: bool, after_frame: AfterFrame
) -> None:
    """Drive one robot and put what comes out into the result; raise StoppedError if it was stopped."""
    frames, started = longest(moves), time.perf_counter()
    commands = np.stack([move.commands(frames) for move in moves], axis=1)
    free = np.stack([move.free(frames) for move in moves], axis=1)
    record = drive(chosen, commands, np.where(free, 0.0, np.nan), after_frame)
    measured: dict[str, np.ndarray] = {}
    if record.stopped is None:
        robot = result.robots[chosen.name] = figures(chosen.name, chosen.settings, moves, record)
        measured = {
            "move": np.array([move.kind for move in moves]),
            "speed": np.array([move.speed for move in moves]),
            "rolls_out": np.array([move.rolls_out for move in moves]),
            **robot.fitted,
        }
    result.outcomes[i] = _outcome(record, time.perf_counter() - started, measured)
    if record.stopped:
        raise StoppedError(record.stopped)
    known = robot.measured["drag_forward"] / robot.measured["efficiency_accelerating"]
    if check and np.isfinite(known):
        result.checks[chosen.name] = checks(chosen, robot, lambda frame: after_frame(frames + 1 + frame))


def _outcome(record: Record, wall_s: float, measured: dict[str, np.ndarray]) -> Outcome:
    simulation = record.simulation
    entry = summary.entry(simulation.scenario, simulation.log, simulation.failures, {}, wall_s, record.stopped)
    return Outcome(simulation.scenario, entry, simulation.rows, simulation.failures, measured)


def _chosen(robot: Scenario | described.Robot | str) -> Scenario:
    """What is driven, under the robot's name."""
    if not isinstance(robot, Scenario):
        robot = scenario("rect", robot=robot, wheels={"model": "two-rollers"})
    distributions.refuse(robot.distributions, "slip")
    name = re.sub(r"[^\w.-]+", "-", Path(robot.robot).stem if robot.robot.endswith(".toml") else robot.robot)
    return robot.replace(name=name, description="how it slips")


def _cells(robot: Robot) -> list[list[str]]:
    rows = []
    for name, (title, unit, digits) in QUANTITIES.items():
        values = robot.measured[name], robot.law.get(name), robot.published.get(name)
        cells = [DASH if value is None or np.isnan(value) else f"{value:.{digits}f}" for value in values]
        deviation = robot.deviation(name)
        rows.append([title, unit, *cells, "" if np.isnan(deviation) else f"{deviation:+.0f}"])
    return rows
