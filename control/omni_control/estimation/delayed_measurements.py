"""Schedule of filters whose measurements arrive late.

A filter stays at the last frame that had ended when the camera captured the robot. From there to
the present the robot's state is extrapolated from the commands, as over the dead time. The
alternative, correcting the present state by the past measurement, needs the velocity that is to be
corrected. It would count as evidence what acted on that velocity after the capture.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_control.delay_compensation import RowSelection
from omni_control.kinematics import Array

MAX_FRAMES_BEHIND = 15  # older measurements are treated as that old
_ROUNDING = 1e-6  # of a frame


class FilterStep(NamedTuple):
    """One step of the filters of n robots, to the end of this frame or of an earlier one.

    Attributes:
        frames_behind: Frames from the end of the step to the present, (n,); meaningless for a
            frozen filter.
        frozen: Filters that do not move in this step, (n,).
        capture_offset: Time from the end of this frame's last step to the capture of the
            measurement, (n,) s; negative if the capture came first.
    """

    frames_behind: Array
    frozen: NDArray[np.bool_]
    capture_offset: Array

    @classmethod
    def to_present(cls, n: int) -> "FilterStep":
        """Return the step of n filters from the last frame to this one; arrays are read-only."""
        zeros = np.broadcast_to(0.0, n)
        return cls(zeros, np.broadcast_to(False, n), zeros)

    def select(self, rows: RowSelection) -> "FilterStep":
        """Return the step of some robots."""
        return FilterStep(self.frames_behind[rows], self.frozen[rows], self.capture_offset[rows])


def plan_steps(
    frames_behind: Array, age: Array, is_visible: NDArray[np.bool_], period: float
) -> tuple[FilterStep, ...]:
    """Return the steps of n filters in a frame. The last one takes the measurements.

    A measurement may be older than its filter's time, as after a frame without a measurement.
    The filter is then frozen, `capture_offset` is negative, and the measurement is compared
    with the position of the robot at its capture.

    Args:
        frames_behind: Frames from each filter's time to the previous frame, (n,).
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
