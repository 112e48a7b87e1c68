"""Search for a dead time that is far from the nominal one, in the first second of motion.

The Kalman filter linearizes about its estimate, and finds dead times that are wrong by a few frames
only. Here, nominal robots with different dead times receive the same commands. Their poses follow
the measured ones slowly. The mean squared deviation measures how well a dead time explains the
motion. It hardly depends on gains, which scale the motion of all nominal robots alike.
"""

import numpy as np
from numpy.typing import NDArray

from omni_control.controllers.base import TeamModel
from omni_control.delay_compensation import CommandHistory
from omni_control.estimation.delayed_measurements import FilterStep
from omni_control.estimation.motion_model import DEAD_TIME, POSE, VELOCITY, MotionModel
from omni_control.kinematics import Array, compute_pose_error

MAX_ERROR_FRAMES = 8  # of the nominal dead time
SPACING_FRAMES = 2  # between the dead times
FILTER_RANGE_FRAMES = 3  # error of a dead time that the filter corrects by itself
FOLLOWING_GAIN = 0.1  # fraction of a deviation by which a nominal robot is moved, per measurement
MAX_EVIDENCE_FRAMES = 60.0  # measurements in motion after which the search ends
MIN_EVIDENCE_FRAMES = 8.0  # measurements in motion before which no dead time is chosen
MIN_COST_RATIO = 3.0  # of the present to the best dead time, so that the best is chosen


class DeadTimeSearch:
    """Nominal robots with different dead times, for each of n robots.

    Args:
        model: Nominal model.
        dynamics: Motion model.
        noise: Standard deviations of measured x, y and heading, (3,) m, m, rad.
        n: Number of robots.

    Attributes:
        is_active: Robots whose dead time is still searched, (n,).
    """

    def __init__(self, model: TeamModel, dynamics: MotionModel, noise: Array, n: int) -> None:
        offsets = np.arange(-MAX_ERROR_FRAMES, MAX_ERROR_FRAMES + 1, SPACING_FRAMES)
        self._dead_times = np.unique(np.maximum(model.delay_frames + offsets, 0.0))
        self._dynamics, self._period, self._noise = dynamics, model.period, noise
        self._states = np.tile(dynamics.prior, (len(self._dead_times), n, 1))
        self._rest_pose = np.zeros((n, 3))
        # Sums of products of measured and nominal displacements, (dead times, n).
        self._measured_square, self._product, self._nominal_square = np.zeros(
            (3, len(self._dead_times), n)
        )
        self._evidence = np.zeros(n)
        self.is_active = np.ones(n, bool)

    def start(self, pose: Array) -> None:
        """Place the nominal robots at the measured poses (n, 3)."""
        self._states[..., POSE], self._rest_pose = pose, pose.copy()

    def advance(self, sent: CommandHistory, step: FilterStep) -> None:
        """Move the nominal robots by a step."""
        latency = (self._dead_times[:, None] + step.frames_behind)[..., None]
        states = self._dynamics.step(self._states, sent.get_delayed(latency), self._period)
        self._states = np.where(step.is_frozen[:, None], self._states, states)

    def correct(self, measured_pose: Array, offset: Array, weight: Array) -> None:
        """Compare the nominal robots with measured poses, and let them follow.

        Args:
            measured_pose: Measured poses (n, 3), NaN without a measurement.
            offset: Time from the state to the capture, (n, 1) s.
            weight: Weights of the measurements as evidence, (n,); 0 at rest.
        """
        is_visible = ~np.isnan(measured_pose[:, 0])
        nominal_pose = self._states[..., POSE] + offset * self._states[..., VELOCITY]
        error = np.nan_to_num(compute_pose_error(measured_pose, nominal_pose))
        displacement = np.nan_to_num(compute_pose_error(measured_pose, self._rest_pose))
        self._states[..., POSE] += FOLLOWING_GAIN * error
        self._rest_pose = self._rest_pose + FOLLOWING_GAIN * displacement
        measured, nominal = displacement / self._noise, (displacement - error) / self._noise
        self._measured_square += weight * (measured**2).sum(-1)
        self._product += weight * (measured * nominal).sum(-1)
        self._nominal_square += weight * (nominal**2).sum(-1)
        self._evidence = self._evidence + weight * is_visible
        self.is_active = self.is_active & (self._evidence < MAX_EVIDENCE_FRAMES)

    def find(self, dead_time: Array) -> tuple[NDArray[np.intp], Array]:
        """Return the indices (m,) of robots whose dead time must change, and their states (m, 18).

        Args:
            dead_time: Present estimates, (n,) frames.
        """
        robots = np.arange(len(dead_time))
        # Least squares over the gain.
        explained = np.maximum(self._product, 0) ** 2 / np.maximum(self._nominal_square, 1e-9)
        cost = self._measured_square - explained
        is_near = np.abs(self._dead_times[:, None] - dead_time) <= FILTER_RANGE_FRAMES
        present_cost = np.where(is_near, cost, np.inf).min(0)
        best = cost.argmin(0)
        is_better = present_cost > MIN_COST_RATIO * cost[best, robots]
        is_better &= self.is_active & (self._evidence > MIN_EVIDENCE_FRAMES)
        changed = np.flatnonzero(is_better)
        states = self._states[best[changed], changed]
        states[:, DEAD_TIME] = self._dead_times[best[changed]]
        return changed, states
