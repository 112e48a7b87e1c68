"""What the tests of plants share: settings, and driving a plant without radio and camera."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omni_mj.link.radio import Received
from omni_mj.plants.kinematic import KinematicPlant
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.scenarios.settings import Settings

FRAME_S = 1 / 60
SIGMAS = 5  # of a statistic's own spread


def with_settings(**sections: dict[str, Any]) -> Settings:
    """The defaults with fields of some sections replaced."""
    return Settings().replace(**sections)


def quiet(**sections: dict[str, Any]) -> Settings:
    """As above, with a gyro that makes no error."""
    sections["sensors"] = {"gyro_noise_rad_s": 0.0, "gyro_bias_rad_s": 0.0} | sections.get("sensors", {})
    return with_settings(**sections)


def drive(plant: KinematicPlant | MujocoPlant, commands: NDArray, age: NDArray | int = 0) -> NDArray:
    """Poses (frames + 1, n, 3) under commands (frames, n, 3); vision sees the true heading, said to be `age` old."""
    poses = [plant.pose()]
    ages = np.broadcast_to(age, commands.shape[1])
    for frame, command in enumerate(commands):
        plant.advance(frame, Received(command, plant.pose()[:, 2], ages))
        poses.append(plant.pose())
    return np.array(poses)


def constant(command: NDArray | list[float], frames: int, n: int) -> NDArray:
    return np.broadcast_to(np.asarray(command, float), (frames, n, 3))
