"""What leads robots along a run: the model of departures, the filter on it and the regulator, each by another way."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import solve_discrete_are

import omni_mj as om
from omni_control.kinematics import Array
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies.limit.attempts import Learned, led
from omni_mj.studies.limit.deviations import Deviations
from omni_mj.studies.limit.follower import Follower, regulator
from omni_mj.studies.limit.predictor import COMPASS, GAIN, POSE, Predictor
from omni_mj.studies.limit.unknowns import Unknowns

LAG_S, DELAY = 0.05, 3


def lagging(commands: Array, lag_s: float) -> Array:
    """Positions (F,) of a body with v' = (u - v) / lag by scipy's solver; each command acts for a frame, late."""
    state, positions = np.zeros(2), [0.0]
    for command in np.concatenate([np.zeros(DELAY), commands])[: len(commands) - 1]:
        way = lambda _, x, u=command: [x[1], (u - x[1]) / lag_s]  # noqa: E731
        state = solve_ivp(way, (0, PERIOD_S), state, rtol=1e-10, atol=1e-12).y[:, -1]
        positions.append(state[0])
    return np.array(positions)


def departed(deviations: Deviations, commands: Array) -> Array:
    poses, by = deviations.operators()
    return np.linalg.solve(poses.toarray(), by @ commands.ravel()).reshape(-1, 3)


def test_a_robot_that_lags_is_known_in_closed_form() -> None:
    commands = np.random.default_rng(0).standard_normal(15)
    found = departed(Deviations.prior(15, DELAY, LAG_S), np.outer(commands, [1, 0, 2]))
    np.testing.assert_allclose(found, np.outer(lagging(commands, LAG_S), [1, 0, 2]), atol=1e-8)


def test_deviations_are_found_in_how_runs_differ() -> None:
    """Of a robot that lags less ahead than aside and turns on its way.

    Regressors that are held back a little cost less than 1 % where many of them say much the same.
    """
    frames, lags = 80, (0.03, 0.08, 0.02)
    heading = np.linspace(0, 2, frames)
    reference = np.stack([np.sin(heading), heading**2, heading], axis=1)
    each = [Deviations.prior(frames, DELAY, lag) for lag in lags]
    c, s, none = np.cos(heading), np.sin(heading), np.zeros(frames)
    turned = np.array([[c, -s, none], [s, c, none], [none, none, none + 1]]).transpose(2, 0, 1)

    def body(of: list[Array]) -> Array:
        return turned @ (np.eye(3) * np.stack([each[:, 0, 0] for each in of], axis=1)[:, None]) @ turned.swapaxes(1, 2)

    keep = body([one.keep for one in each])
    push = np.array([body([one.push[j] for one in each]) for j in range(2)])
    true = Deviations(keep, push, DELAY)
    commands = np.random.default_rng(1).standard_normal((frames, 3, 3))
    poses = np.stack([departed(true, commands[:, i]) for i in range(3)], axis=1)
    found = Deviations.fit(reference, DELAY, poses, commands)
    np.testing.assert_allclose(found.keep, true.keep, atol=0.01)
    np.testing.assert_allclose(found.push, true.push, atol=0.01)


@pytest.mark.parametrize("weight", [0.01, 0.1])
def test_far_from_the_end_gains_are_those_of_the_riccati_equation(weight: float) -> None:
    """For one axis of a robot that is the same in every frame, by scipy."""
    deviations = Deviations.prior(300, DELAY, LAG_S)
    keep, push = deviations.keep[0, 0, 0], deviations.push[:, 0, 0, 0]
    transition = np.array([[1, PERIOD_S * keep, PERIOD_S * push[1]], [0, keep, push[1]], [0, 0, 0]])
    effect = np.array([[PERIOD_S * push[0]], [push[0]], [1]])
    cost = solve_discrete_are(transition, effect, np.diag([1.0, 0, 0]), np.array([[weight]]))
    gain = np.linalg.solve(weight + effect.T @ cost @ effect, effect.T @ cost @ transition)[0]
    found = regulator(deviations, weight)[0]
    for axis in range(3):
        np.testing.assert_allclose(found[axis, axis::3], gain, rtol=1e-6)


def test_poses_are_predicted_as_well_as_can_be() -> None:
    """Of robots on which only white noise of the speed acts, per frame q in position, seen with noise r.

    The filter of such a random walk settles at a variance P = M r / (M + r) with M = q/2 + sqrt(q^2/4 + q r), and D
    frames later it is P + D q. 600 robots make a variance known within 6 % of itself.
    """
    frames, n, step, noise = 80, 600, 1e-3, 2e-3
    settings = om.scenario("rect", vision={"position_noise_m": noise}).settings
    unknowns = Unknowns(speed=step / PERIOD_S, turn=1e-9, drift=0, turn_drift=0, compass=0)
    zero = np.zeros((frames, n, 3))
    predictor = Predictor(Deviations.prior(frames, DELAY, 0.0), zero, zero, settings, unknowns, firmware=False)
    random = np.random.default_rng(0)
    poses = np.cumsum(step * random.standard_normal((frames, n, 3)) * [1, 1, 0], axis=0)
    for k in range(frames - DELAY):
        ahead = predictor.see(poses[k] + noise * random.standard_normal((n, 3)) * [1, 1, 0], np.zeros(n))
        predictor.sent(np.zeros((n, 3)))
    q, r = step**2, noise**2
    before = q / 2 + np.sqrt(q**2 / 4 + q * r)
    off = (poses[frames - 1] - ahead[:, POSE])[:, :2]
    assert off.var() == pytest.approx(before * r / (before + r) + DELAY * q, rel=0.12)


def test_what_firmware_and_carpet_do_to_a_command_is_undone() -> None:
    """A command c that a gain g makes larger and a compass error a turns does what was planned, without feedback:

    (1 + g) c + a (c_y, -c_x) = u; the rounds in which it is found leave |g|^6 of it, 6e-5 of u.
    """
    frames, n, gain, compass = 20, 2, -0.2, 0.05
    settings = om.scenario("rect").settings
    planned = np.tile([1.0, -0.5, 0.0], (frames, n, 1))
    deviations = Deviations.prior(frames, DELAY, 0.0)
    still = Unknowns(*[1e-9] * 5)
    predictor = Predictor(deviations, planned, np.zeros((frames, n, 3)), settings, still, firmware=False)
    predictor.state[:, GAIN], predictor.state[:, COMPASS] = gain, compass
    follower = Follower(predictor, np.zeros((frames, 1, 3, 9)), np.zeros(n, int))
    sent = follower(np.full((n, 3), np.nan), np.zeros(n))
    wanted = np.linalg.solve([[1 + gain, compass], [-compass, 1 + gain]], [1.0, -0.5])
    np.testing.assert_allclose(sent[:, :2], np.tile(wanted, (n, 1)), rtol=3e-4)


def test_the_filter_sees_the_compass_error_of_the_firmware() -> None:
    """Of a gyro whose bias turns it by 2 degrees in a second; what the filter makes of it is right to a third."""
    chosen = om.scenario(
        "rect",
        wheels={"model": "two-rollers"},
        sensors={"gyro_bias_rad_s": 0.05},
        reference={"waypoints": [[0, 0], [1.2, 0]], "max_acceleration_m_s2": 1.5, "settle_s": 0},
    )
    simulation = Simulation(chosen, [Learned], seeds=range(4))
    poses = simulation.references[0].poses
    frames, delay = len(poses), chosen.settings.radio.delay_frames
    commands = np.zeros_like(poses)
    commands[: frames - 1 - delay] = np.diff(poses, axis=0)[delay:] / PERIOD_S
    commands, poses = (np.repeat(values[:, None], 4, axis=1) for values in (commands, poses))
    deviations = Deviations.prior(frames, delay, LAG_S)
    predictor = Predictor(deviations, commands, poses, chosen.settings, Unknowns(), firmware=True)
    follower = Follower(predictor, regulator(deviations, 0.1)[:, None], np.zeros(4, int))
    found = []

    def note(_: int) -> None:
        plant = simulation.plant
        assert isinstance(plant, MujocoPlant)
        found.append((plant._firmware.estimate.heading - plant.pose()[:, 2], predictor.state[:, COMPASS]))

    led(simulation, follower, note)
    true, known = np.array(found)[frames // 2 :, 0], np.array(found)[frames // 2 :, 1]
    assert np.sqrt((true**2).mean()) > 0.005
    assert np.sqrt(((true - known) ** 2).mean()) < np.sqrt((true**2).mean()) / 3
