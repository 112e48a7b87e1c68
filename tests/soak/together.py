"""Faults of the world two at a time, on the plant that costs least: nobody crashes, all come to rest at their goal."""

import random
from collections.abc import Iterator
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np
from moments import Found
from numpy.typing import NDArray

import omni_mj as om
from omni_mj.scenarios.faults import Fault, made
from omni_mj.scenarios.rows import Row
from omni_mj.simulate.simulation import Simulation

CONTROLLERS = ("comp-flc", "adaptive-comp-flc")
BEGIN_S, LASTS_S, PUSHED_S = (0.5, 1.5), (0.3, 2.5), 0.25  # a push of seconds takes a robot off any field
WAY = {"waypoints": [[0, 0], [1.0, 0.5], [0, 0.5], [0, 0]], "settle_s": 3.0}
HALF_FIELD_M = (4.5, 3.0)
REST, GOAL_M = (0.05, 0.05, 0.25), 0.03  # m/s and rad/s in the last quarter of a second; from its goal


def pairs(rng: random.Random, count: int, folder: Path) -> Iterator[Found]:
    """So many pairs of the kinds that are in the storm, drawn of all; each with a robot of its own."""
    storm = {fault.kind: fault for fault in om.scenario("storm").settings.fault}
    scenario = om.scenario("rect", plant="planar", physics={"kernel": "numba"}, reference=WAY, controllers=CONTROLLERS)
    every = list(combinations_with_replacement(sorted(storm), 2))
    chosen = rng.sample(every, min(count, len(every)))
    settings = [scenario.settings.replace(fault=[_drawn(rng, storm[kind]) for kind in pair]) for pair in chosen]
    driven = [(name, seed, each) for name in CONTROLLERS for seed, each in enumerate(settings)]
    table = [Row(world, 0, *each, scenario.robot) for world, each in enumerate(driven)]
    simulation = Simulation(scenario, rows=table)
    log = simulation.run()
    pose, goal = log.channel("pose"), log.channel("ref")[-1]
    causes = {failure.row: failure.cause for failure in simulation.failures}
    for number, each in enumerate(settings):
        wrong = []
        for row in range(number, len(table), len(settings)):
            found = _wrong(pose[:, row], goal[row]) + ([causes[row]] if row in causes else [])
            wrong += [f"{table[row].controller}: {what}" for what in found]
        yield " and ".join(fault.told for fault in each.fault), wrong


def _wrong(pose: NDArray, goal: NDArray) -> list[str]:
    """What is wrong with how a robot drove (frames, 3), which should have come to a goal (3,)."""
    speed, far = np.abs(np.diff(pose[-15:], axis=0)).max(0) * 60, np.abs(pose[:, :2]).max(0)
    off = np.abs(pose[-1] - goal)[:2].max()
    wrong = ["it has no pose that is a number"] * (not np.isfinite(pose).all())
    wrong += [f"it goes on at {speed.round(2)}"] * (not (speed < REST).all())
    wrong += [f"it is {off:.2f} m from its goal"] * (not off < GOAL_M)
    return wrong + [f"it left the field, {far.round(1)}"] * (not (far < HALF_FIELD_M).all())


def _drawn(rng: random.Random, fault: Fault) -> Fault:
    """The fault at another time, for as long as it may last."""
    lasts = PUSHED_S if fault.kind == "push" else rng.uniform(*LASTS_S)
    (again,) = made([fault.values() | {"at": round(rng.uniform(*BEGIN_S), 2), "for": round(lasts, 2)}])
    return again
