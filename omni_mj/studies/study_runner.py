"""What all studies are made of: a simulation that is run, and the outcome of it."""

import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from omni_control.controllers import list_available_controllers
from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config.plugins import find_controller, label
from omni_mj.config.scenario import Scenario
from omni_mj.config.settings import PERIOD_S, Settings
from omni_mj.results import metrics, summary
from omni_mj.results.result import Outcome
from omni_mj.simulation.simulation import Simulation

AfterFrame = Callable[[int], None]
StartProgress = Callable[[str, int], AfterFrame]  # given a title and the number of frames to come
# Of a robot-frame in the log, with what is made of it to measure, and its reference
FRAME_BYTES = 1200


class StoppedError(Exception):
    """Raised by a callback between two frames: the study shall end here and keep what it has.

    Attributes:
        reason: in a word.
    """

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(reason)


def ignore_frame(_: object) -> None:
    """What is called after a frame where nobody wants to know."""


def no_progress(title: str, frames: int) -> AfterFrame:
    """Return what to call after each frame where nobody wants to know."""
    return ignore_frame


def check_memory(robots: int, frames: int) -> None:
    """Raise OmniError if so many robots at once take more memory than this computer has free, as far as it says."""
    try:
        free_b = 1024 * int(Path("/proc/meminfo").read_text().split("MemAvailable:")[1].split()[0])
    except (OSError, IndexError):
        return
    if robots * frames * FRAME_BYTES > free_b:
        raise OmniError(
            f"{robots} robots at once for {frames} frames take about {robots * frames * FRAME_BYTES / 1e9:.2g} GB of"
            f" memory, and {free_b / 1e9:.2g} GB are free; run fewer at a time, or something shorter"
        )


def resting_reference(frames: int) -> dict[str, Any]:
    """Return the settings of a reference that rests, for so many frames at least."""
    return {
        "shape": "waypoints",
        "waypoints": [[0, 0], [0, 0]],
        "mode": "timed",
        "settle_s": frames * PERIOD_S,
    }


def open_loop_settings(settings: Settings, frames: int, **sections: Any) -> Settings:
    """Settings for robots that are commanded from outside, each alone, without dead time and faults.

    Args:
        settings: all else.
        frames: for how many the reference, which rests, lasts at least.
        sections: further values, by section and field.
    """
    return settings.replace(
        reference={**resting_reference(frames), **sections.pop("reference", {})},
        radio={"delay_frames": 0, "jitter_frames": 0},
        world={"start_poses": [[0, 0, 0]]},
        fault=(),
        **sections,
    )


def run_simulation(simulation: Simulation, after_frame: AfterFrame = ignore_frame) -> Outcome:
    """Run a simulation and measure what came of it.

    Args:
        simulation: at its start.
        after_frame: called with each frame's number; it may raise `StoppedError`.

    Returns:
        The outcome with its log; of a run that was stopped, up to there.
    """
    started, stopped = time.perf_counter(), None
    try:
        simulation.run(after_frame)
    except StoppedError as error:
        stopped = error.reason
    log, drawn = simulation.log, simulation.drawn
    failures = sorted(
        simulation.failures, key=lambda failure: (failure.time_s, failure.row)
    )  # whatever the batch
    measured = metrics.row_metrics(log, failures)
    wall_s = time.perf_counter() - started
    entry = summary.entry(simulation.scenario, log, failures, measured, wall_s, stopped, drawn)
    return Outcome(simulation.scenario, entry, log.rows, failures, measured, log, drawn)


def send_twists(
    simulation: Simulation, twists: Iterable[Array], after_frame: AfterFrame
) -> str | None:
    """Send robots twists (n, 3) frame by frame, in place of controllers; return why that was stopped, or None."""
    try:
        for frame, twist in enumerate(twists):
            simulation.step(twist)
            after_frame(frame)
    except StoppedError as error:
        return error.reason
    return None


def open_loop_outcome(
    scenario: Scenario,
    simulation: Simulation,
    started: float,
    stopped: str | None,
    measured: Mapping[str, np.ndarray],
) -> Outcome:
    """Return the outcome of robots that were commanded from outside, whose errors mean nothing.

    Args:
        scenario: That was asked for.
        simulation: That was run.
        started: When, by `time.perf_counter`.
        stopped: Why it ended before its time, or None.
        measured: Numbers of each row.
    """
    log, failures, wall_s = simulation.log, list(simulation.failures), time.perf_counter() - started
    entry = summary.entry(scenario, log, failures, {}, wall_s, stopped, simulation.drawn)
    return Outcome(scenario, entry, simulation.rows, failures, measured)


def count_frames(simulation: Simulation) -> int:
    """How many frames a simulation has from start to end."""
    return max(reference.frames for reference in simulation.references)


def list_informed(scenario: Scenario) -> list[str]:
    """Labels of the controllers that are given the truth: no competitors."""
    return [label(kind) for kind in scenario.controllers if find_controller(kind).knows_truth]


def list_competitors() -> tuple[str, ...]:
    """Return the controllers that come with the package, but for those that are given the truth."""
    return tuple(
        name for name in list_available_controllers() if not find_controller(name).knows_truth
    )
