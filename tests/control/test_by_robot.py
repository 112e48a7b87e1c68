"""The same by other arithmetic: loops over robots instead of numpy, and single numbers instead of arrays."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omni_control.controllers import make
from omni_control.controllers.base import Told
from omni_control.controllers.identifying import Identifying
from omni_control.estimation.kalman import KalmanFilter
from omni_control.fuzzy.by_robot import velocity
from omni_control.fuzzy.rules import ENGINE, FuzzyLaw
from omni_control.kinematics import FEW, Array, Kinematics
from omni_control.limits import CommandLimits
from omni_control.reference import MotionLimits, TimedReference
from omni_control.team import Team
from tests.support.laws import LAW

T = 1 / 60
REFERENCE = TimedReference([(0, 0, 0), (0.8, 0.3, 1.0), (0.2, 0.9, -2.5)], MotionLimits(2.0, 3.0, 6.0, 20.0), T)
WHEELS = Kinematics(np.deg2rad([60, 135, 225, 300]), 0.08, 0.028)
FRAMES = 30


def images(n: int, late: bool) -> tuple[Array, Array | None]:
    """Noisy poses (frames, n, 3) behind the reference, some of them missing or elsewhere, and their ages."""
    rng = np.random.default_rng(7)
    poses = REFERENCE.poses[np.maximum(np.arange(FRAMES) - 7, 0)]
    seen = poses[:, None] * rng.uniform(0.9, 1.0, (n, 1)) + rng.normal(0, [0.002, 0.002, 0.01], (FRAMES, n, 3))
    seen[rng.uniform(size=(FRAMES, n)) < 0.1] = np.nan
    seen[18:21, 0, :2] += 0.03  # pushed, or taken for another
    return seen, rng.uniform(0, 0.06, (FRAMES, n)) if late else None


def driven(
    n: int, late: bool, *, loops: bool, rows: slice = slice(None), alpha: tuple[float, float] | None = (0.9, 0.8)
) -> tuple[Array, Identifying]:
    """Commands (frames, n, 3) for these images, and the controller after them."""
    told = Told(T, 4, alpha=alpha, geometry=WHEELS, compiled=(lambda loop: loop) if loops else None)
    seen, ages = images(n, late)
    seen, ages = seen[:, rows], None if ages is None else ages[:, rows]
    controller = make("adaptive-comp-flc", told, REFERENCE, seen.shape[1])
    team = Team(controller, np.zeros((seen.shape[1], 3)))
    commands = [team.step(seen[k], age=None if ages is None else ages[k]) for k in range(FRAMES)]
    assert isinstance(controller, Identifying)
    return np.array(commands), controller


@pytest.mark.parametrize(("late", "alpha"), [(False, (0.9, 0.8)), (True, (0.9, 0.8)), (False, None)])
def test_loops_identify_predict_and_command_as_numpy_does(late: bool, alpha: tuple[float, float] | None) -> None:
    """Uncompiled, over images of every kind: to what rounding grows to in 30 frames of feedback."""
    (numpys, one), (looped, other) = (driven(2, late, loops=loops, alpha=alpha) for loops in (False, True))
    np.testing.assert_allclose(looped, numpys, rtol=0, atol=1e-11)
    for name in ("position", "velocity", "push", "variance", "surprise", "sliding", "noise", "latency"):
        np.testing.assert_allclose(getattr(other.plant, name), getattr(one.plant, name), rtol=0, atol=1e-11)
    for name in ("heading", "rate", "bias", "lag", "effort", "friction", "coupling", "variance", "surprise"):
        np.testing.assert_allclose(getattr(other.turning, name), getattr(one.turning, name), rtol=0, atol=1e-11)


@pytest.mark.parametrize("late", [False, True])
def test_loops_take_each_robot_by_itself(late: bool) -> None:
    """Alone it is commanded the same, bit for bit."""
    together, _ = driven(3, late, loops=True)
    alone, _ = driven(3, late, loops=True, rows=slice(1, 2))
    assert np.array_equal(together[:, 1:2], alone)


def test_a_loop_corrects_no_error_that_is_not_a_number() -> None:
    """Minima and maxima of Python and of compilers would take it for a number: the team stops whom it is told."""
    for error in ((np.nan, 0.0), (0.0, np.nan)):
        assert np.isnan(velocity(ENGINE.tables, FuzzyLaw().ranges, *error)).all()


@LAW
@given(seed=st.integers(0, 10_000), n=st.integers(1, FEW))
def test_few_robots_are_filtered_and_limited_as_among_many(seed: int, n: int) -> None:
    """Bit for bit, whether numbers are taken one by one or all at once: seen or not, turned about, too fast."""
    rng, many = np.random.default_rng(seed), FEW + 3
    noise, limits = rng.uniform(0, 0.01, (many, 3)), [MotionLimits(*rng.uniform(0.5, 5, 4)) for _ in range(many)]
    start, last = rng.normal(0, 1, (many, 3)), rng.normal(0, 1, (many, 3))
    filters = [KalmanFilter(start[:count], T, noise[:count]) for count in (n, many)]
    few, all_of_them = (CommandLimits(limits[:count], T) for count in (n, many))
    for _ in range(5):
        measured = start + rng.normal(0, [0.01, 0.01, 3.0], (many, 3))
        measured[rng.uniform(size=many) < 0.3] = np.nan
        displacement = rng.normal(0, 0.03, (many, 3))
        for each, count in zip(filters, (n, many), strict=True):
            each.update(measured[:count], displacement[:count])
        for name in ("pose", "twist", "drift", "sigma", "normalised"):
            one, other = (getattr(each, name) for each in filters)
            assert np.array_equal(one, other[:n], equal_nan=True), name
        wanted = rng.normal(0, 1, (many, 3)) * 10.0 ** rng.integers(-3, 200, (many, 1))
        assert np.array_equal(few(wanted[:n], last[:n]), all_of_them(wanted, last)[:n])


@LAW
@given(
    kind=st.sampled_from(["p", "flc", "comp-flc", "comp-flc-lag"]),
    seed=st.integers(0, 10_000),
    n=st.integers(1, FEW + 2),
    late=st.booleans(),
)
def test_a_team_goes_through_frames_by_loops_as_by_numpy(kind: str, seed: int, n: int, late: bool) -> None:
    """Bit for bit, with images that are missing, elsewhere, backwards, the same again, or late, which numpy takes in.

    What a loop leaves to numpy depends on all robots of a team, and must not be seen in one that is not concerned.
    """
    rng, start = np.random.default_rng(seed), np.random.default_rng(seed).normal(0, 1, (n, 3))
    limits, loop = MotionLimits(*rng.uniform(0.5, 5, 4)), lambda function: function
    teams = [
        Team(make(kind, Told(T, 3, limits=limits, compiled=compiled), REFERENCE, n), start) for compiled in (None, loop)
    ]
    measured = start
    for k in range(25):
        again = rng.random((n, 1)) < 0.05
        measured = np.where(again, measured, start + rng.normal(0, [0.01, 0.01, 0.1], (n, 3)))
        measured[rng.random(n) < 0.1] = np.nan
        measured[rng.random(n) < 0.05] += rng.choice([[0.5, 0, 0], [0, 0, np.pi]])
        age = rng.uniform(0, 0.03, n) if late and k == 10 else None
        one, other = (team.step(measured, age=age) for team in teams)
        np.testing.assert_array_equal(other, one)
        for name in ("estimate", "twist", "predicted", "alpha_hat"):
            np.testing.assert_array_equal(getattr(teams[1], name), getattr(teams[0], name))
        for name in ("state", "sigma", "normalised"):
            np.testing.assert_array_equal(getattr(teams[1].filter, name), getattr(teams[0].filter, name))
