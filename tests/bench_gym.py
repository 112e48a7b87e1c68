"""`make bench`: robot frames per CPU-second of the Gymnasium environments.

    python tests/bench_gym.py [--robots 1 64 1024] [--plant kinematic planar mujoco]

A frame includes the plant, camera, filter, limits, radio, observations and rewards.
"""

import argparse
import time

import gymnasium
import numpy as np

import omni_mj.gym  # noqa: F401 - registers them

ROUNDS, LEAST_S = 3, 1.0  # the fastest of so many rounds counts; of so much CPU time each
MOST_ON_MUJOCO = 64  # robots: a frame of more takes seconds, and no robot less


def speed(plant: str, robots: int, backend: str) -> float:
    """Frames of robots per CPU-second, on the route of `rect`."""
    env = gymnasium.make_vec("omni_mj/Track-v0", robots, plant=plant, physics={"backend": backend})
    env.reset(seed=0)
    action, best = np.tile([0.1, 0.05, 0.0], (robots, 1)), 0.0
    env.step(action)
    for _ in range(ROUNDS):
        frames, start = 0, time.process_time()
        while time.process_time() - start < LEAST_S:
            env.step(action)
            frames += 1
        best = max(best, frames * robots / (time.process_time() - start))
    return best


def main() -> None:
    """Measure and print."""
    given = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    given.add_argument("--robots", type=int, nargs="+", default=[1, 64, 1024])
    given.add_argument("--plant", nargs="+", default=["kinematic", "planar", "mujoco"])
    chosen = given.parse_args()
    print("frames of robots per CPU-second through omni_mj/Track-v0; 60 are a simulated second")
    print(f"{'plant, backend':24s}", *(f"{robots:>10d}" for robots in chosen.robots))
    for plant in chosen.plant:
        for backend in ("numpy",) if plant == "kinematic" else ("numpy", "jax"):
            found = [
                f"{speed(plant, robots, backend):10.0f}"
                if plant != "mujoco" or robots <= MOST_ON_MUJOCO
                else " " * 10
                for robots in chosen.robots
            ]
            print(f"{plant + ', ' + backend:24s}", *found, flush=True)


if __name__ == "__main__":
    main()
