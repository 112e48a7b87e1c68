"""What a camera shows that is frozen, confused, knocked or late: against what there was to see."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from omni_mj.link.late_camera import camera

from omni_mj.link.camera import Camera
from omni_mj.scenarios.faults import KINDS, Fault
from omni_mj.scenarios.settings import VisionSettings

FRAME_S, SIGMAS, FRAMES = 1 / 60, 5, 80
TWIST = np.array([0.6, -1.2, 2.0])
SHARP = {"position_noise_m": 0.0, "heading_noise_rad": 0.0, "miss_probability": 0.0}
EACH: dict[str, dict[str, Any]] = {
    "vision-out": {},
    "vision-freeze": {},
    "vision-mirrored": {},
    "vision-wrong-id": {"x_m": 1.5, "y_m": -0.5, "heading_deg": 30.0},
    "vision-bias": {"x_m": 0.05, "y_m": -0.02, "heading_deg": 5.0},
    "vision-clock": {"ms_per_s": 20.0},
    "vision-jitter": {"s": 0.05},
    "vision-delay": {"to": 0.06},
}


def made(kind: str, start: int = 0, lasts: int = 0, **values: Any) -> Fault:
    return KINDS[kind](kind=kind, at=start * FRAME_S, **{"for": lasts * FRAME_S}, **values)


def poses(frames: int = FRAMES) -> NDArray:
    """Of a robot that keeps its twist, (frames, 3)."""
    return np.arange(frames)[:, None] * FRAME_S * TWIST


def wrapped(angle: Any) -> Any:
    return np.angle(np.exp(1j * angle))


def shown(*robots: list[Fault], frames: int = FRAMES, seed: int = 2, believed: float = 1.0, **vision: Any) -> NDArray:
    """What is seen of such robots, (frames, n, 3), carried on from when that was with a share of their twist."""
    settings, n = [VisionSettings(**{**SHARP, **vision})] * len(robots), len(robots)
    look = camera(settings, [(seed,)] * n, robots)
    found = []
    for pose in poses(frames):
        measured, seen = look(np.tile(pose, (n, 1)))
        np.testing.assert_array_equal(seen, ~np.isnan(measured[:, 0]))
        found.append(measured if look.age is None else measured + look.age[:, None] * believed * TWIST)
    return np.array(found)


def assert_poses(found: NDArray, expected: NDArray) -> None:
    np.testing.assert_allclose(found[:, :2], expected[:, :2], atol=1e-12)
    np.testing.assert_allclose(wrapped(found[:, 2] - expected[:, 2]), 0, atol=1e-12)


def test_a_frozen_camera_shows_its_last_image_with_its_noise() -> None:
    """What it missed then, or when it is frozen from the start, it does not show."""
    got = shown([made("vision-freeze", 20, 15)], [made("vision-freeze", 0, 5)], position_noise_m=0.01)
    np.testing.assert_array_equal(got[19:35, 0], np.tile(got[19, 0], (16, 1)))
    assert np.isnan(got[:5, 1]).all()
    assert (np.diff(got[5:, 1, 0]) != 0).all()


def test_a_mirrored_heading_is_half_a_turn_off_as_often_as_said() -> None:
    """All else is as it is."""
    frames, share = 1000, 0.25
    all_of_them, some = [made("vision-mirrored", 10, 30)], [made("vision-mirrored", probability=share)]
    got, true = shown(all_of_them, some, frames=frames), poses(frames)
    off = np.abs(wrapped(got[..., 2] - true[:, None, 2]))
    np.testing.assert_allclose(off[:, 0], np.pi * ((np.arange(frames) >= 10) & (np.arange(frames) < 40)), atol=1e-9)
    assert (off[:, 1] > 3).mean() == pytest.approx(share, abs=SIGMAS * np.sqrt(share * (1 - share) / frames))
    np.testing.assert_allclose(got[..., :2], np.tile(true[:, None, :2], (1, 2, 1)), atol=1e-12)


def test_another_that_is_taken_for_the_robot_is_where_it_stands() -> None:
    got = shown([made("vision-wrong-id", 10, 20, **EACH["vision-wrong-id"])])[:, 0]
    expected = poses()
    expected[10:30] = 1.5, -0.5, np.radians(30)
    assert_poses(got, expected)


def test_biases_of_a_camera_add_up() -> None:
    one, other = made("vision-bias", 5, 40, x_m=0.1, heading_deg=170.0), made("vision-bias", 20, x_m=-0.03, y_m=0.2)
    expected = poses()
    expected[5:45] += 0.1, 0, np.radians(170)
    expected[20:] += -0.03, 0.2, 0
    assert_poses(shown([one, other])[:, 0], expected)


def test_a_clock_that_loses_has_robots_carried_too_far() -> None:
    """By twist times the time by which images are said to be older: that since the fault began times its rate."""
    rate, start, end = 0.05, 12, 60
    clock = made("vision-clock", start, end - start, ms_per_s=1000 * rate)
    expected, frame = poses(), np.arange(FRAMES)
    error = np.where((frame >= start) & (frame < end), rate * (frame - start) * FRAME_S, 0.0)
    assert_poses(shown([clock])[:, 0], expected + error[:, None] * TWIST)
    assert_poses(shown([clock], believed=0.0)[:, 0], expected)


def test_images_that_are_late_are_as_old_as_said() -> None:
    """Of a robot believed to stand the pose is that of then; a team that knows its twist has it carried to now."""
    late = made("vision-delay", 20, 30, to=4 * FRAME_S)
    got, true = shown([late], believed=0.0)[:, 0], poses()
    assert_poses(got[:20], true[:20])
    assert np.isnan(got[20:24]).all()
    assert_poses(got[24:50], true[20:46])  # until fresh ones overtake those that are on their way
    assert_poses(got[50:], true[50:])
    known = shown([late])[:, 0]
    seen = ~np.isnan(known[:, 0])
    assert_poses(known[seen], true[seen])


def test_jitter_makes_images_up_to_so_late() -> None:
    most = 3
    got = shown([made("vision-jitter", s=most * FRAME_S)], frames=400, believed=0.0)[:, 0]
    age = np.arange(400) - got[:, 0] / (TWIST[0] * FRAME_S)
    known = ~np.isnan(age)
    assert age[known].min() >= -1e-9
    assert 2 < age[known].max() <= most + 1e-9
    assert 0.3 < known.mean() < 1


@pytest.mark.parametrize(("kind", "values"), EACH.items())
def test_a_fault_that_is_over_leaves_the_camera_as_it_was_and_concerns_no_other_row(
    kind: str, values: dict[str, Any]
) -> None:
    """To the bit, with noise and misses; that of a row beside it is the camera of those to whom nothing happens."""
    one = made(kind, 20, 25, **values)
    noisy = {"position_noise_m": 0.01, "heading_noise_rad": 0.02, "miss_probability": 0.1}
    beside, met = np.moveaxis(shown([], [one], **noisy), 1, 0)
    np.testing.assert_array_equal(beside, shown([], **noisy)[:, 0])
    np.testing.assert_array_equal(met, shown([one], **noisy)[:, 0])
    np.testing.assert_array_equal(met[:20], beside[:20])
    np.testing.assert_array_equal(met[50:], beside[50:])
    assert (met[20:45] != beside[20:45]).any()
    alone = Camera([VisionSettings(**noisy)], [(2,)])
    np.testing.assert_array_equal(beside, [alone(pose[None])[0][0] for pose in poses()])
