"""Test that no controller has less error than the limit, and its closed-form special cases."""

from typing import Any

import numpy as np
import pytest
from benches import studies as bench
from scipy.integrate import solve_ivp
from scipy.linalg import solve_discrete_are
from scipy.optimize import minimize

import omni_mj as om
from omni_control.controllers.registry import CONTROLLERS
from omni_control.kinematics import Array
from omni_control.reference import MotionLimits, TimedReference

PERIOD_S = 1 / 60
LAG_S, DELAY = 0.05, 3
ROUTE = {
    "waypoints": [[0, 0], [0.08, 0.03, 0.1]],
    "max_acceleration_m_s2": 3.0,
    "initial_rest_s": 0.12,
    "settle_s": 0.05,
}
SLOW = {"alpha_correlation_time_s": 10.0}
SEEDS, ITERATIONS = 2, 8


def lagging(commands: Array, lag_s: float) -> Array:
    """Return positions (F,) by v' = (u - v) / lag, solved by scipy, for delayed commands."""
    state, positions = np.zeros(2), [0.0]
    for command in np.concatenate([np.zeros(DELAY), commands])[: len(commands) - 1]:
        derivative = lambda _, x, u=command: [x[1], (u - x[1]) / lag_s]  # noqa: E731
        state = solve_ivp(derivative, (0, PERIOD_S), state, rtol=1e-10, atol=1e-12).y[:, -1]
        positions.append(state[0])
    return np.array(positions)


def test_first_order_lag_has_a_closed_form() -> None:
    commands = np.random.default_rng(0).standard_normal(15)
    computed = bench.deviations(
        bench.DeviationModel.prior(15, DELAY, LAG_S), np.outer(commands, [1, 0, 2])
    )
    np.testing.assert_allclose(computed, np.outer(lagging(commands, LAG_S), [1, 0, 2]), atol=1e-8)


def test_model_is_fitted_to_differences_between_runs() -> None:
    """Use a robot with less lag forward than sideways that turns on its path."""
    frames = 80
    heading = np.linspace(0, 2, frames)
    reference = np.stack([np.sin(heading), heading**2, heading], axis=1)
    c, s, none = np.cos(heading), np.sin(heading), np.zeros(frames)
    rotation = np.array([[c, -s, none], [s, c, none], [none, none, none + 1]]).transpose(2, 0, 1)
    axes = [bench.DeviationModel.prior(frames, DELAY, lag) for lag in (0.03, 0.08, 0.02)]

    def world(values: list[Array]) -> Array:
        return rotation @ np.diag([value[0, 0, 0] for value in values]) @ rotation.swapaxes(1, 2)

    command = np.array([world([axis.command[j] for axis in axes]) for j in range(2)])
    true = bench.DeviationModel(world([axis.velocity for axis in axes]), command, DELAY)
    commands = np.random.default_rng(1).standard_normal((frames, 3, 3))
    poses = np.stack([bench.deviations(true, commands[:, i]) for i in range(3)], axis=1)
    fitted = bench.DeviationModel.fit(reference, DELAY, poses, commands)
    np.testing.assert_allclose(fitted.velocity, true.velocity, atol=0.01)
    np.testing.assert_allclose(fitted.command, true.command, atol=0.01)


def test_optimized_commands_equal_those_of_scipy() -> None:
    """Along one axis, where the acceleration limit is active."""
    frames, delay = 40, 3
    model, limits = (
        bench.DeviationModel.prior(frames, delay, LAG_S),
        MotionLimits(5.0, 4.7, 26.0, 50.8),
    )
    errors = np.zeros((frames, 3))
    errors[10:, 0] = 0.01 * np.minimum(np.arange(frames - 10) / 10, 1)
    commands, expected = bench.planned(model, limits, errors)
    unit = np.eye(3 * frames)[:, ::3]
    gain = np.stack(
        [bench.deviations(model, column.reshape(-1, 3))[:, 0] for column in unit.T], axis=1
    )
    step = limits.acceleration * PERIOD_S
    sums = np.tril(np.ones((frames, frames)))  # commands are sums of bounded changes
    effect = gain @ sums
    optimum = minimize(
        lambda change: ((errors[:, 0] + effect @ change) ** 2).sum() * 1e4,
        np.zeros(frames),
        jac=lambda change: 2e4 * effect.T @ (errors[:, 0] + effect @ change),
        bounds=[(-step, step)] * frames,
        options={"maxiter": 5000, "ftol": 1e-15},
    )
    assert optimum.fun / 1e4 > 1e-8, "limits that do not bind"
    assert (expected[:, 0] ** 2).sum() == pytest.approx(optimum.fun / 1e4, rel=0.05)
    assert np.abs(np.diff(commands[:, 0], prepend=0)).max() < 1.01 * step


