"""A bench with robots whose wheels creep: the law of docs/controllers.md, integrated in small steps, and a loop."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from omni_control import Kinematics, Team
from omni_control.kinematics import Array

T, SUBSTEPS, KEPT = 1 / 60, 16, 64
NOISE = np.array([0.0013, 0.0013, 0.01])
WHEELS = Kinematics(np.radians([60.0, 135.0, 225.0, 300.0]), 0.083, 0.0285)
SIDE = 5 / 3  # times as much give sideways as forward, with these wheels


@dataclass
class Creeping:
    """Robots of which (tau + g^2 T |v|) v' = u - c n - g v holds along the axes of the body; turning has a lag.

    Args:
        start: poses (n, 3).
        delay: dead time, frames.
        lag, creep, friction: forward, s, s^2/m, m/s.
        alpha: forward, sideways, turning.
    """

    start: Array
    delay: int = 6
    lag: float = 0.02
    creep: float = 0.06
    friction: float = 0.03
    alpha: tuple[float, float, float] = (0.92, 0.87, 0.98)

    def __post_init__(self) -> None:
        self.pose = np.array(self.start, float)
        self.body_twist = np.zeros_like(self.pose)
        self.flying = [np.zeros_like(self.pose)] * self.delay

    def advance(self, command: Array) -> None:
        """Go on by a frame in which the commands (n, 3) are sent, world frame."""
        self.flying.append(command)
        acting, gain, side = self.flying.pop(0), 1 / np.array(self.alpha), np.array([1.0, SIDE])
        for _ in range(SUBSTEPS):
            heading, v = self.pose[:, 2], self.body_twist
            c, s = np.cos(heading), np.sin(heading)
            u = np.stack([c * acting[:, 0] + s * acting[:, 1], c * acting[:, 1] - s * acting[:, 0]], axis=1)
            speed = np.hypot(v[:, 0], v[:, 1])[:, None]
            rubs = self.friction * side * v[:, :2] / np.maximum(speed, 0.05)
            late = self.lag * side + gain[:2] ** 2 * self.creep * side * speed
            rate = (u - rubs - gain[:2] * v[:, :2]) / late
            turning = (acting[:, 2:] - gain[2] * v[:, 2:]) / (0.25 * self.lag)
            # The turning of the axes moves no velocity of the world.
            spin = v[:, 2:] * np.stack([v[:, 1], -v[:, 0]], axis=1)
            dt = T / SUBSTEPS
            self.body_twist = v + dt * np.concatenate([rate + spin, turning], axis=1)
            w = self.body_twist
            world = np.stack([c * w[:, 0] - s * w[:, 1], s * w[:, 0] + c * w[:, 1], w[:, 2]], axis=1)
            self.pose = self.pose + dt * world


def loop(
    team: Team,
    robots: Creeping,
    frames: int,
    *,
    seed: int = 0,
    sees: Callable[[int, Array, Array], Array] = lambda frame, image, last: image,
    hears: Callable[[int], bool] = lambda frame: True,
) -> dict[str, Array]:
    """Drive robots for some frames; return their poses, and what the team records, (frames, n, k) by name.

    Args:
        team: of these robots.
        robots: at their start.
        frames: how many.
        seed: of the noise of vision.
        sees: the image of a frame by its number, what a camera would show, and the image before.
        hears: whether what is sent in a frame arrives; robots stand as long as nothing does.
    """
    rng, image, record = np.random.default_rng(seed), robots.pose.copy(), []
    for frame in range(frames):
        fresh = robots.pose + NOISE * rng.standard_normal(robots.pose.shape)
        fresh[:, 2] = np.angle(np.exp(1j * fresh[:, 2]))
        image = sees(frame, fresh, image)
        command = team.step(image)
        record.append({"pose": robots.pose.copy(), "command": command, **team.channels, "alpha_hat": team.alpha_hat})
        record[-1]["latency_hat"] = team.latency_hat
        robots.advance(command if hears(frame) else np.zeros_like(command))
    return {name: np.array([entry[name] for entry in record]) for name in record[0]}
