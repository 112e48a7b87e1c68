"""Runs of a scenario in which robots are led: rows side by side, told what to do from outside."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from omni_control.controllers.base import Controller
from omni_control.kinematics import Array
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.scenario import Scenario
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies.outcome import AfterFrame


class Learned(Controller):
    """Stands where a controller would be named."""


class Leader(Protocol):
    """Who leads the robots of a batch."""

    def __call__(self, measured: Array, heading: Array) -> Array:
        """Commands (n, 3) by the poses (n, 3) that vision reports, and the headings (n,) that are sent along."""
        ...

    def sent(self, command: Array) -> None:
        """Hear what is sent of them (n, 3), within the limits."""
        ...


class Table:
    """Leads robots by commands (F, n, 3) that are known beforehand."""

    def __init__(self, commands: Array) -> None:
        self._next = iter(commands)

    def __call__(self, measured: Array, heading: Array) -> Array:
        """See `Leader`."""
        return next(self._next)

    def sent(self, command: Array) -> None:
        """See `Leader`."""


class Together:
    """Several leaders of a batch, each of the rows that come next.

    Args:
        leaders: with the number of rows of each.
    """

    def __init__(self, leaders: Sequence[tuple[Leader, int]]) -> None:
        ends = np.cumsum([0, *(rows for _, rows in leaders)])
        self._parts = [(leader, slice(ends[i], ends[i + 1])) for i, (leader, _) in enumerate(leaders)]

    def __call__(self, measured: Array, heading: Array) -> Array:
        """See `Leader`."""
        return np.concatenate([leader(measured[part], heading[part]) for leader, part in self._parts])

    def sent(self, command: Array) -> None:
        """See `Leader`."""
        for leader, part in self._parts:
            leader.sent(command[part])


@dataclass(frozen=True, eq=False)
class Attempts:
    """What came of n rows in F frames.

    Attributes:
        asked: commands, before the limits, (F, n, 3); asking for the same gives the same run, bit for bit.
        sent: these, within the limits, (F, n, 3).
        poses: true ones, (F, n, 3).
        errors: these less where they should have been, (F, n, 3); infinite for a row that failed.
        measured: poses that vision reported, (F, n, 3).
        headings: that were sent along, (F, n).
    """

    asked: Array
    sent: Array
    poses: Array
    errors: Array
    measured: Array
    headings: Array

    @property
    def distance(self) -> Array:
        """Errors in the plane, (F, n) m."""
        return np.hypot(self.errors[..., 0], self.errors[..., 1])

    @property
    def whole(self) -> np.ndarray:
        """Which rows came to their end, (n,)."""
        return np.asarray(np.isfinite(self.errors).all((0, 2)))


def quiet(scenario: Scenario) -> Scenario:
    """The same without noise: what vision and gyro show is true, nothing disturbs, packets take equally long."""
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


def row(scenario: Scenario, world: int, seed: int, label: str = Learned.__name__) -> Row:
    """One robot of a batch, alone in its world."""
    return Row(world, 0, label, seed, scenario.settings, scenario.robot)


def attempt(scenario: Scenario, seeds: Sequence[int], leader: Leader, after_frame: AfterFrame) -> Attempts:
    """Lead a robot for each seed from start to end; `after_frame` may raise `StoppedError`."""
    rows = [row(scenario, i, seed) for i, seed in enumerate(seeds)]
    return led(Simulation(scenario, [Learned], rows=rows), leader, after_frame)


def led(simulation: Simulation, leader: Leader, after_frame: AfterFrame) -> Attempts:
    """Lead the robots of a simulation from start to end."""
    asked = []
    measured, headings = list[Array](), list[Array]()
    while not simulation.done:
        seen = simulation.observe()
        measured.append(seen.carried)
        headings.append(seen.pose[:, 2].copy())
        asked.append(leader(seen.carried, seen.pose[:, 2]))
        simulation.step(asked[-1])
        leader.sent(simulation.team.last)
        after_frame(simulation.frame - 1)
    return of(simulation, np.array(asked), np.array(measured), np.array(headings))


def of(simulation: Simulation, asked: Array, measured: Array, headings: Array) -> Attempts:
    """What a simulation that is over has recorded."""
    log = simulation.log
    poses = log.channel("pose")
    errors = poses - log.channel("ref")
    errors[:, [failure.row for failure in simulation.failures]] = np.inf
    return Attempts(asked, log.channel("command"), poses, errors, measured, headings)
