"""The loop: camera, filter, tracker, limits, radio, plant, record; 60 times a simulated second.

All robots run side by side as rows of arrays: first every seed of the first controller, then of the next.
"""

import math
from collections.abc import Callable

import numpy as np

from omni_control.controllers.base import Controller, Seen, Told
from omni_control.delay import CommandsInFlight
from omni_control.estimation.kalman import KalmanFilter
from omni_control.limits import CommandLimits
from omni_control.reference.timed import Reference
from omni_mj.link.camera import Camera
from omni_mj.link.radio import Radio
from omni_mj.plants import Plant
from omni_mj.scenarios import controllers
from omni_mj.scenarios.plants import find_plant
from omni_mj.scenarios.references import iterated_reference, timed_reference
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.simulate.log import Trajectory


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

        self.plant: Plant = find_plant(scenario.plant)([settings] * n, start, row_seeds, frames)
        self.camera = Camera(settings.vision, row_seeds, frames)
        self.told = _told(scenario)
        self.filter = KalmanFilter(start, PERIOD_S, self.told.vision_noise)
        self.sent = CommandsInFlight(n, math.ceil(self.told.latency_frames) + 1)
        self.trackers = [
            (self._tracker(name), slice(i * len(seeds), (i + 1) * len(seeds)))
            for i, name in enumerate(scenario.controllers)
        ]
        self.limits = CommandLimits(settings.control, n)
        self.radio = Radio(settings.radio, row_seeds, frames)
        self.trajectory = Trajectory(scenario.labels, seeds, frames)

    def run(self, after_frame: Callable[[int], None] = lambda frame: None) -> None:
        """Run to the end; `after_frame` is called with each frame's number once it is in the trajectory.

        Raises:
            SimulationError: the physics became unstable; the trajectory keeps what came before.
            ControllerError: a user's controller failed; likewise.
        """
        command = np.zeros((self.trajectory.n, 3))
        for frame in range(self.reference.frames):
            pose = self.plant.pose()
            measured, seen = self.camera(frame, pose)
            self.sent.push(command)
            estimate = self.filter.update(measured, self.sent.felt(self.told.latency_frames) * PERIOD_S)
            filtered = Seen(estimate, self.filter.twist, measured)
            true = Seen(pose, self.plant.twist(), pose)  # for an oracle
            wanted = [
                controllers.command(tracker, frame, true if tracker.knows_truth else filtered, command, rows)
                for tracker, rows in self.trackers
            ]
            command = self.limits(np.concatenate(wanted))
            received = self.radio.exchange(frame, command, estimate[:, 2])

            self.trajectory.write(
                frame,
                ref=self.reference.at(frame, pose)[0],
                pose=pose,
                vision=measured,
                vision_valid=seen,
                predicted=np.concatenate([t.predicted for t, _ in self.trackers]),
                command=command,
                applied=received.command,
                alpha_hat=np.concatenate([t.alpha_hat for t, _ in self.trackers]),
                latency_hat=np.concatenate([t.latency_hat for t, _ in self.trackers]),
                **vars(self.plant.telemetry()),
            )
            after_frame(frame)
            self.plant.advance(frame, received)

    def _tracker(self, name: str | type[Controller]) -> Controller:
        settings, n = self.scenario.settings.reference, self.scenario.seeds
        reference: Reference = iterated_reference(settings, n) if settings.mode == "iterated" else self.reference
        return controllers.make(name, self.told, reference, n)


def _told(scenario: Scenario) -> Told:
    """What the team's computer is told of the loop."""
    settings, control, vision = scenario.settings, scenario.settings.control, scenario.settings.vision
    wheels = scenario.plant == "mujoco"
    return Told(
        period=PERIOD_S,
        delay_frames=max(settings.radio.delay_frames + control.delay_error_frames, 0),
        lag_s=control.lag_s if wheels else 0.0,
        drag_m_s=control.drag_m_s if wheels else 0.0,
        position_noise_m=vision.position_noise_m,
        heading_noise_rad=vision.heading_noise_rad,
        error_range_m=control.error_range_m,
        speed_range_m_s=control.speed_range_m_s,
        heading_gain=control.heading_gain,
        alpha_window_frames=control.alpha_window_frames,
    )
