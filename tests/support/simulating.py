"""What the tests of the loop share: short runs of the two controllers of the paper."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from omni_mj.scenarios import scenario
from omni_mj.simulate.log import Trajectory
from omni_mj.simulate.simulation import Simulation

FRAME_S = 1 / 60
SHORT = ("reference.waypoints=[[0,0],[0.5,0]]", "reference.settle_s=0.2")
# Equation 7 without doubt: no noise, a plant that does as told, limits out of the way.
IDEAL = (
    "vision.position_noise_m=0",
    "vision.heading_noise_rad=0",
    "vision.miss_probability=0",
    "kinematic.alpha_low=1",
    "kinematic.alpha_high=1",
    "control.max_acceleration_m_s2=1000",
)
PLANTS = ("kinematic", "mujoco")
DISTURBED = ("disturbance.velocity_m_s=0.1", "disturbance.force_n=10")
FLC, COMPENSATED = 0, 1  # rows of the default controllers


def simulation(
    plant: str,
    overrides: tuple[str, ...] = (),
    controllers: tuple[str, ...] = ("flc", "comp-flc"),
    seed: int = 0,
    seeds: int = 1,
) -> Simulation:
    head = {"plant": plant, "controllers": controllers, "seed": seed, "seeds": seeds}
    return Simulation(scenario.load("rect", SHORT + overrides, head))


@cache
def run(
    plant: str,
    overrides: tuple[str, ...] = (),
    controllers: tuple[str, ...] = ("flc", "comp-flc"),
    seed: int = 0,
    seeds: int = 1,
) -> Trajectory:
    simulated = simulation(plant, overrides, controllers, seed, seeds)
    simulated.run()
    return simulated.trajectory


def ages(trajectory: Trajectory) -> NDArray:
    """How many frames ago what is applied was commanded (frames, controllers, seeds); k + 1 for nothing in frame k."""
    command, applied = (trajectory.channel(name) for name in ("command", "applied"))
    sent = np.concatenate([np.zeros_like(command[:1]), command])  # 0 is what is applied before anything arrives
    same = (sent[None] == applied[:, None]).all(-1)
    assert (same.sum(1) == 1).all(), "noisy commands, no two of which are equal"
    return np.arange(1, len(command) + 1)[:, None, None] - same.argmax(1)
