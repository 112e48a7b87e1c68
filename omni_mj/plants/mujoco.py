"""The physical plant: models/ssl_robot.xml, n copies stepped on all cores, driven by their firmware."""

import os
from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco.batch import Batch

from omni_control.kinematics import Array, wrap_angle
from omni_mj.link.noise import Stream, draw
from omni_mj.link.radio import Received
from omni_mj.onboard.battery import Battery
from omni_mj.onboard.firmware import Firmware
from omni_mj.onboard.motors import Motors
from omni_mj.plants import SimulationError, Telemetry
from omni_mj.scenarios.settings import PERIOD_S, Settings, column
from omni_mj.worlds import contact_roller, robot
from omni_mj.worlds.wheels import WheelGeometry, contact_slip

TOPPLED = np.sin(np.deg2rad(45) / 2) ** 2  # of the quaternion's x^2 + y^2: tilted by more than 45 degrees
# MuJoCo resets an unstable simulation silently after one of these.
_UNSTABLE = {
    mujoco.mjtWarning.mjWARN_BADQPOS: "a position is not a number or too large",
    mujoco.mjtWarning.mjWARN_BADQVEL: "a velocity is not a number or too large",
    mujoco.mjtWarning.mjWARN_BADQACC: "an acceleration is not a number or too large",
}


