"""Train a linear policy by proximal policy optimization (PPO), then run it as a controller.

    python ppo.py [--scenario rect] [--iterations 300] [--plant planar] [--robots 512]

The policy is trained on the planar plant. `--plant` is the plant of the final comparison with other
controllers, on seeds that were not used for training. Needs omni-mj[gym].
"""

import argparse
from typing import NamedTuple

import gymnasium
import numpy as np

import omni_mj as om
import omni_mj.gym

parser = argparse.ArgumentParser(
    description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
)
parser.add_argument("--scenario", default="rect")
parser.add_argument("--iterations", type=int, default=300)
parser.add_argument("--robots", type=int, default=512, help="that explore at the same time")
parser.add_argument("--plant", default="planar")
options = parser.parse_args()

HISTORY_LENGTH, N_ENVS, N_STEPS = 9, options.robots, 32
DISCOUNT, GAE_DECAY, CLIP = 0.96, 0.95, 0.2
N_EPOCHS, BATCH_SIZE, LEARNING_RATE = 4, 8192, 0.006
MAX_COMMAND = np.array([3.7, 3.7, 26.0])  # m/s and rad/s of an action of 1
# Standard deviation of the exploring commands in the first and the last iteration, m/s and rad/s
INITIAL_SIGMA, FINAL_SIGMA = np.array([0.3, 0.3, 0.6]), np.array([0.1, 0.1, 0.2])
# Pose errors and twists of an observation, and the units in which the policy takes them
USED_VECTORS, UNITS = slice(0, 12), np.array([0.2] * 6 + [1.0] * 6)[:, None]  # m or rad, 1/s
FEEDFORWARD = 6  # index of the reference's twist at the end of the dead time
random = np.random.default_rng(0)


class Rollout(NamedTuple):
    """Frames of all robots: arrays (steps, envs, ...)."""

    inputs: np.ndarray
    commands: np.ndarray
    rewards: np.ndarray
    features: np.ndarray
    next_features: np.ndarray
    terminated: np.ndarray
    ended: np.ndarray
    running: np.ndarray


def select_inputs(observations):
    """Return the inputs of the policy, (n, 12, 3), from observations (n, values)."""
    return observations.reshape(len(observations), -1, 3)[:, USED_VECTORS] / UNITS


def decide(weights, inputs):
    """Return commands (n, 3): per axis a weighted sum of the inputs."""
    return (weights * inputs).sum(1)


def compute_features(inputs):
    """Return the features of the value function, (n, 73): linear and quadratic in the inputs."""
    flat = inputs.reshape(len(inputs), -1)
    return np.hstack([flat, flat**2, np.ones((len(flat), 1))])


class Sampler:
    """Robots that explore.

    All are kept in the same frame, which is fast: if half of them have ended, all start again.
    """

    def __init__(self, scenario):
        self.envs = gymnasium.make_vec(
            "omni_mj/Track-v0",
            N_ENVS,
            scenario=scenario,
            plant="planar",
            history_length=HISTORY_LENGTH,
            max_error_m=0.5,
            autoreset_mode="Disabled",
        )
        self.seed, self.ended = 0, np.ones(N_ENVS, bool)

    def collect(self, weights, sigma):
        """Return a `Rollout` of N_STEPS frames and its mean position error, m."""
        steps, errors = [], []
        for _ in range(N_STEPS):
            if self.ended.all():
                observations, _ = self.envs.reset(seed=self.seed)
                self.inputs, self.seed = select_inputs(observations), self.seed + N_ENVS
                self.ended = np.zeros(N_ENVS, bool)
            inputs, running = self.inputs, ~self.ended
            commands = decide(weights, inputs) + sigma * random.normal(size=(N_ENVS, 3))
            observations, rewards, terminated, truncated, info = self.envs.step(
                commands / MAX_COMMAND
            )
            self.inputs, self.ended = select_inputs(observations), terminated | truncated
            self.ended |= self.ended.mean() > 0.5
            features, next_features = compute_features(inputs), compute_features(self.inputs)
            steps.append(
                (inputs, commands, rewards, features, next_features, terminated, self.ended.copy(),
                 running)
            )  # fmt: skip
            errors.append(info["position_error_m"][running].mean())
        return Rollout(*map(np.array, zip(*steps, strict=True))), np.mean(errors)


