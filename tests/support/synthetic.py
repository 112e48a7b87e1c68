"""Robots by the law of command to motion, written apart from the package: logs of known truth for identification."""

import numpy as np

FINE = 8  # steps of the law in a line of a log


def logs(
    truth: np.ndarray,
    seconds: float,
    *,
    rate: float = 30.0,
    seed: int = 0,
    noise: float = 0.0013,
    speed: float = 1.6,
    pull: float = 3.0,
    push: float = 0.0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (F,), poses measured (F, n, 3) and commands (F, n, 3), world frame, of n robots.

    Each law (n, 9): latency, effort forward and sideways, creep the same, lag the same, friction, compass error; it is
    solved by Heun's method with steps of 1/8 line. Commands are trapezoids between random velocities, three quarters
    of a second each. `push` is a velocity that swings along x at 1.1 Hz, m/s, and that no law knows.
    """
    rng, n, lines = np.random.default_rng(seed), len(truth), round(seconds * rate)
    late, effort, creep, tau, rub, turned = np.split(truth, [1, 3, 5, 7, 8], axis=1)
    command, goal = np.zeros((lines, n, 3)), np.zeros((n, 3))
    steepest = np.array([pull, pull, 15.0]) / rate
    for k in range(1, lines):
        if k % round(0.75 * rate) == 1:
            goal = rng.uniform(-1, 1, (n, 3)) * [speed, speed, 2 * speed]
        command[k] = command[k - 1] + np.clip(goal - command[k - 1], -steepest, steepest)
    dt, poses = 1 / (rate * FINE), np.zeros((lines, n, 3))
    z, v, angle = np.zeros(n, complex), np.zeros(n, complex), np.zeros(n)

    def rates(v: np.ndarray, angle: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Acceleration in the world, turn rate."""
        line = np.floor((t - late[:, 0]) * rate + 1e-9).astype(int)
        u = np.where((line >= 0)[:, None], command[np.maximum(line, 0), np.arange(n)], 0.0)
        into = np.exp(-1j * angle)
        wanted, along = (u[:, 0] + 1j * u[:, 1]) * into * np.exp(-1j * turned[:, 0]), v * into
        size = np.abs(along)[:, None]
        two = np.stack([along.real, along.imag], 1)
        pull = np.stack([wanted.real, wanted.imag], 1) - rub * two / np.maximum(size, 0.05) - effort * two
        change = pull / (tau + effort**2 * creep * size)
        return (change[:, 0] + 1j * change[:, 1]) / into, u[:, 2]

    for k in range(lines):
        poses[k] = np.stack([z.real, z.imag, angle], 1)
        for i in range(FINE):
            t = (k + i / FINE) / rate + 0.25 * dt  # within the step, so that a command's change falls between two
            a, w = rates(v, angle, t)
            b, w = rates(v + dt * a, angle + dt * w, t)
            swing = push * np.sin(2 * np.pi * 1.1 * t)
            z, v, angle = z + dt * (v + dt * a / 2 + swing), v + dt * (a + b) / 2, angle + dt * w
    measured = poses + rng.normal(size=poses.shape) * [noise, noise, 0.003]
    return np.arange(lines) / rate, measured, command
