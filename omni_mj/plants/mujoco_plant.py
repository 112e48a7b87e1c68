"""The plant `mujoco`: batches of MuJoCo worlds with robots that their firmware drives."""

import copy
import os
from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config.rows import Row
from omni_mj.mjcf import mujoco, world_builder
from omni_mj.network.radio import ReceivedCommand
from omni_mj.plants.mjdata_views import CopyableBatch, RobotViews
from omni_mj.plants.mujoco_robots import MujocoRobots
from omni_mj.plants.randomization import RobotVariation
from omni_mj.plants.row_checks import MODEL_SETTINGS, check_equal_settings, check_start_poses
from omni_mj.robot.electronics import CycleRecord

# Number of robots from which several threads are faster than one
MIN_ROBOTS_FOR_THREADS = 16
# A robot has toppled at a tilt of 45 degrees. The quaternion's x^2 + y^2 is the squared sine of
# half the tilt.
TOPPLED_SINE_SQUARED = np.sin(np.deg2rad(45) / 2) ** 2
# Warnings after which MuJoCo silently resets a simulation
INSTABILITY_WARNINGS = [
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
]


class MujocoPlant(MujocoRobots):
    """Robots with roller wheels on carpet that collide with robots and walls of their world.

    Args:
        rows: Rows of all robots, world by world in the order of their slots. All worlds have the
            same number of robots. The settings `MODEL_SETTINGS` must be the same in all rows.
        start_poses: Poses at the start, world frame, (n, 3) m, m, rad.
        with_hulls: Whether robots collide with each other and with walls. If given, overlapping
            start poses are accepted. Default: they collide if a world has several robots, and may
            not overlap at the start.

    Raises:
        OmniError: Rows cannot share a batch, a robot overlaps another or a wall at the start, or
            the model of a robot lacks a part.
    """

    def __init__(
        self,
        rows: Sequence[Row],
        start_poses: Array,
        with_hulls: bool | None = None,
    ) -> None:
        check_equal_settings(rows, MODEL_SETTINGS)
        settings = [row.settings for row in rows]
        n = len(rows)
        robots_per_world = max(row.slot for row in rows) + 1
        n_worlds = n // robots_per_world
        self._robots_per_world = robots_per_world
        self._substeps = settings[0].physics.substeps
        world = world_builder.build_world(settings[0], robots_per_world, with_hulls=with_hulls)
        # Results do not depend on the number of threads.
        threads = 1 if n < MIN_ROBOTS_FOR_THREADS else len(os.sched_getaffinity(0))
        model = copy.copy(world.model)
        # The battery limits voltages, which may exceed the model's range while motors brake.
        model.actuator_ctrllimited[:] = 0
        self._batch = CopyableBatch(model, n_worlds, min(threads, n_worlds))
        variation = RobotVariation.draw(rows)
        views = RobotViews(self._batch, world)
        views.write_variation(variation)
        self._start_poses = np.array(start_poses, float)
        super().__init__(rows, world, views, variation, self._start_poses[:, 2])
        self._active_worlds: np.ndarray | None = None  # indices of worlds to step; None for all
        self._reset_worlds(np.arange(n_worlds))
        if robots_per_world > 1 and with_hulls is None:
            check_start_poses(rows, world.model, self._batch.bind("qpos"))
        self._start()
        self._start_faults(views)

    def advance(self, received: ReceivedCommand) -> dict[int, str]:
        """See `Plant`."""
        failures: dict[int, str] = {}
        for n_cycles, segment in received.split():
            failures = self.advance_cycles(n_cycles, segment)
        return failures

    def _advance_cycle(self) -> CycleRecord:
        record = self._begin_cycle()
        for substep in range(self._substeps):
            self._batch.step(self._active_worlds)
            if substep == 0:
                # MuJoCo computes sensors at the beginning of a step. Reading them after the first
                # step makes them one cycle old in the next cycle, for any number of steps per
                # cycle.
                self._read_sensors()
            if self._roller_pitch is not None:
                self._views.wrap_rollers(self._roller_pitch)
            if substep < self._substeps - 1:
                self._views.write_slip_limits(self._drag, self._views.load.get())
        return record

    def _end_frame(self) -> dict[int, str]:
        super()._end_frame()
        return self._stop_failed_rows()

    def _reset_worlds(self, worlds: np.ndarray) -> None:
        """Move the robots of some worlds to their start poses, at rest, and read all sensors.

        Args:
            worlds: Indices of the worlds, (k,).
        """
        slots = np.arange(self._robots_per_world)
        rows = (worlds[:, None] * self._robots_per_world + slots).ravel()
        self._views.place_robots(rows, self._start_poses[rows])
        self._heading[rows] = self._start_poses[rows, 2]
        self._batch.forward(worlds)
        self._read_sensors()

    def _stop_failed_rows(self) -> dict[int, str]:
        """Stop rows that became unstable or toppled, and return a mapping from row to cause."""
        _, x, y, _ = self._views.pose.get()[3:]
        has_toppled = (x * x + y * y > TOPPLED_SINE_SQUARED) & ~self._failed
        # np.count_nonzero is faster than .any() on small arrays.
        warnings = slice(INSTABILITY_WARNINGS[0], INSTABILITY_WARNINGS[-1] + 1)
        warning_counts = np.asarray(self._batch.warning)[:, warnings, 1]  # (worlds, 3)
        if not (has_toppled.any() or np.count_nonzero(warning_counts)):
            return {}
        is_unstable = np.repeat(warning_counts > 0, self._robots_per_world, axis=0)
        symptoms = np.column_stack([is_unstable, has_toppled])
        messages = [f"became unstable (MuJoCo: {warning.name})" for warning in INSTABILITY_WARNINGS]
        messages.append("toppled over")
        rows = np.flatnonzero(symptoms.any(1) & ~self._failed)
        self._stop_rows(rows, rows[is_unstable[rows].any(1)])
        return {row: messages[symptoms[row].argmax()] for row in rows.tolist()}

    def _stop_rows(self, rows: np.ndarray, unstable_rows: np.ndarray) -> None:
        """Switch rows off, and stop stepping worlds in which all rows are off.

        Args:
            rows: Rows to switch off.
            unstable_rows: The rows among them that became unstable. Their worlds are reset first.
        """
        self._failed[rows] = True
        if len(unstable_rows):
            self._reset_worlds(np.unique(unstable_rows // self._robots_per_world))
        is_finished = self._failed.reshape(-1, self._robots_per_world).all(1)
        self._batch.bind("qvel")[is_finished] = 0.0
        self._active_worlds = np.flatnonzero(~is_finished)
