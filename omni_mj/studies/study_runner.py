"""Shared parts of the studies: callbacks, memory check, settings, and the run of a simulation."""

import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from omni_control.controllers.registry import list_available_controllers
from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config.plugins import find_controller, label_controller
from omni_mj.config.scenario import Scenario
from omni_mj.config.settings import PERIOD_S, Settings
from omni_mj.results import metrics, summary
from omni_mj.results.result import Outcome
from omni_mj.simulation.simulation import Simulation

AfterFrame = Callable[[int], None]  # called with the number of each frame
StartProgress = Callable[[str, int], AfterFrame]  # called with a title and the number of frames
# Memory per robot and frame: log, reference, and temporary arrays of the metrics
FRAME_BYTES = 1200


class StoppedError(Exception):
    """Raised by a callback between two frames to end a study; results so far are kept.

    Attributes:
        reason: Reason in one word, such as "interrupted".
    """

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(reason)


def ignore_frame(_: object) -> None:
    """Do nothing after a frame."""


def no_progress(title: str, frames: int) -> AfterFrame:
    """Return `ignore_frame`, for studies whose progress is not shown."""
    return ignore_frame


def check_memory(robots: int, frames: int) -> None:
    """Raise OmniError if robots that are simulated together need more memory than is free.

    Without `/proc/meminfo` nothing is checked.
    """
    try:
        free_b = 1024 * int(Path("/proc/meminfo").read_text().split("MemAvailable:")[1].split()[0])
    except (OSError, IndexError):
        return
    needed_b = robots * frames * FRAME_BYTES
    if needed_b > free_b:
        raise OmniError(
            f"{robots} robots at once for {frames} frames take about {needed_b / 1e9:.2g} GB of "
            f"memory, and {free_b / 1e9:.2g} GB are free; "
            "run fewer at a time, or a shorter scenario"
        )


def resting_reference(frames: int) -> dict[str, Any]:
    """Return the settings of a reference that stays at its start for at least `frames` frames."""
    return {
        "shape": "waypoints",
        "waypoints": [[0, 0], [0, 0]],
        "mode": "timed",
        "settle_s": frames * PERIOD_S,
    }


def open_loop_settings(settings: Settings, frames: int, **sections: Any) -> Settings:
    """Return settings for robots that are commanded without a controller.

    Each robot has a world of its own, no dead time and no faults.

    Args:
        settings: All other settings.
        frames: Least duration of the run, frames.
        **sections: Further values, by section and field.
    """
    return settings.replace(
        reference={**resting_reference(frames), **sections.pop("reference", {})},
        radio={"delay_frames": 0, "jitter_frames": 0},
        world={"start_poses": [[0, 0, 0]]},
        fault=(),
        **sections,
    )


def run_simulation(simulation: Simulation, after_frame: AfterFrame = ignore_frame) -> Outcome:
    """Run a simulation and compute the metrics of its rows.

    Args:
        simulation: At its start.
        after_frame: Called with each frame's number; it may raise `StoppedError`.

    Returns:
        The outcome with its log, up to the last frame if the run was stopped.
    """
    start_time, stopped = time.perf_counter(), None
    try:
        simulation.run(after_frame)
    except StoppedError as error:
        stopped = error.reason
    log, drawn = simulation.log, simulation.drawn_parameters
    # Their order must not depend on how rows were split into batches.
    failures = sorted(simulation.failures, key=lambda failure: (failure.time_s, failure.row))
    measured = metrics.row_metrics(log, failures)
    wall_s = time.perf_counter() - start_time
    entry = summary.scenario_entry(
        simulation.scenario, log, failures, measured, wall_s, stopped, drawn
    )
    return Outcome(simulation.scenario, entry, log.rows, failures, measured, log, drawn)


def send_twists(
    simulation: Simulation, twists: Iterable[Array], after_frame: AfterFrame
) -> str | None:
    """Send twists to the robots in place of their controllers.

    Args:
        simulation: At its start.
        twists: Twists (n, 3) of each frame.
        after_frame: Called with each frame's number; it may raise `StoppedError`.

    Returns:
        The reason if the run was stopped, else None.
    """
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
    start_time: float,
    stopped: str | None,
    measured: Mapping[str, np.ndarray],
) -> Outcome:
    """Return the outcome of robots that were commanded without a controller.

    Its entry has no tracking errors, because there was nothing to track.

    Args:
        scenario: The requested scenario.
        simulation: The simulation that was run.
        start_time: Start of the study by `time.perf_counter`, s.
        stopped: Reason why it ended early, or None.
        measured: Columns of numbers, one value per row.
    """
    log, failures = simulation.log, list(simulation.failures)
    wall_s = time.perf_counter() - start_time
    entry = summary.scenario_entry(
        scenario, log, failures, {}, wall_s, stopped, simulation.drawn_parameters
    )
    return Outcome(scenario, entry, simulation.rows, failures, measured)


def count_frames(simulation: Simulation) -> int:
    """Return the number of frames of a simulation from start to end."""
    return max(reference.frames for reference in simulation.references)


def list_privileged(scenario: Scenario) -> list[str]:
    """Return the labels of the scenario's controllers that know the true state."""
    return [
        label_controller(kind) for kind in scenario.controllers if find_controller(kind).knows_truth
    ]


def list_competitors() -> tuple[str, ...]:
    """Return the package's controllers except those that know the true state."""
    return tuple(
        name for name in list_available_controllers() if not find_controller(name).knows_truth
    )
