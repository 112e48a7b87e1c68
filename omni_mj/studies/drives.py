"""Robots that drive standard profiles side by side, and how they respond.

Profiles are commanded frame by frame: no controller, no dead time, and a camera without noise, whose heading keeps them
straight.
"""

from collections.abc import Sequence

import numpy as np

from omni_control.controllers.base import Controller
from omni_control.errors import OmniError
from omni_mj.measure.response import NAMES, Profile, Response, measure
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import Settings
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies.outcome import AfterFrame, standing

DIRECTIONS = {"forward": (1.0, 0.0), "sideways": (0.0, 1.0), "diagonal": (0.5**0.5, 0.5**0.5)}
AXES = ("forward", "sideways")
# Without limits of the command, noise and pushes.
UNDISTURBED = {
    "control": {"max_speed_m_s": 20, "max_acceleration_m_s2": 1000},
    "vision": {"position_noise_m": 0, "heading_noise_rad": 0, "miss_probability": 0},
    "disturbance": {"force_n": 0},
}


class Commanded(Controller):
    """Stands where a controller would be named; what the robots are sent is the profile."""


class ProfileDrives:
    """Drives of standard profiles in one batch, each in every direction.

    Args:
        scenario: Seed, robot and plant.
        drives: Settings, all of one shape (see `plants.mujoco`), and profile of each drive.

    Attributes:
        simulation: One row per drive and direction.
        frames: Number of frames to simulate.
        labels: Direction and profile of each row, by column name.

    Raises:
        OmniError: The plant has no wheels.
    """

    def __init__(self, scenario: Scenario, drives: Sequence[tuple[Settings, Profile]]) -> None:
        self._profiles = [profile for _, profile in drives for _ in DIRECTIONS]
        self._directions = np.array([*DIRECTIONS.values()] * len(drives))
        speeds = [profile.command() for profile in self._profiles]
        # The last frame only records the pose that the command of the frame before led to.
        self.frames = 1 + max(map(len, speeds))
        self._twists = np.zeros((self.frames, len(speeds), 3))
        for i, speed in enumerate(speeds):
            self._twists[: len(speed), i, :2] = speed[:, None] * self._directions[i]
        settings = [standing(s, self.frames, **UNDISTURBED) for s, _ in drives for _ in DIRECTIONS]
        rows = [
            Row(i, 0, Commanded.__name__, scenario.seed, settings_i, scenario.robot)
            for i, settings_i in enumerate(settings)
        ]
        self.simulation = Simulation(scenario, [Commanded], rows=rows)
        if self.simulation.plant.geometry is None:
            raise OmniError(f"alpha is studied on wheels, and the plant {scenario.plant!r} has none")
        self._geometry = self.simulation.plant.geometry
        self.labels = {"direction": np.array([*DIRECTIONS] * len(drives))}
        for name in vars(self._profiles[0]):
            self.labels[name] = np.array([getattr(profile, name) for profile in self._profiles])

    def run(self, after_frame: AfterFrame) -> None:
        """Drive all rows and call `after_frame`, which may raise `StoppedError`, after each frame."""
        for frame, twists in enumerate(self._twists):
            self.simulation.step(twists)
            after_frame(frame)

    def body(self) -> Response:
        """Return the response of the robots, (drives, directions); not a number for those that failed."""
        return self._response(self.simulation.log.channel("pose")[..., :2])

    def wheels(self) -> Response:
        """Return the response that the robots would have had without slip, (drives, directions)."""
        to_body = np.linalg.pinv(self._geometry.matrix)[:2] * self._geometry.radius
        return self._response(self.simulation.log.channel("wheel_angle") @ to_body.T)

    def _response(self, positions: np.ndarray) -> Response:
        """Return the response for positions (frames, n, 2)."""
        travelled = (positions * self._directions).sum(-1)
        responses = [
            measure(profile, travelled[: len(profile.command()) + 1, i : i + 1])
            for i, profile in enumerate(self._profiles)
        ]
        shape = (-1, len(DIRECTIONS))
        return Response(*(np.reshape([getattr(r, name) for r in responses], shape) for name in NAMES))
