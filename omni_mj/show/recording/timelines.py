"""The timelines of a recording: a run's frames, and their time."""

import rerun as rr

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import PERIOD_S

FRAME, TIME = "frame", "time"


def indexes(frames: Array) -> list[rr.TimeColumn]:
    """Index columns that place rows in `frames`."""
    return [rr.TimeColumn(FRAME, sequence=frames), rr.TimeColumn(TIME, duration=frames * PERIOD_S)]
