"""Episodes of n robots, begun when asked; those that begin together are rows of one simulation while they last."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_control.controllers.base import Controller, Seen
from omni_control.errors import OmniError
from omni_control.kinematics import Array, wrap_angle
from omni_control.reference import EachReference, SampledReference
from omni_mj.gym import frames
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import PERIOD_S, Settings
from omni_mj.simulate.simulation import Simulation, alike

ARM_M = 0.09  # the league's largest radius of a robot: so far its hull is off per radian of heading
LOST_M = 1.0
LONGEST_MEMORY = 600  # frames

Bools = NDArray[np.bool_]


class Outside(Controller):
    """Holds the place of a controller where commands come from outside; it has them remembered, and is never asked."""

    memory: int = 1  # frames

    def __init__(self, told: object, reference: object, n: int) -> None:
        super().__init__(told, reference, n)  # type: ignore[arg-type]
        self.memory_frames = max(self.memory, self.memory_frames)


@dataclass
class _Together:
    """Robots whose episodes began in the same frame.

    Args:
        simulation: theirs.
        robots: their numbers, in the order of its rows.
    """

    simulation: Simulation
    robots: NDArray[np.intp]
    known_failures: int = 0
    reference: SampledReference = field(init=False)
    last: NDArray[np.intp] = field(init=False)
    limits: Array = field(init=False)

    def __post_init__(self) -> None:
        """Put together what does not change during the episodes."""
        own = self.simulation.references
        self.reference = own[0] if all(each is own[0] for each in own) else EachReference(own)
        self.last = np.array([each.frames - 1 for each in own])
        control = [row.settings.control for row in self.simulation.rows]
        self.limits = np.array([[c.max_speed_m_s, c.max_speed_m_s, c.max_turn_rate_rad_s] for c in control])

    def errors(self) -> tuple[Array, Array]:
        """How far the robots are off their reference: distance in the plane and angle, without sign, (n,) m and rad."""
        frame, poses = self.simulation.frame, self.simulation.plant.pose()
        here, _ = self.reference.at(frame, poses)
        off = poses - here
        return np.hypot(off[:, 0], off[:, 1]), np.abs(wrap_angle(off[:, 2]))

    def failed(self) -> list[int]:
        """Rows that failed since it was asked last."""
        new = self.simulation.failures[self.known_failures :]
        self.known_failures += len(new)
        return [failure.row for failure in new]


@dataclass(frozen=True)
class Outcome:
    """What came of a frame, of each of n robots; nothing, where an episode has ended before.

    Args:
        reward: (n,).
        terminated, truncated: whether the episode has ended, now or before, (n,).
        distance, turned: true distance from the reference in m, true error of the heading in rad, (n,).
    """

    reward: Array
    terminated: Bools
    truncated: Bools
    distance: Array
    turned: Array


class Episodes:
    """n robots that each follow the reference of a scenario, commanded from outside.

    Args:
        scenario: its controllers and seeds do not matter.
        n: robots.
        memory: how many of the commands sent are observed. [as many as may be in flight, and one]
        lost_m: how far off its reference a robot is lost.

    Attributes:
        memory: as given, or found.
        seen: what was last observed of each robot, (n, `frames.size(memory)`).
        terminated, truncated: whether its episode has ended, (n,); both for a robot of which none was begun.

    Raises:
        OmniError: one of these is not allowed, or the scenario has several robots in a world.
    """

    def __init__(self, scenario: Scenario, n: int, memory: int | None, lost_m: float) -> None:
        if len(scenario.settings.world.places) > 1:
            raise OmniError("world.places: an environment is one robot; leave one place")
        if not 0 < lost_m < math.inf:
            raise OmniError(f"lost_m must be a positive number of m, not {lost_m}")
        self.memory = _memory(scenario) if memory is None else memory
        if not (isinstance(self.memory, int) and 1 <= self.memory <= LONGEST_MEMORY):
            raise OmniError(f"memory must be a whole number of frames from 1 to {LONGEST_MEMORY}, not {self.memory}")
        parameters = {Outside.__name__: {"memory": self.memory}}
        settings = Settings(**{**dict(scenario.settings), "controller": parameters})  # in place of others'
        self.scenario = scenario.replace(controllers=(Outside,), settings=settings)
        self.lost_m, self.n = lost_m, n
        self.seen = np.zeros((n, frames.size(self.memory)), np.float32)
        self.terminated, self.truncated = np.ones((2, n), bool)
        self._together: list[_Together] = []

    @property
    def ended(self) -> Bools:
        """Whether an episode has ended, (n,)."""
        return self.terminated | self.truncated

    def begin(self, robots: NDArray[np.intp], seeds: Sequence[int]) -> None:
        """Begin an episode of some robots, from the start of their references.

        Args:
            robots: their numbers.
            seeds: of each one's noise, and of what is drawn for it.

        Raises:
            OmniError: a seed draws what is not allowed.
        """
        self.terminated[robots] = self.truncated[robots] = False
        groups: dict[object, list[tuple[int, Row]]] = {}
        for robot, seed in zip(robots.tolist(), seeds, strict=True):
            own = self.scenario.settings_of(seed)
            group = groups.setdefault(alike(self.scenario.plant, own), [])
            row = Row(len(group), 0, Outside.__name__, seed, own, self.scenario.robot)
            group.append((robot, row))
        for each in self._together:  # what ended there was begun anew here
            each.robots[np.isin(each.robots, robots)] = -1
        for group in groups.values():
            numbers, rows = zip(*group, strict=True)
            self._together.append(_Together(Simulation(self.scenario, rows=rows, logged=False), np.array(numbers)))
            self._observe(self._together[-1])

    def go_on(self, action: ArrayLike) -> Outcome:
        """Go on by a frame with the actions (n, 3) of all robots; those whose episodes have ended stay as they are.

        Raises:
            OmniError: the actions are not (n, 3) finite numbers.
        """
        given = np.asarray(action, float)
        if given.shape != (self.n, 3):
            raise OmniError(f"actions must be finite numbers {(self.n, 3)}, not {given.dtype} of shape {given.shape}")
        reward, distance, turned = np.zeros((3, self.n))
        self._together = [each for each in self._together if self._lasts(each).any()]
        for each in self._together:
            going, simulation = self._lasts(each), each.simulation
            simulation.step(frames.command(given[each.robots], simulation.observe(), each.limits))
            off, angle = each.errors()
            failed = np.zeros(len(off), bool)
            failed[each.failed()] = True
            terminated = failed | ~(off <= self.lost_m)  # what is no number has failed
            cost = np.minimum(np.where(failed, self.lost_m, off + ARM_M * angle), self.lost_m)
            cost += np.where(terminated, self.lost_m * (each.last - simulation.frame), 0.0)
            robots = each.robots[going]
            reward[robots], distance[robots], turned[robots] = -cost[going], off[going], angle[going]
            self.terminated[robots] = terminated[going]
            self.truncated[robots] = ((simulation.frame >= each.last) & ~terminated)[going]
            self._observe(each, going)
        return Outcome(reward, self.terminated.copy(), self.truncated.copy(), distance, turned)

    def _lasts(self, each: _Together) -> Bools:
        return (each.robots >= 0) & ~self.ended[each.robots]

    def _observe(self, each: _Together, going: Bools | slice = slice(None)) -> None:
        seen: Seen = each.simulation.observe()
        found = frames.observation(each.simulation.frame, seen, each.reference, self.memory)
        self.seen[each.robots[going]] = found[going]


def _memory(scenario: Scenario) -> int:
    """Frames within which a command has acted, at most.

    Raises:
        OmniError: there is no most, since the dead time is drawn from a distribution without ends.
    """
    control, radio = scenario.settings.control, scenario.settings.radio
    drawn = scenario.distributions.get("radio.delay_frames")
    if drawn is not None and not drawn.ends:
        raise OmniError("radio.delay_frames is drawn from a distribution without ends: give it some, or give memory=")
    longest = radio.delay_frames if drawn is None else max(drawn.ends)
    return int(longest) + radio.jitter_frames + math.ceil(control.lag_s / PERIOD_S) + 1
