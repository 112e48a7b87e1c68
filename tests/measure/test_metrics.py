"""What is measured of rows, against closed forms and plain recomputation."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from logs import failure, filled, rows

from omni_mj.measure import causes, metrics
from omni_mj.measure.errors import AXES, errors
from omni_mj.measure.running import Effort
from omni_mj.measure.way import travel

T = 1 / 60


def moving(frames: int, rest: int) -> np.ndarray:
    """A reference (frames, 1, 3) that moves up to frame `rest` and stands from there on."""
    poses = np.zeros((frames, 1, 3))
    poses[:, 0, 0] = 0.01 * np.minimum(np.arange(frames), rest)
    return poses


def effort(command: np.ndarray) -> np.ndarray:
    """Of commands (frames, ..., axes)."""
    found = Effort(command.shape[1:])
    found.add(command)
    return found.value


def excess_effort(command: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Of commands beside the positions of references, (frames, n, 2)."""
    channels = {
        name: np.pad(each, [(0, 0), (0, 0), (0, 1)]) for name, each in (("command", command), ("ref", reference))
    }
    ends = (~np.isnan(reference[..., 0])).sum(0)
    log = filled(rows(("a",), range(command.shape[1])), len(command), ends, **channels)
    return metrics.row_metrics(log)["excess_effort_m_s2"]


