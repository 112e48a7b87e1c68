"""What loops over robots read and write of the filters that identify n of them: plain arrays, as they are there."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_control.estimation.motion import Plane
from omni_control.kinematics import Array


class TurningArrays(NamedTuple):
    """Of `Turning`. A loop writes those before `kept`."""

    state: Array  # (n, 9)
    variance: Array  # (n, 9, 9)
    creep: Array  # (n,)
    surprise: Array  # (n,)
    kept: Array  # (9,)
    renewed: Array  # (9,)
    forget: Array  # (9,)
    least: Array  # (5,)
    most: Array  # (5,)
    period: float
    noise: float
    slid: float
    creeps: float
    arm: float
    tells: float


class PlantArrays(NamedTuple):
    """Of `Identifier`. A loop writes those before `kept`."""

    state: Array  # (n, 14)
    variance: Array  # (n, 14, 14)
    noise: Array  # (n,)
    surprise: Array  # (n,)
    sliding: Array  # (n,)
    lasts: Array  # (n,)
    seen: Plane  # (3, n)
    lacks: Plane  # (2, n)
    past: Array  # (frames, n, 8)
    arriving: Plane  # (n,)
    gained: Plane  # (n,)
    kept: Array  # (14,)
    renewed: Array  # (14,)
    forget: Array  # (14, 14)
    restless: Array  # (4,)
    gives: Array  # (2,)
    lowest: Array  # (8,)
    highest: Array  # (8,)
    period: float
    delay: float
    told: float
    ends: float


class GivesArrays(NamedTuple):
    """Of `Compliance`; of robots whose wheels do not give way, of no wheel."""

    rims: Plane  # (W,)
    standing: Array  # (W,)
    shifting: Plane  # (W,)
    arm: float
    share: float


class LateArrays(NamedTuple):
    """As `Late`, of which there always is one."""

    behind: Array  # (n,)
    held: NDArray[np.bool_]  # (n,)
    after: Array  # (n,)
