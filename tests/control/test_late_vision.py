"""Poses that were seen a while before the frame, in the filter of vision and in that of turning."""

import numpy as np
import pytest
from driven import DRIFT, DRIFT_TIME_S, GAIN_ERROR, NOISE, T, driven, filtered
from hypothesis import given
from hypothesis import strategies as st
from laws import LAW

from omni_control.estimation.turning import Turning
from omni_control.estimation.way import Way
from omni_control.kinematics import Array


def best(measured: Array, displacement: Array, late: int, start: float, noise: float, wander: float) -> Array:
    """The optimal filter of one robot's axis, seen `late` frames ago: the positions of those frames are states too."""
    count = late + 2
    f = np.eye(count, k=-1)  # each position is that of the frame before it, one frame later
    f[:3, :2] = [[1, T], [0, np.exp(-T / DRIFT_TIME_S)], [1, 0]]
    if late > 1:
        f[2:, 1] = 0
    h = np.zeros(count)
    h[0 if late == 0 else late + 1] = 1
    x, p, said = np.zeros(count), np.zeros((count, count)), []
    x[0], p[0, 0] = start, noise**2
    for z, q in zip(measured, displacement, strict=True):
        x, p = f @ x, f @ p @ f.T
        x[0], p[0, 0], p[1, 1] = x[0] + q, p[0, 0] + (GAIN_ERROR * q) ** 2, p[1, 1] + wander**2 * T
        if not np.isnan(z):
            gain = p @ h / (h @ p @ h + noise**2)
            x, p = x + gain * (z - h @ x), p - np.outer(gain, h @ p)
        said.append(x[0])
    return np.array(said)


@pytest.mark.parametrize("late", [1, 4])
def test_what_is_seen_late_serves_as_well_as_it_can(late: int) -> None:
    """Errors are at most a tenth above those of the optimal filter, which knows where robots were in each frame.

    That takes the noise of the frames since for none of what is seen; ours, in one state, takes it for part of it.
    """
    true, measured, displacement = driven(3, 400, 30)
    start = true[0] - displacement[0]
    late_seen = np.full_like(measured, np.nan)
    late_seen[late:] = measured[:-late]
    said = filtered(late_seen, displacement, start, np.full((400, 30), late * T))["pose"]
    for axis in range(2):
        optimal = [
            best(late_seen[:, i, axis], displacement[:, i, axis], late, start[i, axis], NOISE[axis], DRIFT[axis])
            for i in range(30)
        ]
        rms = [
            np.sqrt(((values - true[..., axis])[20:] ** 2).mean()) for values in (said[..., axis], np.array(optimal).T)
        ]
        assert rms[0] < 1.1 * rms[1], f"axis {axis}"


@LAW
@given(st.integers(0, 2**32 - 1), st.floats(0, 0.2))
def test_a_perfect_robot_seen_late_is_tracked_exactly(seed: int, longest: float) -> None:
    """Seen at any time within 0.2 s before each frame, evenly moving within frames: poses are the true ones.

    Rounding as of one that is seen at once (`test_filter`).
    """
    rng = np.random.default_rng(seed)
    displacement, age = rng.uniform(-0.05, 0.05, (60, 3, 3)), rng.uniform(0, longest, (60, 3))
    poses = np.concatenate([np.zeros((1, 3, 3)), np.cumsum(displacement, axis=0)])
    frames = np.maximum(np.arange(1, 61)[:, None] - age / T, 0.0)
    index, share = frames.astype(int), (frames % 1)[..., None]
    row, after = np.arange(3), np.minimum(index + 1, 60)
    seen = (1 - share) * poses[index, row] + share * poses[after, row]
    said = filtered(seen, displacement, np.zeros((3, 3)), age)
    np.testing.assert_allclose(said["pose"], poses[1:], rtol=0, atol=1e-12)


def test_a_velocity_that_was_believed_does_not_confirm_itself() -> None:
    """Robots stand, seen without noise, though the filter believes in 1 m/s: half a second later it does not.

    However old what is seen is; a filter that takes for seen what it carried on by that velocity would go on for good.
    What commands do not explain is believed to fade, so that of 1 m/s some tenths are missing.
    """
    for late in (1 / 120, 0.05, 0.1):
        pose = np.zeros((130, 1, 3))
        pose[:100, 0, 0] = T * np.arange(1, 101)  # it drives at 1 m/s that nobody commands, and is held
        pose[100:, 0, 0] = pose[99, 0, 0]
        frames = np.maximum(np.arange(130) - late / T, 0)
        seen = pose.copy()
        seen[:, 0, 0] = np.interp(frames, np.arange(130), pose[:, 0, 0])
        said = filtered(seen, np.zeros((130, 1, 3)), np.zeros((1, 3)), np.full((130, 1), late))
        assert said["twist"][99, 0, 0] == pytest.approx(0.85, abs=0.15)
        assert abs(said["twist"][-1, 0, 0]) < 0.1


@pytest.mark.parametrize("late", [0.01, 0.05])
def test_a_heading_seen_late_is_known_as_well_but_for_what_happened_since(late: float) -> None:
    """Turns of sines of 4 rad/s by the law, seen with vision's noise: errors at most half as large again as at once."""
    rng, noise, robots = np.random.default_rng(0), 0.01, 20
    errors = []
    for age in (0.0, late):
        true = Turning(np.zeros(robots), T, noise, 0.02)
        found = Turning(np.zeros(robots), T, noise, 0.02)
        headings, off = [np.zeros(robots)] * 10, []
        for k in range(300):
            command = 4 * np.sin(k * T * 3 + np.arange(robots))
            true.heading, true.rate = true.step(true.heading, true.rate, command, T, np.zeros(robots))
            headings.append(true.heading)
            whole, part = int(age / T), age / T % 1
            seen = (1 - part) * headings[-1 - whole] + part * headings[-2 - whole]
            measured = np.angle(np.exp(1j * (seen + noise * rng.standard_normal(robots))))
            found.update(measured, command, np.zeros(robots), np.full(robots, age) if age else None)
            off.append(found.heading - true.heading)
        errors.append(np.sqrt(np.mean(np.array(off)[60:] ** 2)))
    assert errors[1] < 1.5 * errors[0] < 1.5 * noise


@LAW
@given(st.integers(1, 80), st.floats(0, 1.2), st.integers(0, 2**32 - 1))
def test_a_way_is_the_difference_of_where_robots_were(frames: int, age: float, seed: int) -> None:
    """By interpolation between the positions at frames; before the first, and longer ago than is kept, they stood."""
    moved = np.random.default_rng(seed).uniform(-1, 1, (frames, 2, 3))
    way = Way(T)
    for each in moved:
        way.add(each, each, each)  # its velocities are of no account where they are not corrected
    positions = np.concatenate([np.zeros((1, 2, 3)), np.cumsum(moved, axis=0)])[-65:]
    ages = np.array([age, age / 2])
    for row in range(2):
        then = [np.interp(-ages[row] / T, np.arange(1 - len(positions), 1), positions[:, row, i]) for i in range(3)]
        np.testing.assert_allclose(way.since(ages)[row], positions[-1, row] - then, atol=1e-12)
