"""How closely robots follow velocity commands: gain, lag, and the causes of both.

The paper's motor correction factor alpha is the displacement achieved over the displacement
commanded in a window of time. While a robot speeds up, a lag lowers this ratio as a low gain does.
Alpha alone cannot tell them apart. So robots drive standard velocity profiles, from which gain and
lag are measured separately (`omni_mj.results.ramp_response`):

- with operating conditions that are varied one by one;
- worn, with every combination of causes. The Shapley value of a cause is its contribution to gain
  and lag (`operating_conditions.shapley_values`).

Profiles are commanded frame by frame, without controller and dead time. The camera has no noise;
its heading keeps the robots straight.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from omni_control.arguments import check_types
from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config import distributions
from omni_mj.config.scenario import Scenario
from omni_mj.config.settings import Settings
from omni_mj.results.ramp_response import RampProfile, RampResponse, measure_ramp_response
from omni_mj.results.result import Result
from omni_mj.results.seed_statistics import finite_or_none
from omni_mj.results.text_table import Table, format_table
from omni_mj.simulation.simulation import Simulation
from omni_mj.studies.alpha.operating_conditions import (
    CAUSES,
    CONDITION_VALUES,
    DIRECTIONS,
    PROFILE,
    PROFILE_TEXT,
    UNIT_VECTORS,
    WORN,
    WORN_TEXT,
    ConditionValues,
    ablate_causes,
    apply_condition,
    shapley_values,
)
from omni_mj.studies.open_loop import build_open_loop, open_loop_settings, run_open_loop
from omni_mj.studies.run_scenario import StartProgress, no_progress, resolve_scenario

DEFINITIONS = {
    "steady_gain": "achieved / commanded speed in the last 0.5 s at constant speed",
    "acceleration_gain": (
        "slope of the achieved over the commanded speed in the second half of the ramp up"
    ),
    "lag_s": (
        "(missing displacement after the ramp up + excess displacement after the ramp down) / "
        "(2 x steady gain x speed), both compared with steady gain x commanded displacement"
    ),
    "share": (
        "Shapley value of a cause: mean change by adding it, over all orders in which the causes "
        "can be added; these contributions add up to the total effect"
    ),
}
# Settings without effective limits of commands, noise and disturbances
UNDISTURBED = {
    "control": {"max_speed_m_s": 20, "max_acceleration_m_s2": 1000},
    "vision": {"position_noise_m": 0, "heading_noise_rad": 0, "miss_probability": 0},
    "disturbance": {"force_n": 0},
}
Trials = Sequence[tuple[Settings, RampProfile]]
# Factor to the table's unit and decimal places of each quantity of `RampResponse`
_FORMATS = ((1.0, 3), (1.0, 3), (1000.0, 0))
_HEADINGS = ["forward/sideways", "", "steady gain", "gain speeding up", "lag, ms"]


@dataclass(frozen=True)
class AlphaStudy:
    """Responses of all trials. Their last axis is the direction of motion, see `DIRECTIONS`.

    Attributes:
        condition_values: Condition -> values under which it was varied, all others nominal.
        baseline: Response of the robot with the scenario's settings, (directions,).
        by_condition: Condition -> response under its values, (values, directions).
        by_causes: Response of a worn robot with every combination of `CAUSES`. The leading axes,
            one per cause, have two entries: without and with the cause.
    """

    condition_values: ConditionValues
    baseline: RampResponse
    by_condition: Mapping[str, RampResponse]
    by_causes: RampResponse

    @property
    def worn(self) -> RampResponse:
        """Response of the worn robot with all causes, (directions,)."""
        return self.by_causes.at((1,) * len(CAUSES))

    @property
    def wheel_loop(self) -> RampResponse:
        """Response of the worn robot without any cause: wheel loops and back-EMF, (directions,)."""
        return self.by_causes.at((0,) * len(CAUSES))

    def contributions(self, quantity: str) -> dict[str, Array]:
        """Return each cause's contribution to a quantity of `RampResponse`, (directions,)."""
        return shapley_values(getattr(self.by_causes, quantity))

    def report(self) -> dict[str, Any]:
        """Return the study as plain values for JSON."""
        numbers = {
            "profile": PROFILE._asdict(),
            "baseline": self.baseline._asdict(),
            "by_condition": {
                name: {"values": self.condition_values[name], **response._asdict()}
                for name, response in self.by_condition.items()
            },
            "worn": {"conditions": WORN, **self.worn._asdict()},
            "wheel_loop": self.wheel_loop._asdict(),
            "causes": {
                name: {
                    cause: {"share": values} for cause, values in self.contributions(name).items()
                }
                for name in RampResponse._fields
            },
        }
        head = {"definitions": DEFINITIONS, "directions": list(DIRECTIONS)}
        return head | finite_or_none(numbers)

    def text(self) -> str:
        """Return the study as tables of plain text."""
        rows_by_title = {
            f"one condition varied, {PROFILE_TEXT}": self._condition_rows(),
            f"causes of lost gain and of lag: {PROFILE_TEXT}, {WORN_TEXT}": self._cause_rows(),
        }
        return "\n\n".join(
            format_table(Table(title, _HEADINGS, list(rows), 2))
            for title, rows in rows_by_title.items()
        )

    def _condition_rows(self) -> Iterator[list[str]]:
        yield ["the scenario's settings", "", *_format_response(self.baseline)]
        for name, response in self.by_condition.items():
            for i, value in enumerate(self.condition_values[name]):
                yield ["" if i else name, f"{value:g}", *_format_response(response.at(i))]

    def _cause_rows(self) -> Iterator[list[str]]:
        yield ["wheel loop and back-EMF alone", "", *_format_response(self.wheel_loop)]
        contributions = [self.contributions(name) for name in RampResponse._fields]
        for cause in CAUSES:
            contribution = RampResponse(*(shares[cause] for shares in contributions))
            yield [f"contribution of {cause}", "", *_format_response(contribution, "+")]
        yield ["sum: the worn robot", "", *_format_response(self.worn)]