class MujocoPlant:
    """Robots with roller wheels on carpet, each in a world of its own.

    Args:
        settings: one per robot; the sections wheels and physics must be the same for all.
        start: poses at the start, (n, 3).
        seeds: one per robot.
        frames: frames of the run.
        threads: of the physics; all cores by default. Results do not depend on it.
    """

    def __init__(
        self, settings: Sequence[Settings], start: Array, seeds: list[int], frames: int, threads: int | None = None
    ) -> None:
        common = settings[0]
        assert all((s.wheels, s.physics) == (common.wheels, common.physics) for s in settings), "one batch, one model"
        fast = common.wheels.model == "contact-roller"
        model = contact_roller.load_model() if fast else robot.load_model()
        cycle = model.opt.timestep  # of the wheel loops, however finely the physics is integrated
        self._cycles, self._substeps = round(PERIOD_S / cycle), common.physics.substeps
        model.opt.timestep = cycle / self._substeps
        model.actuator_ctrllimited[:] = 0  # the battery limits, also where braking motors lift its voltage
        n = len(start)
        self._batch = batch = Batch(model, n, threads or min(n, os.cpu_count() or 1))
        self._motor = robot.motor(model)
        self._geometry = robot.kinematics(model)
        self._set_friction(model, settings)
        self._gain = batch.expand("actuator_gainprm")

        names = [f"{i + 1}" for i in range(robot.WHEELS)]
        sensor, qpos, qvel = batch.bind("sensordata"), batch.bind("qpos"), batch.bind("qvel")
        self._gyro = sensor[:, model.sensor("gyro").adr[0] + 2]
        self._encoders = sensor[:, robot.even_slice([model.sensor(f"encoder_{i}").adr[0] for i in names])]
        base, dof = model.joint("robot").qposadr[0], model.joint("robot").dofadr[0]
        self._velocity = qvel[:, dof : dof + 6]
        self._position, self._quaternion = qpos[:, base : base + 2], qpos[:, base + 3 : base + 7]
        self._qpos, self._qvel, self._wheels = qpos, qvel, WheelGeometry.of(model)
        wheels = robot.wheel_joints(model)
        self._wheel_angle = qpos[:, robot.even_slice([w.qposadr[0] for w in wheels])]
        self._wheel_speed = qvel[:, robot.even_slice([w.dofadr[0] for w in wheels])]
        self._ctrl = batch.bind("ctrl")
        self._handover = contact_roller.Handover(batch) if fast else None
        self._push = batch.bind("xfrc_applied")[:, model.body("chassis").id, :2]

        qpos[:], qvel[:] = robot.standing(model)
        self._position[:] = start[:, :2]
        self._quaternion[:] = np.stack([np.cos(start[:, 2] / 2), *np.zeros((2, n)), np.sin(start[:, 2] / 2)], axis=1)
        self._heading = np.array(start[:, 2], float)
        push = draw(seeds, Stream.DISTURBANCE, lambda rng: rng.uniform(-1, 1, (frames, 2)))
        self._force = column([s.disturbance for s in settings], "force_n") * push
        sensors = [s.sensors for s in settings]
        bias = draw(seeds, Stream.GYRO_BIAS, lambda rng: rng.standard_normal((1, 1)))
        noise = draw(seeds, Stream.GYRO_NOISE, lambda rng: rng.standard_normal((frames, 1)))
        self._gyro_error = column(sensors, "gyro_bias_rad_s") * bias + column(sensors, "gyro_noise_rad_s") * noise

        self._motors = Motors(self._motor, [s.motor for s in settings], PERIOD_S)
        self._battery = Battery([s.battery for s in settings])
        self._firmware = Firmware(settings, self._geometry, self._motor, self._heading, cycle, PERIOD_S)
        batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL.value)  # sensors of the state in which the robots start
        of_a_frame = (self._cycles, n, robot.WHEELS)
        self._duties, self._voltages, self._currents = np.zeros((3, *of_a_frame))

    def pose(self) -> Array:
        """See `Plant`."""
        return np.column_stack([self._position, self._heading])

    def twist(self) -> Array:
        """See `Plant`."""
        return self._velocity[:, [0, 1, 5]]

    def advance(self, frame: int, received: Received) -> None:
        """See `Plant`."""
        motors, battery, handover = self._motors, self._battery, self._handover
        self._push[:] = self._force[frame]
        self._gain[:, :, 0], self._gain[:, :, 1] = motors.resistance, motors.constant
        self._firmware.receive(received, motors.winding)
        gyro_error = self._gyro_error[frame, :, 0]
        for k in range(self._cycles):
            angles = self._encoders if handover is None else self._encoders + handover.sensor_offset
            duty = self._duties[k] = self._firmware.duties(self._gyro + gyro_error, angles)
            voltage = np.multiply(duty, battery.voltage[:, None], out=self._voltages[k])
            self._ctrl[:], self._currents[k] = motors.drive(voltage, self._wheel_speed)
            for _ in range(self._substeps):
                self._batch.step()
                if handover is not None:
                    handover()
            battery.load(duty, self._currents[k])
        motors.warm(self._currents)
        battery.discharge(PERIOD_S)
        self._check(frame)

    def telemetry(self) -> Telemetry:
        """See `Plant`."""
        return Telemetry(
            wheel_angle=(self._wheel_angle if self._handover is None else self._handover.angle).copy(),
            wheel_speed=self._wheel_speed.copy(),
            voltage=self._voltages[-1].copy(),
            current=self._currents[-1].copy(),
            duty_peak=np.abs(self._duties).max((0, 2)),
            voltage_peak=np.abs(self._voltages).max((0, 2)),
            current_peak=np.abs(self._currents).max((0, 2)),
            winding=self._motors.winding,
            housing=self._motors.housing,
            battery=self._battery.voltage,
            slip=contact_slip(self._wheels, self._geometry, self._qpos, self._qvel),
        )

    def _set_friction(self, model: mujoco.MjModel, settings: Sequence[Settings]) -> None:
        """Write each robot's friction of carpet, hinges and rollers into its own copy of these model fields."""
        self._batch.expand("pair_friction")[:, :, :2] = column([s.carpet for s in settings], "friction")[:, None]
        weight = model.body("chassis").subtreemass[0] * -model.opt.gravity[2]
        rolling = column([s.carpet for s in settings], "lint") * weight / robot.WHEELS * self._geometry.radius
        gear = column([s.drive for s in settings], "gear_friction_nm")
        dofs = [joint.dofadr[0] for joint in robot.wheel_joints(model)]
        self._batch.expand("dof_frictionloss")[:, dofs] = robot.numeric("motor_friction") + gear + rolling
        rollers = model.dof_damping > 0
        self._batch.expand("dof_damping")[:, rollers] = column([s.drive for s in settings], "roller_damping_nm_s")

    def _check(self, frame: int) -> None:
        """Raise SimulationError for an unstable or toppled robot; otherwise read the heading."""
        time = f"at {(frame + 1) * PERIOD_S:.3f} s"
        for warning, meaning in _UNSTABLE.items():
            if (bad := np.flatnonzero(self._batch.warning[:, warning, 1])).size:
                name = mujoco.mjtWarning(warning).name
                raise SimulationError(
                    f"the simulation of robot {bad[0]} became unstable {time}: {meaning} (MuJoCo warning {name})"
                )
        w, x, y, z = self._quaternion.T
        if (fallen := np.flatnonzero(x * x + y * y > TOPPLED)).size:
            raise SimulationError(f"robot {fallen[0]} toppled over {time}")
        heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        self._heading = self._heading + wrap_angle(heading - self._heading)