def settling_times(reference: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Of robots that are so far (frames, n) aside of references (frames, n, 3)."""
    aside = reference + np.where(np.arange(3) == 1, distance[..., None], 0.0)
    ends = (~np.isnan(distance)).sum(0)
    log = filled(rows(("a",), range(distance.shape[1])), len(distance), ends, ref=reference, pose=aside)
    return metrics.row_metrics(log)["settle_s"]


def test_errors_are_those_along_the_axes_in_the_plane_and_of_the_heading_to_the_nearest_turn() -> None:
    """Off by 3 and -4 cm and by a turn less a tenth of a radian: 5 cm and a tenth."""
    pose = np.ones((2, 6, 3))
    pose[:, 4] += [0.03, -0.04, 2 * math.pi - 0.1]
    found = errors(filled(rows(("a", "b"), (0, 1, 2)), 2, ref=1.0, pose=pose))
    assert list(found) == list(AXES)
    for axis, wanted in {"x": 0.03, "y": 0.04, "distance": 0.05, "heading": 0.1}.items():
        error = found[axis]
        assert error.shape == (2, 6)
        np.testing.assert_allclose(error[:, 4], wanted, atol=1e-12, err_msg=axis)
        np.testing.assert_array_equal(np.delete(error, 4, axis=1), 0.0)


@settings(deadline=None, derandomize=True, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.floats(-math.pi, math.pi))
def test_along_and_across_turn_with_the_path(seed: int, turn: float) -> None:
    """Two parts of the error in the plane, by Pythagoras; a path and a robot that are turned as a whole keep them."""
    rng = np.random.default_rng(seed)
    ref, pose = np.cumsum(rng.normal(size=(2, 30, 2, 3)), axis=1)
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    found = errors(filled(rows(("a", "b")), 30, [30, 11], ref=ref, pose=pose))
    np.testing.assert_allclose(np.hypot(found["along"], found["across"]), found["distance"], rtol=1e-9)
    ref, pose = (np.concatenate([each[..., :2] @ rotation.T, each[..., 2:]], axis=-1) for each in (ref, pose))
    turned = errors(filled(rows(("a", "b")), 30, [30, 11], ref=ref, pose=pose))
    for axis in ("along", "across"):
        np.testing.assert_allclose(turned[axis], found[axis], atol=1e-9, err_msg=axis)


def test_on_a_circle_who_is_late_is_behind_and_who_is_outside_is_aside() -> None:
    """Late by a 1/10 rad on a radius of 1 m: the chord 2 sin(0.05), seen from the tangent at an angle of 0.05. Outside
    by 5 cm: all of it across. The last frame knows the frame before it only, and is half a step off: left out."""
    angle = 0.02 * np.arange(200)
    late, outside = (np.array([[np.cos(a), np.sin(a)]]) for a in (angle - 0.1, angle))
    ref, pose = np.zeros((200, 2, 3)), np.zeros((200, 2, 3))
    ref[..., :2] = np.moveaxis(outside, -1, 0)
    pose[:, 0, :2], pose[:, 1, :2] = late[0].T, 1.05 * outside[0].T
    found = errors(filled(rows(("late", "outside")), 200, ref=ref, pose=pose))
    chord = 2 * math.sin(0.05)
    for axis, wanted in {"along": (chord * math.cos(0.05), 0), "across": (chord * math.sin(0.05), 0.05)}.items():
        np.testing.assert_allclose(found[axis][1:-1], np.broadcast_to(wanted, (198, 2)), atol=1e-9, err_msg=axis)


def test_at_rest_the_last_direction_counts() -> None:
    """Rest, ahead along y, rest, back along -x, rest; and a reference that never moves, whose direction is x."""
    legs = [(0, 0)] * 5 + [(0, 0.01)] * 5 + [(0, 0)] * 5 + [(-0.01, 0)] * 5 + [(0, 0)] * 5
    ref = np.zeros((len(legs), 2, 2))
    ref[:, 0] = np.cumsum(legs, axis=0)
    found = travel(ref)
    # The first step back leads to frame 15; a direction looks both ways, so that it is new in the frame before.
    wanted = np.where(np.arange(len(legs))[:, None] < 14, (0.0, 1.0), (-1.0, 0.0))
    np.testing.assert_allclose(found[:, 0], wanted, atol=1e-12)
    np.testing.assert_array_equal(found[:, 1], np.broadcast_to((1.0, 0.0), (len(legs), 2)))


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
        order = np.sort(error)  # the 99th percentile: this share of the way from the least to the greatest
        p99 = np.interp(0.99 * (length - 1), np.arange(length), order)
        wanted = error.max(), p99, error.mean(), math.sqrt((error**2).mean()), error.argmax() * T
        names = "distance_max_m", "distance_p99_m", "distance_mean_m", "distance_rms_m", "greatest_at_s"
        assert [together[name][i] for name in names] == pytest.approx(wanted, rel=1e-12)


def test_failing_improves_no_number() -> None:
    """Errors, efforts and settling without bound, nothing else; and a row that never began is the same."""
    log = filled(rows(("a",), (0, 1, 2)), 30, [30, 12, 0], pose=0.001, command=1.0)
    found = metrics.row_metrics(log, [failure(log, 1), failure(log, 2)])
    for name, values in found.items():
        unknown = name.startswith("peak_") or name in causes.NAMES  # of a log without motors
        averaged = name != "greatest_at_s" and not unknown
        assert np.isfinite(values[0]) or unknown, name
        assert np.isposinf(values[1:]).all() if averaged else np.isnan(values[1:]).all(), name
    nothing = metrics.row_metrics(filled(rows(), 0))
    assert all(np.isnan(values).all() for values in nothing.values())


def test_effort_of_an_acceleration_an_oscillation_and_a_step() -> None:
    """Speeding up at 3 and 4 m/s^2 is 5 m/s^2; a sine's derivative shrinks by sinc(w T / 2) from frame to frame; a
    step of 0.6 m/s in the first of n frames is 0.6 / T once, so 0.6 / (T sqrt(n))."""
    speed = np.arange(1, 91)[:, None, None] * T
    assert effort(np.concatenate([3.0 * speed, -4.0 * speed], axis=-1)) == pytest.approx([5.0])
    w, frames = 2 * math.pi * 2.0, 600
    sine = 0.5 * np.sin(w * T * np.arange(1, frames + 1))[:, None]
    shrink = math.sin(w * T / 2) / (w * T / 2)
    assert effort(sine) == pytest.approx(0.5 * w * shrink / math.sqrt(2), rel=1e-9)
    step = np.full((25, 2, 2), [0.6, 0.0])
    assert effort(step) == pytest.approx([0.6 * 60 / 5] * 2)


def test_who_sends_the_references_own_velocities_has_no_excess_effort() -> None:
    """Now, or a dead time before they are due; who adds a hum of 0.1 m/s in every other frame has the hum's own effort,
    which is 0.2 m/s from frame to frame, where the reference has no acceleration that could go with it or against it.

    The root of a difference of squares, each good to 1e-15, is good to 1e-6.
    """
    frames, start = 400, 20
    speed = np.concatenate([np.zeros(start), np.linspace(0, 1, 60), np.full(240, 1.0), np.linspace(1, 0, 60)])
    velocity = np.stack([0.6 * speed, -0.8 * speed], axis=-1)
    velocity = np.concatenate([velocity, np.zeros((frames - len(velocity), 2))])
    path = np.concatenate([np.zeros((1, 2)), np.cumsum(velocity, axis=0)[:-1]]) * T
    early = np.concatenate([velocity[12:], np.zeros((12, 2))])
    hum = np.where(np.arange(frames) % 2, 0.1, -0.1)[:, None] * (0.8, 0.6)  # across the way
    commands = np.stack([velocity, early, velocity + hum, 0.5 * velocity], axis=1)
    references = np.repeat(path[:, None], 4, axis=1)
    excess = excess_effort(commands, references)
    own = effort(hum)
    np.testing.assert_allclose(excess, [0, 0, own, 0], atol=1e-6)
    assert own == pytest.approx(0.2 / T, rel=0.01)  # but for the first frame, which comes from rest
    ended = np.where(np.arange(frames)[:, None, None] < 100, references, np.nan)
    alone = excess_effort(commands[:100], references[:100])
    np.testing.assert_allclose(excess_effort(np.where(np.isnan(ended), np.nan, commands), ended), alone)


def test_an_error_that_decays_settles_when_the_exponential_says() -> None:
    """e(t) = start exp(-t / tau) from the end of the move on is below 1 cm after tau ln(start / 1 cm), in frames."""
    rest, frames = 30, 200
    after = np.maximum(np.arange(frames) - rest, 0) * T
    for start_m, tau_s in ((0.05, 0.1), (0.3, 0.25), (0.011, 1.0)):
        times = settling_times(moving(frames, rest), start_m * np.exp(-after / tau_s)[:, None])
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
    wanted = [0, 0, (32 - 10) * T, np.inf, 0, 3 * T, 15 * T]
    np.testing.assert_allclose(settling_times(ref, error), wanted)


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
