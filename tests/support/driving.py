"""What the tests of plants share: settings, rows, and driving a plant without radio and camera."""

from collections.abc import Sequence
from typing import Any

import compiled
import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_mj.link.radio import Received
from omni_mj.plants import Plant
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.settings import Settings

FRAME_S = 1 / 60
SIGMAS = 5  # of a statistic's own spread
ROBOT = "tigers-v2016"
# A stiff wheel loop. Not stiffer: free of its rim, the default robot's hub gains 1.2 rad/s a cycle and volt, and is
# heard of a cycle late. With 1 V s/rad in place of 0.4, currents swing by 2 A at rest and by 6 A in motion.
STIFF = {"kp": 0.4, "ki": 20.0, "turn_gain": 0.0}


def with_settings(**sections: dict[str, Any]) -> Settings:
    """The defaults with fields of some sections replaced."""
    return Settings().replace(**sections)


def quiet(**sections: dict[str, Any]) -> Settings:
    """As above, with a gyro that makes no error, reckoned by compiled loops."""
    sections["physics"] = compiled.NUMBA | sections.get("physics", {})
    sections["sensors"] = {"gyro_noise_rad_s": 0.0, "gyro_bias_rad_s": 0.0} | sections.get("sensors", {})
    return with_settings(**sections)


def rows(
    settings: Sequence[Settings], seeds: Sequence[int] | None = None, places: int = 1, robot: str = ROBOT
) -> list[Row]:
    """A row for each of `settings`, `places` of them in a world."""
    seeds = seeds or [0] * len(settings)
    return [
        Row(i // places, i % places, "", seed, chosen, robot)
        for i, (seed, chosen) in enumerate(zip(seeds, settings, strict=True))
    ]


def mujoco(
    settings: Sequence[Settings], start: ArrayLike | None = None, seeds: Sequence[int] | None = None, **more: Any
) -> MujocoPlant:
    """The physical plant with a robot for each of `settings`, at the origin if nothing else is said."""
    compiled.ready("mujoco", settings)
    threads = more.pop("threads", None)
    poses = np.zeros((len(settings), 3)) if start is None else np.asarray(start, float)
    return MujocoPlant(rows(settings, seeds, **more), poses, threads)


def drive(plant: Plant, commands: NDArray, age: NDArray | int = 0) -> NDArray:
    """Poses (frames + 1, n, 3) under commands (frames, n, 3); vision sees the true heading, said to be `age` old.

    No robot may fail.
    """
    poses = [plant.pose()]
    ages = np.broadcast_to(age, commands.shape[1])
    for command in commands:
        assert plant.advance(Received(command, plant.pose()[:, 2], ages)) == {}
        poses.append(plant.pose())
    return np.array(poses)


def constant(command: ArrayLike, frames: int, n: int) -> NDArray:
    """The same commands, (3,) or (n, 3), in every frame."""
    return np.broadcast_to(np.asarray(command, float), (frames, n, 3))


def ramp(twists: ArrayLike, acceleration: ArrayLike, frames: int) -> NDArray:
    """Commands (frames, n, 3) that speed up to twists (n, 3), each at a rate (1/s^2 of its size), then stay."""
    twists = np.asarray(twists, float)
    frame = np.arange(1, frames + 1)[:, None]
    share = np.minimum(1.0, np.asarray(acceleration) * FRAME_S * frame / np.linalg.norm(twists, axis=1))
    return share[..., None] * twists
