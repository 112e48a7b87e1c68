"""The camera: statistics of noise and misses, delayed images with their own clock, faults."""

import math
from typing import Any

import numpy as np
import pytest
from benches.camera_and_radio import FRAME_S, SHARP, make_fault, measure_poses
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

import omni_mj as om

FRAMES = 10_000
SIGMAS = 5  # of an estimate's own spread
TWIST = np.array([0.6, -1.2, 2.0])
NOISY = {"position_noise_m": 0.01, "heading_noise_rad": 0.02, "miss_probability": 0.1}


def resting_poses(frames: int, n: int = 1) -> NDArray:
    return np.zeros((frames, n, 3))


def moving_poses(frames: int, n: int = 1, age: NDArray | float = 0.0) -> NDArray:
    """Return the poses (frames, n, 3) of robots with constant twists, some time before a frame."""
    time = np.arange(frames)[:, None] * FRAME_S - age
    return np.broadcast_to(time[..., None] * TWIST, (frames, n, 3))


def assert_same_poses(values: NDArray, expected: NDArray) -> None:
    np.testing.assert_allclose(values[..., :2], expected[..., :2], atol=1e-12)
    np.testing.assert_allclose(np.exp(1j * (values - expected)[..., 2]), 1, atol=1e-12)


def test_noise_is_white_normal_and_independent_per_axis() -> None:
    measured, _ = measure_poses(
        resting_poses(FRAMES), position_noise_m=0.0013, heading_noise_rad=0.01, miss_probability=0.0
    )
    noise, max_correlation = measured[:, 0] / [0.0013, 0.0013, 0.01], SIGMAS / math.sqrt(FRAMES)
    assert all(stats.kstest(axis, "norm").pvalue > 6e-7 for axis in noise.T)
    for lag in (1, 2, 10):
        assert np.abs((noise[lag:] * noise[:-lag]).mean(0)).max() < max_correlation
    assert np.abs(np.corrcoef(noise.T)[np.triu_indices(3, 1)]).max() < max_correlation


def test_missed_detections_have_their_probability() -> None:
    """The first image is always measured."""
    probability = 0.02
    poses, _ = measure_poses(resting_poses(FRAMES), miss_probability=probability)
    measured = ~np.isnan(poses[..., 0])
    spread = math.sqrt(probability * (1 - probability) / FRAMES)
    assert 1 - measured.mean() == pytest.approx(probability, abs=SIGMAS * spread + 1 / FRAMES)
    assert measured[0].all()


def test_measurements_do_not_depend_on_the_batch_or_the_duration() -> None:
    """Noise depends on the row's own seed; misses, rates and delays of others do not matter."""
    settings = [
        {"rate_hz": rate, "delay_s": delay}
        for rate, delay in ((30, 0.0), (60, 0.03), (90, 0.0), (60, 0.0))
    ]
    seeds, common = [7, 8, 7, 7], {**NOISY, "loss_probability": 0.2}
    batch, ages = measure_poses(moving_poses(60, 4), seeds=seeds, visions=settings, **common)
    for row, (vision, seed) in enumerate(zip(settings, seeds, strict=True)):
        single, age = measure_poses(moving_poses(40), seeds=[seed], visions=[vision], **common)
        np.testing.assert_array_equal(batch[:40, [row]], single)
        np.testing.assert_array_equal(ages[:40, [row]], age)
    frequent_misses, no_misses = (
        measure_poses(resting_poses(200), miss_probability=p)[0] for p in (0.5, 0.0)
    )
    assert (np.isnan(frequent_misses) | (frequent_misses == no_misses)).all()


@given(st.floats(-10, 10), st.floats(-10, 10), st.floats(-100, 100))
def test_without_noise_measured_is_the_pose_with_wrapped_heading(
    x: float, y: float, heading: float
) -> None:
    measured, _ = measure_poses(np.array([[[x, y, heading]]]), **SHARP)
    assert abs(measured[0, 0, 2]) <= math.pi + 1e-13
    assert_same_poses(measured, np.array([[[x, y, heading]]]))


