"""The limit is one: no controller gets below it, and where its value is known in closed form, it is that."""

from typing import Any

import numpy as np
import pytest
from benches import studies as bench
from scipy.integrate import solve_ivp
from scipy.linalg import solve_discrete_are
from scipy.optimize import minimize

import omni_mj as om
from omni_control.controllers import CONTROLLERS
from omni_control.kinematics import Array
from omni_control.reference import MotionLimits

PERIOD_S = 1 / 60
LAG_S, DELAY = 0.05, 3
ROUTE = {
    "waypoints": [[0, 0], [0.08, 0.03, 0.1]], "max_acceleration_m_s2": 3.0, "initial_rest_s": 0.12, "settle_s": 0.05,
}  # fmt: skip
SLOW = {"alpha_correlation_time_s": 10.0}
SEEDS = 2


def lagging(commands: Array, lag_s: float) -> Array:
    """Positions (F,) of a body with v' = (u - v) / lag by scipy's solver; each command acts for a frame, late."""
    state, positions = np.zeros(2), [0.0]
    for command in np.concatenate([np.zeros(DELAY), commands])[: len(commands) - 1]:
        law = lambda _, x, u=command: [x[1], (u - x[1]) / lag_s]  # noqa: E731
        state = solve_ivp(law, (0, PERIOD_S), state, rtol=1e-10, atol=1e-12).y[:, -1]
        positions.append(state[0])
    return np.array(positions)


def test_first_order_lag_has_a_closed_form() -> None:
    commands = np.random.default_rng(0).standard_normal(15)
    found = bench.departures(bench.PRIOR(15, DELAY, LAG_S), np.outer(commands, [1, 0, 2]))
    np.testing.assert_allclose(found, np.outer(lagging(commands, LAG_S), [1, 0, 2]), atol=1e-8)


def test_model_is_fitted_to_differences_between_runs() -> None:
    """Of a robot that lags less ahead than aside and turns on its path."""
    frames = 80
    heading = np.linspace(0, 2, frames)
    reference = np.stack([np.sin(heading), heading**2, heading], axis=1)
    c, s, none = np.cos(heading), np.sin(heading), np.zeros(frames)
    turned = np.array([[c, -s, none], [s, c, none], [none, none, none + 1]]).transpose(2, 0, 1)
    axes = [bench.PRIOR(frames, DELAY, lag) for lag in (0.03, 0.08, 0.02)]

    def world(values: list[Array]) -> Array:
        return turned @ np.diag([value[0, 0, 0] for value in values]) @ turned.swapaxes(1, 2)

    command = np.array([world([axis.command[j] for axis in axes]) for j in range(2)])
    true = bench.Model(world([axis.velocity for axis in axes]), command, DELAY)
    commands = np.random.default_rng(1).standard_normal((frames, 3, 3))
    poses = np.stack([bench.departures(true, commands[:, i]) for i in range(3)], axis=1)
    found = bench.FIT(reference, DELAY, poses, commands)
    np.testing.assert_allclose(found.velocity, true.velocity, atol=0.01)
    np.testing.assert_allclose(found.command, true.command, atol=0.01)


def test_optimized_commands_equal_those_of_scipy() -> None:
    """Against scipy's solver of the same problem along one axis, in which the limit of acceleration binds."""
    frames, delay = 40, 3
    model, limits = bench.PRIOR(frames, delay, LAG_S), MotionLimits(5.0, 4.7, 26.0, 50.8)
    errors = np.zeros((frames, 3))
    errors[10:, 0] = 0.01 * np.minimum(np.arange(frames - 10) / 10, 1)
    commands, expected = bench.planned(model, limits, errors)
    unit = np.eye(3 * frames)[:, ::3]
    gain = np.stack(
        [bench.departures(model, column.reshape(-1, 3))[:, 0] for column in unit.T], axis=1
    )
    step = limits.acceleration * PERIOD_S
    sums = np.tril(np.ones((frames, frames)))  # commands are sums of bounded changes
    effect = gain @ sums
    best = minimize(
        lambda change: ((errors[:, 0] + effect @ change) ** 2).sum() * 1e4,
        np.zeros(frames),
        jac=lambda change: 2e4 * effect.T @ (errors[:, 0] + effect @ change),
        bounds=[(-step, step)] * frames,
        options={"maxiter": 5000, "ftol": 1e-15},
    )
    assert best.fun / 1e4 > 1e-8, "limits that do not bind"
    assert (expected[:, 0] ** 2).sum() == pytest.approx(best.fun / 1e4, rel=0.05)
    assert np.abs(np.diff(commands[:, 0], prepend=0)).max() < 1.01 * step


