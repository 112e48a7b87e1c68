"""Electrical energy in is heat, friction and motion out, step by step."""

from typing import Any

import mujoco as mj
import numpy as np
import pytest
from benches.plant import FRAME_S, GRAVITY, MASS_KG, mujoco, noiseless, receive_at_once
from mujoco.batch import Batch
from numpy.typing import NDArray

from omni_mj.plants.mujoco_plant import MujocoPlant

STATE = ("qpos", "qvel", "ctrl", "xfrc_applied")
FIELDS = ("dof_frictionloss", "dof_solimp", "dof_damping", "actuator_gainprm")


class Recorder:
    """Wrapper of a batch that records inputs and results of MuJoCo in each step."""

    def __init__(self, batch: Batch) -> None:
        self._batch = batch
        self._live = {name: batch.bind(name) for name in STATE} | {
            name: batch.expand(name) for name in FIELDS
        }
        self.steps: list[dict[str, NDArray]] = []

    def step(self, worlds: None) -> None:
        inputs = {name: live[0].copy() for name, live in self._live.items()}
        self._batch.step(worlds)
        self.steps.append(inputs | {"after": self._live["qvel"][0].copy()})

    def __getattr__(self, name: str) -> Any:
        return getattr(self._batch, name)


def contact_power(model: mj.MjModel, data: mj.MjData, velocity: NDArray) -> float:
    """Return the power that contact forces take from a robot, W; or a displacement's work, J."""
    power = 0.0
    for index in range(data.ncon):
        force = np.zeros(6)
        mj.mj_contactForce(model, data, index, force)
        contact = data.contact[index]
        (roller,) = (g for g in contact.geom if model.geom(g).name != "carpet")
        jacobian = np.zeros((3, model.nv))
        mj.mj_jac(model, data, jacobian, None, contact.pos[:, None], model.geom_bodyid[roller])
        # The frame's normal points from the first geom to the second, the force acts on the second.
        sign = 1 if contact.geom[1] == roller else -1
        power -= sign * force[:3] @ (contact.frame.reshape(3, 3) @ jacobian @ velocity)
    return power


class Audit:
    """Balance of the motors' work, J: summed over steps with constant forces and linear speeds."""

    def __init__(self, plant: MujocoPlant) -> None:
        self.model, self.robot = plant._batch.get_model(0), plant._world.robots[0]
        self.data = mj.MjData(self.model)
        self.work = self.slides = 0.0
        self.lost = dict.fromkeys(("hubs", "slips", "rollers", "drag", "contacts"), 0.0)
        self.kinetic: list[float] = []

    def add(self, now: dict[str, NDArray]) -> None:
        model, data, robot, lost = self.model, self.data, self.robot, self.lost
        hubs, slips, rollers = robot.wheel_dofs, robot.slip_dofs, robot.roller_dofs.ravel()
        for owner, names in ((data, STATE), (model, FIELDS)):
            for name in names:
                getattr(owner, name)[:] = now[name]
        mj.mj_forward(model, data)
        mj.mj_energyVel(model, data)
        self.kinetic.append(float(data.energy[1]))
        displacement = (now["qvel"] + now["after"]) / 2 * model.opt.timestep
        dry = np.zeros(model.nv)
        rows = np.flatnonzero(data.efc_type == mj.mjtConstraint.mjCNSTR_FRICTION_DOF)
        dry[data.efc_id[rows]] = data.efc_force[rows]
        self.work += data.qfrc_actuator[hubs] @ displacement[hubs]
        lost["hubs"] -= (dry[hubs] - model.dof_damping[hubs] * now["qvel"][hubs]) @ displacement[
            hubs
        ]
        lost["slips"] -= dry[slips] @ displacement[slips]
        lost["rollers"] += model.dof_damping[rollers] * now["qvel"][rollers] @ displacement[rollers]
        lost["contacts"] += contact_power(model, data, displacement)
        # The wrench acts on the chassis's centre of mass; free joints turn in their own frame.
        wrench, chassis = now["xfrc_applied"][robot.chassis], data.xmat[robot.chassis].reshape(3, 3)
        rotation, arm = (
            chassis @ displacement[3:6],
            data.xipos[robot.chassis] - data.xpos[robot.chassis],
        )
        lost["drag"] -= (
            wrench[:3] @ (displacement[:3] + np.cross(rotation, arm)) + wrench[3:] @ rotation
        )
        # By the law alone: a rim that slides does so against friction times load times radius.
        limit = model.dof_frictionloss[slips]
        self.slides += (limit * np.abs(displacement[slips]))[
            np.abs(dry[slips]) > 0.999 * limit
        ].sum()


# On a slippery carpet wheels slide most of the time.
@pytest.mark.parametrize(("friction", "substeps"), [(0.8, 1), (0.25, 1), (0.8, 2)])
def test_energy_audit_of_a_driven_robot(friction: float, substeps: int) -> None:
    plant = mujoco([noiseless(carpet={"friction": friction}, physics={"substeps": substeps})])
    plant._batch = tape = Recorder(plant._batch)  # type: ignore[assignment]
    currents = []
    for frame in range(60):
        # Speeding up forward, curving away, braking hard, then backwards and turning: the end is in
        # full motion.
        time = frame * FRAME_S
        twist = [1.8 * np.sin(4.5 * time), 0.8 * np.sin(3.0 * time), 4.0 * np.sin(6.0 * time)]
        assert plant.advance(receive_at_once(np.array([twist]), plant.pose()[:, 2])) == {}
        currents.append(plant._record.current[:, :, 0])
        if frame == 0:
            constant = (
                float(plant._views.torque_constant.get()[0, 0])
                * plant._world.model.actuator_gear[0, 0]
            )
    audit = Audit(plant)
    for now in tape.steps:
        audit.add(now)
    # Work is done by current times torque constant. 0.2 %: magnets warm by a kelvin, and a cycle's
    # current is that of its first step.
    torques = constant * np.repeat(np.concatenate(currents), substeps, axis=0)
    hubs = [(now["qvel"] + now["after"])[audit.robot.wheel_dofs] / 2 for now in tape.steps]
    assert audit.work == pytest.approx(
        (torques * hubs).sum() * plant._world.model.opt.timestep, rel=2e-3
    )
    energy_gain = audit.kinetic[-1] - audit.kinetic[0]
    lifted = MASS_KG * GRAVITY * (tape.steps[-1]["qpos"][2] - tape.steps[0]["qpos"][2])
    # 0.3 %: 0.1 % is what the last step and the drag's four cycles leave.
    assert sum(audit.lost.values()) + energy_gain + lifted == pytest.approx(audit.work, rel=0.003)
    # Each of the large terms matters, so that none hides another's error; contacts only shake a
    # little.
    assert (
        min(audit.lost["slips"], audit.lost["drag"], audit.lost["hubs"], energy_gain)
        > 0.03 * audit.work
    )
    assert 0 < audit.lost["contacts"] + lifted < 0.02 * audit.work
    assert audit.slides > 0.3 * audit.lost["slips"]
    if friction < 0.5:
        assert audit.slides == pytest.approx(audit.lost["slips"], rel=0.01), (
            "what does not slide hardly creeps"
        )
