"""What the tests of faults share: robots that meet some from the frame on at which they stand."""

from typing import Any

import compiled
import numpy as np
import pytest
from default_robot import RADIUS_M, TANGENTS
from driving import FRAME_S, constant, drive, mujoco, quiet, rows
from numpy.typing import ArrayLike, NDArray

from omni_mj.plants import Plant
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.plants.planar import PlanarPlant
from omni_mj.scenarios.settings import Settings

# Rim and rollers turn along with a body that slides away under them (see test_sliding.py).
RIM_INERTIA = 1e-6 + 16 * (0.0015 * 0.0225**2 + 6e-8)
ROLLING_KG = RIM_INERTIA / RADIUS_M**2 * (TANGENTS**2).sum(0)
ICE: dict[str, Any] = {"carpet": {"friction": 0.01, "pile": 0.0}, "drive": {"roller_friction": 0.0}}
SETTLE, REST = 12, np.zeros(3)  # frames after which a robot stands
STILL = 1e-5  # m, rad: what it moves meanwhile on ice, twice over
FAST: dict[str, Any] = {"wheels": {"model": "two-rollers"}}


def meets(*faults: dict[str, Any], **sections: Any) -> Settings:
    """A robot to which these happen, from the frame `SETTLE` on if nothing else is said."""
    return quiet(**sections, fault=[{"at": SETTLE * FRAME_S, **each} for each in faults])


def standing(plant: Plant, frames: int = SETTLE) -> NDArray:
    """Poses of robots that are told to stand."""
    return drive(plant, constant(REST, frames, len(plant.pose())))


def planar(settings: list[Settings], start: ArrayLike | None = None) -> PlanarPlant:
    """Robots on the planar plant, at the origin if nothing else is said."""
    compiled.ready("planar", settings)
    return PlanarPlant(rows(settings), np.zeros((len(settings), 3)) if start is None else np.asarray(start, float))


def two_rollers(settings: list[Settings], start: ArrayLike | None = None) -> MujocoPlant:
    """Robots on the plant of bodies, with the wheels that cost least."""
    return mujoco([each.replace(**FAST) for each in settings], start)


ON_WHEELS = pytest.mark.parametrize("plant_of", [two_rollers, planar], ids=["mujoco", "planar"])