@given(st.floats(10, 300), st.floats(0, 0.2), st.floats(0, 0.1))
def test_images_show_the_pose_at_their_capture_time(
    rate: float, delay: float, jitter: float
) -> None:
    """For a straight motion, where interpolation is exact; a missed robot has the age 0."""
    measured, age = measure_poses(
        moving_poses(60), **SHARP, rate_hz=rate, delay_s=delay, jitter_s=jitter
    )
    is_measured = ~np.isnan(measured[..., 0])
    assert is_measured.any()
    assert_same_poses(measured[is_measured], moving_poses(60, 1, age)[is_measured])
    assert (age >= 0).all()
    assert (age[~is_measured] == 0).all()


@pytest.mark.parametrize(
    ("vision", "fraction"),
    [
        ({"rate_hz": 20.0}, 1 / 3),
        ({"rate_hz": 40.0}, 2 / 3),
        ({"rate_hz": 150.0}, 1),
        ({"loss_probability": 0.3}, 0.7),
    ],
    ids=str,
)
def test_images_arrive_at_the_rate_minus_losses(vision: dict[str, float], fraction: float) -> None:
    measured, _ = measure_poses(moving_poses(2000), **SHARP, **vision)
    assert np.isfinite(measured[..., 0]).mean() == pytest.approx(
        fraction, abs=SIGMAS * np.sqrt(0.25 / 2000)
    )


def test_jitter_is_bounded_and_images_arrive_in_order() -> None:
    for vision, faults in (
        ({"jitter_s": 3 * FRAME_S}, []),
        ({}, [make_fault("vision-jitter", jitter_s=3 * FRAME_S)]),
    ):
        measured, _ = measure_poses(moving_poses(300), [faults], **SHARP, **vision)
        age = np.arange(300) - measured[:, 0, 0] / (TWIST[0] * FRAME_S)  # frames
        is_measured = ~np.isnan(age)
        assert age[is_measured].min() >= -1e-9
        assert 2 < age[is_measured].max() <= 3 + 1e-9
        assert (np.diff(measured[is_measured, 0, 0]) > 0).all()
        assert 0.3 < is_measured.mean() < 1  # several come at a tick, and at others none


@pytest.mark.parametrize(
    "vision", [{"rate_hz": 58.8, "delay_s": 0.016}, {"delay_s": 0.05}], ids=str
)
def test_delayed_images_of_a_nominal_robot_lose_nothing(
    vision: dict[str, float],
) -> None:
    """Without noise or disturbances, the measured pose is the true pose."""
    result = om.run(
        om.load_scenario(
            "rect", plant="kinematic", vision=SHARP | vision, radio={"delay_frames": 1},
            kinematic={"alpha_low": 1.0, "alpha_high": 1.0},
            reference={"waypoints": [[0, 0], [1, 0.5], [0, 0]]},
        ),
        ["comp-flc"],
    )  # fmt: skip
    frames = result.frames()
    assert np.abs(np.subtract(frames["x_m"], frames["ref_x_m"])).max() < 1e-4


# Faults.


def measure_extrapolated(*robots: list[dict[str, Any]], frames: int = 80, **vision: Any) -> NDArray:
    """Return the measured poses of moving robots with faults, extrapolated by age and twist."""
    measured, age = measure_poses(
        moving_poses(frames, len(robots)), robots, seeds=[2] * len(robots), **{**SHARP, **vision}
    )
    return measured + age[..., None] * TWIST


def test_lost_vision_returns_nan_and_changes_no_other_noise() -> None:
    spans: list[list[dict[str, Any]]] = [[], [(10, 5)], [(40, 0)], [(0, 3), (20, 10), (25, 10)]]
    poses = measure_extrapolated(
        *([make_fault("vision-loss", *span) for span in row_spans] for row_spans in spans),
        miss_probability=0.1,
    )
    hidden = np.zeros((80, 4), bool)
    hidden[10:15, 1], hidden[40:, 2], hidden[:3, 3], hidden[20:35, 3] = True, True, True, True
    expected = np.where(hidden[..., None], np.nan, poses[:, :1])
    np.testing.assert_array_equal(poses, expected)


def test_frozen_vision_repeats_the_last_image() -> None:
    poses = measure_extrapolated(
        [make_fault("vision-freeze", 20, 15)],
        [make_fault("vision-freeze", 0, 5)],
        position_noise_m=0.01,
    )
    np.testing.assert_array_equal(poses[19:35, 0], np.tile(poses[19, 0], (16, 1)))
    assert np.isnan(poses[:5, 1]).all()
    assert (np.diff(poses[5:, 1, 0]) != 0).all()


