"""Cameras: what each sees, when, how late; and what SSL-Vision says of them and the field."""

from pathlib import Path

import numpy as np
import pytest
from benches.serve import FAST, QUIET, Field, here
from serve_client import local

from omni_mj.network.camera_calibration import CameraErrors

CYCLE_S = 1 / 960
FAULTS = """
[[fault]]
kind = "firmware-timeout"
start_s = 0.2
robots = [3]

[[fault]]
kind = "vision-bias"
start_s = 0.0
robots = [1]
x_m = 0.25

[[fault]]
kind = "vision-clock-drift"
start_s = 0.0
drift_ms_per_s = 50.0

[[fault]]
kind = "vision-delay"
start_s = 0.0
delay_s = 0.1
"""


def test_each_camera_takes_images_by_a_clock_of_its_own() -> None:
    """Images come at the camera's rate from its own phase. Time stamps are of its own clock."""
    sets = "vision.cameras=4", "vision.rate_hz=75", "vision.clock_offset_s=0.5"
    taken = Field(*QUIET, FAST, *sets).cycles(480)
    begins, offsets = [], []
    for number in range(4):
        images = [image for image in taken if image.detection.camera_id == number]
        times = np.array([image.cycle for image in images]) * CYCLE_S
        assert [image.detection.frame_number for image in images] == list(range(len(times)))
        assert len(times) in (37, 38)
        late = times - np.arange(len(times)) / 75
        assert np.ptp(late) <= CYCLE_S + 1e-9
        begins.append(late.min())
        stamps = np.array([image.detection.t_capture for image in images])
        np.testing.assert_allclose(stamps - times, stamps[0] - times[0], atol=1e-9)
        offsets.append(stamps[0] - times[0])
    assert begins[0] == pytest.approx(0, abs=1e-9)
    assert len({round(begin / CYCLE_S) for begin in begins}) >= 3  # drawn from a dozen cycles
    assert max(begins) < 1 / 75 + CYCLE_S
    assert len({round(offset, 6) for offset in offsets}) == 4
    assert max(map(abs, offsets)) < 4 * 0.5


def test_cameras_that_see_a_robot_differ_by_how_they_are_set_up_and_their_noise() -> None:
    """A robot at rest between four cameras: mean errors are offsets, deviations are the noise."""
    offset, noise = 0.02, 0.002
    sets = (
        "vision.cameras=4",
        f"vision.camera_offset_m={offset}",
        f"vision.position_noise_m={noise}",
        FAST,
    )
    bench = Field(*QUIET[1:], *sets)
    assert bench.put(0, 0.05, -0.05, 0.0) == []
    taken = bench.cycles(2880)
    by_camera = [
        [i.poses[0, :2] for i in taken if i.detection.camera_id == number][:170]
        for number in range(4)
    ]
    seen = np.array(by_camera)
    assert np.isfinite(seen).all()
    errors = seen.mean(1) - bench.poses[0, :2]
    # 8 numbers of deviation `offset`: none beyond 4 of it; not all alike. The mean of 170 is off by
    # noise / 13.
    assert np.abs(errors).max() < 4 * offset
    assert np.ptp(errors, axis=0).min() > 10 * noise / 13
    np.testing.assert_allclose(seen.std(1), noise, rtol=5 / np.sqrt(2 * 170))


def test_cameras_have_the_calibration_errors_of_run() -> None:
    """Each at the robot's position; two cameras that detect it differ."""
    sets = "vision.cameras=2", "vision.calibration_error_m=0.02", "vision.camera_offset_m=0.01"
    bench = Field(*QUIET, FAST, *sets)
    assert bench.put(0, 0.05, -0.05, 0.0) == []
    calibrated = CameraErrors([bench.pitch.rows[0].settings], [(bench.pitch.rows[0].seed,)])
    errors = []
    for image in bench.cycles(64):
        pose = bench.poses[0, :2]
        errors.append(calibrated(pose[None], image.detection.camera_id)[0])
        np.testing.assert_allclose(image.poses[0, :2] - pose, errors[-1], atol=1e-4)
    assert np.abs(np.diff(np.unique(errors, axis=0), axis=0)).min() > 1e-3


