"""The environments: observations, actions and rewards equal those of a controller in the loop."""

import copy
import pickle
import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from commands import run_python
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
    expected = 1.0 - np.minimum(np.hypot(x, y) + 0.09 * np.abs(turn), 1.0)

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
        present = body_axes @ (reference[frame] - acted_distance * forward)
        predicted = body_axes @ (reference[frame + delay] - all_sent * forward)
        history = observation[-3 * history_length :].reshape(history_length, 3)
        np.testing.assert_allclose(observation[:2], present, atol=1.3e-3)
        np.testing.assert_allclose(observation[3:5], predicted, atol=1.3e-3)
        np.testing.assert_allclose(history[:, 0], sent[-history_length:], atol=1e-3)
        np.testing.assert_allclose(history[:, 1:], 0, atol=1e-3)


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


def play(env: gymnasium.Env, action: list[float]) -> tuple[list[float], bool]:
    """Repeat an action to the end; return the rewards and whether the robot was terminated."""
    rewards, terminated, truncated = [], False, False
    while not (terminated or truncated):
        _, reward, terminated, truncated, _ = env.step(action)
        rewards.append(reward)
    assert env.step(action)[1:4] == (0.0, terminated, truncated)
    return rewards, terminated


def test_ending_an_episode_early_never_pays() -> None:
    """The same past continued in two ways: no reward is negative, and none follows an end."""
    max_error = 0.2
    env = make_env("rect", max_error_m=max_error, plant="kinematic", reference=SHORT)
    env.reset(seed=1)
    for _ in range(5):
        env.step([0.0, 0.0, 0.0])
    lost, is_lost = play(copy.deepcopy(env), [-1.0, 0.0, 0.0])
    stayed, has_failed = play(env, [0.05, 0.03, 0.0])
    assert is_lost
    assert not has_failed
    assert len(lost) < len(stayed)
    assert lost[-1] == 0
    assert all(0 <= reward <= max_error for reward in lost + stayed)
    for discount in (1.0, 0.99, 0.5):
        returns = [
            sum(discount**i * r for i, r in enumerate(rewards)) for rewards in (lost, stayed)
        ]
        assert 0 <= returns[0] <= returns[1]


def test_an_episode_that_is_lost_in_its_last_frame_is_terminated_alone() -> None:
    """As Gymnasium defines them, truncation is an end for another reason than the robot's state."""
    away = {"plant": "kinematic", "reference": SHORT}
    env = make_env("rect", max_error_m=100.0, **away)
    env.reset(seed=1)
    errors, truncated = [], False
    while not truncated:
        _, _, terminated, truncated, info = env.step([-1.0, 0.0, 0.0])
        assert not terminated
        errors.append(info["position_error_m"])
    # The error grows until the end, so this limit is passed in the last frame only.
    limit = (errors[-1] + max(errors[:-1])) / 2
    assert errors[-1] > limit
    envs = make_envs(2, "rect", max_error_m=limit, autoreset_mode="Disabled", **away)
    envs.reset(seed=[1, 1])
    ends = [envs.step(np.array([[-1.0, 0, 0], [0.05, 0.03, 0]]))[2:4] for _ in errors]
    terminated, truncated = np.moveaxis(ends, 1, 0)
    assert not (terminated & truncated).any()
    assert terminated[-1].tolist() == [True, False]
    assert truncated[-1].tolist() == [False, True]
    assert not (terminated | truncated)[:-1].any()


def test_observations_are_within_their_space() -> None:
    """Also if faults act, and if a reference turns away by more than 100 rad."""
    spins = [[0, 0, 6 * i] for i in range(25)]
    turning = {"waypoints": spins, "max_turn_rate_rad_s": 30, "max_turn_acceleration_rad_s2": 200}
    largest = 0.0
    for n_steps, options in (
        (30, {"scenario": "fault-all", "plant": "mujoco"}),
        (200, {"scenario": "fault-vision-outliers", "plant": "kinematic"}),
        (600, {"scenario": "rect", "plant": "kinematic", "reference": turning, "max_error_m": 9.0}),
    ):
        env = make_env(**options)
        observation, _ = env.reset(seed=0)
        for _ in range(n_steps):
            observation, *_ = env.step([0.1, 0.0, 0.0])
            assert observation in env.observation_space
            largest = max(largest, abs(observation).max())
    assert largest == 100  # of the last: clipped


@pytest.mark.parametrize("plant", ["kinematic", "planar", "mujoco"])
def test_copies_and_pickles_continue_alike(plant: str) -> None:
    """Bit for bit, in the running episode and in those that follow; copies are independent."""
    scenario = "fault-all" if plant == "mujoco" else "rect"
    envs = make_envs(2, scenario, max_error_m=0.15, plant=plant)
    envs.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1, 1, (12, 2, 3))
    for action in actions[:4]:
        envs.step(action)
    twins = copy.deepcopy(envs), pickle.loads(pickle.dumps(envs))
    results = [[env.step(action) for action in actions] + [env.reset()] for env in (envs, *twins)]
    for result in results[1:]:
        for twin_step, step in zip(result, results[0], strict=True):
            assert_same(twin_step, step)


