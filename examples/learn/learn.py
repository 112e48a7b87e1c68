"""A policy learns to drive by the cross-entropy method, then drives as a controller; needs omni-mj[gym].

    python learn.py [--scenario rect] [--generations 25] [--plant mujoco]

Its robots learn on the plant planar; `--plant` is the one that it drives on in the end, beside other controllers.
"""

import argparse

import gymnasium
import numpy as np

import omni_mj as om
import omni_mj.gym

given = argparse.ArgumentParser(
    description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
)
given.add_argument("--scenario", default="rect")
given.add_argument("--generations", type=int, default=25)
given.add_argument("--plant", default="mujoco")
given = given.parse_args()

MEMORY, POLICIES, BEST = 9, 64, 12
HIGHEST = np.array([3.7, 3.7, 26.0])  # m/s and rad/s that an action of 1 means
USED = slice(
    0,
    12,
    # The ways and twists of an observation; the way to where the commands in flight lead says of these
)
START = np.array([2.0] * 6 + [0.5] * 6)[:, None] * np.ones(
    3
)  # how far to look for weights of ways, 1/s, and of twists
random = np.random.default_rng(0)


def act(weights, seen):
    """Each of a robot's axes by itself: a weighted sum of what is seen along it; weights (n, 12, 3)."""
    return (weights * seen.reshape(len(seen), -1, 3)[:, USED]).sum(1) / HIGHEST


many = gymnasium.make_vec(
    "omni_mj/Track-v0",
    POLICIES,
    scenario=given.scenario,
    plant="planar",
    history_length=MEMORY,
    autoreset_mode="Disabled",
)
middle, spread = np.zeros_like(START), START
for generation in range(given.generations):
    weights = middle + spread * random.normal(size=(POLICIES, *START.shape))
    seen, _ = many.reset(seed=[generation] * POLICIES)  # the same noise for all
    returns, frames, ended = np.zeros(POLICIES), 0, np.zeros(POLICIES, bool)
    while not ended.all():
        seen, reward, terminated, truncated, _ = many.step(act(weights, seen))
        returns, frames, ended = returns + reward, frames + 1, terminated | truncated
    elite = weights[np.argsort(returns)[-BEST:]]
    middle, spread = elite.mean(0), elite.std(0) + 0.03 * START * 0.9**generation
    print(f"generation {generation}: {-100 * np.median(returns) / frames:.2f} cm off", flush=True)


class Learned(om.Controller):
    """What was learned, with all else that drives on a team's computer."""

    def __init__(self, model, reference, n):
        super().__init__(model, reference, n)
        self.memory_frames = max(self.memory_frames, MEMORY)

    def command(self, frame, observation):
        """See `Controller`."""
        observed = omni_mj.gym.encode_observation(frame, observation, self.reference, MEMORY)
        return omni_mj.gym.decode_action(act(middle, observed), observation, self.model.limits)


names = ["p", "comp-flc", "adaptive-comp-flc", Learned]
print(
    om.run(
        om.load_scenario(given.scenario, plant=given.plant), names, seeds=range(1000, 1004)
    ).table()
)