def test_faults_concern_the_robots_whose_numbers_they_name_and_cameras_as_a_whole(
    tmp_path: Path,
) -> None:
    """One robot is measured elsewhere, the other frozen; time stamps drift by the clock's rate."""
    file = tmp_path / "served.toml"
    file.write_text(FAULTS, encoding="utf-8")
    bench = Field(*QUIET, FAST, "radio.delay_frames=0", blue="1,3", scenario=str(file))
    errors = []
    while bench.time_s < 0.6:
        for image in bench.look():
            time_s = image.cycle * CYCLE_S
            assert image.detection.t_capture == pytest.approx(0.95 * time_s, abs=1e-6)
            assert image.sent_s == pytest.approx(time_s + 0.1)
            errors.append(image.poses[0, 0] - bench.poses[0, 0])
        bench.drive(1, local(1, 0.5) + local(3, 0.5))
    np.testing.assert_allclose(errors, 0.25, atol=1e-9)
    speeds = np.hypot(*bench.twists[:, :2].T)
    assert speeds[0] > 0.3
    assert speeds[1] < 0.02
    assert (
        bench.put(7, 2.0, 2.0, 0.0) == []
    )  # the world is made anew, and times of faults count from then
    (image,) = bench.look()
    assert image.detection.t_capture == pytest.approx(bench.time_s)


@pytest.mark.parametrize(
    ("sets", "dimensions_mm"),
    [
        ((), (9000, 6000, 700, 1000, 1000, 2000)),
        (
            ("world.field_length_m=12", "world.field_width_m=9", "world.field_margin_m=0.3"),
            (12000, 9000, 300, 1800, 1800, 3600),
        ),
    ],
    ids=["division B", "division A"],
)
def test_the_geometry_is_that_of_a_division(
    sets: tuple[str, ...], dimensions_mm: tuple[int, ...]
) -> None:
    """Rules: goals of 1 or 1.8 m, defense areas of 2 m x 1 m or 3.6 m x 1.8 m."""
    with here(Field(*QUIET, FAST, "vision.cameras=3", *sets)) as (client, _):
        geometry = client.packet("geometry").geometry
    size = geometry.field
    assert dimensions_mm == (
        size.field_length,
        size.field_width,
        size.boundary_width,
        size.goal_width,
        size.penalty_area_depth,
        size.penalty_area_width,
    )
    lines = {line.name: (line.p1.x, line.p1.y, line.p2.x, line.p2.y) for line in size.field_lines}
    assert len(lines) == 12
    x, y, depth, half_width = np.array(dimensions_mm)[[0, 1, 4, 5]] * [0.5, 0.5, 1, 0.5]
    assert lines["TopTouchLine"] == (-x, y, x, y)
    assert lines["RightGoalLine"] == (x, -y, x, y)
    assert lines["RightPenaltyStretch"] == (x - depth, -half_width, x - depth, half_width)
    assert [camera.camera_id for camera in geometry.calib] == [0, 1, 2]
    # SSL-Vision's pinhole: turned by half a turn about x, (x, y, z) is (x + tx, -y + ty, tz) for
    # the camera.
    middles = [-camera.tx for camera in geometry.calib]
    carpet_length = size.field_length + 2 * size.boundary_width
    np.testing.assert_allclose(
        middles, [-carpet_length / 3, 0, carpet_length / 3], rtol=1e-6, atol=1e-6
    )


@pytest.mark.parametrize("jitter_s", [0.0, 0.02])
def test_images_are_sent_after_the_delay_of_their_camera(jitter_s: float) -> None:
    """The stamps differ by the delay and up to the jitter, also of a camera with a wrong clock."""
    sets = "vision.delay_s=0.03", f"vision.jitter_s={jitter_s}", "vision.clock_offset_s=0.5"
    images = Field(*QUIET, FAST, *sets, "vision.cameras=2").cycles(480)
    stamps = [(image.detection.t_sent, image.detection.t_capture) for image in images]
    ages = -np.diff(stamps)[:, 0]
    assert ages.min() >= 0.03 - 1e-9
    assert ages.max() <= 0.03 + jitter_s + 1e-9
    assert ages.std() == pytest.approx(jitter_s / np.sqrt(12), rel=0.3)
