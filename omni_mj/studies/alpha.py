"""How robots follow their commands, and why not better: gain and lag apart, and where they come from.

The paper's motor correction factor alpha is a ratio of ways, achieved over commanded, in a window of time. A robot that
is late shows a small one whenever it speeds up, however much of its speed it reaches in the end: alpha alone does not
tell gain from lag. So robots drive standard profiles, from which both are measured apart (`measure.response`):

- under conditions that are changed one by one;
- worn, with every combination of causes, which says how much of gain and lag each takes (`conditions.shares`);

and a controller drives robots around paths, which shows the alpha that a team would see (`drives`).
"""

import itertools
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.measure import summary
from omni_mj.measure.metrics import ALPHA_MIN_SPEED_M_S, ALPHA_PERCENTILES, ALPHA_START_FRAMES, ALPHA_WINDOW_FRAMES
from omni_mj.measure.response import NAMES, Response
from omni_mj.measure.result import Outcome, Result
from omni_mj.measure.table import DASH, Table
from omni_mj.measure.table import text as aligned
from omni_mj.scenarios import distributions
from omni_mj.scenarios.scenario import Scenario, load
from omni_mj.scenarios.settings import FRAME_RATE_HZ
from omni_mj.studies.conditions import (
    CAUSES,
    CONDITIONS,
    LABELS,
    PROFILE,
    USUAL,
    WORN,
    Conditions,
    changed,
    combinations,
    shares,
)
from omni_mj.studies.drives import (
    AXES,
    CONTROLLER,
    DIRECTIONS,
    Commanded,
    ProfileDrives,
    alpha_percentiles,
    path_simulation,
)
from omni_mj.studies.outcome import AfterFrame, StoppedError, nothing, total_frames

TASKS = ("rect", "league")
DEFINITIONS = {
    "steady": "speed achieved / commanded in the last 0.5 s of the cruise",
    "speeding_up": "slope of the speed achieved over that commanded in the second half of the ramp up",
    "lag_s": "way missing after the ramp up and run on after that down, beside steady gain x way; / (2 gain speed)",
    "share": "mean over all orders in which the causes could be added to a robot without any; shares add up",
    "alpha": (
        f"displacement achieved / commanded in windows of {ALPHA_WINDOW_FRAMES / FRAME_RATE_HZ:g} s, where in each"
        f" and the {ALPHA_START_FRAMES / FRAME_RATE_HZ:g} s before it more than {ALPHA_MIN_SPEED_M_S:g} m/s was"
        f" commanded along the axis; driven by {CONTROLLER}"
    ),
}
_UNITS = {"steady": (1.0, 3), "speeding_up": (1.0, 3), "lag_s": (1000.0, 0)}
_HEADINGS = ["", "", "steady gain: fwd", "side", "speeding up: fwd", "side", "lag, ms: fwd", "side"]


@dataclass(frozen=True)
class Study:
    """Responses, each with the directions of `DIRECTIONS` as its last axis, and alpha in use.

    Attributes:
        conditions: Those that were changed alone, name -> values.
        base: Response of the robot as the scenario has it, (directions,).
        changed: Condition -> response under its values, (values, directions).
        caused: Response of a worn robot with every combination of `CAUSES`: an axis of two for each, then directions.
        wheels: Response of the worn robot's wheels, (directions,): what it would do if they did not slip.
        in_use: Task -> axis -> percentiles of alpha.
    """

    conditions: Conditions
    base: Response
    changed: Mapping[str, Response]
    caused: Response
    wheels: Response
    in_use: Mapping[str, Mapping[str, Mapping[str, float]]]

    @property
    def worn(self) -> Response:
        """Response of the worn robot, with all causes, (directions,)."""
        return self.caused.at((1,) * len(CAUSES))

    @property
    def loop(self) -> Response:
        """Response of the same without any cause: what wheel loops and motors leave by themselves, (directions,)."""
        return self.caused.at((0,) * len(CAUSES))

    def shares(self, quantity: str) -> dict[str, Array]:
        """Return what each cause adds to a quantity of `Response`, (directions,)."""
        return shares(getattr(self.caused, quantity))

    def report(self) -> dict[str, Any]:
        """Return the study in plain values."""
        return {
            "definitions": DEFINITIONS,
            "directions": list(DIRECTIONS),
            "profile": vars(PROFILE),
            "base": _plain(self.base),
            "changed": {name: {"values": list(self.conditions[name])} | _plain(r) for name, r in self.changed.items()},
            "worn": {"conditions": WORN, **_plain(self.worn)},
            "worn_wheels": _plain(self.wheels),
            "wheel_loop_alone": _plain(self.loop),
            "causes": {
                name: {cause: {"share": _list(share)} for cause, share in self.shares(name).items()} for name in NAMES
            },
            "usual": {name: list(values) for name, values in USUAL.items()},
            "in_use": self.in_use,
        }

    def text(self) -> str:
        """Return the study as tables of plain text."""
        drive = f"{PROFILE.speed_m_s:g} m/s at {PROFILE.acceleration_m_s2:g} m/s²"
        worn = f"windings at {WORN['winding_c']:g} °C, battery at {100 * WORN['charge']:g} %"
        usual = "; ".join(f"{LABELS[name]} {', '.join(f'{v:g}' for v in values)}" for name, values in USUAL.items())
        in_use = f"alpha over {ALPHA_WINDOW_FRAMES / FRAME_RATE_HZ:g} s in use, driven by {CONTROLLER}; {usual}"
        tables = [
            Table(f"one condition changed, {drive}", _HEADINGS, list(self._condition_rows()), 2),
            Table(f"where gain and lag come from: {drive}, {worn}", _HEADINGS, list(self._cause_rows()), 2),
            Table(in_use, ["", "", *(f"{p} %" for p in ALPHA_PERCENTILES)], list(self._use_rows()), 2),
        ]
        return "\n\n".join(aligned(table) for table in tables if table.rows)

    def _condition_rows(self) -> Iterator[list[str]]:
        yield ["as it is", "", *_cells(self.base)]
        for name, response in self.changed.items():
            for i, value in enumerate(self.conditions[name]):
                yield ["" if i else LABELS[name], f"{value:g}", *_cells(response.at(i))]

    def _cause_rows(self) -> Iterator[list[str]]:
        yield ["wheel loop and back-EMF alone", "", *_cells(self.loop)]
        for cause in CAUSES:
            yield [f"share of {cause}", "", *_cells(Response(*(self.shares(name)[cause] for name in NAMES)), "+")]
        yield ["sum: the worn robot", "", *_cells(self.worn)]
        yield ["  of which its wheels turn", "", *_cells(self.wheels)]

    def _use_rows(self) -> Iterator[list[str]]:
        for task, axes in self.in_use.items():
            for axis in AXES:
                yield [task, axis, *([f"{value:.2f}" for value in axes[axis].values()] or [DASH] * 3)]


