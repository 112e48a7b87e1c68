"""Where robots are in a batch of MuJoCo's: what a plant reads and writes in every step."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from mujoco.batch import Batch

from omni_control.kinematics import Array
from omni_mj.mjcf import roles
from omni_mj.robot.motors import Motor
from omni_mj.robot.rims import Drives, Sensed
from omni_mj.scenarios.settings import Settings, column
from omni_mj.worlds.build import World
from omni_mj.worlds.columns import Columns
from omni_mj.worlds.two_rollers import Handover


@dataclass(frozen=True, eq=False)
class Slips:
    """The hinges on which rims slip: their speed in rad/s, highest dry friction in N m and impedance, (n, W)."""

    speed: Columns
    limit: Columns
    impedance: Columns

    def set(self, limit: Array, impedance: Array) -> None:
        """Write limits and impedances, (W, n)."""
        self.limit.set(limit.T)
        self.impedance.set(impedance.T)


@dataclass(frozen=True, eq=False)
class Bound:
    """Live arrays of n robots with W wheels.

    Attributes:
        qpos, qvel: All positions and speeds of a robot.
        position, quaternion, velocity: Of the free joint: (n, 3) m, (n, 4), (n, 6) m/s and rad/s.
        wheel_angle, wheel_speed: Of the hubs, (n, W) rad and rad/s.
        gyro, encoders: What these sensors show, (n, 1) rad/s and (n, W) rad.
        ctrl: Voltages for the dcmotors, (n, W).
        resistance, constant: Of the dcmotors, (n, W).
        wrench: Force and torque on the chassis, world frame, (n, 6).
        load: Of the wheels, (n, W) N.
        slips: Of the rims; None of wheels that do not creep.
        handover: Of wheels of two rollers; None of others.
    """

    qpos: Columns
    qvel: Columns
    position: Columns
    quaternion: Columns
    velocity: Columns
    wheel_angle: Columns
    wheel_speed: Columns
    gyro: Columns
    encoders: Columns
    ctrl: Columns
    resistance: Columns
    constant: Columns
    wrench: Columns
    load: Columns
    slips: Slips | None
    handover: Handover | None

    @classmethod
    def of(cls, batch: Batch, world: World) -> Self:
        """Find the robots of a world in a batch of such worlds."""
        robots = world.robots
        qpos, qvel, sensors, ctrl = (batch.bind(name) for name in ("qpos", "qvel", "sensordata", "ctrl"))
        motors, gain = np.array([robot.motors for robot in robots]), batch.expand("actuator_gainprm")
        forces, slips = batch.bind("xfrc_applied"), np.array([robot.slip_dofs for robot in robots])
        wheel_angle = Columns(qpos, np.array([robot.wheel_qpos for robot in robots]))
        of_rims: Slips | None = None
        handover: Handover | None = None
        if slips.size:
            limit, impedance = batch.expand("dof_frictionloss"), batch.expand("dof_solimp")[:, :, 0]
            of_rims = Slips(Columns(qvel, slips), Columns(limit, slips), Columns(impedance, slips))
        if slips.size and robots[0].rollers.shape[1] == roles.KEPT:
            angles = Columns(qpos, np.array([robot.slip_qpos for robot in robots]))
            bottom, following = (
                Columns(qvel, np.array([robot.roller_dofs[:, k] for robot in robots])) for k in range(roles.KEPT)
            )
            handover = Handover(wheel_angle, angles, (bottom, following), world.wheels.pitch)
        return cls(
            qpos=Columns(qpos, np.array([robot.qpos for robot in robots])),
            qvel=Columns(qvel, np.array([robot.dofs for robot in robots])),
            position=Columns(qpos, np.array([robot.qpos[:3] for robot in robots])),
            quaternion=Columns(qpos, np.array([robot.qpos[3:7] for robot in robots])),
            velocity=Columns(qvel, np.array([robot.dofs[:6] for robot in robots])),
            wheel_angle=wheel_angle,
            wheel_speed=Columns(qvel, np.array([robot.wheel_dofs for robot in robots])),
            gyro=Columns(sensors, np.array([[robot.gyro] for robot in robots])),
            encoders=Columns(sensors, np.array([robot.encoders for robot in robots])),
            ctrl=Columns(ctrl, motors),
            resistance=Columns(gain[:, :, 0], motors),
            constant=Columns(gain[:, :, 1], motors),
            wrench=Columns(
                forces.reshape(len(forces), -1),
                np.array([range(6 * robot.chassis, 6 * robot.chassis + 6) for robot in robots]),
            ),
            load=Columns(sensors, world.loads),
            slips=of_rims,
            handover=handover,
        )

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
        if self.slips is not None:
            self.slips.set(drives.limit, drives.impedance)


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
