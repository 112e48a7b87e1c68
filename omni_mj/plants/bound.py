"""What a plant reads and writes in every step: parts of the batch's arrays, as rows of robots."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from mujoco.batch import Batch

from omni_mj.mjcf import roles
from omni_mj.worlds.build import World
from omni_mj.worlds.columns import Columns
from omni_mj.worlds.two_rollers import Handover


@dataclass(frozen=True, eq=False)
class Slips:
    """The hinges on which rims slip: their speed in rad/s, highest dry friction in N m and impedance, (n, W)."""

    speed: Columns
    limit: Columns
    impedance: Columns


@dataclass(frozen=True, eq=False)
class Bound:
    """Live arrays of n robots with W wheels.

    Attributes:
        qpos, qvel: all positions and speeds of a robot.
        position, quaternion, velocity: of the free joint: (n, 3) m, (n, 4), (n, 6) m/s and rad/s.
        wheel_angle, wheel_speed: of the hubs, (n, W) rad and rad/s.
        gyro, encoders: what these sensors show, (n, 1) rad/s and (n, W) rad.
        ctrl: voltages that the dcmotors are told, (n, W).
        resistance, constant: of the dcmotors, (n, W).
        wrench: force and torque on the chassis, world frame, (n, 6).
        load: of the wheels, (n, W) N.
        slips: of the rims; None of wheels that do not creep.
        handover: of wheels of two rollers; None of others.
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
        """Find them."""
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
