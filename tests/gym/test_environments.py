"""The environments: observations, actions and rewards equal those of a controller in the loop."""

import subprocess
import sys
import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import omni_mj as om
import omni_mj.gym
from omni_control.install_hints import describe_installation

SHORT = {"waypoints": [[0, 0], [0.2, 0.1, 0.5]], "settle_s": 0.1}
DRAWN = {
    "plant": "kinematic",
    "reference": SHORT,
    "radio": {"delay_frames": {"uniform": [2, 7]}},
    "control": {"max_speed_m_s": {"choice": [2.0, 3.0]}},
}
MEMORY = 9


def act(observation: np.ndarray, max_command: np.ndarray | float) -> np.ndarray:
    """Return actions of a policy: the previewed twist plus three times the pose error."""
    pose_error, twist = observation[..., 3:6], observation[..., 18:21]
    return (twist + 3.0 * pose_error) / max_command


def make_env(scenario: om.Scenario | str = "rect", **options: Any) -> gymnasium.Env:
    """Return one environment, without Gymnasium's wrappers."""
    return gymnasium.make("omni_mj/Track-v0", scenario=scenario, **options).unwrapped


def make_envs(
    num_envs: int = 1, scenario: om.Scenario | str = "rect", **options: Any
) -> gymnasium.vector.VectorEnv:
    """Return a vector of environments."""
    return gymnasium.make_vec("omni_mj/Track-v0", num_envs, scenario=scenario, **options)


class Policy(om.Controller):
    """The policy of `act` as a controller."""

    def __init__(self, model: Any, reference: Any, n: int) -> None:
        super().__init__(model, reference, n)
        self.memory_frames = MEMORY

    def command(self, frame: int, observation: om.Observation) -> np.ndarray:
        observed = omni_mj.gym.encode_observation(frame, observation, self.reference, MEMORY)
        return omni_mj.gym.decode_action(act(observed, 4.0), observation, self.model.limits)


@pytest.mark.parametrize("plant", ["kinematic", "mujoco"])
def test_gymnasium_check_passes(plant: str) -> None:
    """No warnings about spaces, returned types, and reproducible seeds."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make("omni_mj/Track-v0", plant=plant, reference=SHORT).unwrapped)


def test_rewards_equal_the_errors_of_the_same_controller() -> None:
    """The same seed gives the same noise and drawn settings; compared with the run's table."""
    changes = {**DRAWN, "plant": "planar"}
    result = om.run(om.load_scenario("rect", **changes), [Policy], seeds=[5])
    table = result.frames().to_pydict()
    x, y, turn = (np.subtract(table[a], table[f"ref_{a}"]) for a in ("x_m", "y_m", "heading_rad"))
    expected = -(np.hypot(x, y) + 0.09 * np.abs(turn))

    env = make_env("rect", history_length=MEMORY, **changes)
    observation, info = env.reset(seed=5)
    rewards, end = [], False
    while not end:
        observation, reward, terminated, end, _ = env.step(act(observation, 4.0))
        rewards.append(reward)
        assert not terminated
    assert info == {"seed": 5}
    np.testing.assert_array_equal(rewards, expected[1:])  # the first frame is the start


def test_observations_are_errors_to_the_reference() -> None:
    """Without noise, alpha = 1: full speed is a delayed ramp of the highest acceleration."""
    delay, history_length, speed, max_acceleration = 3, 5, 2.0, 4.7
    route = {"waypoints": [[0, 0, 1.0], [0, 0.5, 1.0]], "settle_s": 0.5}
    env = make_env(
        "rect",
        plant="kinematic",
        reference=route,
        radio={"delay_frames": delay},
        control={"max_speed_m_s": speed, "max_acceleration_m_s2": max_acceleration},
        kinematic={"alpha_low": 1.0, "alpha_high": 1.0},
        disturbance={"velocity_m_s": 0.0},
        vision={"position_noise_m": 0.0, "heading_noise_rad": 0.0},
        history_length=history_length,
    )
    observation, _ = env.reset(seed=0)
    step = 1 / 60
    forward = np.array([np.cos(1.0), np.sin(1.0)])
    reference = (
        om.Simulation(om.load_scenario("rect", reference=route), ["p"]).references[0].poses[:, :2]
    )
    sent = [0.0] * (history_length + delay)
    for frame in range(1, 20):
        sent.append(min(sent[-1] + max_acceleration * step, speed))
        observation, *_ = env.step([1.0, 0.0, 0.0])
        acted_distance, all_sent = (step * sum(sent[: len(sent) - late]) for late in (delay, 0))
        body_axes = np.stack([forward, [-forward[1], forward[0]]])
        # Vision is exact, but the filter assumes a noise of 1.3 mm, and lags by less than that.
        np.testing.assert_allclose(
            observation[:2], body_axes @ (reference[frame] - acted_distance * forward), atol=1.3e-3
        )
        np.testing.assert_allclose(
            observation[3:5],
            body_axes @ (reference[frame + delay] - all_sent * forward),
            atol=1.3e-3,
        )
        np.testing.assert_allclose(
            observation[-3 * history_length :].reshape(history_length, 3)[:, 0],
            sent[-history_length:],
            atol=1e-3,
        )
        np.testing.assert_allclose(
            observation[-3 * history_length :].reshape(history_length, 3)[:, 1:], 0, atol=1e-3
        )


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED])
def test_vector_equals_single_environments(mode: AutoresetMode) -> None:
    """Bit for bit Gymnasium's own vector of single environments, with episodes of other lengths."""
    n, lost = 4, 0.12
    envs = make_envs(n, "rect", max_error_m=lost, autoreset_mode=mode, **DRAWN)
    single_envs = SyncVectorEnv(
        [lambda: make_env("rect", max_error_m=lost, **DRAWN) for _ in range(n)], autoreset_mode=mode
    )
    random = np.random.default_rng(0)
    assert_same(envs.reset(seed=3), single_envs.reset(seed=3))
    assert envs.metadata["autoreset_mode"] is mode
    n_ended = np.zeros(2, int)
    for _ in range(120):
        action = random.uniform(-0.5, 0.5, (n, 3)).astype(np.float32)
        result, expected = envs.step(action), single_envs.step(action)
        assert_same(result, expected)
        n_ended += result[2].sum(), result[3].sum()
        ended = result[2] | result[3]
        if mode is AutoresetMode.DISABLED and ended.any():
            options = [{"reset_mask": ended.copy()} for _ in range(2)]
            assert_same(envs.reset(options=options[0]), single_envs.reset(options=options[1]))
    assert (n_ended > 0).all()


