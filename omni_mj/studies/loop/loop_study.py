"""Loop study: step response and stability margins of control loops, measured on the plant.

`loop_experiment` runs the robots, `loop_metrics` evaluates the record.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from omni_control.arguments import check_types
from omni_control.kinematics import Array
from omni_mj.config import distributions
from omni_mj.config.plugins import ControllerSpec
from omni_mj.config.scenario import Scenario
from omni_mj.results.result import Result
from omni_mj.results.seed_statistics import finite_or_none
from omni_mj.results.text_table import Table, format_number, format_table
from omni_mj.studies.loop import loop_experiment
from omni_mj.studies.loop.loop_experiment import CASES, FREQUENCIES, STEP_M, LoopExperiment
from omni_mj.studies.loop.loop_metrics import (
    Gains,
    StabilityMargins,
    StepMetrics,
    compute_margins,
    compute_step_metrics,
    estimate_loop_gain,
)
from omni_mj.studies.run_scenario import (
    StartProgress,
    build_result,
    list_competitors,
    no_progress,
    resolve_scenario,
)

DEFINITIONS = {
    "rest, driving": (
        f"the robot is at rest, or drives at {loop_experiment.SPEED_M_S:g} m/s and weaves by "
        f"{loop_experiment.WEAVE_M_S:g} m/s forward and sideways"
    ),
    "forward, sideways": "direction of step and disturbance, in the body frame",
    "step": (
        "the reference's poses step without notice, its velocities do not; the response is half "
        "the difference of two robots with opposite steps under the same noise; it does not exist "
        "for a controller that reads the reference before the step only"
    ),
    "rise_time_s": "time from 10 % to 90 % of the step",
    "overshoot": "largest excess over the step, fraction of the step",
    "settling_5_mm_s, settling_2_percent_s": (
        "time after which the error stays within 5 mm, or within 2 % of the step"
    ),
    "steady_state_error_m": "mean error in the last half second of three",
    "gain": (
        "L = -u / (u + d) by Fourier transform: u is the team's command, d a disturbance that is "
        "added to it before the radio and unknown to the team; both are half the difference of two "
        "robots with opposite disturbances"
    ),
    "crossover_rad_s": "lowest frequency at which abs(L) falls below one",
    "phase_deg": "phase margin: smallest 180 degrees + phase of L at a crossover",
    "delay_s": "delay margin: smallest phase margin over frequency at a crossover",
    "gain_margin": "smallest 1 / abs(L) where the phase is -180 degrees and abs(L) < 1",
    "sensitivity": "Ms, largest abs(1 / (1 + L)) in the measured range of frequencies",
}
# Heading, factor and decimal places of each field of `StepMetrics` and `StabilityMargins`
STEP_COLUMNS = (
    ("rise, ms", 1e3, 0),
    ("overshoot, %", 1e2, 0),
    ("to 5 mm, s", 1, 2),
    ("to 2 %, s", 1, 2),
    ("steady, mm", 1e3, 1),
)
MARGIN_COLUMNS = (
    ("crossover, rad/s", 1, 1),
    ("phase, °", 1, 0),
    ("delay, ms", 1e3, 0),
    ("gain", 1, 2),
    ("Ms", 1, 2),
)


class LoopMeasurement(NamedTuple):
    """Loop gain, step response and metrics of one controller in one case.

    Attributes:
        gains: L at `FREQUENCIES`, complex, (harmonics,).
        step_response: Displacement since the step, (frames,) m.
        step_metrics: Metrics of the step response.
        margins: Stability margins.
    """

    gains: Gains
    step_response: Array
    step_metrics: StepMetrics
    margins: StabilityMargins

    def report(self) -> dict[str, Any]:
        """Return plain values for JSON; None for a value that does not exist."""
        return {
            "rms_m_s": loop_experiment.RMS_M_S,
            "step_m": STEP_M,
            "step": finite_or_none(self.step_metrics._asdict()),
            "margins": finite_or_none(self.margins._asdict()),
            "gain": finite_or_none(np.abs(self.gains)),
            "phase_deg": finite_or_none(np.degrees(np.angle(self.gains))),
        }


@dataclass
class LoopResult(Result):
    """Result of the loop study. Its rows hold case and sign.

    Attributes:
        loops: Case -> controller -> measurement; empty if the study was stopped.
    """

    loops: Mapping[str, Mapping[str, LoopMeasurement]] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """Robot and plant, for the titles of tables and figure."""
        scenario = self.outcomes[0].scenario
        return f"{scenario.robot} on the {scenario.plant} plant"

    def summary(self) -> dict[str, Any]:
        """Return the summary of any result, with the loops as `loop`."""
        cases = {
            case: {label: loop.report() for label, loop in loops.items()}
            for case, loops in self.loops.items()
        }
        report = {
            "definitions": DEFINITIONS,
            "frequencies_rad_s": FREQUENCIES.round(6).tolist(),
            "cases": cases,
        }
        return super().summary() | {"loop": report if cases else None}

    def table(self) -> str:
        """Return metrics and margins as lines of text; empty if the study was stopped."""
        if not self.loops:
            return ""
        step_title = f"response to a step of {100 * STEP_M:g} cm: {self.title}"
        steps = self._format_metrics(step_title, "step_metrics", STEP_COLUMNS)
        margin_title = f"stability margins: {self.title}"
        margins = self._format_metrics(margin_title, "margins", MARGIN_COLUMNS)
        remarks = "\n".join(
            f"note: {label} did not respond to the step; it must read self.reference in command()"
            for label, loop in next(iter(self.loops.values())).items()
            if np.isnan(loop.step_response).all() and np.isfinite(loop.gains).all()
        )
        return "\n\n".join(filter(None, [steps, margins, remarks]))

    def _format_metrics(
        self, title: str, field_name: str, columns: Sequence[tuple[str, float, int]]
    ) -> str:
        """Return the table of a field of `LoopMeasurement`.

        Args:
            title: Title of the table.
            field_name: "step_metrics" or "margins".
            columns: Heading, factor and decimal places of each metric.
        """
        rows = []
        for case, loops in self.loops.items():
            for i, (label, loop) in enumerate(loops.items()):
                values = finite_or_none(getattr(loop, field_name))
                formatted = [
                    format_number(value, factor, digits)
                    for value, (_, factor, digits) in zip(values, columns, strict=True)
                ]
                rows.append(["" if i else case, label, *formatted])
        headings = ["", "", *(heading for heading, _, _ in columns)]
        return format_table(Table(title, headings, rows, 2))


@check_types
def measure_loop(
    scenario: Scenario | str = "rect",
    controllers: Sequence[ControllerSpec] | None = None,
    *,
    start_progress: StartProgress = no_progress,
) -> LoopResult:
    """Measure step responses and stability margins of control loops.

    Args:
        scenario: Scenario, or its name, with robot, plant, seeds and settings; its reference is
            ignored.
        controllers: Names, `file.py:Class`, or classes derived from `Controller`. Default: all
            built-in controllers that do not know the true state.
        start_progress: Called with a title and the number of frames. It returns a function that is
            called with each frame's number and may raise `StoppedError`.

    Raises:
        OmniError: The scenario or a controller does not exist.
    """
    scenario = resolve_scenario(
        scenario, list_competitors() if controllers is None else controllers
    )
    distributions.require_fixed_settings(scenario.distributions, "loop")
    scenario = scenario.replace(
        name="loop", description="step responses and margins", paper_table=0
    )
    experiment = LoopExperiment(scenario)
    outcome = experiment.run(start_progress("loop", loop_experiment.TOTAL_FRAMES))
    loops = {} if outcome.entry["reason"] else _evaluate(experiment, scenario.labels)
    return LoopResult(**vars(build_result(outcome)), loops=loops)


def _evaluate(
    experiment: LoopExperiment, labels: Sequence[str]
) -> dict[str, dict[str, LoopMeasurement]]:
    """Return case -> controller -> measurement of an experiment that ran to its end."""
    position, command, disturbance = experiment.paired_responses()
    start = loop_experiment.WARM_UP_FRAMES
    after_step = slice(start, start + loop_experiment.STEP_FRAMES)
    measured = slice(-loop_experiment.MEASURED_FRAMES, None)
    is_responding = np.abs(command[after_step]).max(axis=(0, 3)) > 0
    displacement = (position[after_step] - position[start]).mean(3)

    def evaluate_loop(i: int, j: int) -> LoopMeasurement:
        gains = estimate_loop_gain(command[measured, i, j], disturbance[measured, i, j])
        response = np.where(is_responding[i, j], displacement[:, i, j], np.nan)
        metrics = compute_step_metrics(response, STEP_M)
        return LoopMeasurement(gains, response, metrics, compute_margins(gains))

    return {
        case: {label: evaluate_loop(i, j) for i, label in enumerate(labels)}
        for j, case in enumerate(CASES)
    }
