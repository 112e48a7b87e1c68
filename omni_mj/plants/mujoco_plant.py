"""The plant `mujoco`: batches of MuJoCo worlds with robots that their firmware drives."""

import copy
import os
from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.config.rows import Row
from omni_mj.mjcf import world_builder
from omni_mj.network.radio import ReceivedCommand
from omni_mj.plants.cyclewise_plant import CyclewisePlant
from omni_mj.plants.mjdata_views import CopyableBatch, RobotViews
from omni_mj.plants.randomization import RobotVariation
from omni_mj.plants.row_checks import MODEL_SETTINGS, check_equal_settings, check_start_poses
from omni_mj.plants.telemetry import Telemetry
from omni_mj.robot.electronics import (
    CycleRecord,
    ElectronicsParameters,
    begin_frame,
    run_cycle,
    stack_telemetry,
)
from omni_mj.robot.motors_and_drivers import compute_load_friction
from omni_mj.robot.wheel_carpet_forces import DRAG_CYCLES, CarpetParameters, Drag, compute_drag

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


class MujocoParameters(NamedTuple):
    """Parameters of n robots on the plant `mujoco`."""

    electronics: ElectronicsParameters
    carpet: CarpetParameters  # its creep compliance is scaled for slip hinges


class MujocoPlant(CyclewisePlant):
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
        self._world = world = world_builder.build_world(
            settings[0], robots_per_world, with_hulls=with_hulls
        )
        # Results do not depend on the number of threads.
        threads = 1 if n < MIN_ROBOTS_FOR_THREADS else len(os.sched_getaffinity(0))
        model = copy.copy(world.model)
        # The battery limits voltages, which may exceed the model's range while motors brake.
        model.actuator_ctrllimited[:] = 0
        self._batch = CopyableBatch(model, n_worlds, min(threads, n_worlds))
        variation = RobotVariation.draw(rows)
        self._views = RobotViews(self._batch, world)
        self._views.write_variation(settings, variation)
        self._start_poses = np.array(start_poses, float)
        self._heading = self._start_poses[:, 2].copy()
        super().__init__(rows, world.kinematics, variation, self._heading)
        self._active_worlds: np.ndarray | None = None  # indices of worlds to step; None for all
        self._reset_worlds(np.arange(n_worlds))
        if robots_per_world > 1 and with_hulls is None:
            check_start_poses(rows, world.model, self._batch.bind("qpos"))
        wheels = settings[0].wheels
        self._roller_pitch: float | None = None
        if wheels.model == "two-rollers":
            self._roller_pitch = 2 * np.pi / wheels.rollers
        self._make_parameters()
        self._drag: Drag
        self._start_cycles()
        self._start_faults(self._views)

    def _make_parameters(self) -> None:
        """Set parameters and initial state; encoder counts start at the present wheel angles."""
        electronics, state = self._initial_electronics
        carpet = self._nominal_carpet
        model = self._world.model
        inverse_inertia = model.dof_invweight0[self._world.robots[0].slip_dofs][:, None]
        # 1 / (R^2 C dt A), with which slip hinges get Q / A (`omni_mj.robot.wheel_carpet_forces`)
        compliance = carpet.creep_compliance / (model.opt.timestep * inverse_inertia)
        carpet = carpet._replace(creep_compliance=compliance)
        self.parameters = MujocoParameters(electronics, carpet)
        _, wheel_angle = self._sensor_values
        count = np.floor(wheel_angle * electronics.firmware.counts_per_rad)
        self.electronics = state._replace(firmware=state.firmware._replace(encoder_count=count))

    def pose(self) -> Array:
        """See `Plant`."""
        poses = self._views.pose.get()[:3].T
        poses[:, 2] = self._heading
        return poses

    def twist(self) -> Array:
        """See `Plant`."""
        return self._views.velocity.get()[[0, 1, 5]].T

    def telemetry(self) -> Telemetry:
        """See `Plant`."""
        views = self._views
        slip = abs(views.slip_speed.get()) * self.parameters.carpet.radius
        wheel_angle = views.wheel_angle.get()
        wheel_speed = views.wheel_speed.get()
        return Telemetry(
            stack_telemetry(self.electronics, self._record, wheel_angle, wheel_speed, slip).T
        )

    def advance(self, received: ReceivedCommand) -> dict[int, str]:
        """See `Plant`."""
        failures: dict[int, str] = {}
        for n_cycles, segment in received.split():
            failures = self.advance_cycles(n_cycles, segment)
        return failures

    def compute_heading(self) -> Array:
        """Return the headings of robots, which may be tilted, (n,) rad in (-pi, pi]."""
        w, x, y, z = self._views.pose.get()[3:]
        return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

    def _begin_frame(self) -> None:
        """Apply changes from frame to frame: faults, disturbances, vision's headings, heat."""
        # Faults that begin or end change `self.parameters` here, so read them afterwards.
        inputs = self._take_inputs()
        parameters = self.parameters.electronics
        _, wheel_angle = self._sensor_values
        self.electronics = begin_frame(parameters, self.electronics, inputs, wheel_angle)
        motors = self.electronics.motors
        self._views.resistance.set(motors.resistance)
        self._views.torque_constant.set(motors.back_emf_constant / parameters.motors.gear_ratio)

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
        self._heading += wrap_angle(self.compute_heading() - self._heading)
        return self._stop_failed_rows()

    def _begin_cycle(self) -> CycleRecord:
        """Run the firmware, and write voltages, forces on the chassis, and slip limits."""
        views = self._views
        is_drag_due = self.electronics.cycle % DRAG_CYCLES == 0
        gyro, wheel_angle = self._sensor_values
        wheel_speed = views.wheel_speed.get()
        load = views.load.get()
        self.electronics, record = run_cycle(
            self.parameters.electronics, self.electronics, gyro, wheel_angle, wheel_speed
        )
        if is_drag_due:
            motion = views.read_motion()
            slip_speed = views.slip_speed.get()
            self._drag = compute_drag(self.parameters.carpet, motion, load, wheel_angle, slip_speed)
            views.write_drag(self._drag, motion, self.electronics.inputs.push_force)
        motors = self.electronics.motors
        # MuJoCo's dcmotor has the constant resistance R in place of R + X |w|
        # (`omni_mj.robot.motors_and_drivers`). The voltage K w + R I drives the same current I.
        views.voltage.set(
            motors.back_emf_constant * wheel_speed + record.current * motors.resistance
        )
        motor_parameters = self.parameters.electronics.motors
        views.write_hub_friction(compute_load_friction(motor_parameters, motors, record.current))
        views.write_slip_limits(self._drag, load)
        return record

    def _read_sensors(self) -> None:
        """Store gyro, (n,) rad/s, and encoders, (W, n) rad."""
        self._sensor_values = self._views.gyro.get()[0], self._views.encoders.get()

    def _reset_worlds(self, worlds: np.ndarray) -> None:
        """Move the robots of some worlds to their start poses, at rest, and read all sensors.

        Args:
            worlds: Indices of the worlds, (k,).
        """
        slots = np.arange(self._robots_per_world)
        rows = (worlds[:, None] * self._robots_per_world + slots).ravel()
        rest_qpos = self._world.rest_qpos[np.array([robot.qpos for robot in self._world.robots])]
        positions = self._views.qpos.get()
        speeds = self._views.qvel.get()
        x, y, heading = self._start_poses[rows].T
        positions[:, rows] = rest_qpos[rows % self._robots_per_world].T
        positions[:2, rows] = x, y
        positions[3:7, rows] = np.cos(heading / 2), 0 * x, 0 * x, np.sin(heading / 2)
        speeds[:, rows] = 0.0
        self._views.qpos.set(positions)
        self._views.qvel.set(speeds)
        self._heading[rows] = heading
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
