"""Robots in MuJoCo worlds that their firmware drives: the part that knows no batch of worlds."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.config.rows import Row
from omni_mj.mjcf.world_builder import World
from omni_mj.plants.cyclewise_plant import CyclewisePlant
from omni_mj.plants.fault_effects import ChangeableBodies
from omni_mj.plants.mjdata_views import RobotViews
from omni_mj.plants.randomization import RobotVariation
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


class MujocoParameters(NamedTuple):
    """Parameters of n robots on the plant `mujoco`."""

    electronics: ElectronicsParameters
    carpet: CarpetParameters  # its creep compliance is scaled for slip hinges


class MujocoRobots(CyclewisePlant):
    """Robots with roller wheels in MuJoCo worlds.

    Args:
        rows: Rows of the robots, all with the same model.
        world: Model of each world.
        views: Views of the robots, at rest at their start.
        variation: Deviations of the robots from their settings.
        heading: Heading at the start, (n,) rad.
    """

    def __init__(
        self,
        rows: Sequence[Row],
        world: World,
        views: RobotViews,
        variation: RobotVariation,
        heading: Array,
    ) -> None:
        self._world, self._views, self._heading = world, views, heading.copy()
        super().__init__(rows, world.kinematics, variation, heading)
        wheels = rows[0].settings.wheels
        self._roller_pitch: float | None = None
        if wheels.model == "two-rollers":
            self._roller_pitch = 2 * np.pi / wheels.rollers
        self._drag: Drag

    def _start(self) -> None:
        """Begin with the robots as they are now; encoders count from the present wheel angles."""
        electronics, state = self._initial_electronics
        self._change_parameters(electronics)
        _, wheel_angle = self._sensor_values
        count = np.floor(wheel_angle * electronics.firmware.counts_per_rad)
        self.electronics = state._replace(firmware=state.firmware._replace(encoder_count=count))
        self._start_cycles()

    def _change_parameters(self, electronics: ElectronicsParameters) -> ChangeableBodies:
        carpet = self._nominal_carpet
        model = self._world.model
        inverse_inertia = model.dof_invweight0[self._world.robots[0].slip_dofs][:, None]
        # 1 / (R^2 C dt A), with which slip hinges get Q / A (`omni_mj.robot.wheel_carpet_forces`)
        compliance = carpet.creep_compliance / (model.opt.timestep * inverse_inertia)
        carpet = carpet._replace(creep_compliance=compliance)
        self.parameters = MujocoParameters(electronics, carpet)
        self._views.write_friction([row.settings for row in self._rows])
        return self._views

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
        wheels = views.wheel_angle.get(), views.wheel_speed.get()
        return Telemetry(stack_telemetry(self.electronics, self._record, *wheels, slip).T)

    def compute_heading(self) -> Array:
        """Return the headings of robots, which may be tilted, (n,) rad in (-pi, pi]."""
        return compute_heading(self._views.pose.get()[3:])

    def _begin_frame(self) -> None:
        """Apply changes from frame to frame: faults, disturbances, vision's headings, heat."""
        # Faults that begin or end change `self.parameters` here, so read them afterwards.
        inputs = self._take_inputs()
        parameters = self.parameters.electronics
        _, wheel_angle = self._sensor_values
        self.electronics = begin_frame(parameters, self.electronics, inputs, wheel_angle)
        self._write_motors()

    def _write_motors(self) -> None:
        """Write what heat changes."""
        motors, parameters = self.electronics.motors, self.parameters.electronics.motors
        self._views.resistance.set(motors.resistance)
        self._views.torque_constant.set(motors.back_emf_constant / parameters.gear_ratio)

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

    def _end_frame(self) -> dict[int, str]:
        self._heading += wrap_angle(self.compute_heading() - self._heading)
        return {}


def compute_heading(quaternion: Array) -> Array:
    """Return the headings of orientations (w, x, y, z), (4, ...), in (-pi, pi] rad."""
    w, x, y, z = quaternion
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
