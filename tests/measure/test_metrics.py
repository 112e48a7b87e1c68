"""What is measured of rows, against closed forms and plain recomputation."""

import math

import numpy as np
import pytest
from logs import failure, filled, rows

from omni_mj.measure import metrics

T = 1 / 60


def moving(frames: int, rest: int) -> np.ndarray:
    """A reference (frames, 1, 3) that moves up to frame `rest` and stands from there on."""
    poses = np.zeros((frames, 1, 3))
    poses[:, 0, 0] = 0.01 * np.minimum(np.arange(frames), rest)
    return poses


def test_errors_are_those_along_the_axes_in_the_plane_and_of_the_heading_to_the_nearest_turn() -> None:
    """Off by 3 and -4 cm and by a turn less a tenth of a radian: 5 cm and a tenth."""
    pose = np.ones((2, 6, 3))
    pose[:, 4] += [0.03, -0.04, 2 * math.pi - 0.1]
    errors = metrics.errors(filled(rows(("a", "b"), (0, 1, 2)), 2, ref=1.0, pose=pose))
    assert list(errors) == ["x", "y", "distance", "heading"]
    for (axis, error), wanted in zip(errors.items(), (0.03, 0.04, 0.05, 0.1), strict=True):
        assert error.shape == (2, 6)
        np.testing.assert_allclose(error[:, 4], wanted, atol=1e-12, err_msg=axis)
        np.testing.assert_array_equal(np.delete(error, 4, axis=1), 0.0)


def test_a_row_that_ends_earlier_has_the_numbers_it_has_alone() -> None:
    """And those that numpy says of its own frames; sums are made in another order, so 1e-12 is allowed."""
    rng = np.random.default_rng(5)
    channels = {name: rng.normal(size=(40, 3, 3)) for name in ("pose", "ref", "command")}
    together = metrics.row_metrics(filled(rows(("a", "b", "c")), 40, [40, 17, 1], **channels))
    for i, length in enumerate((40, 17, 1)):
        own = {name: values[:length, i : i + 1] for name, values in channels.items()}
        alone = metrics.row_metrics(filled(rows(), length, **own))
        for name, values in together.items():
            np.testing.assert_allclose(values[i], alone[name][0], rtol=1e-12, err_msg=name)
        error = np.hypot(*(own["pose"] - own["ref"])[:, 0, :2].T)
        wanted = error.max(), error.mean(), math.sqrt((error**2).mean()), error.argmax() * T
        names = "distance_max_m", "distance_mean_m", "distance_rms_m", "greatest_at_s"
        assert [together[name][i] for name in names] == pytest.approx(wanted, rel=1e-12)


def test_failing_improves_no_number() -> None:
    """Errors without bound, nothing else; and a row that never began is the same."""
    log = filled(rows(("a",), (0, 1, 2)), 30, [30, 12, 0], pose=0.001, command=1.0)
    found = metrics.row_metrics(log, [failure(log, 1), failure(log, 2)])
    for name, values in found.items():
        of_error = name.split("_")[0] in metrics.AXES
        assert np.isfinite(values[0]) or name.startswith("peak_"), name
        assert np.isposinf(values[1:]).all() if of_error else np.isnan(values[1:]).all(), name
    nothing = metrics.row_metrics(filled(rows(), 0))
    assert all(np.isnan(values).all() for values in nothing.values())


def test_effort_of_an_acceleration_an_oscillation_and_a_step() -> None:
    """Speeding up at 3 and 4 m/s^2 is 5 m/s^2; a sine's derivative shrinks by sinc(w T / 2) from frame to frame; a
    step of 0.6 m/s in the first of n frames is 0.6 / T once, so 0.6 / (T sqrt(n))."""
    speed = np.arange(1, 91)[:, None, None] * T
    assert metrics.control_effort(np.concatenate([3.0 * speed, -4.0 * speed], axis=-1)) == pytest.approx([5.0])
    w, frames = 2 * math.pi * 2.0, 600
    sine = 0.5 * np.sin(w * T * np.arange(1, frames + 1))[:, None]
    shrink = math.sin(w * T / 2) / (w * T / 2)
    assert metrics.control_effort(sine) == pytest.approx(0.5 * w * shrink / math.sqrt(2), rel=1e-9)
    step = np.full((25, 2, 2), [0.6, 0.0])
    assert metrics.control_effort(step) == pytest.approx([0.6 * 60 / 5] * 2)


