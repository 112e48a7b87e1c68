"""Robots that drive standard profiles side by side, each under settings of its own: what their response is.

They are commanded frame by frame: no controller, no dead time, and a camera without noise, whose heading keeps them
straight.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise

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
Groups = Mapping[str, Sequence[tuple[Settings, Profile]]]


class Commanded(Controller):
    """Stands where a controller would be named; what the robots are sent is the profile."""


class Drives:
    """Drives in one batch, each in every direction; those that fail have responses that are not a number.

    Args:
        scenario: seed, robot, plant.
        groups: name -> drives: settings, all of one shape (see `plants.mujoco`), and profile.

    Raises:
        OmniError: the plant has no wheels.
    """

    def __init__(self, scenario: Scenario, groups: Groups) -> None:
        self._sizes = {name: len(drives) for name, drives in groups.items()}
        every = [(drive, name) for drives in groups.values() for drive in drives for name in DIRECTIONS]
        self._profiles = [profile for (_, profile), _ in every]
        self._heading = np.array([DIRECTIONS[name] for _, name in every])
        self.scenario, self.frames = scenario, frames(groups)
        self.rows = [
            Row(world, 0, Commanded.__name__, scenario.seed, _undisturbed(settings, self.frames), scenario.robot)
            for world, ((settings, _), _) in enumerate(every)
        ]
        self.simulation = Simulation(scenario, [Commanded], rows=self.rows)
        if self.simulation.plant.geometry is None:
            raise OmniError(f"alpha is studied on wheels, and the plant {scenario.plant!r} has none")
        self._geometry = self.simulation.plant.geometry
        self.driven: dict[str, np.ndarray] = {"direction": np.array([name for _, name in every])}
        for name in vars(self._profiles[0]):
            self.driven[name] = np.array([getattr(profile, name) for profile in self._profiles])

    def run(self, after_frame: AfterFrame) -> None:
        """Drive; `after_frame` is called with each frame's number, and may raise `StoppedError`."""
        command = np.zeros((self.frames, len(self.rows), 3))
        for i, profile in enumerate(self._profiles):
            speed = profile.command()
            command[: len(speed), i, :2] = speed[:, None] * self._heading[i]
        for frame, sent in enumerate(command):
            self.simulation.step(sent)
            after_frame(frame)

    def body(self) -> Response:
        """How the robots followed, (n,) in the order of their rows."""
        return self._response((self.simulation.log.channel("pose")[..., :2] * self._heading).sum(-1))

    def wheels(self) -> Response:
        """How their wheels did, (n,): what the robots would have done, had no wheel slipped."""
        per_wheel = np.linalg.pinv(self._geometry.matrix)[:2] * self._geometry.radius  # speeds of body over wheel
        return self._response((self.simulation.log.channel("wheel_angle") @ per_wheel.T * self._heading).sum(-1))

    def grouped(self, response: Response) -> dict[str, Response]:
        """The groups of a response of all: name -> (drives, directions)."""
        ends = np.cumsum([0, *self._sizes.values()])
        each = {name: getattr(response, name).reshape(-1, len(DIRECTIONS)) for name in NAMES}
        return {
            group: Response(*(values[start:end] for values in each.values()))
            for group, (start, end) in zip(self._sizes, pairwise(ends), strict=True)
        }

    def _response(self, travelled: np.ndarray) -> Response:
        """Of ways along the drives (frames, n)."""
        found = Response(*np.full((len(NAMES), len(self.rows)), np.nan))
        for profile in set(self._profiles):
            robots = [i for i, driven in enumerate(self._profiles) if driven == profile]
            part = measure(profile, travelled[: len(profile.command()) + 1, robots])
            for name in NAMES:
                getattr(found, name)[robots] = getattr(part, name)
        return found


def frames(groups: Groups) -> int:
    """How many frames the longest drive takes, with one more that only records where it led."""
    return 1 + max(len(profile.command()) for drives in groups.values() for _, profile in drives)


def _undisturbed(settings: Settings, length: int) -> Settings:
    """Without dead time, noise and limits of the command; the reference lasts as many frames."""
    return standing(
        settings,
        length,
        control={"max_speed_m_s": 20, "max_acceleration_m_s2": 1000},
        vision={"position_noise_m": 0, "heading_noise_rad": 0, "miss_probability": 0},
        disturbance={"force_n": 0},
    )
