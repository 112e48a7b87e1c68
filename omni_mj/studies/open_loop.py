"""Runs without a controller: robots are sent twists, and nothing is tracked."""

import time
from collections.abc import Iterable
from typing import Any

from omni_control.controllers.base import Controller
from omni_control.kinematics import Array
from omni_mj.config import PERIOD_S
from omni_mj.config.rows import build_single_robot_rows
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


def build_open_loop(scenario: Scenario, runs: Iterable[tuple[int, Settings]]) -> Simulation:
    """Return a simulation of robots without controllers, from seed and settings of each."""
    labeled_runs = [(Controller.__name__, *run) for run in runs]
    rows = build_single_robot_rows(labeled_runs, scenario.robot)
    return Simulation(scenario, [Controller], rows=rows)


def run_open_loop(
    scenario: Scenario, simulation: Simulation, twists: Iterable[Array], after_frame: AfterFrame
) -> Outcome:
    """Send twists to the robots in place of their controllers.

    Args:
        scenario: The scenario to report.
        simulation: At its start.
        twists: Twists (n, 3) of each frame.
        after_frame: Called with each frame's number; it may raise `StoppedError`.

    Returns:
        The outcome, without tracking errors: there was nothing to track.
    """
    start_time, stopped = time.perf_counter(), None
    try:
        for frame, twist in enumerate(twists):
            simulation.step(twist)
            after_frame(frame)
    except StoppedError as error:
        stopped = str(error)
    log, failures = simulation.log, simulation.failures
    wall_s = time.perf_counter() - start_time
    entry = summary.scenario_entry(
        scenario, log, failures, {}, wall_s, stopped, simulation.drawn_parameters
    )
    return Outcome(scenario, entry, simulation.rows, failures)
