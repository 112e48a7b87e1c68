"""What nobody can know before a run: robots that are nothing but their law, driven by who knows them and who does not.

    python tests/bench_learning.py [--scenario rect] [--robot tigers-v2016] [--robots 200] [--seed 0]

Robots answer by the law of `omni_control.estimation.motion` and by nothing else, with parameters drawn from what their
team believes of them: beforehand nobody knows more. Vision has the scenario's noise, and nothing is wrong with any of
them. They are driven by adaptive-comp-flc

- by heart: it knows the parameters,
- as a stranger: it learns them, and that nothing of them ever changes. Of a law that is exact its filter is then the
  best there is, to first order: what is left is what vision tells too late,
- as it is: it learns them and allows for changes, pushes, and what no law knows.

This is done with what a team is told of robots that were measured, for one that knows the dead time to a hundredth of a
frame besides, and for one that is told nothing of alpha.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from omni_control import Team, Told
from omni_control.controllers.adaptive import AdaptiveCompFlc
from omni_control.estimation.identify import Identifier
from omni_control.estimation.motion import LATENCY, Motion, Plane, pairs, plane
from omni_control.kinematics import Array
from omni_control.reference import Reference
from omni_mj.measure.statistics import spread
from omni_mj.measure.table import Table, text
from omni_mj.scenarios.scenario import scenario
from omni_mj.simulate.simulation import Simulation

EXACT_FRAMES = 0.01  # within which a dead time is exact
SURE = 1e-4  # of a standard deviation that is none
Kind = Callable[[Array], type[AdaptiveCompFlc]]


class Lawful:
    """n robots that keep to the law, from rest, heading 0.

    Args:
        start: (n,) m.
        told: dead time, period and wheels are those.
        parameters: (n, 8), in the order of `motion.NAMES`.
    """

    def __init__(self, start: Plane, told: Told, parameters: Array) -> None:
        self.position, self.velocity = start.copy(), np.zeros_like(start)
        self._law, self._period = Motion(parameters, told.geometry), told.period
        latency, self._robots = told.delay_frames + parameters[:, LATENCY], np.arange(len(start))
        self._whole, self._rest = np.floor(latency).astype(int), latency % 1
        self._sent: list[Plane] = [np.zeros_like(start)] * (self._whole.max() + 2)

    def advance(self, command: Plane) -> None:
        """Send commands (n,) and go on by a frame."""
        self._sent = [*self._sent[1:], command]
        sent = np.array(self._sent)[::-1]
        felt = (1 - self._rest) * sent[self._whole, self._robots] + self._rest * sent[self._whole + 1, self._robots]
        step = self._law.step(self.velocity, felt, np.ones_like(felt), self._period)
        self.position, self.velocity = self.position + plane(step.moved), plane(step.velocity).copy()


def as_it_is(truth: Array) -> type[AdaptiveCompFlc]:
    """The controller that ships."""
    return AdaptiveCompFlc


def stranger(truth: Array) -> type[AdaptiveCompFlc]:
    """One that knows that nothing changes, but not what it is."""

    class Stranger(AdaptiveCompFlc):
        def _identifier(self, pose: Array) -> Identifier:
            plant = super()._identifier(pose)
            plant._kept[4:], plant._renewed[4:] = 1.0, 0.0
            plant._forget[...], plant._restless[...] = 0.0, plant._restless * SURE**2
            plant.variance[:, 6] = plant.variance[:, :, 6] = 0.0  # the compass is right
            if (abs(truth[:, LATENCY]) < EXACT_FRAMES).all():  # and so is the dead time
                plant.variance[:, 6 + LATENCY] *= SURE
                plant.variance[:, :, 6 + LATENCY] *= SURE
            return plant

    return Stranger


def by_heart(truth: Array) -> type[AdaptiveCompFlc]:
    """One that knows all there is to know."""

    class ByHeart(stranger(truth)):  # type: ignore[misc]
        def _identifier(self, pose: Array) -> Identifier:
            plant: Identifier = super()._identifier(pose)
            plant._know(np.concatenate([plant._state[:, :6], truth], axis=1))
            plant.variance[:, 6:, 6:] *= SURE**2
            return plant

    return ByHeart


KINDS: dict[str, Kind] = {"by heart": by_heart, "as a stranger": stranger, "as it is": as_it_is}


def drawn(told: Told, reference: Reference, robots: int, seed: int) -> Array:
    """Parameters (robots, 8) from what a team that is told this believes, as far as robots can be so."""
    believes = AdaptiveCompFlc(told, reference, 1)._identifier(np.zeros((1, 3)))
    mean, variance = believes.motion.parameters[0], believes.variance[0, 6:, 6:]
    values = np.random.default_rng(seed).multivariate_normal(mean, variance, robots)
    return np.clip(values, believes._lowest, believes._highest)


def driven(kind: Kind, told: Told, reference: Reference, frames: int, truth: Array, seed: int) -> Array:
    """Distances (frames, n) m of robots from where they should be."""
    rng, n = np.random.default_rng([seed, 1]), len(truth)
    start = np.broadcast_to(reference.at(0, np.zeros((n, 3)))[0], (n, 3))
    plant = Lawful(plane(np.ascontiguousarray(start[:, :2])), told, truth)
    team, distances = Team(kind(truth)(told, reference, n), start), np.empty((frames, n))
    for frame in range(frames):
        pose = np.column_stack([pairs(plant.position), np.zeros(n)])
        distances[frame] = np.hypot(*(pose - reference.at(frame, pose)[0])[:, :2].T)
        pose[:, :2] += told.position_noise_m * rng.standard_normal((n, 2))
        plant.advance(plane(np.ascontiguousarray(team.step(pose)[:, :2])))
    return distances


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description="What does learning cost?")
    parser.add_argument("--scenario", default="rect", help="One in which robots do not turn.")
    parser.add_argument("--robot", default="tigers-v2016")
    parser.add_argument("--robots", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    simulation = Simulation(scenario(given.scenario, plant="planar", robot=given.robot), ["adaptive-comp-flc"])
    controller = simulation.team.controllers[0]
    rows = []
    measured, nothing = controller.told, replace(controller.told, alpha=None, creep_sideways_s2_m=None)
    cases = ("measured", measured), ("measured, dead time exact", measured), ("nothing of alpha", nothing)
    for says, told in cases:
        truth = drawn(told, controller.reference, given.robots, given.seed)
        truth[:, 0] = 0.0  # the compass, which headings correct
        truth[:, LATENCY] *= "exact" not in says
        for name, kind in KINDS.items():
            found = driven(kind, told, controller.reference, simulation.references[0].frames, truth, given.seed)
            both = (spread(100 * values) for values in (found.max(0), found.mean(0)))
            rows.append([says, name, *(f"{each['mean']:.3f} +- {each['plus_minus']:.3f}" for each in both)])
    title = f"{given.scenario}, {given.robot}: distance in cm, mean over {given.robots} robots with 95 % intervals"
    print(text(Table(title, ["told", "driven", "maximum", "mean"], rows, 2)))


if __name__ == "__main__":
    main()
