"""A robot that is advanced around the steps of a scene.

The firmware runs 960 times per second, whatever the timestep of the scene. Before each step, the
cycles run that are due. They see the angles of the wheels as they were one cycle earlier, as on the
plant `mujoco`, interpolated between steps. So steps of a cycle, or of a fraction of it, give the
results of the plant with as many substeps.
"""

import math
from fractions import Fraction

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config import CYCLE_RATE_HZ
from omni_mj.config.rows import Row
from omni_mj.mjcf.world_builder import World
from omni_mj.network.radio import ReceivedCommand
from omni_mj.plants.mjdata_views import RobotViews
from omni_mj.plants.mujoco_robots import MujocoRobots
from omni_mj.plants.randomization import RobotVariation
from omni_mj.robot.electronics import CycleRecord
from omni_mj.robot.firmware_state import FrameInputs
from omni_mj.robot.motors_and_drivers import compute_resistance

# Largest product of timestep and rate of a wheel loop, by trials; with more, wheels on the floor
# oscillate.
MAX_LOOP_GAIN = 3.5


class SteppedRobot(MujocoRobots):
    """A robot that is advanced around the steps of a scene.

    Args:
        row: Row of the robot.
        world: Model of the scene.
        views: View of the robot, which is at its start.
        variation: Deviations of the robot from its settings.

    Attributes:
        record: Record of the last cycle.
    """

    def __init__(
        self,
        row: Row,
        world: World,
        views: RobotViews,
        variation: RobotVariation,
    ) -> None:
        super().__init__([row], world, views, variation, np.zeros(1))
        self._heading = self.compute_heading()
        self._read_sensors()
        self._start()
        self._start_steps()
        self._now = Fraction(0)  # time in cycles
        self._sensor_time = Fraction(-1)  # of the sensor values, in cycles
        self._runs_cycle = False  # whether a cycle ran before this step
        self._voltages: Array | None = None  # commanded voltages, (W, 1) V
        self._push_force = np.zeros((2, 1))
        self.record = CycleRecord(*(values[0] for values in self._record))  # zeros

    def follow(self, world: World, views: RobotViews) -> None:
        """Go on in another model of the scene, and with views of it."""
        self._world, self._views = world, views
        self._change_parameters(self.parameters.electronics)
        self._write_motors()
        self._start_steps()

    def _start_steps(self) -> None:
        """Adopt the timestep of the scene."""
        self._check_wheel_loops()
        step = self._world.model.opt.timestep
        self._cycles_per_step = Fraction(step * CYCLE_RATE_HZ).limit_denominator(10**6)

    def _check_wheel_loops(self) -> None:
        """Raise an OmniError if steps are too long for the gain of the wheel loops.

        The loop of a hub of the inertia J decays at the rate (kp + K) K / (R J). If it holds a
        voltage for more than 2 / rate, the free hub oscillates; on the floor it has more inertia.
        """
        firmware, motors = self.parameters.electronics.firmware, self.electronics.motors
        model, robot = self._world.model, self._world.robots[0]
        damping = (firmware.kp + motors.back_emf_constant) * motors.back_emf_constant
        rate = damping / motors.resistance * model.dof_invweight0[robot.wheel_dofs][:, None]
        max_step = max(float(MAX_LOOP_GAIN / rate.max()), float(firmware.period[0]))
        if model.opt.timestep > max_step:
            raise OmniError(
                f"the timestep of the scene is {model.opt.timestep:g} s; the wheel loops of the "
                f"robot {self._rows[0].robot} need at most {math.floor(1e4 * max_step) / 1e4:g} s, "
                "or a lower firmware.kp"
            )

    def accept(self, name: str, values: Array) -> None:
        """Accept a command; see `RobotDrive.command`."""
        column = values[:, None]
        self._voltages = column if name == "voltages" else None
        self._set_current_setpoint(column if name == "currents" else None)
        rim_speeds = values[None] * self._world.kinematics.radius
        self._receive(
            ReceivedCommand(
                values[None] if name == "velocity" else np.zeros((1, 3)),
                np.full(1, np.nan),
                np.zeros(1, int),
                in_body_frame=np.ones(1, bool),
                rim_speeds=rim_speeds if name == "wheel_speeds" else None,
            )
        )

    def set_push_force(self, force: Array) -> None:
        """Set the push force from now on, world frame, (2,) N."""
        self._push_force = force[:, None]
        self._change_inputs(push_force=self._push_force)

    def before_step(self) -> None:
        """Run the cycles that are due."""
        gyro, angle = self._sensor_values
        change = self._views.wheel_angle.get() - angle  # since the sensors were read
        age = self._now - self._sensor_time
        self._runs_cycle = False
        while (cycle := int(self.electronics.cycle)) <= self._now:
            # As on the plant, sensor values are one cycle old.
            fraction = float((cycle - 1 - self._sensor_time) / age)
            self._sensor_values = gyro, angle + fraction * change
            self.advance_cycles(1, None)
            self._runs_cycle = True
        if not self._runs_cycle:
            self._views.write_slip_limits(self._drag, self._views.load.get())

    def after_step(self) -> None:
        """Read sensors if a cycle has used the previous values."""
        if self._runs_cycle:
            self._read_sensors()
            self._sensor_time = self._now
        if self._roller_pitch is not None:
            self._views.wrap_rollers(self._roller_pitch)
        self._now += self._cycles_per_step

    def _advance_cycle(self) -> CycleRecord:
        if self._voltages is not None:
            p, motors = self.parameters.electronics.motors, self.electronics.motors
            speed = self._views.wheel_speed.get()
            back_emf = motors.back_emf_constant * speed
            resistance = compute_resistance(p, motors, speed)
            self._set_current_setpoint((self._voltages - back_emf) / resistance)
        self.record = self._begin_cycle()
        return self.record

    def _take_inputs(self) -> FrameInputs:
        inputs = super()._take_inputs()
        return inputs._replace(push_force=inputs.push_force + self._push_force)

    def _set_current_setpoint(self, current: Array | None) -> None:
        """Let the drivers hold currents (W, 1), in A, in place of the firmware's duty cycles."""
        self._current_setpoint = current
        self._change_inputs(current_setpoint=current)

    def _change_inputs(self, **inputs: Array | None) -> None:
        """Change inputs of the present frame."""
        state = self.electronics
        self.electronics = state._replace(inputs=state.inputs._replace(**inputs))