@pytest.mark.parametrize("weight", [0.01, 0.1])
def test_gains_far_from_the_end_solve_the_riccati_equation(weight: float) -> None:
    """Solve the algebraic equation by scipy for one axis of a time-invariant robot."""
    model = bench.DeviationModel.prior(300, DELAY, LAG_S)
    decay, inputs = model.velocity[0, 0, 0], model.command[:, 0, 0, 0]
    transition = np.array(
        [[1, PERIOD_S * decay, PERIOD_S * inputs[1]], [0, decay, inputs[1]], [0, 0, 0]]
    )
    effect = np.array([[PERIOD_S * inputs[0]], [inputs[0]], [1]])
    cost = solve_discrete_are(transition, effect, np.diag([1.0, 0, 0]), np.array([[weight]]))
    gain = np.linalg.solve(weight + effect.T @ cost @ effect, effect.T @ cost @ transition)[0]
    computed = bench.regulator_gains(model, weight)[0]
    for axis in range(3):
        np.testing.assert_allclose(computed[axis, axis::3], gain, rtol=1e-6)


def test_prediction_error_is_that_of_the_optimal_filter() -> None:
    """Use robots with white velocity noise: q per frame in position, measured with noise r.

    The stationary variance of the filter is P = M r / (M + r) with M = q/2 + sqrt(q^2/4 + q r). D
    frames later it is P + D q. The variance over 600 robots has an error of 6 %.
    """
    frames, n, step, noise = 80, 600, 1e-3, 2e-3
    settings: dict[str, Any] = {
        "vision": {"position_noise_m": noise},
        # Uniform noise: its standard deviation is its bound over root 3
        "disturbance": {"velocity_m_s": step / PERIOD_S * 3**0.5},
        "kinematic": {"alpha_low": 1.0, "alpha_high": 1.0},
    }
    scenario = om.load_scenario("rect", plant="kinematic", **settings)
    random = np.random.default_rng(0)
    poses = np.cumsum(step * random.standard_normal((frames, n, 3)) * [1, 1, 0], axis=0)
    measured = poses + noise * random.standard_normal((frames, n, 3)) * [1, 1, 0]
    predicted = bench.predicted_poses(scenario, poses, measured, 1.0, DELAY)
    q, r = step**2, noise**2
    prior = q / 2 + np.sqrt(q**2 / 4 + q * r)
    error = (poses[frames - 1] - predicted)[:, :2]
    assert error.var() == pytest.approx(prior * r / (prior + r) + DELAY * q, rel=0.12)


def test_robot_without_lag_is_inverted_exactly() -> None:
    """x(k+1) = x(k) + T alpha u(k-D) is inverted by u(k) = (r(k+D+1) - r(k+D)) / (T alpha).

    Lost packets and images are noise, too.
    """
    alpha, delay = 0.8, 6
    steady = {"alpha_low": alpha, "alpha_high": alpha}
    scenario = om.load_scenario("rect", plant="kinematic", reference=ROUTE, kinematic=steady)
    losses = {"radio": {"loss_probability": 0.3}, "vision": {"dropout_fraction": 0.2}}
    scenario = scenario.replace(settings=scenario.settings.replace(**losses))
    best, _ = bench.learned(scenario, 4)
    expected = np.diff(best.poses - best.errors, axis=0)[delay:, 0] / (PERIOD_S * alpha)
    assert np.abs(best.errors).max() < 2e-7
    np.testing.assert_allclose(best.sent[: len(expected), 0], expected, atol=2e-5)


def test_dead_time_of_fractional_frames_is_inverted_too() -> None:
    """The commands that are known in advance make up for it, as for one of whole frames."""
    scenario = om.load_scenario(
        "rect", plant="kinematic", reference=ROUTE, radio={"delay_frames": 5.5}
    )
    start, *_, end = om.find_limit(scenario, 1, iterations=8).history
    assert end["max"] < min(2e-6, start["max"] / 50)


