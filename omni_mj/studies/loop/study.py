"""The study: step responses and margins of controllers on a plant; see the package."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from omni_control.controllers.base import Controller
from omni_control.errors import OmniError, choose
from omni_control.registry import available
from omni_mj.measure import summary
from omni_mj.measure.result import Outcome, Result
from omni_mj.scenarios import distributions
from omni_mj.scenarios.classes import find_controller
from omni_mj.scenarios.scenario import Scenario, load
from omni_mj.studies.loop.drive import STEP_M, STRENGTHS, Drive
from omni_mj.studies.loop.findings import Findings
from omni_mj.studies.loop.motion import CASES
from omni_mj.studies.outcome import AfterFrame, StoppedError, informed, nothing


@dataclass
class LoopResult(Result):
    """The result of the study; its rows hold case, strength and sign.

    Attributes:
        findings: what was found; None of a study that was stopped.
    """

    findings: Findings | None = None

    def summary(self) -> dict[str, Any]:
        """That of any result, with the findings as `loop`."""
        return super().summary() | {"loop": self.findings.report() if self.findings else None}

    def table(self) -> str:
        """What was found, as lines of text."""
        return self.findings.text() if self.findings else ""


def loop(
    scenario: Scenario | str = "rect",
    controllers: Sequence[str | type[Controller]] | None = None,
    cases: Sequence[str] | None = None,
    *,
    after_frame: AfterFrame = nothing,
) -> LoopResult:
    """Measure how loops answer a step, and how far they are from the edge of stability.

    Args:
        scenario: robot, plant, seeds and all settings, or its name; its reference is left out.
        controllers: names, `file.py:Class`, or classes derived from `Controller`. [those that come with the package,
            but for what is told the truth]
        cases: names of those of `CASES` that are measured. [all]
        after_frame: called with each frame's number of `drive.FRAMES`; it may raise `StoppedError`.

    Raises:
        OmniError: there is no such scenario, controller or case.
    """
    started = time.perf_counter()
    chosen = load(scenario) if isinstance(scenario, str) else scenario
    distributions.refuse(chosen.distributions, "loop")
    kinds = tuple(usual() if controllers is None else controllers)
    chosen = chosen.replace(name="loop", description="step responses and margins", paper_table=0, controllers=kinds)
    names = tuple(CASES if cases is None else cases)
    for name in names:
        if name not in CASES:
            raise OmniError(f"unknown case {name!r}; {choose(name, CASES)}")
    drive = Drive(chosen, {name: CASES[name] for name in names})
    result = LoopResult([Outcome.not_run(chosen)], chosen.labels, informed(chosen), chosen.seed_list)
    try:
        drive.run(after_frame)
    except StoppedError as error:
        result.stopped = error.reason
    result.wall_s = time.perf_counter() - started
    result.complete = result.stopped is None
    if result.complete:
        step = f"steps of {100 * STEP_M * STRENGTHS[-1]:g} cm, then crossover and margins"
        title = f"loops of {chosen.robot} on the {chosen.plant} plant: {step}"
        result.findings = Findings.of(title, drive, chosen.labels, names)
    simulation = drive.simulation
    entry = summary.entry(
        chosen, simulation.log, simulation.failures, {}, result.wall_s, result.stopped, drawn=simulation.drawn
    )
    result.outcomes = [Outcome(chosen, entry, simulation.rows, simulation.failures, drive.asked)]
    return result


def usual() -> tuple[str, ...]:
    """The controllers that are measured unless others are named."""
    return tuple(name for name in available() if not find_controller(name).knows_truth)
