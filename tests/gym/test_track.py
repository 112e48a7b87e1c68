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

SHORT = {"waypoints": [[0, 0], [0.2, 0.1, 0.5]], "settle_s": 0.1}
DRAWN = {
    "plant": "kinematic",
    "reference": SHORT,
    "radio": {"delay_frames": {"uniform": [2, 7]}},
    "control": {"max_speed_m_s": {"choice": [2.0, 3.0]}},
}
MEMORY = 9


def answer(seen: np.ndarray, highest: np.ndarray | float) -> np.ndarray:
    """Return actions of a policy: the previewed twist plus three times the pose error."""
    way, twist = seen[..., 3:6], seen[..., 18:21]
    return (twist + 3.0 * way) / highest


def track(scenario: om.Scenario | str = "rect", **more: Any) -> gymnasium.Env:
    """Return one environment, without Gymnasium's wrappers."""
    return gymnasium.make("omni_mj/Track-v0", scenario=scenario, **more).unwrapped


def tracks(
    num_envs: int = 1, scenario: om.Scenario | str = "rect", **more: Any
) -> gymnasium.vector.VectorEnv:
    """Return a vector of environments."""
    return gymnasium.make_vec("omni_mj/Track-v0", num_envs, scenario=scenario, **more)


class Policy(om.Controller):
    """The same as a controller."""

    def __init__(self, model: Any, reference: Any, n: int) -> None:
        super().__init__(model, reference, n)
        self.memory_frames = MEMORY

    def command(self, frame: int, observation: om.Observation) -> np.ndarray:
        observed = omni_mj.gym.encode_observation(frame, observation, self.reference, MEMORY)
        return omni_mj.gym.decode_action(answer(observed, 4.0), observation, self.model.limits)


@pytest.mark.parametrize("plant", ["kinematic", "mujoco"])
def test_gymnasium_check_passes(plant: str) -> None:
    """Not even a warning: spaces, returned types, and that a seed determines an episode."""
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

    env = track("rect", history_length=MEMORY, **changes)
    seen, info = env.reset(seed=5)
    rewards, end = [], False
    while not end:
        seen, reward, terminated, end, _ = env.step(answer(seen, 4.0))
        rewards.append(reward)
        assert not terminated
    assert info == {"seed": 5}
    np.testing.assert_array_equal(rewards, expected[1:])  # the first frame is the start


def test_observations_are_errors_to_the_reference() -> None:
    """Without noise, alpha = 1: full speed is a delayed ramp of the highest acceleration."""
    delay, history_length, speed, most = 3, 5, 2.0, 4.7
    route = {"waypoints": [[0, 0, 1.0], [0, 0.5, 1.0]], "settle_s": 0.5}
    env = track(
        "rect",
        plant="kinematic",
        reference=route,
        radio={"delay_frames": delay},
        control={"max_speed_m_s": speed, "max_acceleration_m_s2": most},
        kinematic={"alpha_low": 1.0, "alpha_high": 1.0},
        disturbance={"velocity_m_s": 0.0},
        vision={"position_noise_m": 0.0, "heading_noise_rad": 0.0},
        history_length=history_length,
    )
    seen, _ = env.reset(seed=0)
    step = 1 / 60
    forward = np.array([np.cos(1.0), np.sin(1.0)])
    reference = (
        om.Simulation(om.load_scenario("rect", reference=route), ["p"]).references[0].poses[:, :2]
    )
    sent = [0.0] * (history_length + delay)
    for frame in range(1, 20):
        sent.append(min(sent[-1] + most * step, speed))
        seen, *_ = env.step([1.0, 0.0, 0.0])
        felt, all_sent = (step * sum(sent[: len(sent) - late]) for late in (delay, 0))
        own = np.stack([forward, [-forward[1], forward[0]]])
        # Vision is exact, but the filter believes it to 1.3 mm: it lags by less than that.
        np.testing.assert_allclose(seen[:2], own @ (reference[frame] - felt * forward), atol=1.3e-3)
        np.testing.assert_allclose(
            seen[3:5], own @ (reference[frame + delay] - all_sent * forward), atol=1.3e-3
        )
        np.testing.assert_allclose(
            seen[-3 * history_length :].reshape(history_length, 3)[:, 0],
            sent[-history_length:],
            atol=1e-3,
        )
        np.testing.assert_allclose(
            seen[-3 * history_length :].reshape(history_length, 3)[:, 1:], 0, atol=1e-3
        )


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED])
def test_vector_equals_single_environments(mode: AutoresetMode) -> None:
    """Bit for bit Gymnasium's own vector of single environments, with episodes of other lengths."""
    n, lost = 4, 0.12
    many = tracks(n, "rect", max_error_m=lost, autoreset_mode=mode, **DRAWN)
    ones = SyncVectorEnv(
        [lambda: track("rect", max_error_m=lost, **DRAWN) for _ in range(n)], autoreset_mode=mode
    )
    random = np.random.default_rng(0)
    same(many.reset(seed=3), ones.reset(seed=3))
    assert many.metadata["autoreset_mode"] is mode
    both = np.zeros(2, int)
    for _ in range(120):
        action = random.uniform(-0.5, 0.5, (n, 3)).astype(np.float32)
        found, expected = many.step(action), ones.step(action)
        same(found, expected)
        both += found[2].sum(), found[3].sum()
        ended = found[2] | found[3]
        if mode is AutoresetMode.DISABLED and ended.any():
            options = [{"reset_mask": ended.copy()} for _ in range(2)]
            same(many.reset(options=options[0]), ones.reset(options=options[1]))
    assert (both > 0).all()


