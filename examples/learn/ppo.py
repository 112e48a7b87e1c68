"""Train a policy by PPO with Stable-Baselines3, then compare it with other controllers.

    pip install stable-baselines3
    python ppo.py [--frames 500000] [--seed 0] [--scenario rect circle]
    omni-mj run --scenario sprint --plant planar --controller p --controller ppo.py:Learned

The policy corrects the reference's velocity. It trains on random routes on the planar plant, and is
saved as policy.zip, from which the controller `Learned` reads it. Needs omni-mj[gym] as well.
"""

import argparse

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecMonitor, VecNormalize

import omni_mj as om
import omni_mj.gym

POLICY_FILE = "policy.zip"
HISTORY_LENGTH, N_ENVS, EPISODE_FRAMES = 9, 64, 300
# Routes are drawn in each episode. random-waypoints itself has the seed 0.
ROUTES = {
    "seed": {"uniform": [1, 10**6]},
    "max_speed_m_s": {"uniform": [1.0, 3.0]},
    "max_acceleration_m_s2": {"uniform": [1.5, 3.0]},
}
REFERENCE_TWIST = slice(18, 21)  # of an observation: at the end of the dead time, m/s and rad/s
MAX_COMMAND = np.array([3.7, 3.7, 26.0])  # m/s and rad/s of an action of 1
MAX_CORRECTION = np.array([1.0, 1.0, 3.0])  # m/s and rad/s that the policy may add


def correct(observations, corrections):
    """Return actions of the environment (n, 3) for outputs of the policy, -1 to 1, (n, 3)."""
    twists = observations[:, REFERENCE_TWIST] + np.clip(corrections, -1, 1) * MAX_CORRECTION
    return twists / MAX_COMMAND


class TrackVecEnv(VecEnv):
    """The vector of environments as Stable-Baselines3 expects it.

    All robots start together, since robots in the same frame are simulated as one batch.
    """

    def __init__(self, seed):
        self.envs = gymnasium.make_vec(
            "omni_mj/Track-v0",
            N_ENVS,
            scenario="random-waypoints",
            plant="planar",
            reference=ROUTES,
            history_length=HISTORY_LENGTH,
            autoreset_mode="Disabled",
        )
        self.next_seed, self.n_frames = seed * 10**9, 0
        super().__init__(N_ENVS, self.envs.single_observation_space, self.envs.single_action_space)

    def reset(self):
        """Start an episode of each robot."""
        self.observations, _ = self.envs.reset(seed=self.next_seed)
        self.next_seed, self.n_frames = self.next_seed + N_ENVS, 0
        return self.observations

    def step_async(self, actions):
        """Take the actions of the next step."""
        self.corrections = actions

    def step_wait(self):
        """Advance by a frame; robots whose episodes end start another one at once."""
        observations, rewards, terminated, truncated, _ = self.envs.step(
            correct(self.observations, self.corrections)
        )
        self.n_frames += 1
        truncated |= ~terminated & (self.n_frames == EPISODE_FRAMES)
        has_ended = terminated | truncated
        infos = [{} for _ in range(N_ENVS)]
        for i in np.flatnonzero(has_ended):
            infos[i]["terminal_observation"] = observations[i]
            infos[i]["TimeLimit.truncated"] = bool(truncated[i])
        if self.n_frames == EPISODE_FRAMES:
            self.reset()
        elif has_ended.any():
            self.observations, _ = self.envs.reset(options={"reset_mask": has_ended})
        else:
            self.observations = observations
        return self.observations, rewards, has_ended, infos

    def close(self):
        """Close the environments."""
        self.envs.close()

    def get_attr(self, attr_name, indices=None):
        """Return an attribute, which all robots share, once for each robot."""
        return [getattr(self.envs, attr_name)] * N_ENVS

    def env_is_wrapped(self, wrapper_class, indices=None):
        """Return that no robot has a wrapper."""
        return [False] * N_ENVS

    def set_attr(self, attr_name, value, indices=None):
        """Refuse to set an attribute of some robots."""
        raise NotImplementedError

    def env_method(self, method_name, *arguments, indices=None, **options):
        """Refuse to call a method of some robots."""
        raise NotImplementedError


class Learned(om.Controller):
    """The learned policy as a controller."""

    def __init__(self, model, reference, n):
        super().__init__(model, reference, n)
        self.memory_frames = max(self.memory_frames, HISTORY_LENGTH)
        self.policy = PPO.load(POLICY_FILE, device="cpu")

    def command(self, frame, observation):
        """See `Controller`."""
        observations = omni_mj.gym.encode_observation(
            frame, observation, self.reference, HISTORY_LENGTH
        )
        corrections, _ = self.policy.predict(observations, deterministic=True)
        return omni_mj.gym.decode_action(
            correct(observations, corrections), observation, self.model.limits
        )


def train(n_frames, seed):
    """Train a policy for this number of frames of robots, and save it."""
    torch.set_num_threads(1)  # faster for networks of this size
    envs = VecNormalize(VecMonitor(TrackVecEnv(seed)), norm_obs=False, gamma=0.96)  # of rewards
    model = PPO(
        "MlpPolicy",
        envs,
        n_steps=64,
        batch_size=1024,
        gamma=0.96,
        learning_rate=lambda remaining: 1e-3 * remaining,
        policy_kwargs={"log_std_init": -1.0},
        seed=seed,
        device="cpu",
        verbose=1,
    )
    model.learn(n_frames, log_interval=20)
    model.save(POLICY_FILE)


def main():
    """Train, then run the policy on scenarios and seeds that it was not trained on."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frames", type=int, default=500_000, help="frames of robots")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scenario", nargs="+", default=["rect", "circle"])
    options = parser.parse_args()
    train(options.frames, options.seed)
    for name in options.scenario:
        scenario = om.load_scenario(name, plant="planar")
        controllers = ["p", "comp-flc", "adaptive-comp-flc", Learned]
        print(om.run(scenario, controllers, seeds=range(1000, 1004)).table())


if __name__ == "__main__":
    main()
