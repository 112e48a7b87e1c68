"""Where robots are in the arrays of a batch of MuJoCo's, for compiled loops."""

from typing import NamedTuple

import numpy as np
from mujoco.batch import Batch

from omni_control.kinematics import Array
from omni_mj.mjcf import roles
from omni_mj.worlds.build import World

# Columns of `Cells.wheels`, and of `Cells.robots`: x, y; the quaternion; vx, vy and turn rate; the wrench; gyro.
ANGLE, SPEED, CTRL, ENCODER, LOAD, SLIP_ANGLE, SLIP, BOTTOM, FOLLOWING = range(9)
X, Y, QW, QX, QY, QZ, VX, VY, RATE, WRENCH, GYRO = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 15
OF_WHEEL, OF_ROBOT = FOLLOWING + 1, GYRO + 1  # how many there are


class Cells(NamedTuple):
    """Where robots are in the batch's arrays.

    Attributes:
        state: integration states of the worlds, (worlds, numbers).
        sensors: their sensors' data.
        limit: dry friction of their joints, (worlds, nv).
        impedance: of these constraints, (worlds, nv, 5).
        wheels: columns of each place's wheels in state, those of sensors, and of slip hinges, (places, 9, W).
        robots: of each place's robot, (places, 16).
        pitch: between rollers if they are handed over, else 0, (1,) rad.
    """

    state: Array
    sensors: Array
    limit: Array
    impedance: Array
    wheels: np.ndarray
    robots: np.ndarray
    pitch: Array

    @classmethod
    def of(cls, batch: Batch, world: World) -> "Cells":
        """Find them."""
        state = batch.state

        def first(name: str) -> int:
            offset: int = batch.bind(name).ctypes.data - state.ctypes.data
            return offset // state.itemsize

        qpos, qvel, ctrl, forces = (first(name) for name in ("qpos", "qvel", "ctrl", "xfrc_applied"))
        wheels = np.zeros((len(world.robots), OF_WHEEL, len(world.kinematics.azimuths)), np.int64)
        robots = np.zeros((len(world.robots), OF_ROBOT), np.int64)
        creeps = world.robots[0].slip_dofs.size > 0
        kept = creeps and world.robots[0].rollers.shape[1] == roles.KEPT
        for place, robot in enumerate(world.robots):
            wheels[place, ANGLE], wheels[place, SPEED] = qpos + np.array(robot.wheel_qpos), qvel + robot.wheel_dofs
            wheels[place, CTRL], wheels[place, ENCODER] = ctrl + robot.motors, robot.encoders
            wheels[place, LOAD] = world.loads[place]
            if creeps:
                wheels[place, SLIP_ANGLE], wheels[place, SLIP] = qpos + robot.slip_qpos, robot.slip_dofs
            if kept:
                wheels[place, BOTTOM:] = qvel + robot.roller_dofs.T
            robots[place, [X, Y, QW, QX, QY, QZ]] = qpos + np.array(robot.qpos)[[0, 1, 3, 4, 5, 6]]
            robots[place, [VX, VY, RATE]] = qvel + np.array(robot.dofs)[[0, 1, 5]]
            robots[place, WRENCH:GYRO] = forces + 6 * robot.chassis + np.arange(6)
            robots[place, GYRO] = robot.gyro
        return cls(
            state=state,
            sensors=batch.bind("sensordata"),
            limit=batch.expand("dof_frictionloss"),
            impedance=batch.expand("dof_solimp"),
            wheels=wheels,
            robots=robots,
            pitch=np.array([world.wheels.pitch if kept else 0.0]),
        )
