"""Iterative learning without noise: what a robot can do that has driven the same path before.

In each attempt several rows follow commands planned from the best run so far, with feedback, since rolling contacts
do not repeat exactly; others follow the best run with random changes of its commands. How rows departed from the best
one tells the model with which the next commands are planned.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np

from omni_control.controllers.base import Controller
from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.scenarios import references
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.scenario import Scenario
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies.limit.model import DepartureModel
from omni_mj.studies.limit.plan import improve
from omni_mj.studies.limit.tracking import Policy, Tracker
from omni_mj.studies.outcome import AfterFrame

Aim = Literal["max", "mean"]
AIMS: tuple[Aim, ...] = ("max", "mean")
Begin = Callable[[str, int], AfterFrame]
Leader = Callable[[Array, Array, Array], Array]
TEACHERS = ("comp-flc", "adaptive-comp-flc")  # whose best run is the first
SHARES, WEIGHTS = (1.0, 0.3), (0.03, 0.003)  # of a planned change, and of the regulator: all pairs are tried
PROBES = 3  # rows that are disturbed, by so much in m/s and rad/s
PROBE = np.array([0.1, 0.1, 0.5])
PROBE_WEIGHT = 0.1
ASTRAY, ASTRAY_M = 4.0, 0.05  # times the best row's maximum: rows beyond both say nothing of runs near it
HEADING_M = 0.01  # per rad: weight of the heading in what is compared
PATIENCE, PROGRESS, PROGRESS_M = 3, 0.04, 2e-5  # learning ends after so many attempts that gain less


class Learned(Controller):
    """Placeholder for a controller: the robots are commanded from outside."""


@dataclass(frozen=True, eq=False)
class Drives:
    """What came of n rows in F frames.

    Attributes:
        asked: Commands before the limits, (F, n, 3); the same commands give the same run, bit for bit.
        sent: Commands within the limits, (F, n, 3).
        poses: True poses, (F, n, 3).
        errors: Poses less the reference, (F, n, 3); infinite for a row that failed.
    """

    asked: Array
    sent: Array
    poses: Array
    errors: Array

    @classmethod
    def of(cls, simulation: Simulation, asked: Array) -> "Drives":
        """Return those of a simulation that is over."""
        poses, sent = simulation.log.channel("pose"), simulation.log.channel("command")
        errors = poses - simulation.log.channel("ref")
        errors[:, [failure.row for failure in simulation.failures]] = np.inf
        return cls(asked, sent, poses, errors)

    def at(self, rows: Sequence[int]) -> "Drives":
        """Return those of some rows."""
        return Drives(*(values[:, rows] for values in (self.asked, self.sent, self.poses, self.errors)))

    def size(self, aim: Aim) -> Array:
        """Return the maximum or mean error in the plane, (n,) m, and a little of that of the heading."""
        error = np.hypot(self.errors[..., 0], self.errors[..., 1]) + HEADING_M * np.abs(self.errors[..., 2])
        return error.max(0) if aim == "max" else error.mean(0)

    @property
    def merit(self) -> Array:
        """What learning minimizes, (n,) m: the mean of maximum and mean error."""
        return (self.size("max") + self.size("mean")) / 2


def quiet(scenario: Scenario) -> Scenario:
    """Return the scenario without noise, disturbance and jitter."""
    kinematic = scenario.settings.kinematic
    middle = (kinematic.alpha_low + kinematic.alpha_high) / 2
    settings = scenario.settings.replace(
        vision={"position_noise_m": 0, "heading_noise_rad": 0, "miss_probability": 0},
        sensors={"gyro_noise_rad_s": 0, "gyro_bias_rad_s": 0},
        disturbance={"force_n": 0, "velocity_m_s": 0},
        radio={"jitter_frames": 0},
        kinematic={"alpha_low": middle, "alpha_high": middle, "alpha_time_s": 0},
    )
    return scenario.replace(settings=settings)


def simulation(scenario: Scenario, controllers: Sequence[str], seeds: Sequence[int]) -> Simulation:
    """Return a simulation of one robot per controller and seed, each in its own world; no controller: led ones."""
    pairs = list(product(controllers or (Learned.__name__,), seeds))
    rows = [Row(i, 0, name, seed, scenario.settings, scenario.robot) for i, (name, seed) in enumerate(pairs)]
    return Simulation(scenario, controllers or (Learned,), rows=rows)


def lead(robots: Simulation, leader: Leader, after_frame: AfterFrame) -> Drives:
    """Lead robots from start to end by a function of reported poses, sent headings and last commands."""
    asked = []
    while not robots.done:
        seen = robots.observe()
        asked.append(leader(seen.carried, seen.pose[:, 2], robots.team.last))
        robots.step(asked[-1])
        after_frame(robots.frame - 1)
    return Drives.of(robots, np.array(asked))


def _disturbed(tracker: Tracker, changes: Array) -> Leader:
    """Return a leader whose commands differ from the tracker's by changes (F, n, 3)."""
    frames = iter(changes)
    return lambda measured, heading, last: tracker(measured, heading, last) + next(frames)


