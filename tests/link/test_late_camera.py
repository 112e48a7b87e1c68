"""A camera with a clock of its own: what arrives when, of what age, and what a team makes of it."""

import compiled
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from omni_mj.link.late_camera import LateCamera, camera

from omni_mj.link.camera import Camera
from omni_mj.scenarios import scenario
from omni_mj.scenarios.settings import VisionSettings
from omni_mj.simulate.simulation import Simulation

PERIOD_S = 1 / 60
QUIET = {"position_noise_m": 0.0, "heading_noise_rad": 0.0, "miss_probability": 0.0}
TWIST = np.array([[1.0, -2.0, 3.0]])  # a robot that goes on like this is where it was plus this times the time


def quiet(**timing: float) -> VisionSettings:
    return VisionSettings(**QUIET, **timing)


def seen_by(vision: VisionSettings, frames: int, seed: int = 0) -> tuple[NDArray, NDArray]:
    """What a camera shows of a robot that keeps its twist, (frames, 3), and of what age, (frames,) s."""
    look = LateCamera([vision], [(seed,)], [()])
    seen = [(look(k * PERIOD_S * TWIST)[0][0], look.age[0]) for k in range(frames)]
    return np.array([pose for pose, _ in seen]), np.array([age for _, age in seen])


def truth(frames: int, age: NDArray | float = 0.0) -> NDArray:
    """Where it was so long before each frame."""
    poses = (np.arange(frames) * PERIOD_S - age)[:, None] * TWIST
    poses[:, 2] -= 2 * np.pi * np.ceil(poses[:, 2] / (2 * np.pi) - 0.5)
    return poses


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.floats(10, 300), st.floats(0, 0.2), st.floats(0, 0.1))
def test_whatever_arrives_was_so_at_its_age(rate: float, delay: float, jitter: float) -> None:
    """A straight motion: interpolated, it is the truth of that time but for rounding; what is not seen has no age."""
    seen, age = seen_by(quiet(rate_hz=rate, delay_s=delay, jitter_s=jitter), 60)
    known = ~np.isnan(seen[:, 0])
    assert known.any()
    np.testing.assert_allclose(np.exp(1j * (seen - truth(60, age))[known, 2]), 1, atol=1e-12)
    np.testing.assert_allclose(seen[known, :2], truth(60, age)[known, :2], atol=1e-12)
    assert (age >= 0).all()
    assert (age[~known] == 0).all()


@pytest.mark.parametrize(("rate", "share"), [(20.0, 1 / 3), (40.0, 2 / 3), (60.0, 1.0), (150.0, 1.0)])
def test_a_slow_camera_is_silent_at_some_ticks(rate: float, share: float) -> None:
    assert np.isfinite(seen_by(quiet(rate_hz=rate), 120)[0][:, 0]).mean() == pytest.approx(share, abs=0.01)


@pytest.mark.parametrize("delay", [1, 4])
def test_a_late_image_is_where_the_robot_was(delay: int) -> None:
    """With a delay of k frames, the pose k frames ago; before the first arrives, none."""
    seen, age = seen_by(quiet(delay_s=delay * PERIOD_S), 40)
    np.testing.assert_allclose(age[delay:], delay * PERIOD_S, atol=1e-12)
    assert np.isnan(seen[:delay]).all()
    np.testing.assert_allclose(seen[delay:], truth(40)[:-delay], atol=1e-12)


def test_images_are_lost_as_often_as_said() -> None:
    """Five deviations of a binomial share."""
    share = np.isnan(seen_by(quiet(loss_probability=0.3), 2000)[0][:, 0]).mean()
    assert share == pytest.approx(0.3, abs=5 * np.sqrt(0.3 * 0.7 / 2000))


def test_jitter_delays_up_to_as_much_as_said_and_never_shows_an_older_image_after_a_newer_one() -> None:
    seen = seen_by(quiet(jitter_s=3 * PERIOD_S), 300)[0][:, 0]
    age = np.arange(300) - seen / (TWIST[0, 0] * PERIOD_S)  # frames
    known = ~np.isnan(age)
    assert age[known].min() >= -1e-9
    assert age[known].max() <= 3 + 1e-9
    assert (np.diff(seen[known]) > 0).all()
    assert 0.3 < known.mean() < 1  # several come at a tick, and at others none


def test_by_default_it_is_the_camera_there_always_was_and_rows_are_what_they_are_alone() -> None:
    assert isinstance(camera([VisionSettings()] * 3, [(0,)] * 3, [()] * 3), Camera)
    noisy = [VisionSettings(rate_hz=rate, delay_s=0.03, loss_probability=0.2) for rate in (30, 60, 90)]
    seeds: list[tuple[int, ...]] = [(0,), (1,), (0,)]
    together = camera(noisy, seeds, [()] * 3)
    alone = [camera([one], [seed], [()]) for one, seed in zip(noisy, seeds, strict=True)]
    for k in range(30):
        poses = k * 0.01 * np.ones((3, 3))
        both, each = together(poses), [look(poses[[i]]) for i, look in enumerate(alone)]
        np.testing.assert_array_equal(both[0], np.concatenate([one for one, _ in each]))
        np.testing.assert_array_equal(both[1], np.concatenate([seen for _, seen in each]))
        np.testing.assert_array_equal(together.age, [look.age[0] for look in alone])  # type: ignore[index]


def test_the_loop_runs_with_any_camera_and_a_late_one_costs_accuracy() -> None:
    """On the kinematic plant; errors grow, but not by much."""
    errors = []
    for vision in ({}, {"rate_hz": 75.0, "delay_s": 0.03, "jitter_s": 0.005, "loss_probability": 0.02}):
        chosen = scenario.scenario("rect", plant="kinematic", controllers=["comp-flc"], vision=vision)
        log = Simulation(chosen).run()
        errors.append(np.hypot(*(log.channel("pose") - log.channel("ref"))[:, 0, :2].T).max())
    assert errors[0] < errors[1] < 3 * errors[0]


@pytest.mark.parametrize("vision", [{"rate_hz": 58.8}, {"rate_hz": 58.8, "delay_s": 0.016}, {"delay_s": 0.05}], ids=str)
def test_of_a_robot_that_does_as_told_late_images_are_as_good_as_any(vision: dict[str, float]) -> None:
    """Without noise, and where each frame's command is all that moves a robot, where it was says where it is.

    An image between frames is of a straight line, as the filter's robot drives. What is left are hundredths of a
    millimetre, of the frames before the first image.
    """
    chosen = scenario.scenario(
        "rect", plant="kinematic", controllers=["comp-flc"], vision={**QUIET, **vision}, radio={"delay_frames": 1},
        kinematic={"alpha_low": 1.0, "alpha_high": 1.0}, reference={"waypoints": [[0, 0], [1, 0.5], [0, 0]]},
    )  # fmt: skip
    log = Simulation(chosen).run()
    assert np.abs(log.channel("pose") - log.channel("ref")).max() < 1e-4


def test_on_wheels_that_creep_late_images_cost_millimetres() -> None:
    """Images of 50 ms ago, without noise, on the planar plant: adaptive's 4 mm of rect may become 8.

    Who carries them on by his own velocity and takes that for seen strays by metres here.
    """
    compiled.once("planar")
    chosen = scenario.scenario(
        "rect",
        plant="planar",
        controllers=["adaptive-comp-flc"],
        vision={**QUIET, "delay_s": 0.05},
        physics={"kernel": "numpy"},
    )
    log = Simulation(chosen).run()
    assert np.hypot(*(log.channel("pose") - log.channel("ref"))[:, 0, :2].T).max() < 0.008
