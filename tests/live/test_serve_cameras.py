"""Cameras: what each sees, when, how late; and what SSL-Vision says of them and the field."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from served import FAST, QUIET, drive, local, pitch_of

from omni_mj.live.serve.cameras import Image
from omni_mj.live.serve.field import Area, areas, standard, surface
from omni_mj.live.serve.pitch import Pitch
from omni_mj.live.wire import decode, encode
from omni_mj.live.wire.vision import Geometry

CYCLE_S = 1 / 960


def images(pitch: Pitch, seconds: float) -> list[Image]:
    """All that are taken in a while in which nothing moves."""
    found = pitch.look()
    for _ in range(round(seconds / CYCLE_S)):
        pitch.step()
        found += pitch.look()
    return found


def test_each_camera_takes_images_by_a_clock_of_its_own() -> None:
    """At its rate from its own beginning, to the cycle; the first one from 0."""
    pitch = pitch_of(*QUIET, FAST, "vision.cameras=4", "vision.rate_hz=75")
    taken = images(pitch, 0.5)
    begins = []
    for number in range(4):
        times = [image.cycle * CYCLE_S for image in taken if image.camera == number]
        assert [image.frame for image in taken if image.camera == number] == list(range(len(times)))
        assert len(times) in (37, 38)
        late = np.array(times) - np.arange(len(times)) / 75
        assert np.ptp(late) <= CYCLE_S + 1e-9
        begins.append(late.min())
    assert begins[0] == pytest.approx(0, abs=1e-9)
    assert len({round(begin / CYCLE_S) for begin in begins}) >= 3  # drawn from a dozen cycles
    assert max(begins) < 1 / 75 + CYCLE_S


@settings(deadline=None, max_examples=60, derandomize=True)
@given(st.integers(1, 4), st.floats(0.01, 2), st.floats(-5.2, 5.2), st.floats(-3.7, 3.7))
def test_every_place_is_seen_by_a_camera_and_overlaps_by_two(cameras: int, overlap: float, x: float, y: float) -> None:
    whole = surface(standard())
    seen = [bool(area.sees(np.array([[x, y]]))[0]) for area in areas(cameras, whole, overlap)]
    assert any(seen)
    if cameras == 2:
        assert all(seen) == (abs(x) <= overlap / 2) or abs(abs(x) - overlap / 2) < 1e-12
    middle = sum(bool(area.sees(np.zeros((1, 2)))[0]) for area in areas(cameras, whole, overlap))
    assert middle == {1: 1, 2: 2, 3: 1, 4: 4}[cameras]


def test_cameras_that_see_a_robot_differ_by_how_they_are_set_up_and_their_noise() -> None:
    """A robot in the middle of four, at rest: the mean of what each sees is its own offset, the deviation the noise."""
    offset, noise = 0.02, 0.002
    sets = "vision.cameras=4", f"vision.camera_offset_m={offset}", f"vision.position_noise_m={noise}", FAST
    pitch = pitch_of(*QUIET[1:], *sets)
    assert pitch.place({pitch.names[0]: (np.array([0.05, -0.05, 0.0]), np.zeros(3))}, set()) == []
    taken = images(pitch, 3.0)
    seen = np.array([[image.poses[0, :2] for image in taken if image.camera == number][:170] for number in range(4)])
    assert np.isfinite(seen).all()
    apart = seen.mean(1) - pitch.plant.pose()[0, :2]
    # 8 numbers of deviation `offset`: none beyond 4 of it; not all alike. The mean of 170 is off by noise / 13.
    assert np.abs(apart).max() < 4 * offset
    assert np.ptp(apart, axis=0).min() > 10 * noise / 13
    np.testing.assert_allclose(seen.std(1), noise, rtol=5 / np.sqrt(2 * 170))


def test_what_is_sent_late_or_never_is_as_said() -> None:
    """Delay and jitter are uniform above the delay; losses a binomial share, within five deviations."""
    sets = "vision.delay_s=0.02", "vision.jitter_s=0.01", "vision.loss_probability=0.2", "vision.rate_hz=480"
    taken = images(pitch_of(*QUIET, FAST, *sets), 1.5)
    late = np.array([image.sent - image.cycle * CYCLE_S for image in taken])
    lost = np.isinf(late)
    assert lost.mean() == pytest.approx(0.2, abs=5 * np.sqrt(0.2 * 0.8 / len(late)))
    kept = late[~lost]
    assert 0.02 <= kept.min() < 0.021
    assert 0.029 < kept.max() <= 0.03


def test_stamps_are_of_each_camera_s_own_clock() -> None:
    pitch = pitch_of(*QUIET, FAST, "vision.cameras=2", "vision.clock_offset_s=0.5")
    offsets = set()
    for image in images(pitch, 0.1):
        said = pitch.detection(image, 100.0)
        offsets.add((image.camera, round(said.t_capture - 100.0 - image.cycle * CYCLE_S, 9)))
        assert said.t_sent == pytest.approx(said.t_capture)
    assert len(offsets) == 2
    assert len({offset for _, offset in offsets}) == 2


def test_a_fault_hides_robots_from_all_cameras_at_its_time() -> None:
    pitch = pitch_of(FAST, "vision.cameras=2", "vision.miss_probability=0", scenario="fault-vision")
    (fault,) = pitch.rows[0].settings.fault
    begins, seen = fault.at, []
    while pitch.time_s < begins + 0.2:
        drive(pitch, 1, local(0, 0.0))
        for image in pitch.look():
            seen.append((image.cycle * CYCLE_S, not np.isnan(image.poses[0, 0])))
    assert not any(known for time, known in seen if begins < time < begins + fault.for_)


def test_the_geometry_is_that_of_division_b_and_survives_the_wire() -> None:
    """Rules: 9 x 6 m, 0.7 m around, goals of 1 m, defence areas of 2 x 1 m; every camera's pixels are in its image."""
    pitch = pitch_of(FAST, "vision.cameras=3")
    said = decode(Geometry, encode(pitch.geometry()))
    field = said.field
    assert (field.field_length, field.field_width, field.boundary_width) == (9.0, 6.0, 0.7)
    assert (field.goal_width, field.penalty_area_width, field.penalty_area_depth) == (1.0, 2.0, 1.0)
    assert len(field.field_lines) == 12
    assert len({line.name for line in field.field_lines}) == 12
    assert [camera.camera_id for camera in said.calib] == [0, 1, 2]
    area = Area(np.array([1.0, -0.5]), np.array([2.0, 1.5]))
    camera = area.calibration(0)
    for x, y in ((-1.0, -2.0), (3.0, 1.0), (1.0, -0.5)):
        # SSL-Vision's pinhole: turned by half a turn about x, (x, y, z) is (x + tx, -y + ty, tz) for the camera.
        place = x + camera.tx, -y + camera.ty
        middle = camera.principal_point_x, camera.principal_point_y
        expected = [c + camera.focal_length * p / camera.tz for c, p in zip(middle, place, strict=True)]
        assert area.pixel(x, y) == pytest.approx(expected)
        assert 0 <= area.pixel(x, y)[0] <= 1920
        assert 0 <= area.pixel(x, y)[1] <= 1200
