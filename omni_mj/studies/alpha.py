"""How the motor correction factor alpha comes out of friction, heat, battery and lint.

Robots drive standard velocity profiles, each combination of conditions in a robot of its own, commanded step by step:
no controller, no dead time, and a camera without noise, whose heading keeps the robots straight.
"""

import itertools
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from omni_control.controllers.base import Controller
from omni_control.kinematics import Array
from omni_mj.measure import summary
from omni_mj.measure.metrics import ALPHA_PERCENTILES, ALPHA_WINDOW_FRAMES, alpha_windows
from omni_mj.measure.result import Outcome, Result
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.scenario import Scenario, load
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S, Settings
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies.outcome import AfterFrame, StoppedError, nothing

Conditions = Mapping[str, Sequence[float]]
CONDITIONS: Conditions = {
    "friction": (0.3, 0.4, 0.5, 0.7, 0.9, 1.0),
    "winding_c": (25.0, 75.0, 120.0),
    "charge": (1.0, 0.5, 0.15),
    "lint": (0.03, 0.065, 0.15),
}
DIRECTIONS = {"x": (1.0, 0.0), "y": (0.0, 1.0), "diagonal": (0.5**0.5, 0.5**0.5)}
SPEED_M_S, ACCELERATION_M_S2 = 1.5, 3.0
# The windows of 0.25 s: the ramp takes two, then the profile cruises; what follows a change of slope is left out.
PHASES = {"accelerating": range(2), "cruising": range(3, 6)}
FRAMES = ALPHA_WINDOW_FRAMES * 6
# What real robots meet, over which the paper's interval [0.7, 1] should come out.
USUAL = {"friction": (0.5, 0.9), "winding_c": (25.0, 120.0), "charge": (0.15, 1.0), "lint": (0.065, 0.065)}


class Profile(Controller):
    """Stands where a controller would be named; what the robots are sent is the profile."""


@dataclass(frozen=True)
class Study:
    """alpha over friction, winding temperature, charge, lint, direction and window, in this order of axes.

    `conditions` are the values of the first four.
    """

    conditions: Conditions
    alpha: Array

    def phase(self, name: str) -> Array:
        """The windows of one phase."""
        return self.alpha[..., list(PHASES[name])]

    def usual(self) -> Array:
        """Both phases under the conditions of `USUAL`, flat."""
        inside = np.ix_(*(_inside(values, USUAL[name]) for name, values in self.conditions.items()))
        return np.concatenate([self.phase(name)[inside].ravel() for name in PHASES])

    def trend(self, condition: str) -> Array:
        """Mean of alpha over everything but one condition, in the order of its values."""
        axis = list(self.conditions).index(condition)
        both = np.concatenate([self.phase(name) for name in PHASES], axis=-1)
        mean: Array = np.nanmean(both, axis=tuple(i for i in range(both.ndim) if i != axis))
        return mean

    def percentiles(self) -> dict[str, float]:
        """Of alpha under the usual conditions; none without them."""
        usual = self.usual()
        usual = usual[~np.isnan(usual)]
        return {f"p{p}": round(float(np.percentile(usual, p)), 6) for p in ALPHA_PERCENTILES} if usual.size else {}

    def report(self) -> dict[str, Any]:
        """The study in plain values."""
        return {
            "definition": f"displacement achieved / commanded along the drive, windows of {ALPHA_WINDOW_FRAMES} frames",
            "profile": {"speed_m_s": SPEED_M_S, "acceleration_m_s2": ACCELERATION_M_S2, "rate_hz": FRAME_RATE_HZ},
            "axes": {**{name: list(values) for name, values in self.conditions.items()}, "direction": list(DIRECTIONS)},
            "alpha": {name: _plain(self.phase(name).mean(-1)) for name in PHASES},
            "windows": {name: [round(i * ALPHA_WINDOW_FRAMES * PERIOD_S, 6) for i in PHASES[name]] for name in PHASES},
            "trends": {name: _plain(self.trend(name)) for name in self.conditions},
            "usual": {"conditions": USUAL, **self.percentiles()},
        }


@dataclass
class AlphaResult(Result):
    """The result of the study; its rows hold conditions, direction and alpha.

    Attributes:
        study: alpha over the conditions; None of a study that was stopped.
    """

    study: Study | None = None

    def summary(self) -> dict[str, Any]:
        """That of any result, with the study as `alpha`."""
        return super().summary() | {"alpha": self.study.report() if self.study else None}

    def table(self) -> str:
        """The trends, and the percentiles under usual conditions, as lines of text."""
        return "\n".join(self.lines())

    def lines(self) -> Iterator[str]:
        """See `table`."""
        if self.study is None:
            return
        yield "mean alpha over everything else"
        width = max(map(len, self.study.conditions))
        for name, values in self.study.conditions.items():
            pairs = zip(values, self.study.trend(name), strict=True)
            yield f"{name.ljust(width)}  " + "   ".join(f"{value:g}: {mean:.3f}" for value, mean in pairs)
        if percentiles := self.study.percentiles():
            bounds = ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in USUAL.items())
            yield f"usual conditions ({bounds}):"
            numbers = ", ".join(f"{value:.3f}" for value in percentiles.values())
            yield f"  5th, 50th, 95th percentile of alpha: {numbers}"