@dataclass
class AlphaResult(Result):
    """The result of the study; its rows hold settings, direction, profile and response of each drive.

    Attributes:
        study: What was found; None of a study that was stopped.
    """

    study: Study | None = None

    def summary(self) -> dict[str, Any]:
        """Return that of any result, with the study as `alpha`."""
        return super().summary() | {"alpha": self.study.report() if self.study else None}

    def table(self) -> str:
        """Return what was found as lines of text."""
        return self.study.text() if self.study else ""


def alpha(
    scenario: Scenario | str = "rect",
    conditions: Conditions = CONDITIONS,
    tasks: Sequence[str] = TASKS,
    *,
    begin: Callable[[str, int], AfterFrame] = lambda title, frames: nothing,
) -> AlphaResult:
    """Study how robots follow their commands.

    Args:
        scenario: The robot and all its settings, or its name. Its reference is left out, and of the standard profiles
            its radio and the camera's noise as well.
        conditions: Those that are changed one by one, with their values.
        tasks: Scenarios around whose paths a controller drives robots under usual conditions.
        begin: Called with a title and the number of frames to come; what it returns is called after each frame with
            its number.

    Returns:
        Gain and lag, NaN for robots that failed, their causes, and alpha in use.

    Raises:
        OmniError: There is no such scenario or condition, or the plant has no wheels.
    """
    started = time.perf_counter()
    chosen = load(scenario) if isinstance(scenario, str) else scenario
    chosen = chosen.replace(name="alpha", description="gain and lag, and their causes", paper_table=0, seeds=1)
    distributions.refuse(chosen.distributions, "alpha")
    drives = [(chosen.settings, PROFILE)]
    drives += [changed(chosen.settings, name, value) for name, values in conditions.items() for value in values]
    drives += [(combined, PROFILE) for combined in combinations(chosen.settings)]
    profiles = ProfileDrives(chosen, drives)
    paths = {task: path_simulation(chosen, task) for task in tasks}
    result = AlphaResult([], [Commanded.__name__], seeds=[chosen.seed])
    after_frame, number = begin("alpha", profiles.frames + sum(map(total_frames, paths.values()))), itertools.count()

    def count(_: int) -> None:
        after_frame(next(number))

    try:
        profiles.run(count)
        for simulation in paths.values():
            simulation.run(count)
        result.complete = True
    except StoppedError as error:
        result.stopped = error.reason
    result.wall_s = time.perf_counter() - started
    measured = dict(profiles.labels)
    if result.complete:
        body = profiles.body()
        in_use = {task: alpha_percentiles(simulation.log) for task, simulation in paths.items()}
        result.study = _study(conditions, body, profiles.wheels().at(-1), in_use)
        measured |= {name: getattr(body, name).ravel() for name in NAMES}
    for simulation in (profiles.simulation, *paths.values()):
        failures = list(simulation.failures)
        entry = summary.entry(simulation.scenario, simulation.log, failures, {}, result.wall_s, result.stopped)
        result.outcomes.append(Outcome(simulation.scenario, entry, simulation.rows, failures, measured))
        measured = {}  # only the standard profiles have responses
    return result


def _study(
    conditions: Conditions, body: Response, wheels: Response, in_use: Mapping[str, Mapping[str, Mapping[str, float]]]
) -> Study:
    """Return the study for responses (drives, directions): unchanged, conditions one by one, combined causes."""
    start, changes = 1, {}
    for name, values in conditions.items():
        changes[name] = body.at(slice(start, start + len(values)))
        start += len(values)
    shape = (2,) * len(CAUSES) + (len(DIRECTIONS),)
    combined = Response(*(getattr(body, name)[start:].reshape(shape) for name in NAMES))
    return Study(conditions, body.at(0), changes, combined, wheels, in_use)


def _cells(response: Response, sign: str = "") -> list[str]:
    """Return forward and sideways of each quantity as text."""
    return [
        f"{factor * getattr(response, name)[j]:{sign}.{digits}f}"
        for name, (factor, digits) in _UNITS.items()
        for j in range(len(AXES))
    ]


def _plain(response: Response) -> dict[str, Any]:
    return {name: _list(getattr(response, name)) for name in NAMES}


def _list(values: Array) -> Any:
    """Return nested lists, with None for what is not a number."""
    rounded = values.round(6).astype(object)
    rounded[np.isnan(values)] = None
    return rounded.tolist()
