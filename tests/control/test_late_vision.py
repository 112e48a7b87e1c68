"""Poses that were seen a while before the frame: filters that are behind the present, and what they say of it."""

import numpy as np
import pytest
from benches.control import AdaptiveCompFlc, Array
from closed_loop import DRIFT, DRIFT_TIME_S, GAIN_ERROR, NOISE, T, simulate_drift
from hypothesis import given, settings
from hypothesis import strategies as st

from omni_control import Controller, MotionLimits, OmniError, Team, TeamModel, TimedReference


def estimated(
    measured: Array, displacement: Array, start: Array, age: Array
) -> tuple[Array, Array]:
    """Poses and twists (frames, n, 3) that a team believes in, of robots without dead time; ages are (frames, n)."""
    model = TeamModel(T, 0, lag_s=0.0, position_noise_m=NOISE[0], heading_noise_rad=NOISE[2])
    team, seen = Team(Controller(model, None, len(start)), start), []  # type: ignore[arg-type]
    for k, (pose, each) in enumerate(zip(measured, age, strict=True)):
        seen.append(team.observe(pose, measurement_age=each))
        team.last_command = displacement[min(k + 1, len(displacement) - 1)] / T
    return np.array([one.pose for one in seen]), np.array([one.twist for one in seen])


def best(
    measured: Array, displacement: Array, late: int, start: float, noise: float, wander: float
) -> Array:
    """The optimal filter of one robot's axis, seen `late` frames ago: the positions of those frames are states too."""
    count = late + 2  # position, drift, and the positions of one to `late` frames ago
    f = np.zeros((count, count))
    f[0, :2], f[1, 1], f[2, 0] = (1, T), np.exp(-T / DRIFT_TIME_S), 1
    f[range(3, count), range(2, count - 1)] = 1
    x, p, said = np.zeros(count), np.zeros((count, count)), []
    x[[0, *range(2, count)]], p[0, 0] = start, noise**2
    for z, q in zip(measured, displacement, strict=True):
        x, p = f @ x, f @ p @ f.T
        x[0], p[0, 0], p[1, 1] = x[0] + q, p[0, 0] + (GAIN_ERROR * q) ** 2, p[1, 1] + wander**2 * T
        if not np.isnan(z):
            gain = p[:, -1] / (p[-1, -1] + noise**2)
            x, p = x + gain * (z - x[-1]), p - np.outer(gain, p[-1])
        said.append(x[0])
    return np.array(said)


@pytest.mark.parametrize("late", [1, 4])
def test_what_is_seen_late_serves_as_well_as_it_can(late: int) -> None:
    """Errors are at most 3 % above those of the optimal filter, which is told the true process noise."""
    true, measured, displacement = simulate_drift(3, 300, 20)
    displacement[0] = 0
    seen = np.full_like(measured, np.nan)
    seen[late:] = measured[:-late]
    poses, _ = estimated(seen, displacement, true[0], np.full((300, 20), late * T))
    optimal = [
        best(seen[:, i, 0], displacement[:, i, 0], late, true[0, i, 0], NOISE[0], DRIFT[0])
        for i in range(20)
    ]
    ours, theirs = ((values - true[..., 0])[20:] for values in (poses[..., 0], np.array(optimal).T))
    assert np.sqrt((ours**2).mean()) < 1.03 * np.sqrt((theirs**2).mean())


@settings(max_examples=12)
@given(st.integers(0, 2**32 - 1), st.floats(0, 0.2))
def test_a_perfect_robot_seen_late_is_tracked_exactly(seed: int, longest: float) -> None:
    """Images of any age up to 0.2 s, none before the last one's, of robots that move evenly within frames.

    Rounding as of one that is seen at once (`test_filter`).
    """
    rng, frames = np.random.default_rng(seed), np.arange(40)[:, None]
    displacement = rng.uniform(-0.05, 0.05, (40, 3, 3))
    displacement[0] = 0
    poses = np.cumsum(displacement, axis=0)
    taken = np.maximum.accumulate(
        np.maximum(frames - rng.uniform(0, longest / T, (40, 3)), 0), axis=0
    )  # frames
    index, row = taken.astype(int), np.arange(3)
    share = (taken - index)[..., None]
    seen = (1 - share) * poses[index, row] + share * poses[np.minimum(index + 1, 39), row]
    found, twists = estimated(seen, displacement, np.zeros((3, 3)), (frames - taken) * T)
    np.testing.assert_allclose(found, poses, rtol=0, atol=1e-12)
    np.testing.assert_allclose(twists, displacement / T, rtol=0, atol=1e-10)


@pytest.mark.parametrize("late", [1 / 120, 0.05, 0.1])
def test_a_velocity_that_was_believed_does_not_confirm_itself(late: float) -> None:
    """Robots stop, seen to a micrometre, though the filter believes in 1 m/s that nobody commanded.

    Observation to the bit, the gate would take it for a frozen image (`test_gate`). A quarter of a
    second after that can be seen it is forgotten; a filter that takes for seen what it carried on
    by that velocity would go on for good.
    """
    frames = np.arange(130)
    position = T * np.minimum(frames, 100.0)
    seen = np.zeros((130, 1, 3))
    seen[:, 0, 0] = np.interp(frames - late / T, frames, position)
    seen[:, 0, 0] += 1e-6 * np.random.default_rng(0).standard_normal(130)
    _, twists = estimated(seen, np.zeros((130, 1, 3)), np.zeros((1, 3)), np.full((130, 1), late))
    assert twists[100, 0, 0] == pytest.approx(1, abs=0.1)
    assert np.abs(twists[:, 0, 0]).max() < 1.2
    assert abs(twists[100 + round(late / T) + 15, 0, 0]) < 0.05


def test_a_row_of_a_batch_is_what_it_is_alone() -> None:
    """To the bit, whatever the ages of the others are: each robot's filters make its own steps."""
    rng, frames = np.random.default_rng(5), 60
    ages = np.where(rng.random((frames, 3)) < 0.3, 0.0, rng.uniform(0, 0.1, (frames, 3))) * [
        1,
        0.3,
        0,
    ]
    seen = 0.01 * np.cumsum(rng.standard_normal((frames, 3, 3)), axis=0)
    seen[rng.random((frames, 3)) < 0.1] = np.nan
    model, way = (
        TeamModel(T, 3),
        TimedReference([[0, 0, 0], [0.5, 0.3, 1]], MotionLimits(1.0, 1.0, 3.0, 6.0), T),
    )

    def commanded(rows: list[int]) -> Array:
        team = Team(AdaptiveCompFlc(model, way, len(rows)), np.zeros((len(rows), 3)))
        return np.array(
            [team.step(seen[k, rows], measurement_age=ages[k, rows]) for k in range(frames)]
        )

    together = commanded([0, 1, 2])
    for row in range(3):
        np.testing.assert_array_equal(commanded([row])[:, 0], together[:, row])


@pytest.mark.parametrize("age", [[-0.1], [np.nan], [np.inf], [0.1, 0.1], 0.1, "old"], ids=str)
def test_ages_that_cannot_be_are_refused(age: object) -> None:
    team = Team(Controller(TeamModel(T, 0), None, 1), np.zeros((1, 3)))  # type: ignore[arg-type]
    with pytest.raises(OmniError, match="measurement_age must be "):
        team.observe(np.zeros((1, 3)), measurement_age=age)  # type: ignore[arg-type]
