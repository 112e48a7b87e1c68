"""Consistency of the tracker: innovations and errors compared with its covariances."""

from dataclasses import dataclass

import numpy as np
import pytest
from benches.short_simulations import Simulation, scenario
from numpy.typing import NDArray

GAPS = ("vision.dropout_fraction=0.2", "vision.mean_dropout_frames=10")
CORNER = (
    "reference.waypoints=[[-1, -0.75, 0], [0, -0.75, 0], [0, 0, 1.5]]",
    "reference.settle_s=0.5",
    "wheels.model=two-rollers",
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
    "mujoco, gaps": ("rect", "mujoco", 3, (*CORNER, *GAPS)),
}


@dataclass
class Certainty:
    """Return normalized innovations, pose errors and sigma, shape (frames, n, 3)."""

    innovation: NDArray
    error: NDArray
    sigma: NDArray
    frames_since_detection: NDArray  # (frames, n): for how many frames the robot has not been seen


@pytest.fixture(scope="module", params=CASES)
def certainty(request: pytest.FixtureRequest) -> Certainty:
    name, plant, seeds, overrides = CASES[request.param]
    head = {"plant": plant, "seeds": seeds, "controllers": ("comp-flc",)}
    simulation = Simulation(scenario.load_with_overrides(name, overrides, head))
    kalman, states = simulation.team.filter, []
    log = simulation.run(
        lambda frame: states.append(
            (kalman.normalized_innovation.copy(), kalman.pose.copy(), kalman.sigma.copy())
        )
    )
    innovation, pose, sigma = (np.array(values) for values in zip(*states, strict=True))
    is_detected = log.channel("vision_valid")[..., 0]
    frames_since_detection = np.zeros(is_detected.shape, int)
    for k in range(1, len(is_detected)):
        frames_since_detection[k] = np.where(is_detected[k], 0, frames_since_detection[k - 1] + 1)
    return Certainty(innovation, pose - log.channel("pose"), sigma, frames_since_detection)


def test_normalized_squared_innovations_have_mean_one(certainty: Certainty) -> None:
    """The mean is 1 for a filter with the right covariance.

    Some thousand innovations of white noise average to 1 within 5 sqrt(2 / 1000) = 0.2 per axis.
    The filter errs on the side of caution at rest, where its process noise is at the lowest bound
    (heading: 0.9), and is surprised by each change of what disturbs the robot.
    """
    squared = np.nanmean(certainty.innovation**2, (0, 1))
    assert (squared > 0.8).all()
    assert (squared < 1.2).all()


def test_pose_errors_agree_with_sigma(certainty: Certainty) -> None:
    """Squared pose errors over the variances: about 1; few errors exceed three sigmas."""
    normalised = certainty.error / certainty.sigma
    squared = (normalised**2).mean((0, 1))
    # The errors of neighbouring frames are related: some hundred independent ones, 5 sqrt(2 / 100)
    # = 0.7.
    assert (squared > 0.5).all()
    assert (squared < 1.5).all()
    assert (np.abs(normalised) < 3).mean() > 0.99  # 0.997 of a normal distribution