def same(found: Any, expected: Any) -> None:
    """Of nested answers every bit; of a robot that an answer's mask leaves out nothing counts."""
    if isinstance(expected, dict):
        assert found.keys() == expected.keys()
        for name, values in expected.items():
            mask = expected.get(f"_{name}", ...)
            same(found[name][mask], values[mask])
    elif isinstance(expected, tuple):
        for one, other in zip(found, expected, strict=True):
            same(one, other)
    else:
        np.testing.assert_array_equal(found, expected)


def test_ending_an_episode_early_never_pays() -> None:
    """The remaining frames cost as if the robot had stayed there: getting lost never pays."""
    env = track("rect", max_error_m=0.2, plant="kinematic", reference=SHORT)
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
    many, one = tracks(3, "rect", **changes), track("rect", **changes)
    seen, info = many.reset(seed=0)
    alone, _ = one.reset(seed=2)
    np.testing.assert_array_equal(seen[2], alone)
    for _ in range(3):
        found, alone = many.step(np.full((3, 3), 0.1)), one.step(np.full(3, 0.1))
        np.testing.assert_array_equal(found[0][2], alone[0])
        assert found[1][2] == alone[1]
    assert info["seed"].tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"scenario": "recht"}, "unknown scenario"),
        ({"plant": "planer"}, "unknown plant"),
        ({"history_length": 0}, "history_length must be from 1"),
        ({"max_error_m": 0.0}, "max_error_m above 0"),
        ({"world": {"start_poses": [[0, 0, 0], [0, 2, 0]]}}, "an environment has one robot"),
        ({"radio": {"delay_frames": {"normal": [6, 1]}}}, "give history_length="),
        ({"autoreset_mode": "SameStep"}, "must be NextStep or Disabled"),
    ],
)
def test_invalid_arguments_are_rejected_with_one_line(given: dict[str, Any], words: str) -> None:
    with pytest.raises(om.OmniError, match=words):
        tracks(**given)


def test_scenarios_with_parameterized_controllers_are_accepted() -> None:
    """Of any scenario; who drives in it otherwise does not matter."""
    other = om.load_scenario(
        "rect", plant="kinematic", controllers=[Policy, Tuned], controller={"Tuned": {"gain": 2.0}}
    )
    seen, _ = track(other).reset(seed=0)
    np.testing.assert_array_equal(seen, track("rect", plant="kinematic").reset(seed=0)[0])


class Tuned(Policy):
    gain: float = 1.0


def test_invalid_actions_are_rejected() -> None:
    env = tracks(2, plant="kinematic")
    env.reset(seed=0)
    for action in (np.zeros(3), np.full((2, 3), np.nan)):
        with pytest.raises(om.OmniError, match="actions must be finite numbers"):
            env.step(action)


def test_gymnasium_imports_the_package_by_the_environments_name() -> None:
    """Nobody else has to import this package; and without Gymnasium one line names the extra."""
    for code, words in (
        (
            "import gymnasium; "
            "print(gymnasium.make_vec('omni_mj.gym:omni_mj/Track-v0', 2, plant='kinematic'))",
            "TrackVectorEnv",
        ),
        (
            "import sys; sys.modules['gymnasium'] = None; import omni_mj.gym",
            "pip install 'omni-mj[gym]'",
        ),
    ):
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, timeout=60
        )
        assert words in (done.stdout + done.stderr).splitlines()[-1]
