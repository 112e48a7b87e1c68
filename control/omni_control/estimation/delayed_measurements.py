"""Schedule of filters whose measurements arrive late.

A filter advances in steps of a frame, to the last frame boundary before the capture of the
measurement. From there to the present, the state is extrapolated from the commands, as over the
dead time. The alternative is to correct the present state by the past measurement. It would have to
extrapolate the measurement with the estimated velocity, and an error of this velocity would confirm
itself.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_control.delay_compensation import RowSelection
from omni_control.kinematics import Array

MAX_FRAMES_BEHIND = 15  # measurements older than 15 frames are treated as 15 frames old
_ROUNDING = 1e-6  # tolerance of ages, frames


class FilterStep(NamedTuple):
    """One step of the filters of n robots, by a frame, to the present or to an earlier frame.

    Attributes:
        frames_behind: Frames from the end of the step to the present, (n,). In the last step of a
            frame it is valid for all filters, before that only for those that are not frozen.
        is_frozen: Filters that do not advance in this step, because they are already at the frame
            boundary before the capture, (n,).
        capture_offset: Time from the filter's state after the last step of this frame to the
            capture of the measurement, (n,) s; negative if the measurement is older.
    """

    frames_behind: Array
    is_frozen: NDArray[np.bool_]
    capture_offset: Array

    @classmethod
    def to_present(cls, n: int) -> "FilterStep":
        """Return the step of n filters from the previous frame to this one, as read-only arrays."""
        zeros = np.broadcast_to(0.0, n)
        return cls(zeros, np.broadcast_to(False, n), zeros)

    def select(self, rows: RowSelection) -> "FilterStep":
        """Return the step of some robots."""
        return FilterStep(self.frames_behind[rows], self.is_frozen[rows], self.capture_offset[rows])


def plan_steps(
    frames_behind: Array, age: Array, is_visible: NDArray[np.bool_], period: float
) -> tuple[FilterStep, ...]:
    """Return the steps of n filters in a frame. The measurements are processed after the last.

    A measurement may be older than the filter's state, for example after a frame without a
    measurement. The filter is then frozen and `capture_offset` is negative. The measurement is
    compared with the pose that the state implies for the time of capture.

    Args:
        frames_behind: Frames from the state of each filter to the previous frame, (n,).
        age: Time from the capture of each measurement to this frame, (n,) s.
        is_visible: Robots with a measurement, (n,).
        period: Length of a frame, s.
    """
    age_frames = np.minimum(age / period, MAX_FRAMES_BEHIND)
    target = np.where(is_visible, np.ceil(age_frames - _ROUNDING), frames_behind)
    target = np.minimum(target, frames_behind + 1)
    n_steps = frames_behind + 1 - target
    capture_offset = np.where(is_visible, (target - age_frames) * period, 0.0)
    return tuple(
        FilterStep(target + steps_to_go, n_steps <= steps_to_go, capture_offset)
        for steps_to_go in range(max(int(n_steps.max()), 1) - 1, -1, -1)
    )
