"""The timelines of a recording: a run's frames, and their time."""

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from omni_mj.scenarios.settings import PERIOD_S

Frames = NDArray[np.int_]  # (n,) numbers of frames

FRAME, TIME = "frame", "time"


def indexes(frames: Frames) -> list[rr.TimeColumn]:
    """Index columns that place rows in `frames`."""
    return [rr.TimeColumn(FRAME, sequence=frames), rr.TimeColumn(TIME, duration=frames * PERIOD_S)]