def test_an_error_that_decays_settles_when_the_exponential_says() -> None:
    """e(t) = start exp(-t / tau) from the end of the move on is below 1 cm after tau ln(start / 1 cm), in frames."""
    rest, frames = 30, 200
    after = np.maximum(np.arange(frames) - rest, 0) * T
    for start_m, tau_s in ((0.05, 0.1), (0.3, 0.25), (0.011, 1.0)):
        times = metrics.settling_times(moving(frames, rest), start_m * np.exp(-after / tau_s)[:, None])
        assert times == pytest.approx(math.ceil(tau_s * math.log(start_m / 0.01) / T) * T)


def test_settling_counts_the_last_excursion_of_each_row_from_the_end_of_its_own_move() -> None:
    """Rows: always near; far only while moving; far again later; exactly 1 cm at the end, which is not below; ended
    before the others; with a reference that only turns, up to frame 12; with one that never moves."""
    frames = 50
    ref = np.repeat(moving(frames, 10), 7, axis=1)
    ref[:, 5:] = 0.0
    ref[12:, 5, 2] = 1.0
    error = np.full((frames, 7), 0.001)
    error[:10, 1], error[31, 2], error[-1, 3], error[15:, 4] = 0.2, 0.02, 0.01, np.nan
    ref[15:, 4] = np.nan
    error[:15, 5:] = 0.5
    wanted = [0, 0, (32 - 10) * T, np.nan, 0, 3 * T, 15 * T]
    np.testing.assert_allclose(metrics.settling_times(ref, error), wanted)


def test_windows_of_alpha_are_ratios_of_displacements() -> None:
    """A robot that covers 0.8 of its command, half a frame late, shows 0.8 in every window that it has."""
    command = np.full((40, 1), 0.5)
    position = 0.8 * np.cumsum(np.concatenate([[[0.0]], command[:-1]]), axis=0) / 60 - 0.004
    assert metrics.alpha_windows(position, command) == pytest.approx(np.full((25, 1), 0.8))
    assert np.isnan(metrics.alpha_windows(position, command * 0.1)).all()  # slower than 0.1 m/s says nothing
    pose, applied = (np.repeat(values[..., None], 3, axis=-1) for values in (position, command))
    log = filled(rows(("a", "b")), 40, [40, 20], pose=np.repeat(pose, 2, 1), applied=np.repeat(applied, 2, 1))
    for controller in "ab":
        found = metrics.alpha_percentiles(log, log.of(controller))
        assert found is not None
        assert all(value == pytest.approx(0.8) for axis in found.values() for value in axis.values())
    assert metrics.alpha_percentiles(filled(rows(), 15), np.array([0])) is None


def test_alpha_of_the_driven_leaves_out_windows_near_standstill() -> None:
    """A robot that achieves 0.8 of its command 0.1 s late: what begins at rest would show much less."""
    command = np.where((np.arange(120) >= 20) & (np.arange(120) < 90), 0.5, 0.0)[:, None]
    late = np.concatenate([np.zeros((6, 1)), command[:-6]])
    position = 0.8 * np.cumsum(np.concatenate([[[0.0]], late[:-1]]), axis=0) / 60
    every, driven = metrics.alpha_windows(position, command), metrics.driven_alpha(position, command)
    assert np.nanmin(every) < 0.5
    first, last = 20 + metrics.ALPHA_START_FRAMES, 90 - metrics.ALPHA_WINDOW_FRAMES
    assert np.flatnonzero(~np.isnan(driven[:, 0])).tolist() == list(range(first, last + 1))
    assert driven[first : last + 1] == pytest.approx(0.8)
