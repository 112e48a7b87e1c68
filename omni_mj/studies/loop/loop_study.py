"""The loop as a control engineer looks at it: its step response and its margins, measured on the plant.

`drive` is what robots do meanwhile, `response` what is read from the record.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from omni_control.controllers.base import Controller
from omni_control.kinematics import Array
from omni_mj.config import distributions
from omni_mj.config.scenario import Scenario
from omni_mj.results.result import Result
from omni_mj.results.result_tables import Table, format_number
from omni_mj.results.result_tables import format_table as aligned
from omni_mj.results.statistics import finite_or_none
from omni_mj.studies.loop import loop_experiment as drives
from omni_mj.studies.loop.loop_experiment import CASES, FREQUENCIES, STEP_M, LoopExperiment
from omni_mj.studies.loop.stability_margins import (
    Gains,
    Margins,
    StepFigures,
    find_margins,
    loop_gain,
    measure_step,
)
from omni_mj.studies.run_scenario import resolve_scenario
from omni_mj.studies.study_runner import (
    StartProgress,
    list_competitors,
    list_informed,
    no_progress,
    open_loop_outcome,
)

DEFINITIONS = {
    "rest, driving": f"the robot stands; or drives at {drives.SPEED_M_S:g} m/s, weaving by {drives.WEAVE_M_S:g} m/s"
    " forward and left",
    "forward, sideways, along, across": "the direction in which it is stepped and disturbed; it looks and drives ahead",
    "step": "the reference's poses jump, unannounced, its velocities do not; the answer is what robots do besides the"
    " same drive without a jump, by half the difference of two that jump to opposite sides under the same noise",
    "rise": "time from a tenth to nine tenths of the step",
    "overshoot": "largest way beyond the step, share of it",
    "within_5_mm, within_2_percent": "time from which on the error stays as small, s",
    "left": "error in the last half second of three, m",
    "gain": "L = -u / (u + d) by Fourier transform: u what the team commands, d what is added on the way to the radio,"
    " unknown to the team; likewise by half the difference of two rows",
    "crossover": "lowest frequency at which abs(L) falls through one, rad/s",
    "phase": "180 degrees + phase of L there, the least",
    "delay": "phase margin over frequency, the least: what the dead time may be longer, s",
    "gain_margin": "1 / abs(L) where the phase is -180 degrees and abs(L) < 1, the least",
    "sensitivity": "Ms, largest abs(1 / (1 + L)) from the lowest frequency measured to the highest",
}
# Of the figures of `StepFigures` and `Margins`: heading, factor, digits.
COLUMNS = (
    ("rise, ms", 1e3, 0), ("overshoot, %", 1e2, 0), ("5 mm, s", 1, 2), ("2 %, s", 1, 2), ("left, mm", 1e3, 1),
    ("w, rad/s", 1, 1), ("phase, °", 1, 0), ("delay, ms", 1e3, 0), ("gain", 1, 2), ("Ms", 1, 2),
)  # fmt: skip


class LoopMeasurement(NamedTuple):
    """One controller in one case.

    Attributes:
        gains: L at `FREQUENCIES`, complex, (tones,).
        moved: Answer to the step, (frames,) m.
        step: Figures of that.
        margins: Of the loop.
    """

    gains: Gains
    moved: Array
    step: StepFigures
    margins: Margins

    def report(self) -> dict[str, Any]:
        """Return all in plain values, None for what there is none of."""
        figures = {"step": self.step._asdict(), "margins": self.margins._asdict()}
        report = {
            name: {key: finite_or_none(value) for key, value in each.items()}
            for name, each in figures.items()
        }
        values = {"gain": np.abs(self.gains), "phase_deg": np.degrees(np.angle(self.gains))}
        lists = {name: [finite_or_none(value) for value in each] for name, each in values.items()}
        return {"rms_m_s": drives.RMS_M_S, "step_m": STEP_M, **report, **lists}


@dataclass
class LoopResult(Result):
    """The result of the study; its rows hold case and sign.

    Attributes:
        loops: What was found, by case and controller; nothing of a study that was stopped.
    """

    loops: Mapping[str, Mapping[str, LoopMeasurement]] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """What was measured."""
        chosen, step = self.outcomes[0].scenario, f"steps of {100 * STEP_M:g} cm"
        return f"loops of {chosen.robot} on the {chosen.plant} plant: {step}, then crossover and margins"

    def summary(self) -> dict[str, Any]:
        """Return that of any result, with the loops as `loop`."""
        cases = {
            case: {label: one.report() for label, one in loops.items()}
            for case, loops in self.loops.items()
        }
        report = {
            "definitions": DEFINITIONS,
            "frequencies_rad_s": FREQUENCIES.round(6).tolist(),
            "cases": cases,
        }
        return super().summary() | {"loop": report if cases else None}

    def table(self) -> str:
        """Return the figures as lines of text."""
        rows = []
        for case, loops in self.loops.items():
            for i, (label, one) in enumerate(loops.items()):
                figures = (*one.step, *one.margins)
                cells = [
                    format_number(finite_or_none(value), factor, n)
                    for value, (_, factor, n) in zip(figures, COLUMNS, strict=True)
                ]
                rows.append(["" if i else case, label, *cells])
        return (
            aligned(Table(self.title, ["", "", *(heading for heading, _, _ in COLUMNS)], rows, 2))
            if rows
            else ""
        )


def measure_loop(
    scenario: Scenario | str = "rect",
    controllers: Sequence[str | type[Controller]] | None = None,
    *,
    start_progress: StartProgress = no_progress,
) -> LoopResult:
    """Measure how loops answer a step, and how far they are from the edge of stability.

    Args:
        scenario: Robot, plant, seeds and all settings, or its name; its reference is left out.
        controllers: Names, `file.py:Class`, or classes derived from `Controller`. [those that come
            with the package, but for what is told the truth]
        start_progress: Called with a title and the number of frames to come; what it returns is called after
            each frame, and may raise `StoppedError`.

    Raises:
        OmniError: There is no such scenario or controller.
    """
    started = time.perf_counter()
    given = resolve_scenario(scenario, list_competitors() if controllers is None else controllers)
    distributions.refuse(given.distributions, "loop")
    given = given.replace(name="loop", description="step responses and margins", paper_table=0)
    drive = LoopExperiment(given)
    stopped = drive.run(start_progress("loop", drives.FRAMES))
    return LoopResult(
        [open_loop_outcome(given, drive.simulation, started, stopped, drive.asked)],
        given.labels,
        list_informed(given),
        given.seed_list,
        wall_s=time.perf_counter() - started,
        stopped=stopped,
        complete=not stopped,
        loops={} if stopped else _find_loops(drive, given.labels),
    )


def _find_loops(
    drive: LoopExperiment, labels: Sequence[str]
) -> dict[str, dict[str, LoopMeasurement]]:
    """Return the loops of a drive that has come to its end."""
    position, command, disturbance = drive.answers()
    wanted, added = command[-drives.MEASURED :], disturbance[-drives.MEASURED :]
    moved = position[drives.WARM_UP :][: drives.STEP]
    moved = (moved - moved[0]).mean(3)

    def find_loop(i: int, j: int) -> LoopMeasurement:
        gains = loop_gain(wanted[:, i, j], added[:, i, j])
        return LoopMeasurement(
            gains, moved[:, i, j], measure_step(moved[:, i, j], STEP_M), find_margins(gains)
        )

    return {
        case: {label: find_loop(i, j) for i, label in enumerate(labels)}
        for j, case in enumerate(CASES)
    }
