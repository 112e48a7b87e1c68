"""The loop: camera, filter, tracker, limits, radio, plant, record; 60 times a simulated second.

All robots run side by side as rows of arrays: first every seed of the first controller, then of the next.
"""

from collections.abc import Callable

import numpy as np

from omni_control.filter import PoseFilter
from omni_control.reference import IteratedReference, MotionLimits, Reference, TimedReference
from omni_control.tracker import TRACKERS, Tracker, TrackerSettings
from omni_mj.camera import Camera
from omni_mj.limits import CommandLimits
from omni_mj.plants import Plant
from omni_mj.plants.kinematic import KinematicPlant
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.radio import Radio
from omni_mj.scenario import Scenario
from omni_mj.settings import FRAME_RATE_HZ, PERIOD_S, ReferenceSettings
from omni_mj.trajectory import Trajectory

PLANTS: dict[str, type[Plant]] = {"mujoco": MujocoPlant, "kinematic": KinematicPlant}


class Simulation:
    """A scenario, ready to run.

    Attributes:
        scenario: what is run.
        reference: the timed reference, against which errors are measured.
        trajectory: what has been recorded so far.
    """

    def __init__(self, scenario: Scenario) -> None:
        settings, seeds = scenario.settings, scenario.seed_list
        self.scenario = scenario
        self.reference = timed_reference(settings.reference)
        n, frames = len(scenario.controllers) * len(seeds), self.reference.frames
        row_seeds = seeds * len(scenario.controllers)
        start = np.repeat(self.reference.poses[:1], n, axis=0)

        self.plant: Plant = PLANTS[scenario.plant]([settings] * n, start, row_seeds, frames)  # type: ignore[call-arg]
        self.camera = Camera(settings.vision, row_seeds, frames)
        self.filter = PoseFilter(start, PERIOD_S, settings.vision.filter_smoothing)
        self.trackers = [
            (_tracker(name, scenario, self.reference), slice(i * len(seeds), (i + 1) * len(seeds)))
            for i, name in enumerate(scenario.controllers)
        ]
        self.limits = CommandLimits(settings.control, n)
        self.radio = Radio(n, settings.radio.delay_frames)
        self.trajectory = Trajectory(scenario.controllers, seeds, frames)

    def run(self, after_frame: Callable[[int], None] = lambda frame: None) -> None:
        """Run to the end; `after_frame` is called with each frame's number once it is in the trajectory.

        Raises:
            SimulationError: the physics became unstable; the trajectory keeps what came before.
        """
        command = np.zeros((self.trajectory.n, 3))
        for frame in range(self.reference.frames):
            pose = self.plant.pose()
            measured, seen = self.camera(frame, pose)
            estimate = self.filter.update(measured, seen)
            wanted = np.concatenate([t.command(frame, estimate[rows], command[rows]) for t, rows in self.trackers])
            command = self.limits(wanted)
            applied, heading = self.radio.exchange(command, estimate[:, 2])

            self.trajectory.write(
                frame,
                ref=self.reference.at(frame, pose)[0],
                pose=pose,
                vision=measured,
                vision_valid=seen,
                predicted=np.concatenate([t.predicted for t, _ in self.trackers]),
                command=command,
                applied=applied,
                alpha_hat=np.concatenate([t.alpha_hat for t, _ in self.trackers]),
                **vars(self.plant.telemetry()),
            )
            after_frame(frame)
            self.plant.advance(frame, applied, heading)


def timed_reference(settings: ReferenceSettings) -> TimedReference:
    """The reference that a scenario's settings ask for."""
    return TimedReference(
        _visits(settings),
        _motion_limits(settings),
        PERIOD_S,
        round(settings.dwell_s * FRAME_RATE_HZ),
        round(settings.settle_s * FRAME_RATE_HZ),
    )


def _visits(settings: ReferenceSettings) -> list[list[float]]:
    return settings.waypoints[:1] + settings.waypoints[1:] * settings.laps


def _motion_limits(s: ReferenceSettings) -> MotionLimits:
    return MotionLimits(s.max_speed_m_s, s.max_acceleration_m_s2, s.max_turn_rate_rad_s, s.max_turn_acceleration_rad_s2)


def _tracker(name: str, scenario: Scenario, timed: TimedReference) -> Tracker:
    settings, n = scenario.settings, scenario.seeds
    reference: Reference = timed
    if settings.reference.mode == "iterated":
        reference = IteratedReference(_visits(settings.reference), _motion_limits(settings.reference), PERIOD_S, n)
    control = settings.control
    known = TrackerSettings(
        PERIOD_S,
        settings.radio.delay_frames,
        control.error_range_m,
        control.speed_range_m_s,
        control.heading_gain,
        control.alpha_window_frames,
    )
    return TRACKERS[name](known, reference, n)