def estimate_advantages(rollout, value_weights):
    """Return generalized advantage estimates and targets of the value function, (steps, envs)."""
    values = rollout.features @ value_weights
    next_values = rollout.next_features @ value_weights * ~rollout.terminated
    errors = rollout.rewards + DISCOUNT * next_values - values
    advantages = np.zeros_like(errors)
    advantage = np.zeros(N_ENVS)
    for i in reversed(range(N_STEPS)):
        advantage = errors[i] + DISCOUNT * GAE_DECAY * advantage * ~rollout.ended[i]
        advantages[i] = advantage
    targets = values + advantages
    # All robots are at the same place of the route: what they have in common is no advantage.
    n_running = np.maximum(rollout.running.sum(1), 1)
    common = (advantages * rollout.running).sum(1) / n_running
    return advantages - common[:, None], targets


def fit_value(features, targets, value_weights):
    """Return weights of the value function by least squares, close to the previous weights."""
    damping = 1e-3 * len(features)
    return np.linalg.solve(
        features.T @ features + damping * np.eye(features.shape[1]),
        features.T @ targets + damping * value_weights,
    )


class Adam:
    """The optimizer of Kingma and Ba."""

    def __init__(self):
        self.mean, self.square, self.n_steps = 0.0, 0.0, 0

    def compute_step(self, gradient):
        """Return the step for a gradient, about 1 per parameter."""
        self.n_steps += 1
        self.mean = 0.9 * self.mean + 0.1 * gradient
        self.square = 0.99 * self.square + 0.01 * gradient**2
        mean, square = self.mean / (1 - 0.9**self.n_steps), self.square / (1 - 0.99**self.n_steps)
        return mean / (np.sqrt(square) + 1e-12)


def improve(weights, sigma, samples, optimizer, learning_rate):
    """Return weights after some epochs of gradient ascent on PPO's clipped objective."""
    inputs, commands, advantages = samples
    old_deviations = (commands - decide(weights, inputs)) / sigma
    for _ in range(N_EPOCHS):
        order = random.permutation(len(inputs))
        for batch in np.array_split(order, -(-len(order) // BATCH_SIZE)):
            deviations = (commands[batch] - decide(weights, inputs[batch])) / sigma
            ratio = np.exp((old_deviations[batch] ** 2 - deviations**2).sum(1) / 2)
            advantage = advantages[batch]
            clipped = np.where(advantage > 0, ratio > 1 + CLIP, ratio < 1 - CLIP)
            slopes = (np.where(clipped, 0.0, ratio * advantage)[:, None] * deviations) / sigma
            gradient = (slopes[:, None] * inputs[batch]).mean(0)
            weights = weights + learning_rate * optimizer.compute_step(gradient)
    return weights


def train(scenario, n_iterations):
    """Return the weights of a trained policy, (12, 3)."""
    weights, value_weights = np.zeros((12, 3)), np.zeros(73)
    weights[FEEDFORWARD] = 1.0
    sampler, optimizer = Sampler(scenario), Adam()
    for iteration in range(n_iterations):
        progress = iteration / n_iterations
        sigma = (1 - progress) * INITIAL_SIGMA + progress * FINAL_SIGMA
        rollout, error = sampler.collect(weights, sigma)
        advantages, targets = estimate_advantages(rollout, value_weights)
        running = rollout.running
        value_weights = fit_value(rollout.features[running], targets[running], value_weights)
        scaled = advantages[running] / advantages[running].std()
        samples = rollout.inputs[running], rollout.commands[running], scaled
        weights = improve(weights, sigma, samples, optimizer, (1 - progress) * LEARNING_RATE)
        if iteration % 10 == 0:
            print(f"iteration {iteration}: mean error {100 * error:.2f} cm", flush=True)
    return weights


learned_weights = train(options.scenario, options.iterations)


class Learned(om.Controller):
    """The learned policy as a controller."""

    def __init__(self, model, reference, n):
        super().__init__(model, reference, n)
        self.memory_frames = max(self.memory_frames, HISTORY_LENGTH)

    def command(self, frame, observation):
        """See `Controller`."""
        observations = omni_mj.gym.encode_observation(
            frame, observation, self.reference, HISTORY_LENGTH
        )
        action = decide(learned_weights, select_inputs(observations)) / MAX_COMMAND
        return omni_mj.gym.decode_action(action, observation, self.model.limits)


scenario = om.load_scenario(options.scenario, plant=options.plant)
controllers = ["p", "comp-flc", "adaptive-comp-flc", Learned]
result = om.run(scenario, controllers, seeds=range(10**6, 10**6 + 4))
print(result.table())