def assert_same(result: Any, expected: Any) -> None:
    """Compare nested results bit for bit; ignore robots outside the mask of a result."""
    if isinstance(expected, dict):
        assert result.keys() == expected.keys()
        for name, values in expected.items():
            mask = expected.get(f"_{name}", ...)
            assert_same(result[name][mask], values[mask])
    elif isinstance(expected, tuple):
        for result_i, expected_i in zip(result, expected, strict=True):
            assert_same(result_i, expected_i)
    else:
        np.testing.assert_array_equal(result, expected)


def test_ending_an_episode_early_never_pays() -> None:
    """The remaining frames cost as if the robot had stayed there: getting lost never pays."""
    env = make_env("rect", max_error_m=0.2, plant="kinematic", reference=SHORT)
    env.reset(seed=1)
    rewards, terminated = [], False
    while not terminated:
        _, reward, terminated, truncated, info = env.step([-1.0, 0.0, 0.0])
        assert not truncated
        rewards.append(reward)
    frames = (
        om.Simulation(om.load_scenario("rect", plant="kinematic", reference=SHORT))
        .references[0]
        .frames
        - 1
    )
    assert info["position_error_m"] > 0.2
    assert sum(rewards) == pytest.approx(sum(rewards[:-1]) - 0.2 * (frames - len(rewards) + 1))
    assert env.step([0.0, 0.0, 0.0])[1:4] == (0.0, True, False)


def test_robots_that_cannot_share_a_model_are_simulated_apart() -> None:
    """With drawn masses on the MuJoCo plant each robot is its own batch, equal bit for bit."""
    changes = {"reference": SHORT, "body": {"mass_kg": {"uniform": [2.3, 2.6]}}}
    envs, env = make_envs(3, "rect", **changes), make_env("rect", **changes)
    observation, info = envs.reset(seed=0)
    single, _ = env.reset(seed=2)
    np.testing.assert_array_equal(observation[2], single)
    for _ in range(3):
        result, single = envs.step(np.full((3, 3), 0.1)), env.step(np.full(3, 0.1))
        np.testing.assert_array_equal(result[0][2], single[0])
        assert result[1][2] == single[1]
    assert info["seed"].tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"scenario": "recht"}, "unknown scenario"),
        ({"plant": "planer"}, "unknown plant"),
        ({"history_length": 0}, "history_length must be from 1"),
        ({"max_error_m": 0.0}, "max_error_m must be above 0"),
        ({"world": {"start_poses": [[0, 0, 0], [0, 2, 0]]}}, "an environment has one robot"),
        ({"radio": {"delay_frames": {"normal": [6, 1]}}}, "give history_length="),
        ({"autoreset_mode": "SameStep"}, "must be NextStep or Disabled"),
    ],
)
def test_invalid_arguments_are_rejected_with_one_line(
    arguments: dict[str, Any], words: str
) -> None:
    with pytest.raises(om.OmniError, match=words):
        make_envs(**arguments)


def test_scenarios_with_parameterized_controllers_are_accepted() -> None:
    """The scenario's own controllers do not matter."""
    scenario_with_controllers = om.load_scenario(
        "rect", plant="kinematic", controllers=[Policy, Tuned], controller={"Tuned": {"gain": 2.0}}
    )
    observation, _ = make_env(scenario_with_controllers).reset(seed=0)
    np.testing.assert_array_equal(observation, make_env("rect", plant="kinematic").reset(seed=0)[0])


class Tuned(Policy):
    gain: float = 1.0


def test_invalid_actions_are_rejected() -> None:
    env = make_envs(2, plant="kinematic")
    env.reset(seed=0)
    for action in (np.zeros(3), np.full((2, 3), np.nan)):
        with pytest.raises(om.OmniError, match="actions must be finite numbers"):
            env.step(action)


def test_gymnasium_imports_the_package_by_the_environments_name() -> None:
    """No import of this package is needed; without Gymnasium one line names the extra."""
    for code, words in (
        (
            "import gymnasium; "
            "print(gymnasium.make_vec('omni_mj.gym:omni_mj/Track-v0', 2, plant='kinematic'))",
            "TrackVectorEnv",
        ),
        (
            "import sys; sys.modules['gymnasium'] = None; import omni_mj.gym",
            describe_installation("gym"),
        ),
    ):
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, timeout=60
        )
        assert words in (done.stdout + done.stderr).splitlines()[-1]
