"""Cameras as measured: errors fixed to the field, dropouts in bursts, skewed latency."""

from typing import Any

import numpy as np
import pytest
from benches.camera_and_radio import FRAME_S, SHARP, measure_poses
from numpy.typing import NDArray
from scipy import stats

import omni_mj as om
from omni_mj.config.resolve import resolve_settings

SIGMA, LENGTH = 0.01, 1.5
CALIBRATION = {**SHARP, "calibration_error_m": SIGMA, "calibration_length_m": LENGTH}
SEEDS = range(400)


def measure_errors(points: NDArray, seeds: range = SEEDS, **vision: Any) -> NDArray:
    """Return errors (points, seeds, 2) of robots that are put at points (points, 2) in turn."""
    poses = np.zeros((len(points), len(seeds), 3))
    poses[..., :2] = points[:, None]
    measured, _ = measure_poses(poses, seeds=list(seeds), **vision)
    np.testing.assert_array_equal(measured[..., 2], 0)
    return measured[..., :2] - poses[..., :2]


def test_the_calibration_error_is_a_gaussian_process() -> None:
    """Normal over seeds; covariance sigma^2 exp(-d^2 / (2 length^2)); axes are independent."""
    points = np.array([[0, 0], [0.5, 0], [1, 1], [2.0, 0], [4.0, -2.0]])
    errors = measure_errors(points, **CALIBRATION) / SIGMA
    for axis in range(2):
        assert all(stats.kstest(values, "norm").pvalue > 1e-4 for values in errors[..., axis])
        covariance = np.cov(errors[..., axis])
        distances = np.linalg.norm(points[:, None] - points, axis=-1)
        expected = np.exp(-((distances / LENGTH) ** 2) / 2)
        np.testing.assert_allclose(covariance, expected, atol=5 / np.sqrt(len(SEEDS)))
    assert abs(np.mean(errors[..., 0] * errors[..., 1])) < 5 / np.sqrt(errors[..., 0].size / 5)


def test_errors_are_fixed_to_the_field_and_smooth() -> None:
    """The same point has the same error at any time; near points have similar ones."""
    line = np.column_stack([np.linspace(-3, 3, 200), np.full(200, 0.7)])
    errors = measure_errors(np.concatenate([line, line[::-1]]), range(20), **CALIBRATION)
    np.testing.assert_array_equal(errors[:200], errors[:199:-1])
    steps = np.diff(errors[:200], axis=0) / np.diff(line[:, 0])[0]
    # The slope has the standard deviation sigma / length.
    assert np.sqrt((steps**2).mean()) == pytest.approx(SIGMA / LENGTH, rel=0.3)


@pytest.mark.parametrize(
    ("cameras", "border", "field"),
    [
        (2, [0.0, 1.0], {}),
        (3, [10.4 / 6, 1.0], {}),
        (3, [13.4 / 6, 1.0], {"field_length_m": 12.0}),
        (4, [0.0, 1.0], {}),
        (4, [1.0, 0.0], {}),
    ],
)
def test_measured_positions_jump_at_the_border_of_two_cameras(
    cameras: int, border: list[float], field: dict[str, float]
) -> None:
    """By the difference of two independent errors; within a camera there is no jump."""
    axis = int(border[1] == 0)
    across = np.eye(2)[axis] * 1e-6
    points = np.array([border - 3 * across, border - across, border + across, border + 3 * across])
    errors = measure_errors(points, world=field, cameras=cameras, **CALIBRATION)
    assert np.abs(errors[[0, 2]] - errors[[1, 3]]).max() < 1e-6
    jumps = (errors[2] - errors[1]) / (np.sqrt(2) * SIGMA)
    assert all(stats.kstest(values, "norm").pvalue > 1e-4 for values in jumps.T)