@dataclass
class AlphaResult(Result):
    """Result of the alpha study. Its rows hold settings, direction, profile and response.

    Attributes:
        study: Responses of all trials; None if the study was stopped.
    """

    study: AlphaStudy | None = None

    def summary(self) -> dict[str, Any]:
        """Return the summary of any result, with the study as `alpha`."""
        return super().summary() | {"alpha": self.study.report() if self.study else None}

    def table(self) -> str:
        """Return the study as lines of text; empty if it was stopped."""
        return self.study.text() if self.study else ""


@check_types
def measure_alpha(
    scenario: Scenario | str = "rect",
    condition_values: ConditionValues = CONDITION_VALUES,
    *,
    start_progress: StartProgress = no_progress,
) -> AlphaResult:
    """Measure how closely a robot follows velocity commands, and the causes of the deviation.

    Args:
        scenario: Scenario, or its name, with the robot and its settings. Its reference, dead time
            and camera noise are not used.
        condition_values: Condition -> values. Conditions are varied one by one.
        start_progress: Called with a title and the number of frames. It returns a function that is
            called with each frame's number and may raise `StoppedError`.

    Returns:
        Gain and lag, NaN for robots that failed, and the contribution of each cause.

    Raises:
        OmniError: The scenario or a condition does not exist, or the plant has no wheels.
    """
    robot = resolve_scenario(scenario).replace(
        name="alpha", description="gain and lag, and their causes", paper_table=0, seeds=1
    )
    distributions.require_fixed_settings(robot.distributions, "alpha")
    trials = [(robot.settings, PROFILE)]
    trials += [
        apply_condition(robot.settings, name, value)
        for name, values in condition_values.items()
        for value in values
    ]
    trials += [(settings, PROFILE) for settings in ablate_causes(robot.settings)]
    simulation, twists = _prepare_trials(robot, trials)
    outcome = run_open_loop(robot, simulation, twists, start_progress("alpha", len(twists)))
    columns, study, stopped = _profile_columns(trials), None, outcome.entry["reason"]
    if not stopped:
        response = _measure_responses(trials, simulation.log.channel("pose")[..., :2])
        study = _build_study(condition_values, response)
        columns |= {name: values.ravel() for name, values in response._asdict().items()}
    return AlphaResult(
        [replace(outcome, metrics=columns)],
        simulation.scenario.labels,
        seeds=[robot.seed],
        wall_s=outcome.entry["wall_s"],
        stopped=stopped,
        complete=not stopped,
        study=study,
    )


def _prepare_trials(scenario: Scenario, trials: Trials) -> tuple[Simulation, Array]:
    """Return a simulation with a row per trial and direction, and its commands.

    Returns:
        The simulation, and the twists to send, (frames, rows, 3).

    Raises:
        OmniError: The plant has no wheels.
    """
    speeds = [profile.command() for _, profile in trials]
    # The last frame only records the pose that the last command led to.
    twists = np.zeros((1 + max(map(len, speeds)), len(trials), len(DIRECTIONS), 3))
    for i, speed in enumerate(speeds):
        twists[: len(speed), i, :, :2] = speed[:, None, None] * UNIT_VECTORS
    runs = [
        (scenario.seed, open_loop_settings(settings, len(twists), **UNDISTURBED))
        for settings, _ in trials
        for _ in DIRECTIONS
    ]
    simulation = build_open_loop(scenario, runs)
    if simulation.plant.geometry is None:
        raise OmniError(
            f"the alpha study needs a plant with wheels, and the plant {scenario.plant!r} has none"
        )
    return simulation, twists.reshape(len(twists), -1, 3)


def _profile_columns(trials: Trials) -> dict[str, np.ndarray]:
    """Return the columns of each row's direction and profile."""
    profiles = np.repeat([profile for _, profile in trials], len(DIRECTIONS), axis=0)
    columns = dict(zip(RampProfile._fields, profiles.T, strict=True))
    return {"direction": np.array([*DIRECTIONS] * len(trials))} | columns


def _measure_responses(trials: Trials, positions: Array) -> RampResponse:
    """Return the responses (trials, directions) of robots with positions (frames, rows, 2).

    The response of a robot that failed is NaN.
    """
    by_trial = positions.reshape(len(positions), len(trials), *UNIT_VECTORS.shape)
    travelled = (by_trial * UNIT_VECTORS).sum(-1)
    responses = [
        measure_ramp_response(profile, travelled[: len(profile.command()) + 1, i])
        for i, (_, profile) in enumerate(trials)
    ]
    return RampResponse(*np.stack(responses, axis=1))


def _build_study(condition_values: ConditionValues, response: RampResponse) -> AlphaStudy:
    """Return the study of a response (trials, directions).

    Trials are in this order: baseline, conditions one by one, combinations of causes.
    """
    start, by_condition = 1, {}
    for name, values in condition_values.items():
        by_condition[name] = response.at(slice(start, start + len(values)))
        start += len(values)
    shape = (2,) * len(CAUSES) + (len(DIRECTIONS),)
    by_causes = RampResponse(*(values[start:].reshape(shape) for values in response))
    return AlphaStudy(condition_values, response.at(0), by_condition, by_causes)


def _format_response(response: RampResponse, sign: str = "") -> list[str]:
    """Return each quantity as text, forward and sideways separated by a slash."""
    return [
        "/".join(f"{factor * value:{sign}.{digits}f}" for value in values[:2])
        for values, (factor, digits) in zip(response, _FORMATS, strict=True)
    ]
