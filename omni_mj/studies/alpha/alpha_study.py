"""How robots follow their commands, and why not better: gain and lag apart, and where they come from.

The paper's motor correction factor alpha is a ratio of ways, achieved over commanded, in a window of time. A robot that
is late shows a small one whenever it speeds up, however much of its speed it reaches in the end: alpha alone does not
tell gain from lag. So robots drive standard profiles, from which both are measured apart (`measure.response`):

- under conditions that are changed one by one;
- worn, with every combination of causes, which says how much of gain and lag each takes
  (`conditions.shares`).

Profiles are commanded frame by frame: no controller, no dead time, and a camera without noise, whose heading keeps
robots straight.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from omni_control.controllers.base import Controller
from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config import distributions
from omni_mj.config.rows import Row
from omni_mj.config.scenario import Scenario
from omni_mj.config.settings import Settings
from omni_mj.results.ramp_response import NAMES, Profile, Response, measure
from omni_mj.results.result import Result
from omni_mj.results.result_tables import Table
from omni_mj.results.result_tables import text as aligned
from omni_mj.simulation.simulation import Simulation
from omni_mj.studies.alpha.operating_conditions import (
    AXES,
    CAUSES,
    CONDITIONS,
    DIRECTIONS,
    DRIVE_TEXT,
    LABELS,
    PROFILE,
    WORN,
    WORN_TEXT,
    Conditions,
    changed,
    combinations,
    shares,
)
from omni_mj.studies.run_scenario import resolve_scenario
from omni_mj.studies.study_runner import (
    StartProgress,
    no_progress,
    open_loop_outcome,
    open_loop_settings,
    send_twists,
)

DEFINITIONS = {
    "steady": "speed achieved / commanded in the last 0.5 s of the cruise",
    "speeding_up": "slope of the speed achieved over that commanded in the second half of the ramp up",
    "lag_s": "way missing after the ramp up and run on after that down, beside steady gain x way; / (2 gain speed)",
    "share": "mean over all orders in which the causes could be added to a robot without any; shares add up",
}
# Without limits of the command, noise and pushes.
UNDISTURBED = {
    "control": {"max_speed_m_s": 20, "max_acceleration_m_s2": 1000},
    "vision": {"position_noise_m": 0, "heading_noise_rad": 0, "miss_probability": 0},
    "disturbance": {"force_n": 0},
}
Drives = Sequence[tuple[Settings, Profile]]  # settings are all of one shape (see `plants.mujoco`)
_UNITS = {"steady": (1.0, 3), "speeding_up": (1.0, 3), "lag_s": (1000.0, 0)}
_HEADINGS = ["", "", "steady gain: fwd", "side", "speeding up: fwd", "side", "lag, ms: fwd", "side"]


class Commanded(Controller):
    """Stands where a controller would be named; what the robots are sent is the profile."""


@dataclass(frozen=True)
class AlphaStudy:
    """Responses, each with the directions of `DIRECTIONS` as its last axis.

    Attributes:
        conditions: Those that were changed alone, name -> values.
        base: Response of the robot as the scenario has it, (directions,).
        changed: Condition -> response under its values, (values, directions).
        caused: Response of a worn robot with every combination of `CAUSES`: an axis of two for
            each, then directions.
    """

    conditions: Conditions
    base: Response
    changed: Mapping[str, Response]
    caused: Response

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
            "changed": {
                name: {"values": list(self.conditions[name])} | _plain(r)
                for name, r in self.changed.items()
            },
            "worn": {"conditions": WORN, **_plain(self.worn)},
            "wheel_loop_alone": _plain(self.loop),
            "causes": {
                name: {cause: {"share": _list(share)} for cause, share in self.shares(name).items()}
                for name in NAMES
            },
        }

    def text(self) -> str:
        """Return the study as tables of plain text."""
        causes = f"where gain and lag come from: {DRIVE_TEXT}, {WORN_TEXT}"
        tables = [
            Table(
                f"one condition changed, {DRIVE_TEXT}", _HEADINGS, list(self._condition_rows()), 2
            ),
            Table(causes, _HEADINGS, list(self._cause_rows()), 2),
        ]
        return "\n\n".join(map(aligned, tables))

    def _condition_rows(self) -> Iterator[list[str]]:
        yield ["as it is", "", *_cells(self.base)]
        for name, response in self.changed.items():
            for i, value in enumerate(self.conditions[name]):
                yield ["" if i else LABELS[name], f"{value:g}", *_cells(response.at(i))]

    def _cause_rows(self) -> Iterator[list[str]]:
        yield ["wheel loop and back-EMF alone", "", *_cells(self.loop)]
        for cause in CAUSES:
            yield [
                f"share of {cause}",
                "",
                *_cells(Response(*(self.shares(name)[cause] for name in NAMES)), "+"),
            ]
        yield ["sum: the worn robot", "", *_cells(self.worn)]


@dataclass
class AlphaResult(Result):
    """The result of the study; its rows hold settings, direction, profile and response of each drive.

    Attributes:
        study: What was found; None of a study that was stopped.
    """

    study: AlphaStudy | None = None

    def summary(self) -> dict[str, Any]:
        """Return that of any result, with the study as `alpha`."""
        return super().summary() | {"alpha": self.study.report() if self.study else None}

    def table(self) -> str:
        """Return what was found as lines of text."""
        return self.study.text() if self.study else ""


def measure_alpha(
    scenario: Scenario | str = "rect",
    conditions: Conditions = CONDITIONS,
    *,
    start_progress: StartProgress = no_progress,
) -> AlphaResult:
    """Study how robots follow their commands.

    Args:
        scenario: The robot and all its settings, or its name. Its reference is left out, and of the
            standard profiles its radio and the camera's noise as well.
        conditions: Those that are changed one by one, with their values.
        start_progress: Called with a title and the number of frames to come; what it returns is called after
            each frame with its number.

    Returns:
        Gain and lag, NaN for robots that failed, and their causes.

    Raises:
        OmniError: There is no such scenario or condition, or the plant has no wheels.
    """
    started = time.perf_counter()
    robot = resolve_scenario(scenario).replace(
        name="alpha", description="gain and lag, and their causes", paper_table=0, seeds=1
    )
    distributions.refuse(robot.distributions, "alpha")
    drives = [(robot.settings, PROFILE)]
    drives += [
        changed(robot.settings, name, value)
        for name, values in conditions.items()
        for value in values
    ]
    drives += [(combined, PROFILE) for combined in combinations(robot.settings)]
    simulation, twists = _prepare(robot, drives)
    stopped = send_twists(simulation, twists, start_progress("alpha", len(twists)))
    measured, study = {"direction": np.array([*DIRECTIONS] * len(drives))}, None
    measured |= {
        name: np.array([vars(p)[name] for _, p in drives for _ in DIRECTIONS])
        for name in vars(PROFILE)
    }
    if not stopped:
        body = _respond(drives, simulation.log.channel("pose")[..., :2])
        study = _study(conditions, body)
        measured |= {name: values.ravel() for name, values in vars(body).items()}
    return AlphaResult(
        [open_loop_outcome(robot, simulation, started, stopped, measured)],
        [Commanded.__name__],
        seeds=[robot.seed],
        wall_s=time.perf_counter() - started,
        stopped=stopped,
        complete=not stopped,
        study=study,
    )


def _prepare(scenario: Scenario, drives: Drives) -> tuple[Simulation, Array]:
    """Return a simulation with a row per drive and direction, and what rows are sent, (frames, rows, 3).

    Raises:
        OmniError: The plant has no wheels.
    """
    speeds = [profile.command() for _, profile in drives]
    # The last frame only records the pose that the command of the frame before led to.
    twists = np.zeros((1 + max(map(len, speeds)), len(drives), len(DIRECTIONS), 3))
    for i, speed in enumerate(speeds):
        twists[: len(speed), i, :, :2] = speed[:, None, None] * np.array([*DIRECTIONS.values()])
    settings = [
        open_loop_settings(s, len(twists), **UNDISTURBED) for s, _ in drives for _ in DIRECTIONS
    ]
    rows = [
        Row(i, 0, Commanded.__name__, scenario.seed, settings_i, scenario.robot)
        for i, settings_i in enumerate(settings)
    ]
    simulation = Simulation(scenario, [Commanded], rows=rows)
    if simulation.plant.geometry is None:
        raise OmniError(f"alpha is studied on wheels, and the plant {scenario.plant!r} has none")
    return simulation, twists.reshape(len(twists), -1, 3)


def _respond(drives: Drives, positions: Array) -> Response:
    """Return the response (drives, directions) for positions (frames, rows, 2); NaN for robots that failed."""
    directions = np.array([*DIRECTIONS.values()])
    travelled = (positions.reshape(len(positions), -1, *directions.shape) * directions).sum(-1)
    responses = [
        measure(p, travelled[: len(p.command()) + 1, i]) for i, (_, p) in enumerate(drives)
    ]
    return Response(*(np.array([vars(response)[name] for response in responses]) for name in NAMES))


def _study(conditions: Conditions, body: Response) -> AlphaStudy:
    """Return the study for responses (drives, directions): unchanged, conditions one by one, combined causes."""
    start, changes = 1, {}
    for name, values in conditions.items():
        changes[name] = body.at(slice(start, start + len(values)))
        start += len(values)
    shape = (2,) * len(CAUSES) + (len(DIRECTIONS),)
    combined = Response(*(values[start:].reshape(shape) for values in vars(body).values()))
    return AlphaStudy(conditions, body.at(0), changes, combined)


def _cells(response: Response, sign: str = "") -> list[str]:
    """Return forward and sideways of each quantity as text."""
    return [
        f"{factor * getattr(response, name)[j]:{sign}.{digits}f}"
        for name, (factor, digits) in _UNITS.items()
        for j in range(len(AXES))
    ]


def _plain(response: Response) -> dict[str, Any]:
    return {name: _list(values) for name, values in vars(response).items()}


def _list(values: Array) -> Any:
    """Return nested lists, with None for what is not a number."""
    rounded = values.round(6).astype(object)
    rounded[np.isnan(values)] = None
    return rounded.tolist()