@pytest.mark.parametrize("weight", [0.01, 0.1])
def test_gains_far_from_the_end_solve_the_riccati_equation(weight: float) -> None:
    """For one axis of a robot that is the same in every frame, by scipy."""
    model = bench.PRIOR(300, DELAY, LAG_S)
    keep, push = model.velocity[0, 0, 0], model.command[:, 0, 0, 0]
    transition = np.array([[1, PERIOD_S * keep, PERIOD_S * push[1]], [0, keep, push[1]], [0, 0, 0]])
    effect = np.array([[PERIOD_S * push[0]], [push[0]], [1]])
    cost = solve_discrete_are(transition, effect, np.diag([1.0, 0, 0]), np.array([[weight]]))
    gain = np.linalg.solve(weight + effect.T @ cost @ effect, effect.T @ cost @ transition)[0]
    found = bench.regulator_gains(model, weight)[0]
    for axis in range(3):
        np.testing.assert_allclose(found[axis, axis::3], gain, rtol=1e-6)


def test_prediction_error_is_that_of_the_optimal_filter() -> None:
    """Of robots on which only white noise of the speed acts, per frame q in position, seen with noise r.

    The filter of such a random walk settles at a variance P = M r / (M + r) with M = q/2 +
    sqrt(q^2/4 + q r), and D frames later it is P + D q. 600 robots make a variance known within 6 %
    of itself.
    """
    frames, n, step, noise = 80, 600, 1e-3, 2e-3
    settings: dict[str, Any] = {
        "vision": {"position_noise_m": noise},
        "disturbance": {
            "velocity_m_s": step / PERIOD_S * 3**0.5
        },  # uniform: its standard deviation is this by root 3
        "kinematic": {"alpha_low": 1.0, "alpha_high": 1.0},
    }
    scenario = om.load_scenario("rect", plant="kinematic", **settings)
    random = np.random.default_rng(0)
    poses = np.cumsum(step * random.standard_normal((frames, n, 3)) * [1, 1, 0], axis=0)
    measured = poses + noise * random.standard_normal((frames, n, 3)) * [1, 1, 0]
    ahead = bench.predicted_poses(scenario, poses, measured, 1.0, DELAY)
    q, r = step**2, noise**2
    before = q / 2 + np.sqrt(q**2 / 4 + q * r)
    off = (poses[frames - 1] - ahead)[:, :2]
    assert off.var() == pytest.approx(before * r / (before + r) + DELAY * q, rel=0.12)


def test_robot_without_lag_is_inverted_exactly() -> None:
    """With alpha the same for ever, x(k+1) = x(k) + T alpha u(k-D) wants u(k) = (r(k+D+1) - r(k+D)) / (T alpha)."""
    alpha, delay = 0.8, 6
    steady = {"alpha_low": alpha, "alpha_high": alpha}
    scenario = om.load_scenario("rect", plant="kinematic", reference=ROUTE, kinematic=steady)
    best, _ = bench.learned(scenario, 4)
    wanted = np.diff(best.poses - best.errors, axis=0)[delay:, 0] / (PERIOD_S * alpha)
    assert np.abs(best.errors).max() < 2e-7
    np.testing.assert_allclose(best.sent[: len(wanted), 0], wanted, atol=2e-5)


def least(result: om.Result, name: str) -> dict[str, float]:
    """Over the seeds, mean of the maximum and the mean of the error in the plane."""
    error = next(iter(result.summary()["scenarios"].values()))["results"][name]["error_m"][
        "position"
    ]
    return {statistic: error[statistic]["mean"] for statistic in ("max", "mean")}


@pytest.mark.parametrize("plant", ["kinematic", "planar"])
def test_no_controller_has_less_error_than_the_limit(plant: str) -> None:
    """With the same seeds, but for those that are told the truth; and it is the same every time."""
    sections: dict[str, Any] = {"kinematic": SLOW} if plant == "kinematic" else {}
    scenario = om.load_scenario("rect", plant=plant, reference=ROUTE, **sections)
    found = om.find_limit(scenario, SEEDS, iterations=6)
    driven = om.run(scenario, ["lqr", "mpc"], range(SEEDS))
    limit, still = least(found, "limit"), least(found, "limit without noise")
    rivals = [name for name in CONTROLLERS if name != "oracle"]
    assert list(found.controllers) == ["limit", "limit without noise", *rivals]
    for name in rivals:
        for statistic, value in least(found, name).items():
            assert limit[statistic] <= value, (name, statistic)
    for name in driven.controllers:
        assert least(driven, name) == least(found, name)
    assert still["mean"] < limit["mean"]
    trials = found.summary()["limit"]["trials"]
    assert trials[-1]["mean"] <= trials[0]["mean"]
    assert still["mean"] == pytest.approx(trials[-1]["mean"], rel=1e-9), (
        "shown again as it was learned"
    )
    if plant == "kinematic":
        assert om.find_limit(scenario, SEEDS, iterations=6).table() == found.table()


def test_stopped_limit_study_is_incomplete() -> None:
    begun = []

    def begin(title: str, frames: int) -> Any:
        begun.append(title)

        def after_frame(frame: int) -> None:
            assert frame < frames
            if len(begun) == 3:
                raise bench.StoppedError("interrupted")

        return after_frame

    result = om.find_limit(
        om.load_scenario("rect", plant="kinematic", reference=ROUTE), 1, start_progress=begin
    )
    assert (result.stopped, result.complete, result.table()) == ("interrupted", False, "")
    assert result.summary()["stopped"] == "interrupted"
