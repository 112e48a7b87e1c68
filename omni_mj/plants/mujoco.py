"""The physical plant: models/ssl_robot.xml, n copies stepped on all cores, driven by firmware at the physics rate."""

import os

import mujoco
import numpy as np
from mujoco.batch import Batch

from omni_control.kinematics import Array
from omni_mj import robot
from omni_mj.firmware import Firmware
from omni_mj.plants import SimulationError, Telemetry
from omni_mj.randomness import Stream, draw
from omni_mj.settings import FRAME_RATE_HZ, PERIOD_S, Settings

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
        settings: sections firmware, battery, carpet and disturbance.
        start: poses at the start, (n, 3).
        seeds: one per robot.
        frames: frames of the run.
        threads: of the physics; all cores by default. Results do not depend on it.
    """

    def __init__(
        self, settings: Settings, start: Array, seeds: list[int], frames: int, threads: int | None = None
    ) -> None:
        model = robot.load_model()
        model.pair_friction[:, :2] = settings.carpet.friction
        n = len(start)
        self._batch = Batch(model, n, threads or min(n, os.cpu_count() or 1))
        self._steps = round(1 / (FRAME_RATE_HZ * model.opt.timestep))
        self._motor = robot.motor(model)

        names = [f"{i + 1}" for i in range(robot.WHEELS)]
        sensor = self._batch.bind("sensordata")
        self._gyro = sensor[:, model.sensor("gyro").adr[0] + 2]
        self._encoders = _columns(sensor, [model.sensor(f"encoder_{i}").adr[0] for i in names])
        qpos, qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        base = model.joint("robot").qposadr[0]
        self._position, self._quaternion = qpos[:, base : base + 2], qpos[:, base + 3 : base + 7]
        self._wheel_angle = [qpos[:, model.joint(f"wheel_{i}").qposadr[0]] for i in names]
        self._wheel_speed = [qvel[:, model.joint(f"wheel_{i}").dofadr[0]] for i in names]
        self._ctrl = self._batch.bind("ctrl")
        self._torque = self._batch.bind("actuator_force")
        self._push = self._batch.bind("xfrc_applied")[:, model.body("chassis").id, :2]

        qpos[:], qvel[:] = robot.standing(model)
        self._position[:] = start[:, :2]
        self._quaternion[:] = np.stack([np.cos(start[:, 2] / 2), *np.zeros((2, n)), np.sin(start[:, 2] / 2)], axis=1)
        self._heading = np.array(start[:, 2], float)
        self._force = settings.disturbance.force_n * draw(
            seeds, Stream.DISTURBANCE, lambda rng: rng.uniform(-1, 1, (frames, 2))
        )
        self._firmware = Firmware(
            settings.firmware,
            robot.kinematics(model),
            self._motor,
            settings.battery.voltage_v,
            self._heading,
            model.opt.timestep,
        )
        self._voltage_peak, self._current_peak = np.zeros(n), np.zeros(n)

    def pose(self) -> Array:
        """See `Plant`."""
        return np.column_stack([self._position, self._heading])

    def advance(self, frame: int, command: Array) -> None:
        """See `Plant`."""
        self._push[:] = self._force[frame]
        self._voltage_peak[:] = self._current_peak[:] = 0.0
        for _ in range(self._steps):
            voltage = self._firmware.voltages(command, self._gyro, self._encoders)
            self._ctrl[:] = voltage
            self._batch.step()
            np.maximum(self._voltage_peak, np.abs(voltage).max(1), out=self._voltage_peak)
            np.maximum(self._current_peak, np.abs(self._torque).max(1), out=self._current_peak)
        self._current_peak /= self._motor.constant
        self._check(frame)
        w, x, y, z = self._quaternion.T
        if (fallen := np.flatnonzero(x * x + y * y > TOPPLED)).size:
            raise SimulationError(f"robot {fallen[0]} toppled over at {(frame + 1) * PERIOD_S:.3f} s")
        heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        self._heading = self._heading + np.angle(np.exp(1j * (heading - self._heading)))

    def telemetry(self) -> Telemetry:
        """See `Plant`."""
        return Telemetry(
            np.stack(self._wheel_angle, axis=1),
            np.stack(self._wheel_speed, axis=1),
            self._ctrl.copy(),
            self._torque / self._motor.constant,
            self._voltage_peak.copy(),
            self._current_peak.copy(),
        )

    def _check(self, frame: int) -> None:
        for warning, meaning in _UNSTABLE.items():
            if (bad := np.flatnonzero(self._batch.warning[:, warning, 1])).size:
                raise SimulationError(
                    f"the simulation of robot {bad[0]} became unstable at {(frame + 1) * PERIOD_S:.3f} s: {meaning}"
                    f" (MuJoCo warning {mujoco.mjtWarning(warning).name})"
                )


def _columns(array: Array, indices: list[int]) -> Array:
    """A live view of neighbouring columns."""
    first = indices[0]
    assert indices == list(range(first, first + len(indices)))
    return array[:, first : first + len(indices)]
