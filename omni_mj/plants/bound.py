"""Where robots are in a batch of MuJoCo's: what a plant reads and writes in every step."""

from collections.abc import Callable, Sequence

import numpy as np
from mujoco.batch import Batch

from omni_control.kinematics import Array
from omni_mj.mjcf import roles
from omni_mj.mjcf.roles import Robot
from omni_mj.robot.motors import Motor
from omni_mj.robot.rims import Drives, Sensed
from omni_mj.scenarios.settings import Settings, column
from omni_mj.worlds.build import World
from omni_mj.worlds.columns import Columns
from omni_mj.worlds.two_rollers import Handover


class Bound:
    """Live arrays of n robots with W wheels.

    Args:
        batch: Of the robots' worlds.
        world: As built.

    Attributes:
        qpos, qvel: All positions and speeds of a robot.
        position, quaternion, velocity: Of the free joint: (n, 3) m, (n, 4), (n, 6) m/s and rad/s.
        wheel_angle, wheel_speed: Of the hubs, (n, W) rad and rad/s.
        gyro, encoders: What these sensors show, (n, 1) rad/s and (n, W) rad.
        ctrl: Voltages for the dcmotors, (n, W).
        resistance, constant: Of the dcmotors, (n, W).
        wrench: Force and torque on the chassis, world frame, (n, 6).
        load: Of the wheels, (n, W) N.
        creeps: Whether rims slip on hinges.
        slip_speed, slip_limit, slip_impedance: Of these hinges, (n, W) rad/s, N m and 1.
        handover: Of wheels of two rollers; None of others.
    """

    def __init__(self, batch: Batch, world: World) -> None:
        robots = world.robots

        def at(array: Array, numbers: Callable[[Robot], Sequence[int] | np.ndarray]) -> Columns:
            return Columns(array, np.array([numbers(robot) for robot in robots]))

        qpos, qvel, sensors = (batch.bind(name) for name in ("qpos", "qvel", "sensordata"))
        gain, forces = batch.expand("actuator_gainprm"), batch.bind("xfrc_applied")
        self.qpos, self.qvel = at(qpos, lambda r: r.qpos), at(qvel, lambda r: r.dofs)
        self.position = at(qpos, lambda r: r.qpos[:3])
        self.quaternion = at(qpos, lambda r: r.qpos[3:7])
        self.velocity = at(qvel, lambda r: r.dofs[:6])
        self.wheel_angle, self.wheel_speed = at(qpos, lambda r: r.wheel_qpos), at(qvel, lambda r: r.wheel_dofs)
        self.gyro, self.encoders = at(sensors, lambda r: [r.gyro]), at(sensors, lambda r: r.encoders)
        self.ctrl = at(batch.bind("ctrl"), lambda r: r.motors)
        self.resistance, self.constant = at(gain[:, :, 0], lambda r: r.motors), at(gain[:, :, 1], lambda r: r.motors)
        self.wrench = at(forces.reshape(len(forces), -1), lambda r: range(6 * r.chassis, 6 * r.chassis + 6))
        self.load = Columns(sensors, world.loads)
        self.creeps = robots[0].slip_dofs.size > 0
        self.handover: Handover | None = None
        if self.creeps:
            self.slip_speed = at(qvel, lambda r: r.slip_dofs)
            self.slip_limit = at(batch.expand("dof_frictionloss"), lambda r: r.slip_dofs)
            self.slip_impedance = at(batch.expand("dof_solimp")[:, :, 0], lambda r: r.slip_dofs)
        if self.creeps and robots[0].rollers.shape[1] == roles.KEPT:
            slips = at(qpos, lambda r: r.slip_qpos)
            bottom, following = at(qvel, lambda r: r.roller_dofs[:, 0]), at(qvel, lambda r: r.roller_dofs[:, 1])
            self.handover = Handover(self.wheel_angle, slips, (bottom, following), world.wheels.pitch)

    def read(self, gyro: Array, encoder_angle: Array) -> Sensed:
        """Read what is needed before a step.

        Args:
            gyro: What gyros showed a cycle ago, (n,) rad/s.
            encoder_angle: What encoders showed, (W, n) rad.
        """
        x, y, _ = self.position.get().T
        w, _, _, z = self.quaternion.get().T
        velocity_x, velocity_y, _, _, _, rate = self.velocity.get().T
        speed, load = self.wheel_speed.get().T.copy(), self.load.get().T
        return Sensed(gyro, encoder_angle, speed, load, x, y, w, z, velocity_x, velocity_y, rate)

    def write(self, drives: Drives) -> None:
        """Write voltages, forces and limits before a step."""
        self.ctrl.set(drives.voltage.T)
        self.wrench.set(drives.wrench.T)
        if self.creeps:
            self.limit_slips(drives.limit, drives.impedance)

    def limit_slips(self, limit: Array, impedance: Array) -> None:
        """Write limits and impedances of the slip hinges, (W, n)."""
        self.slip_limit.set(limit.T)
        self.slip_impedance.set(impedance.T)


def write_friction(batch: Batch, world: World, settings: Sequence[Settings]) -> None:
    """Write friction of wheels, rollers and gears into each robot's copy of the model's fields.

    Args:
        batch: Of the robots' worlds.
        world: As built.
        settings: Of each robot.
    """
    drive, robots = [s.drive for s in settings], world.robots
    if not robots[0].slip_dofs.size:  # the carpet's friction is that of the contacts, not of slip hinges
        pairs, friction = batch.expand("pair_friction"), column([s.carpet for s in settings], "friction")
        for direction in range(2):
            Columns(pairs[:, :, direction], world.pairs).set(friction)
    motors, hubs = [Motor.of(s.motor) for s in settings], np.array([robot.wheel_dofs for robot in robots])
    dry, damping = batch.expand("dof_frictionloss"), batch.expand("dof_damping")
    Columns(dry, hubs).set(column(motors, "wheel_dry") + column(drive, "gear_friction_nm"))
    Columns(damping, hubs).set(column(motors, "wheel_viscous"))
    rollers = np.array([robot.roller_dofs.ravel() for robot in robots])
    Columns(damping, rollers).set(column(drive, "roller_damping_nm_s"))