def test_pictures_are_drawn() -> None:
    """As `make_vec_env` of Stable-Baselines3 and recorders of videos ask for them."""
    env = gymnasium.make(
        "omni_mj/Track-v0", render_mode="rgb_array", plant="kinematic", reference=SHORT
    )
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.unwrapped.render()
    env.reset(seed=0)
    pictures = [env.render()]
    for _ in range(30):
        env.step([0.3, 0.0, 0.0])
    pictures.append(env.render())
    for picture in pictures:
        assert picture.dtype == np.uint8
        assert picture.shape == (360, 480, 3)
        assert len(np.unique(picture)) > 3
    assert (pictures[0] != pictures[1]).any()
    envs = make_envs(2, plant="kinematic", reference=SHORT, render_mode="rgb_array")
    envs.reset(seed=0)
    np.testing.assert_array_equal(envs.render()[0], pictures[0])
    with pytest.raises(om.OmniError, match="render_mode must be 'rgb_array' or None, got 'ansi'"):
        make_env(render_mode="ansi")
    without = make_env(plant="kinematic")
    without.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert without.render() is None


def test_seeds_of_all_integer_types_are_equal() -> None:
    env, envs = make_env(plant="kinematic"), make_envs(2, plant="kinematic")
    expected, _ = env.reset(seed=250)
    for kind in (np.uint8, np.int16, np.uint32, np.int64, np.uint64, np.array):
        np.testing.assert_array_equal(env.reset(seed=kind(250))[0], expected)
        for seed in (kind(249), np.array([249, 250]), (kind(249), kind(250)), [None, kind(250)]):
            np.testing.assert_array_equal(envs.reset(seed=seed)[0][1], expected)
    for seed in (-1, 2**63, True, 1.0, "1", [1, 2, 3], np.nan):
        for reset in (env.reset, envs.reset):
            with pytest.raises(om.OmniError, match="seed must be an integer"):
                reset(seed=seed)
    for mask in ([1, 0], np.ones(3, bool), "x", None):
        with pytest.raises(om.OmniError, match="reset_mask must be 2 booleans"):
            envs.reset(options={"reset_mask": mask})


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
        ({"history_length": 0}, "history_length must be an integer from 1"),
        ({"max_error_m": 0.0}, "max_error_m must be a number above 0"),
        ({"world": {"start_poses": [[0, 0, 0], [0, 2, 0]]}}, "an environment has one robot"),
        ({"radio": {"delay_frames": {"normal": [6, 1]}}}, "give history_length="),
        ({"autoreset_mode": "SameStep"}, "must be NextStep or Disabled"),
        ({"history_length": 2.5}, "history_length must be an integer"),
        ({"max_error_m": "1"}, "max_error_m must be a number above 0, got '1'"),
        ({"num_envs": 0}, "num_envs must be an integer from 1"),
        ({"num_envs": "3"}, "num_envs must be an integer from 1"),
        ({"render_mode": ["rgb_array"]}, "render_mode must be 'rgb_array' or None"),
        ({"render_mode": np.array(["rgb_array"])}, "render_mode must be 'rgb_array' or None"),
        ({"autoreset_mode": ["NextStep"]}, "must be NextStep or Disabled"),
        ({"autoreset_mode": np.array(["NextStep", "x"])}, "must be NextStep or Disabled"),
        ({"autoreset_mode": np.array("NextStep")}, "must be NextStep or Disabled"),
        ({"plant": np.array(["planar", "x"])}, "plant must be"),
        ({"scenario": ["rect"]}, "must be"),
        ({"scenario": 5000 * "a"}, "unknown scenario"),
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
    """Numbers beyond -1 to 1 are clipped; anything that is not finite numbers is refused."""
    env, envs = make_env(plant="kinematic"), make_envs(1, plant="kinematic")
    for unstarted in (env, envs):
        with pytest.raises(gymnasium.error.ResetNeeded):
            unstarted.step(np.zeros(unstarted.action_space.shape))
    for action in (
        None, 0.0, "abc", [], [0, 0], [0, 0, 0, 0], [np.nan, 0, 0], [0, np.inf, 0], ["0", "0", "0"],
        [None] * 3, [True, False, True], [[0], [0, 1], [0]], {"x": 1}, np.zeros(3, complex),
        np.zeros((1, 1, 3)),
    ):  # fmt: skip
        for step, argument in ((env.step, action), (envs.step, [action])):
            with pytest.raises(om.OmniError, match="must be finite numbers of shape"):
                step(argument)
    env.reset(seed=0)
    envs.reset(seed=0)
    for beyond, limit in (([1e308, -2, 0], [1, -1, 0]), ([3, 0, -1e9], [1, 0, -1])):
        observation, *_ = env.step(np.array(beyond, np.float64))
        np.testing.assert_array_equal(envs.step(np.array([limit], int))[0][0], observation)


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
        done = run_python(code=code)
        assert words in (done.stdout + done.stderr).splitlines()[-1]
