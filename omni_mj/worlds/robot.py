"""The robot of models/ssl_robot.xml: where the file is, and the numbers that Python reads from the compiled model."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from omni_control.kinematics import Array, Kinematics
from omni_mj.scenarios import robots

WHEELS = 4


def model_path() -> Path:
    """Path of ssl_robot.xml."""
    return robots.model_path(robots.DEFAULT)


def load_model() -> mujoco.MjModel:
    """Compile a fresh model, the caller's to change."""
    return mujoco.MjModel.from_xml_path(str(model_path()))


@lru_cache(maxsize=1)
def shared_model() -> mujoco.MjModel:
    """The model, compiled once, to be read only."""
    return load_model()


def wheel_joints(model: mujoco.MjModel) -> list[Any]:
    """Named views of the wheels' hinges, in the order of the wheels."""
    return [model.joint(f"wheel_{i + 1}") for i in range(WHEELS)]


def standing(model: mujoco.MjModel) -> tuple[Array, Array]:
    """Positions (nq,) and velocities (nv,) of a robot at rest at the origin, its weight on its rollers.

    As modelled, the rollers touch the carpet at distance zero, where rounding decides which of them carry load first.
    """
    data = mujoco.MjData(model)
    for _ in range(round(0.25 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    return data.qpos.copy(), np.zeros(model.nv)


def even_slice(indices: Sequence[int]) -> slice:
    """Evenly spaced indices as a slice, which makes a live view of an array's columns."""
    first, step = int(indices[0]), int(indices[1] - indices[0])
    assert [int(i) for i in indices] == [first + step * k for k in range(len(indices))]
    return slice(first, int(indices[-1]) + 1, step)


def numeric(name: str) -> float:
    """A number that the model holds under <custom>."""
    return float(shared_model().numeric(name).data[0])


@dataclass(frozen=True)
class Motor:
    """The model's motor and gear: torque constant (N m/A = V s/rad), resistance (ohm), gear ratio."""

    constant: float
    resistance: float
    gear: float


def motor(model: mujoco.MjModel) -> Motor:
    """Read the motor from the first wheel's dcmotor."""
    resistance, constant = model.actuator("motor_1").gainprm[:2]
    return Motor(float(constant), float(resistance), float(model.actuator("motor_1").gear[0]))


def kinematics(model: mujoco.MjModel) -> Kinematics:
    """Read azimuths, arm and radius of the wheels from the compiled model."""
    centres = np.array([model.body(f"wheel_{i + 1}").pos for i in range(WHEELS)])
    azimuths = np.arctan2(centres[:, 1], centres[:, 0]) % (2 * np.pi)
    return Kinematics(azimuths, float(np.hypot(*centres[0, :2])), float(centres[0, 2]))