def test_known_offsets_and_random_camera_positions_add_up() -> None:
    points = np.array([[-1.0, 0.5], [1.0, 0.5], [6.0, 9.0]])
    offsets = [[0.01, -0.02], [0.03, 0.0]]
    errors = measure_errors(points, range(2), **SHARP, cameras=2, camera_offsets_m=offsets)
    np.testing.assert_allclose(errors[:, 0], [offsets[0], offsets[1], offsets[1]], atol=1e-12)
    random = measure_errors(points[:2], **SHARP, cameras=2, camera_offset_m=0.02)
    assert stats.kstest(random.ravel() / 0.02, "norm").pvalue > 1e-4
    with pytest.raises(om.OmniError, match="cameras is 1"):
        om.load_scenario("rect", vision={"camera_offsets_m": offsets})


def test_robots_of_a_world_share_its_cameras() -> None:
    """Also in serve, whose cameras are the same ones."""
    from omni_mj.network.camera_calibration import CameraErrors

    vision = {"cameras": 2, "camera_offset_m": 0.02, **CALIBRATION}
    settings = resolve_settings({"vision": vision})
    seeds = [(3,), (3, 1), (4,)]
    positions = np.array([[1.0, 1.0], [1.0, 1.0], [1.0, 1.0]])
    errors = CameraErrors([settings] * 3, seeds)(positions)
    np.testing.assert_array_equal(errors[0], errors[1])
    assert (errors[0] != errors[2]).all()
    alone = CameraErrors([settings], seeds[:1])
    np.testing.assert_array_equal(alone(positions, 1), errors[[0, 0, 0]])


def test_dropouts_are_a_gilbert_elliott_channel() -> None:
    """Lengths are geometric with their mean; the fraction of dropped images follows."""
    mean, fraction, frames = 6.0, 0.15, 6000
    poses = np.zeros((frames, 8, 3))
    vision = {**SHARP, "dropout_fraction": fraction, "mean_dropout_frames": mean}
    measured, _ = measure_poses(poses, seeds=list(range(8)), **vision)
    is_dropped = np.isnan(measured[..., 0]).T
    assert not is_dropped[:, 0].any()
    assert is_dropped.mean() == pytest.approx(fraction, abs=0.012)
    edges = np.diff(np.pad(is_dropped, ((0, 0), (1, 1))).astype(int), axis=1)
    lengths = np.argwhere(edges == -1)[:, 1] - np.argwhere(edges == 1)[:, 1]
    counts = np.bincount(lengths, minlength=60)[1:60]
    expected = stats.geom(1 / mean).pmf(np.arange(1, 60)) * len(lengths)
    is_frequent = expected > 5
    statistic = ((counts - expected) ** 2 / expected)[is_frequent].sum()
    assert stats.chi2(is_frequent.sum()).sf(statistic) > 1e-4


@pytest.mark.parametrize("variation", [0.3, 1.0])
def test_processing_times_have_a_gamma_distribution(variation: float) -> None:
    """Mean and standard deviation are as set; images that are overtaken are dropped."""
    from omni_mj.network.camera import ImageTiming

    mean, delay = 0.02, 0.01
    skewed = {"processing_s": mean, "processing_variation": variation}
    settings = resolve_settings({"vision": {"delay_s": delay, **skewed}})
    timing = ImageTiming([settings] * 50, [(seed,) for seed in range(50)], [()] * 50)
    latencies = np.array([timing.schedule_arrival(k, 0.0)[0] for k in range(200)]).ravel()
    shape = 1 / variation**2
    law = stats.gamma(shape, loc=delay, scale=mean / shape)
    assert stats.kstest(latencies, law.cdf).pvalue > 1e-4
    poses = np.zeros((400, 1, 3))
    poses[..., 0] = np.arange(400)[:, None] * FRAME_S  # 1 m/s
    measured, age = measure_poses(poses, **SHARP, **skewed)
    is_measured = np.isfinite(measured[..., 0])
    captured = np.where(is_measured, np.arange(400)[:, None] * FRAME_S - age, np.nan)
    np.testing.assert_allclose(measured[is_measured][:, 0], captured[is_measured], atol=1e-12)
    assert (np.diff(captured[is_measured]) > 0).all()