class Learner:
    """Learns the commands of a scenario for L robots side by side.

    Args:
        scenario: Without noise.
        seeds: Of the robots, L of them.
        begin: Called with a title and the number of frames before each attempt; what it returns is called after each
            frame.

    Attributes:
        best: The best run of each robot so far.
        model: How robots depart from it.
        history: Maximum and mean error in the plane of the best run, m, median over the robots, after each attempt.
    """

    def __init__(self, scenario: Scenario, seeds: Sequence[int], begin: Begin) -> None:
        self.scenario, self.seeds, self._begin = scenario, list(seeds), begin
        settings, (x, y, heading) = scenario.settings, scenario.settings.world.places[0]
        self.reference = references.timed(settings, (x, y, heading)).poses
        self.model = DepartureModel.prior(len(self.reference), settings.radio.delay_frames, 2 * settings.control.lag_s)
        self.history: list[dict[Aim, float]] = []
        self.best: Drives
        self._random = np.random.default_rng(0)
        teachers = simulation(scenario, TEACHERS, self.seeds)
        teachers.run(begin("controllers", len(self.reference)))
        self._choose(Drives.of(teachers, teachers.log.channel("command")))
        if not np.isfinite(self.best.merit).all():
            raise OmniError(f"no controller comes to the end of {scenario.name!r}: there is nothing to learn from")

    def learn(self, attempts: int) -> None:
        """Attempt after attempt, plan from the best run, until nothing is gained any more."""
        limits, idle = references.motion_limits(self.scenario.settings.control), 0
        tries = list(product(SHARES, WEIGHTS))
        for number in range(1, attempts + 1):
            best, before = self.best, self.best.merit
            commands, errors = improve(self.model, limits, best.errors, best.sent)
            shares = [share for share, _ in tries] + [0.0] * PROBES
            policies = [Policy(weight) for _, weight in tries] + [Policy(PROBE_WEIGHT)] * PROBES
            tracker = Tracker(
                self.model,
                np.concatenate([best.sent + share * (commands - best.sent) for share in shares], axis=1),
                np.concatenate([best.poses + share * (errors - best.errors) for share in shares], axis=1),
                self.scenario,
                [policy for policy in policies for _ in self.seeds],
            )
            disturbed = _disturbed(tracker, self._changes(len(tries), len(policies)))
            robots = simulation(self.scenario, (), self.seeds * len(policies))
            made = lead(robots, disturbed, self._begin(f"attempt {number}", len(self.reference)))
            self._choose(made)
            self._fit(made)
            gained = before - self.best.merit > np.maximum(PROGRESS * before, PROGRESS_M)
            idle = 0 if gained.any() else idle + 1
            if idle == PATIENCE:
                break

    def _changes(self, quiet_groups: int, groups: int) -> Array:
        """Return random changes of the commands, of two frames each; none for the first groups of rows."""
        changes = PROBE * self._random.standard_normal((len(self.reference), groups * len(self.seeds), 3))
        changes[1:] += changes[:-1].copy()
        changes[:, : quiet_groups * len(self.seeds)] = 0
        return changes / np.sqrt(2)

    def _choose(self, made: Drives) -> None:
        """Take the best row of each robot, if it is better than the best run so far."""
        robots = len(self.seeds)
        rows = [int(made.merit[i::robots].argmin()) * robots + i for i in range(robots)]
        chosen = made.at(rows)
        if self.history:
            better = chosen.merit < self.best.merit
            pairs = zip(vars(chosen).values(), vars(self.best).values(), strict=True)
            chosen = Drives(*(np.where(better[:, None], new, old) for new, old in pairs))
        self.best = chosen
        distance = np.hypot(chosen.errors[..., 0], chosen.errors[..., 1])
        self.history.append({"max": float(np.median(distance.max(0))), "mean": float(np.median(distance.mean(0)))})

    def _fit(self, made: Drives) -> None:
        """Fit the model to how the rows of each robot differ from its best row."""
        robots, farthest = len(self.seeds), made.size("max")
        poses, commands = list[Array](), list[Array]()
        for robot in range(robots):
            rows = sorted(range(robot, len(farthest), robots), key=lambda row: float(farthest[row]))
            near = [row for row in rows if farthest[row] < max(ASTRAY * farthest[rows[0]], ASTRAY_M)]
            poses.append(made.poses[:, near[1:]] - made.poses[:, near[:1]])
            commands.append(made.sent[:, near[1:]] - made.sent[:, near[:1]])
        if sum(values.shape[1] for values in poses) > 1:
            self.model = DepartureModel.fit(
                self.reference, self.model.delay, np.concatenate(poses, axis=1), np.concatenate(commands, axis=1)
            )
