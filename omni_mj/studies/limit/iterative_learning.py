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

from omni_control.controllers.base import Controller, Observation
from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config import reference_factory
from omni_mj.config.rows import Row
from omni_mj.config.scenario import Scenario
from omni_mj.simulation.simulation import Simulation
from omni_mj.studies.limit.deviation_model import DeviationModel, improve
from omni_mj.studies.limit.lqr_tracking import Policy, Tracker
from omni_mj.studies.study_runner import AfterFrame, StartProgress

Aim = Literal["max", "mean"]
AIMS: tuple[Aim, ...] = ("max", "mean")
Leader = Callable[[Array, Array, Array], Array]
TEACHERS = ("comp-flc", "adaptive-comp-flc")  # whose best run is the first
TRIES = tuple(
    product((1.0, 0.3), (0.03, 0.003))
)  # share of a planned change, weight of the regulator
PROBES = 3  # rows that are disturbed, by so much in m/s and rad/s
PROBE = np.array([0.1, 0.1, 0.5])
PROBE_WEIGHT = 0.1
ASTRAY, ASTRAY_M = (
    4.0,
    0.05,
)  # times the best row's maximum: rows beyond both say nothing of runs near it
HEADING_M = 0.01  # per rad: weight of the heading in what is compared
PATIENCE, PROGRESS, PROGRESS_M = (
    3,
    0.04,
    2e-5,
)  # learning ends after so many attempts that gain less


@dataclass(frozen=True, eq=False)
class Drives:
    """What came of n rows in F frames.

    Attributes:
        sent: Commands within the limits, (F, n, 3).
        poses: True poses, (F, n, 3).
        errors: Poses less the reference, (F, n, 3); infinite for a row that failed.
    """

    sent: Array
    poses: Array
    errors: Array

    @classmethod
    def of(cls, simulation: Simulation) -> "Drives":
        """Return those of a simulation that is over."""
        poses, sent = simulation.log.channel("pose"), simulation.log.channel("command")
        errors = poses - simulation.log.channel("ref")
        errors[:, [failure.row for failure in simulation.failures]] = np.inf
        return cls(sent, poses, errors)

    @property
    def best(self) -> "Drives":
        """Return those of the row with the least merit."""
        row = [int(self.merit.argmin())]
        return Drives(*(values[:, row] for values in (self.sent, self.poses, self.errors)))

    def size(self, aim: Aim, heading_m: float = HEADING_M) -> Array:
        """Return the maximum or mean error in the plane, (n,) m, and a little of that of the heading."""
        error = np.hypot(self.errors[..., 0], self.errors[..., 1]) + heading_m * np.abs(
            self.errors[..., 2]
        )
        return error.max(0) if aim == "max" else error.mean(0)

    @property
    def merit(self) -> Array:
        """What learning minimizes, (n,) m: the mean of maximum and mean error."""
        return (self.size("max") + self.size("mean")) / 2


def led(label: str, leader: Leader) -> type[Controller]:
    """Return a controller that sends what a function of reported poses, sent headings and last commands returns."""

    def command(self: Controller, frame: int, observation: Observation) -> Array:
        return leader(
            observation.extrapolated_pose,
            observation.pose[:, 2],
            observation.sent_commands.get_latest(1)[0],
        )

    return type(label, (Controller,), {"command": command})


def lead(
    scenario: Scenario, seeds: Sequence[int], leader: Leader, after_frame: AfterFrame
) -> Drives:
    """Lead robots, one for each seed and each in its own world, from start to end."""
    rows = [
        Row(i, 0, "led", seed, scenario.settings, scenario.robot) for i, seed in enumerate(seeds)
    ]
    simulation = Simulation(scenario, [led("led", leader)], rows=rows)
    simulation.run(after_frame)
    return Drives.of(simulation)


def learn(
    scenario: Scenario,
    attempts: int,
    history: list[dict[Aim, float]],
    start_progress: StartProgress,
) -> tuple[Drives, DeviationModel]:
    """Learn the commands of a scenario without noise; return the best run and how robots depart from it.

    Args:
        scenario: Without noise; its first seed counts.
        attempts: From each the best run so far is planned anew, until nothing is gained any more;
            so many at most.
        history: Takes maximum and mean error in the plane of the best run, m, after each attempt.
        start_progress: Called with a title and the number of frames before each attempt; what it returns is
            called after each frame.
    """
    settings, seed, idle = scenario.settings, scenario.seed, 0
    reference = reference_factory.timed(settings, settings.world.start_poses[0]).poses
    limits, random = reference_factory.motion_limits(settings.control), np.random.default_rng(0)
    model = DeviationModel.prior(
        len(reference), settings.radio.delay_frames, 2 * settings.control.lag_s
    )
    teachers = Simulation(scenario, TEACHERS, [seed])
    teachers.run(start_progress("controllers", len(reference)))
    best = Drives.of(teachers).best
    if not np.isfinite(best.merit).all():
        raise OmniError(
            f"no controller comes to the end of {scenario.name!r}: there is nothing to learn from"
        )
    policies = [Policy(weight) for _, weight in TRIES] + [Policy(PROBE_WEIGHT)] * PROBES
    shares = np.array([share for share, _ in TRIES] + [0.0] * PROBES)[:, None]
    for number in range(attempts + 1):
        history.append({aim: float(best.size(aim, 0.0)[0]) for aim in AIMS})
        if number == attempts or idle == PATIENCE:
            break
        planned, expected = improve(model, limits, best.errors[:, 0], best.sent[:, 0])
        commands = best.sent + shares * (planned[:, None] - best.sent)
        poses = best.poses + shares * (expected[:, None] - best.errors)
        tracker = Tracker(model, commands, poses, scenario, policies)
        changes = PROBE * random.standard_normal((len(reference), len(policies), 3))
        changes[1:] += changes[:-1].copy()
        frames = iter(np.where(shares == 0, changes / np.sqrt(2), 0.0))
        made = lead(
            scenario,
            [seed] * len(policies),
            lambda *seen, tracker=tracker, frames=frames: tracker(*seen) + next(frames),
            start_progress(f"attempt {number + 1}", len(reference)),
        )
        model = _fitted(model, reference, made)
        gain = float((best.merit - made.best.merit)[0])
        idle = 0 if gain > max(PROGRESS * float(best.merit[0]), PROGRESS_M) else idle + 1
        best = made.best if gain > 0 else best
    return best, model


def _fitted(model: DeviationModel, reference: Array, made: Drives) -> DeviationModel:
    """Return the model fitted to how rows near the best one differ from it, if there are enough."""
    farthest = made.size("max")
    rows = np.argsort(farthest, kind="stable")
    near = rows[farthest[rows] < max(ASTRAY * farthest[rows[0]], ASTRAY_M)]
    if len(near) < 3:
        return model
    poses, commands = (
        values[:, near[1:]] - values[:, near[:1]] for values in (made.poses, made.sent)
    )
    return DeviationModel.fit(reference, model.delay, poses, commands)