def test_a_frozen_image_repeats_the_last_detected_pose() -> None:
    """The robot is not detected in the image before it."""
    fault = make_fault("vision-freeze", 20, 15)
    poses = measure_extrapolated([fault], miss_probability=0.5)[:, 0]
    detected = poses[:20][~np.isnan(poses[:20, 0])]
    assert np.isnan(poses[19, 0])
    np.testing.assert_array_equal(poses[20:35], np.tile(detected[-1], (15, 1)))


def test_biases_add_up_and_have_their_probability() -> None:
    """A bias of half a turn confuses front and back."""
    strong_bias, weak_bias = (
        make_fault("vision-bias", 5, 40, x_m=0.1, heading_deg=170.0),
        make_fault("vision-bias", 20, x_m=-0.03, y_m=0.2),
    )
    expected = np.array(moving_poses(80)[:, 0])
    expected[5:45] += 0.1, 0, np.radians(170)
    expected[20:] += -0.03, 0.2, 0
    assert_same_poses(measure_extrapolated([strong_bias, weak_bias])[:, 0], expected)
    errors = (
        measure_extrapolated(
            [make_fault("vision-bias", heading_deg=180.0, probability=0.25)], frames=1000
        )[:, 0]
        - moving_poses(1000)[:, 0]
    )
    assert (np.cos(errors[:, 2]) < -0.99).mean() == pytest.approx(
        0.25, abs=SIGMAS * np.sqrt(0.25 * 0.75 / 1000)
    )
    np.testing.assert_allclose(errors[:, :2], 0, atol=1e-12)


def test_a_wrong_id_reports_the_other_robots_pose() -> None:
    poses = measure_extrapolated(
        [make_fault("vision-wrong-id", 10, 20, x_m=1.5, y_m=-0.5, heading_deg=30.0)]
    )[:, 0]
    expected = np.array(moving_poses(80)[:, 0])
    expected[10:30] = 1.5, -0.5, np.radians(30)
    assert_same_poses(poses, expected)


def test_a_slow_clock_extrapolates_robots_too_far() -> None:
    """The error is twist times drift times the time since the fault began."""
    rate, start, end, frame = 0.05, 12, 60, np.arange(80)
    error = np.where((frame >= start) & (frame < end), rate * (frame - start) * FRAME_S, 0.0)
    poses = measure_extrapolated(
        [make_fault("vision-clock-drift", start, end - start, drift_ms_per_s=1000 * rate)]
    )
    assert_same_poses(poses[:, 0], moving_poses(80)[:, 0] + error[:, None] * TWIST)


def test_vision_delay_delays_later_images() -> None:
    measured, age = measure_poses(
        moving_poses(80), [[make_fault("vision-delay", 20, 30, delay_s=4 * FRAME_S)]], **SHARP
    )
    assert np.isnan(measured[20:24]).all()
    np.testing.assert_allclose(age[24:50], 4 * FRAME_S, atol=1e-12)
    assert_same_poses(measured[24:50], moving_poses(80)[20:46])
    assert_same_poses(measured[50:], moving_poses(80)[50:])


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        ("vision-loss", {}),
        ("vision-freeze", {}),
        ("vision-wrong-id", {"x_m": 1.5, "y_m": -0.5, "probability": 0.5}),
        ("vision-bias", {"x_m": 0.05, "heading_deg": 5.0}),
        ("vision-clock-drift", {"drift_ms_per_s": 20.0}),
        ("vision-jitter", {"jitter_s": 0.05}),
        ("vision-delay", {"delay_s": 0.06}),
    ],
)
def test_camera_faults_end_without_trace_and_affect_their_row_only(
    kind: str, values: dict[str, Any]
) -> None:
    """Bit for bit, with noise and misses."""
    camera_fault = make_fault(kind, 20, 25, **values)
    healthy, faulty = np.moveaxis(measure_extrapolated([], [camera_fault], **NOISY), 1, 0)
    np.testing.assert_array_equal(healthy, measure_extrapolated([], **NOISY)[:, 0])
    np.testing.assert_array_equal(faulty, measure_extrapolated([camera_fault], **NOISY)[:, 0])
    np.testing.assert_array_equal(faulty[:20], healthy[:20])
    np.testing.assert_array_equal(faulty[50:], healthy[50:])
    assert (faulty[20:45] != healthy[20:45]).any()