def mean_errors(result: om.Result, name: str) -> dict[str, float]:
    """Return the mean over the seeds of maximum and mean position error."""
    error = next(iter(result.summary()["scenarios"].values()))["results"][name]["error_m"][
        "position"
    ]
    return {statistic: error[statistic]["mean"] for statistic in ("max", "mean")}


@pytest.mark.parametrize("plant", ["kinematic", "planar"])
def test_no_controller_has_less_error_than_the_limit(plant: str) -> None:
    """Privileged controllers are excluded. The study is repeatable.

    After 3 iterations, the error without noise is still as large as the error that noise adds.
    """
    sections: dict[str, Any] = {"kinematic": SLOW} if plant == "kinematic" else {}
    scenario = om.load_scenario("rect", plant=plant, reference=ROUTE, **sections)
    result = om.find_limit(scenario, SEEDS, iterations=ITERATIONS)
    runs = om.run(scenario, ["lqr", "mpc"], range(SEEDS))
    limit, noiseless = mean_errors(result, "limit"), mean_errors(result, "limit without noise")
    baselines = [name for name in CONTROLLERS if name != "oracle"]
    assert list(result.controllers) == ["limit", "limit without noise", *baselines]
    for name in baselines:
        for statistic, value in mean_errors(result, name).items():
            assert limit[statistic] <= value, (name, statistic)
    for name in runs.controllers:
        assert mean_errors(runs, name) == mean_errors(result, name)
    assert noiseless["mean"] < limit["mean"]
    trials = result.summary()["limit"]["trials"]
    assert trials[-1]["mean"] <= trials[0]["mean"]
    assert noiseless["mean"] == pytest.approx(trials[-1]["mean"], rel=1e-9), (
        "the learned run is repeated"
    )
    if plant == "kinematic":
        assert om.find_limit(scenario, SEEDS, iterations=ITERATIONS).table() == result.table()


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


@pytest.mark.parametrize("delay", [0, 40])
def test_bound_is_the_error_of_an_ideal_predictor(delay: int) -> None:
    """Robots with a drifting heading are simulated; a Kalman filter predicts their deviation.

    The mean over 1000 robots and 100 frames has a standard error below 1 %; allow 4 %.
    """
    scenario = om.load_scenario("rect", plant="planar", radio={"delay_frames": delay})
    settings, rng = scenario.settings, np.random.default_rng(0)
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0]]) * [1, 0.75, 1]
    route = TimedReference(corners, MotionLimits(3.159, 0.826, 6, 12), PERIOD_S)
    steps = np.diff(route.with_rest(15, 60).poses[:, :2], axis=0)
    growth = np.sqrt((steps**2).sum(1).mean())  # deviation per heading error, m/rad a frame
    decay = 1 - PERIOD_S * settings.firmware.heading_gain
    drift = PERIOD_S * settings.sensors.gyro_noise_rad_s
    noise = settings.vision.position_noise_m
    transition = np.array([[1, growth], [0, decay]])
    covariance, true, estimate = np.eye(2) * 1e-6, *np.zeros((2, 2, 1000))
    predictions, deviations = [], []
    for _ in range(900):
        gain = covariance[:, 0] / (covariance[0, 0] + noise**2)
        measured = true[0] + noise * rng.standard_normal(1000)
        # Predictions of this frame use the measurements of earlier frames.
        predictions.append((np.linalg.matrix_power(transition, delay) @ estimate)[0])
        deviations.append(true[0])
        estimate = transition @ (estimate + np.outer(gain, measured - estimate[0]))
        covariance = transition @ (covariance - np.outer(gain, covariance[0])) @ transition.T
        covariance[1, 1] += drift**2
        true = transition @ true
        true[1] += drift * rng.standard_normal(1000)
    error = np.array(deviations[800:]) - np.array(predictions[800 - delay : 900 - delay])
    bound = bench.compute_mean_error_bound(scenario)
    assert np.abs(error).mean() == pytest.approx(bound, rel=0.04)
    assert bench.compute_mean_error_bound(scenario.replace(plant="kinematic")) == 0
