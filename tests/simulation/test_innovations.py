"""The filter of the loop on both plants: how large its innovations and errors are, against what it says of them."""

from dataclasses import dataclass

import numpy as np
import pytest
from benches.simulating import Simulation, scenario
from numpy.typing import NDArray

GAPS = ("vision.miss_probability=0.02", "vision.miss_frames=10")
CORNER = (
    "reference.waypoints=[[-1, -0.75, 0], [0, -0.75, 0], [0, 0, 1.5]]",
    "reference.settle_s=0.5",
    "physics.backend=numpy",
)
CASES = {
    "kinematic": ("rect", "kinematic", 10, ()),
    "kinematic, alpha anew in each frame": (
        "rect",
        "kinematic",
        10,
        ("kinematic.alpha_correlation_time_s=0",),
    ),
    "kinematic, disturbance": ("rect-noise", "kinematic", 10, ()),
    "kinematic, gaps": ("rect", "kinematic", 10, GAPS),
    "mujoco": ("rect", "mujoco", 3, CORNER),
    "mujoco, gaps": ("rect", "mujoco", 3, (*CORNER, *GAPS, "wheels.model=two-rollers")),
}


@dataclass
class Certainty:
    """Per frame, robot and axis (frames, n, 3): normalised innovations, errors of the pose, and sigma."""

    innovation: NDArray
    error: NDArray
    sigma: NDArray
    unseen: NDArray  # (frames, n): for how many frames the robot has not been seen


@pytest.fixture(scope="module", params=CASES)
def certainty(request: pytest.FixtureRequest) -> Certainty:
    name, plant, seeds, overrides = CASES[request.param]
    head = {"plant": plant, "seeds": seeds, "controllers": ("comp-flc",)}
    simulation = Simulation(scenario.load_with_overrides(name, overrides, head))
    kalman, said = simulation.team.filter, []
    log = simulation.run(
        lambda frame: said.append(
            (kalman.normalized_innovation.copy(), kalman.pose.copy(), kalman.sigma.copy())
        )
    )
    innovation, pose, sigma = (np.array(values) for values in zip(*said, strict=True))
    seen = log.channel("vision_valid")[..., 0]
    unseen = np.zeros(seen.shape, int)
    for k in range(1, len(seen)):
        unseen[k] = np.where(seen[k], 0, unseen[k - 1] + 1)
    return Certainty(innovation, pose - log.channel("pose"), sigma, unseen)


def test_the_innovations_squared_average_one(certainty: Certainty) -> None:
    """Normalised innovations squared: 1 for a filter that is as sure as it may be.

    Some thousand innovations of white noise average to 1 within 5 sqrt(2 / 1000) = 0.2 per axis.
    The filter errs on the side of caution at rest, where its process noise is at the lowest bound
    (heading: 0.9), and is surprised by each change of what disturbs the robot.
    """
    squared = np.nanmean(certainty.innovation**2, (0, 1))
    assert (squared > 0.8).all()
    assert (squared < 1.2).all()


def test_the_errors_are_covered_by_sigma(certainty: Certainty) -> None:
    """Errors of the pose, squared, over what the filter says: about 1 seen or not, and few beyond three sigmas."""
    normalised = certainty.error / certainty.sigma
    squared = (normalised**2).mean((0, 1))
    # The errors of neighbouring frames are related: some hundred independent ones, 5 sqrt(2 / 100)
    # = 0.7.
    assert (squared > 0.5).all()
    assert (squared < 1.5).all()
    assert (np.abs(normalised) < 3).mean() > 0.99  # 0.997 of a normal distribution
