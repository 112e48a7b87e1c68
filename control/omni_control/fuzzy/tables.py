"""What a compiled loop reads of a fuzzy engine: plain arrays, which are the engine's own."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_control.kinematics import Array

Rows = NDArray[np.int64]


class Tables(NamedTuple):
    """Of `Mamdani`: what comes in, which sets and rules there are, and what `CentreOfGravity` has of the outputs."""

    ends: Array  # (2, inputs), low and high
    owner: Rows  # (sets,), the input of each
    sides: Array  # (4, sets), see `mamdani.degree`
    conditions: Rows  # (most, rules)
    rules: Rows  # (most, concluded sets)
    members: Rows  # (most, regions, outputs)
    regions: Array  # (7, regions, outputs), see `centroid.under`
    middle: Array  # (outputs,)