def alpha(
    scenario: Scenario | str = "rect", conditions: Conditions | None = None, *, after_frame: AfterFrame = nothing
) -> AlphaResult:
    """Drive the profiles under all combinations of `conditions`.

    Args:
        scenario: everything else, or its name; its reference, radio and camera are left out.
        conditions: values of `friction`, `winding_c`, `charge` and `lint`. [`CONDITIONS`] Hot windings come with a
            housing as warm as it gets in equilibrium with them.
        after_frame: called with each frame's number.

    Returns:
        alpha, whose windows are not a number for robots that failed.
    """
    started, conditions = time.perf_counter(), conditions or CONDITIONS
    chosen = _without_loop(load(scenario) if isinstance(scenario, str) else scenario)
    combinations = list(itertools.product(itertools.product(*conditions.values()), DIRECTIONS))
    rows = [
        Row(world, 0, Profile.__name__, chosen.seed, _under(chosen.settings, *values), chosen.robot)
        for world, (values, _) in enumerate(combinations)
    ]
    heading = np.array([DIRECTIONS[direction] for _, direction in combinations])
    simulation = Simulation(chosen, [Profile], rows=rows)
    result = AlphaResult([Outcome.not_run(chosen)], [Profile.__name__], seeds=[chosen.seed])
    try:
        for frame, speed in enumerate([*profile(), 0.0]):  # the last only records where the profile led
            simulation.step(np.pad(speed * heading, ((0, 0), (0, 1))))
            after_frame(frame)
    except StoppedError as error:
        result.stopped = error.reason
    result.wall_s = time.perf_counter() - started
    result.complete = result.stopped is None
    entry = summary.entry(chosen, simulation.log, simulation.failures, {}, result.wall_s, result.stopped)
    measured: dict[str, np.ndarray] = {"direction": np.array([direction for _, direction in combinations])}
    if result.complete:
        result.study = Study(conditions, _alpha(simulation, heading, [len(values) for values in conditions.values()]))
        flat = result.study.alpha.reshape(len(rows), -1)
        measured |= {f"alpha_{name}": flat[:, list(windows)].mean(-1) for name, windows in PHASES.items()}
    result.outcomes = [Outcome(chosen, entry, rows, simulation.failures, measured)]
    return result


def profile() -> Array:
    """The commanded speed in each frame, m/s: a ramp, then constant."""
    return np.minimum(SPEED_M_S, ACCELERATION_M_S2 * PERIOD_S * np.arange(1, FRAMES + 1))


def _alpha(simulation: Simulation, heading: Array, shape: Sequence[int]) -> Array:
    """The factor along the drive, one window after the other, over conditions of this shape and directions."""
    along = (simulation.log.channel("pose")[..., :2] * heading).sum(-1)
    command = np.append(profile(), 0.0)[:, None] * np.ones(len(heading))
    windows = alpha_windows(along, command)[::ALPHA_WINDOW_FRAMES]
    return windows.T.reshape(*shape, len(DIRECTIONS), len(windows))


def _without_loop(scenario: Scenario) -> Scenario:
    """The scenario without dead time, noise of the camera, and controllers; its reference is as long as the profile."""
    settings = scenario.settings.replace(
        reference={
            "shape": "waypoints",
            "waypoints": [[0, 0], [0, 0]],
            "mode": "timed",
            "settle_s": 2 * FRAMES * PERIOD_S,
        },
        radio={"delay_frames": 0, "jitter_frames": 0},
        vision={"position_noise_m": 0, "heading_noise_rad": 0, "miss_probability": 0},
        world={"places": [[0, 0, 0]]},
    )
    return scenario.replace(
        name="alpha", description="where alpha comes from", paper_table=0, settings=settings, seeds=1
    )


def _under(settings: Settings, friction: float, winding_c: float, charge: float, lint: float) -> Settings:
    motor = settings.motor
    share = motor.housing_ambient_k_w / (motor.housing_ambient_k_w + motor.winding_housing_k_w)
    housing_c = motor.ambient_c + share * (winding_c - motor.ambient_c)
    return settings.replace(
        carpet={"friction": friction, "lint": lint},
        motor={"winding_c": winding_c, "housing_c": housing_c},
        battery={"charge": charge},
    )


def _inside(values: Sequence[float], bounds: tuple[float, float]) -> list[int]:
    return [i for i, value in enumerate(values) if bounds[0] <= value <= bounds[1]]


def _plain(values: Array) -> Any:
    """Nested lists, with None for what is not a number."""
    rounded = values.round(6).astype(object)
    rounded[np.isnan(values)] = None
    return rounded.tolist()
