"""Robots that drive standard profiles side by side, and around paths: what their response and their alpha is.

Profiles are commanded frame by frame: no controller, no dead time, and a camera without noise, whose heading keeps them
straight. Around a path a controller drives a robot under each of the usual conditions.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from omni_control.controllers.base import Controller
from omni_control.errors import OmniError
from omni_mj.measure import metrics
from omni_mj.measure.response import NAMES, Profile, Response, measure
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.scenario import Scenario, load
from omni_mj.scenarios.settings import Settings
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies import conditions
from omni_mj.studies.outcome import AfterFrame, standing, total_frames

DIRECTIONS = {"forward": (1.0, 0.0), "sideways": (0.0, 1.0), "diagonal": (0.5**0.5, 0.5**0.5)}
AXES = ("forward", "sideways")
CONTROLLER = "comp-flc"  # the paper's
# Without limits of the command, noise and pushes.
UNDISTURBED = {
    "control": {"max_speed_m_s": 20, "max_acceleration_m_s2": 1000},
    "vision": {"position_noise_m": 0, "heading_noise_rad": 0, "miss_probability": 0},
    "disturbance": {"force_n": 0},
}
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
        # One frame more only records where the last one led.
        self.scenario, self.frames = scenario, 1 + max(len(profile.command()) for profile in self._profiles)
        self.rows = [
            Row(world, 0, Commanded.__name__, scenario.seed, standing(s, self.frames, **UNDISTURBED), scenario.robot)
            for world, ((s, _), _) in enumerate(every)
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
        """Return how the robots followed, (n,) in the order of their rows."""
        return self._response((self.simulation.log.channel("pose")[..., :2] * self._heading).sum(-1))

    def wheels(self) -> Response:
        """Return how their wheels did, (n,): what the robots would have done, had no wheel slipped."""
        per_wheel = np.linalg.pinv(self._geometry.matrix)[:2] * self._geometry.radius  # speeds of body over wheel
        return self._response((self.simulation.log.channel("wheel_angle") @ per_wheel.T * self._heading).sum(-1))

    def grouped(self, response: Response) -> dict[str, Response]:
        """Return the groups of a response of all: name -> (drives, directions)."""
        ends = np.cumsum([0, *self._sizes.values()]) * len(DIRECTIONS)
        return {
            group: Response(*(getattr(response, name)[a:b].reshape(-1, len(DIRECTIONS)) for name in NAMES))
            for group, (a, b) in zip(self._sizes, pairwise(ends), strict=True)
        }

    def _response(self, travelled: np.ndarray) -> Response:
        """Return the response for ways along the drives (frames, n)."""
        result = np.full((len(NAMES), len(self.rows)), np.nan)
        for profile in set(self._profiles):
            robots = [i for i, driven in enumerate(self._profiles) if driven == profile]
            part = measure(profile, travelled[: len(profile.command()) + 1, robots])
            result[:, robots] = [getattr(part, name) for name in NAMES]
        return Response(*result)


class InUse:
    """One robot for each of the usual conditions, around the path of a scenario.

    Args:
        scenario: everything but the path.
        task: name of the scenario whose path it is; robots must face along x on it, so that forward is x.
    """

    def __init__(self, scenario: Scenario, task: str) -> None:
        path = {"reference": load(task).settings.reference, "world": {"places": [[0, 0, 0]]}, "fault": ()}
        settings = scenario.settings.replace(**path)
        self.scenario = scenario.replace(
            name=task, controllers=(CONTROLLER,), paper_table=0, settings=settings, seeds=1
        )
        self.rows = [
            Row(world, 0, CONTROLLER, scenario.seed, usual, scenario.robot)
            for world, usual in enumerate(conditions.usual(settings))
        ]
        self.simulation = Simulation(self.scenario, rows=self.rows)
        self.frames = total_frames(self.simulation)

    def run(self, after_frame: AfterFrame) -> None:
        """Drive; `after_frame` is called with each frame's number."""
        self.simulation.run(after_frame)

    def percentiles(self) -> dict[str, dict[str, float]]:
        """Return those of alpha over all robots and windows in which they are driven, by axis; none without any."""
        log = self.simulation.log
        alpha = metrics.driven_alpha(log.channel("pose")[..., :2], log.channel("applied")[..., :2])
        found: dict[str, dict[str, float]] = {}
        for j, axis in enumerate(AXES):
            known = alpha[..., j][~np.isnan(alpha[..., j])]
            levels = metrics.ALPHA_PERCENTILES if known.size else ()
            found[axis] = {f"p{p}": round(float(np.percentile(known, p)), 6) for p in levels}
        return found
