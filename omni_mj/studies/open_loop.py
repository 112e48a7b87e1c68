"""Runs without a controller: robots are sent twists, and nothing is tracked."""

import time
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config import PERIOD_S
from omni_mj.config.scenario import Scenario
from omni_mj.config.settings import Settings
from omni_mj.results import summary
from omni_mj.results.result import Outcome
from omni_mj.simulation.simulation import Simulation
from omni_mj.studies.run_scenario import AfterFrame, StoppedError


def resting_reference(frames: int) -> dict[str, Any]:
    """Return the settings of a reference that stays at its start for at least `frames` frames."""
    return {
        "shape": "waypoints",
        "waypoints": [[0, 0], [0, 0]],
        "mode": "timed",
        "initial_rest_s": 0.0,
        "settle_s": frames * PERIOD_S,
    }


def open_loop_settings(settings: Settings, frames: int, **sections: Any) -> Settings:
    """Return settings for robots that are commanded without a controller.

    Each robot has a world of its own, no dead time and no faults.

    Args:
        settings: All other settings.
        frames: Least duration of the run, frames.
        **sections: Values of other sections, by section and field.
    """
    return settings.replace(
        reference=resting_reference(frames),
        radio={"kind": "fixed", "delay_frames": 0, "jitter_frames": 0},
        world={"start_poses": [[0, 0, 0]]},
        fault=(),
        **sections,
    )


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
        return str(error)
    return None


def open_loop_outcome(
    scenario: Scenario,
    simulation: Simulation,
    start_time: float,
    stopped: str | None,
    row_metrics: Mapping[str, np.ndarray],
) -> Outcome:
    """Return the outcome of robots that were commanded without a controller.

    Its entry has no tracking errors, because there was nothing to track.

    Args:
        scenario: The requested scenario.
        simulation: The simulation that was run.
        start_time: Start of the study by `time.perf_counter`, s.
        stopped: Reason why it ended early, or None.
        row_metrics: Columns of numbers, one value per row.
    """
    log, failures = simulation.log, list(simulation.failures)
    wall_s = time.perf_counter() - start_time
    entry = summary.scenario_entry(
        scenario, log, failures, {}, wall_s, stopped, simulation.drawn_parameters
    )
    return Outcome(scenario, entry, simulation.rows, failures, row_metrics)
