"""A test bench for a robot's motors: the robot clamped in the air, and one motor driven over time."""

from dataclasses import dataclass

import mujoco
import numpy as np
from maxon import MAXON, SHEET, sheet
from numpy.typing import NDArray
from omni_mj.onboard.motors import Motors

from omni_mj.scenarios import models
from omni_mj.scenarios.motor_settings import MotorSettings
from omni_mj.scenarios.settings import Settings
from omni_mj.worlds import build
from omni_mj.worlds.shape import Shape, robot

FINE_STEP = 1e-5  # a thousandth of the time constant: the integrator's error is then below 0.1 %
# The default robot with the motor of 24 V; rims are part of the hubs, for nothing is to slip here.
CLAMPED = Settings(motor=SHEET, wheels={"creep": "off"})


def bench(timestep: float | None = None, massless_wheels: bool = False, held: bool = False) -> mujoco.MjModel:
    """The robot clamped in the air, without gear friction: a wheel's inertia and the motor's own friction remain."""
    spec = robot(Shape.of(CLAMPED), models.robot_path())
    spec.delete(spec.key("home"))
    spec.delete(spec.joint("robot"))
    spec.option.gravity = [0, 0, 0]
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    spec.option.timestep = timestep or build.CYCLE_S
    for i in range(1, 5):
        spec.joint(f"wheel_{i}").frictionloss = MAXON.gear * MAXON.dry
        spec.joint(f"wheel_{i}").damping = [MAXON.gear**2 * MAXON.viscous, 0, 0]
        if held:
            spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=f"wheel_{i}")
    if massless_wheels:
        for joint in (each for each in spec.joints if each.name.startswith("roller")):
            joint.damping = [0, 0, 0]  # of the rollers' bearings: explicit integration needs some inertia beside it
        for body in spec.bodies:
            if body.name.startswith(("wheel", "rim", "roller")):
                body.mass, body.inertia = 1e-9, [1e-12] * 3
    model = spec.compile()
    model.actuator_gainprm[:, :2] = MAXON.resistance, MAXON.constant
    model.actuator_ctrllimited[:] = 0  # what a battery gives is no business of the bench
    return model


@dataclass
class Run:
    """Motor 1 over time: the state before each step and the torque that acted in it, on the motor's shaft."""

    timestep: float
    speed: NDArray
    torque: NDArray  # from the engine
    voltage: NDArray  # at the terminals
    told: NDArray  # current that Motors reports

    @property
    def current(self) -> NDArray:
        return self.torque / MAXON.constant


def run(
    model: mujoco.MjModel,
    seconds: float,
    voltage: float,
    start_speed: float = 0.0,
    load: float = 0.0,
    settings: MotorSettings | None = None,
) -> Run:
    """Drive motor 1 at a voltage, from a speed of its shaft, against a load torque on its shaft."""
    chosen = settings or sheet()
    model.actuator_gainprm[:, 0] = chosen.resistance_ohm
    data = mujoco.MjData(model)
    motors = Motors([chosen], 4, 1 / 60)
    wheel = model.joint("wheel_1").dofadr[0]
    wheels = [model.joint(f"wheel_{i}").dofadr[0] for i in (1, 2, 3, 4)]
    data.qvel[wheel] = start_speed / MAXON.gear
    data.qfrc_applied[wheel] = -load * MAXON.gear
    terminals = np.array([[voltage, 0.0, 0.0, 0.0]])
    speed, torque, told = [], [], []
    for _ in range(round(seconds / model.opt.timestep)):
        speed.append(data.qvel[wheel] * MAXON.gear)
        _, current = motors.drive(terminals, data.qvel[None, wheels])
        data.ctrl[:] = motors.told(current, data.qvel[None, wheels])
        mujoco.mj_step(model, data)
        torque.append(data.actuator_force[0])
        told.append(current[0, 0])
    return Run(model.opt.timestep, np.array(speed), np.array(torque), np.full(len(speed), voltage), np.array(told))
