"""Train a linear policy by the cross-entropy method, then run it as a controller.

    python learn.py [--scenario rect] [--generations 12] [--plant planar]

The policy is trained on the planar plant. `--plant` is the plant of the final comparison with other
controllers. Needs omni-mj[gym].
"""

import argparse

import gymnasium
import numpy as np

import omni_mj as om
import omni_mj.gym

parser = argparse.ArgumentParser(
    description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
)
parser.add_argument("--scenario", default="rect")
parser.add_argument("--generations", type=int, default=12)
parser.add_argument("--plant", default="planar")
options = parser.parse_args()

HISTORY_LENGTH, N_POLICIES, N_ELITE = 9, 64, 12
MAX_ERROR_M = 1.0  # the reward of a frame is this minus the error
MAX_COMMAND = np.array([3.7, 3.7, 26.0])  # m/s and rad/s of an action of 1
# The pose errors and the twists of an observation. The predicted pose contains the commands.
USED_VECTORS = slice(0, 12)
# Initial standard deviation of the weights of pose errors (1/s) and of twists.
INITIAL_SIGMA = np.array([2.0] * 6 + [0.5] * 6)[:, None] * np.ones(3)
random = np.random.default_rng(0)


def act(weights, observations):
    """Return actions: per axis a weighted sum of the observed vectors; weights (n, 12, 3)."""
    vectors = observations.reshape(len(observations), -1, 3)[:, USED_VECTORS]
    return (weights * vectors).sum(1) / MAX_COMMAND


envs = gymnasium.make_vec(
    "omni_mj/Track-v0",
    N_POLICIES,
    scenario=options.scenario,
    plant="planar",
    history_length=HISTORY_LENGTH,
    max_error_m=MAX_ERROR_M,
    autoreset_mode="Disabled",
)
mean, sigma = np.zeros_like(INITIAL_SIGMA), INITIAL_SIGMA
for generation in range(options.generations):
    weights = mean + sigma * random.normal(size=(N_POLICIES, *INITIAL_SIGMA.shape))
    observations, _ = envs.reset(seed=[generation] * N_POLICIES)  # the same noise for all
    returns, n_frames, ended = np.zeros(N_POLICIES), 0, np.zeros(N_POLICIES, bool)
    while not ended.all():
        observations, reward, terminated, truncated, _ = envs.step(act(weights, observations))
        returns, n_frames, ended = returns + reward, n_frames + 1, terminated | truncated
    elite = weights[np.argsort(returns)[-N_ELITE:]]
    mean, sigma = elite.mean(0), elite.std(0) + 0.03 * INITIAL_SIGMA * 0.9**generation
    error_cm = 100 * (MAX_ERROR_M - np.median(returns) / n_frames)
    print(f"generation {generation}: mean error {error_cm:.2f} cm", flush=True)


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
        return omni_mj.gym.decode_action(act(mean, observations), observation, self.model.limits)


scenario = om.load_scenario(options.scenario, plant=options.plant)
controllers = ["p", "comp-flc", "adaptive-comp-flc", Learned]
result = om.run(scenario, controllers, seeds=range(1000, 1004))  # not those of the training
print(result.table())
