"""A test bench for the default robot's motors: the robot clamped in the air, and one motor driven over time."""

from dataclasses import dataclass

import mujoco
import numpy as np
from driving import DRY, GEAR, VISCOUS
from numpy.typing import NDArray

from omni_mj.onboard.motors import Motors
from omni_mj.scenarios import models
from omni_mj.scenarios.motor_settings import MotorSettings
from omni_mj.worlds import build

TORQUE_CONSTANT = 0.036
FINE_STEP = 1e-5  # a thousandth of the time constant: the integrator's error is then below 0.1 %


def bench(timestep: float | None = None, massless_wheels: bool = False, held: bool = False) -> mujoco.MjModel:
    """The robot clamped in the air, without gear and lint: a wheel's inertia and the motor's own friction remain."""
    spec = mujoco.MjSpec.from_file(str(models.model_path("ssl_robot")))
    spec.delete(spec.key("home"))
    spec.delete(spec.joint("robot"))
    spec.option.gravity = [0, 0, 0]
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    spec.option.timestep = timestep or build.CYCLE_S
    for i in range(1, 5):
        spec.joint(f"wheel_{i}").frictionloss = DRY
        spec.joint(f"wheel_{i}").damping = [VISCOUS, 0, 0]
        if held:
            spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=f"wheel_{i}")
    if massless_wheels:
        for joint in (each for each in spec.joints if each.name.startswith("roller")):
            joint.damping = [0, 0, 0]  # of the rollers' bearings: explicit integration needs some inertia beside it
        for body in spec.bodies:
            if body.name.startswith(("wheel", "roller")):
                body.mass, body.inertia = 1e-9, [1e-12] * 3
    return spec.compile()


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
        return self.torque / TORQUE_CONSTANT


def run(
    model: mujoco.MjModel,
    seconds: float,
    voltage: float,
    start_speed: float = 0.0,
    load: float = 0.0,
    settings: MotorSettings | None = None,
) -> Run:
    """Drive motor 1 at a voltage, from a speed of its shaft, against a load torque on its shaft."""
    sheet = settings or MotorSettings()
    model.actuator_gainprm[:, 0] = sheet.resistance_ohm
    data = mujoco.MjData(model)
    motors = Motors([sheet], 4, 1 / 60)
    wheel = model.joint("wheel_1").dofadr[0]
    wheels = [model.joint(f"wheel_{i}").dofadr[0] for i in (1, 2, 3, 4)]
    data.qvel[wheel] = start_speed / GEAR
    data.qfrc_applied[wheel] = -load * GEAR
    terminals = np.array([[voltage, 0.0, 0.0, 0.0]])
    speed, torque, told = [], [], []
    for _ in range(round(seconds / model.opt.timestep)):
        speed.append(data.qvel[wheel] * GEAR)
        _, current, data.ctrl[:] = motors.drive(terminals, data.qvel[None, wheels])
        mujoco.mj_step(model, data)
        torque.append(data.actuator_force[0])
        told.append(current[0, 0])
    return Run(model.opt.timestep, np.array(speed), np.array(torque), np.full(len(speed), voltage), np.array(told))
