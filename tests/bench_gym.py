"""`make bench`: robot frames per CPU-second of the Gymnasium environments.

A frame includes the plant, camera, filter, limits, radio, observations and rewards.
"""

import time

import gymnasium
import numpy as np

import omni_mj.gym  # noqa: F401 - registers them

ROUNDS, LEAST_S = 3, 1.0  # the fastest of so many rounds counts; of so much CPU time each
N_ROBOTS = 1, 64, 1024
MAX_ROBOTS_ON_MUJOCO = 64  # a frame of more takes seconds, and no robot less


def measure_speed(plant: str, robots: int, backend: str) -> float:
    """Return frames of robots per CPU-second, on the route of `rect`."""
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
    print("frames of robots per CPU-second through omni_mj/Track-v0; 60 are a simulated second")
    print(f"{'plant, backend':24s}", *(f"{n_robots:>10d}" for n_robots in N_ROBOTS))
    for plant in ("kinematic", "planar", "mujoco"):
        for backend in ("numpy", "jax") if plant == "planar" else ("numpy",):
            speeds = [
                f"{measure_speed(plant, n_robots, backend):10.0f}"
                for n_robots in N_ROBOTS
                if plant != "mujoco" or n_robots <= MAX_ROBOTS_ON_MUJOCO
            ]
            print(f"{plant + ', ' + backend:24s}", *speeds, flush=True)


if __name__ == "__main__":
    main()
