"""Electrical energy in is heat, friction and motion out."""

import copy
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np
import pytest
from driving import COMMUTATION, DRY, FRAME_S, GEAR, LINT, VISCOUS, hinge_friction, quiet
from driving import mujoco as plant_of
from mujoco.batch import Batch
from numpy.typing import NDArray

from omni_mj.link.radio import Received
from omni_mj.worlds import build

GRAVITY = 9.81


class Tape:
    """Stands between a plant and its batch of one, and keeps each step's state and controls."""

    def __init__(self, batch: Batch) -> None:
        self._batch = batch
        self._live = [batch.bind(name) for name in ("qpos", "qvel", "ctrl")]
        self.steps: list[list[NDArray]] = []

    def step(self, worlds: None) -> None:
        self.steps.append([live[0].copy() for live in self._live])
        self._batch.step(worlds)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._batch, name)


def contact_power(model: mujoco.MjModel, data: mujoco.MjData, velocity: NDArray) -> tuple[float, float]:
    """Power of the contacts' forces against sliding and sinking, from the bodies' velocities, W."""
    sliding = sinking = 0.0
    for index in range(data.ncon):
        force = np.zeros(6)
        mujoco.mj_contactForce(model, data, index, force)
        contact = data.contact[index]
        (roller,) = (g for g in contact.geom if model.geom(g).name != "carpet")
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, jacobian, None, contact.pos[:, None], model.geom_bodyid[roller])
        normal, *tangents = contact.frame.reshape(3, 3) @ jacobian @ velocity
        # The frame's normal points from the first geom to the second, the force acts on the second.
        sign = 1 if contact.geom[1] == roller else -1
        sinking += sign * force[0] * normal
        sliding += sign * force[1:3] @ tangents
    return -sliding, -sinking


# Euler at 1/960 s makes 2 % of energy (the torque of a step works on a speed that it has changed); that falls with the
# step, which shows that nothing else is missing.
@pytest.mark.parametrize(("substeps", "tolerance"), [(1, 0.03), (4, 0.015)])
def test_energy_audit_of_a_driven_robot(substeps: int, tolerance: float) -> None:
    frames = 75
    plant = plant_of([quiet(physics={"substeps": substeps})])
    plant._batch = tape = Tape(plant._batch)  # the plant hands out one instant a frame, the audit needs every step
    electrical, reported = 0.0, []
    for frame in range(frames):
        # Speeding up forward, curving away, braking hard, then backwards and turning: the end is in full motion.
        time = frame * FRAME_S
        twist = [1.8 * np.sin(4.5 * time), 0.8 * np.sin(3.0 * time), 4.0 * np.sin(6.0 * time)]
        plant.advance(Received.at_once(np.array([twist]), plant.pose()[:, 2]))
        electrical += (plant._voltages * plant.currents).sum() / 960
        reported.append(plant.telemetry())
        np.testing.assert_array_equal(plant.currents[-1], reported[-1].current)
    world = build.world(substeps=substeps)
    model = copy.copy(world.model)
    model.actuator_ctrllimited[:] = 0
    data, wheels = mujoco.MjData(model), world.robots[0].wheel_dofs
    bearing = model.dof_damping.copy()  # of the rollers
    model.dof_frictionloss[wheels], model.dof_damping[wheels] = DRY + 0.003 + LINT, VISCOUS
    timestep = model.opt.timestep
    heat, hinges, bearings, sliding, sinking = np.zeros(5)
    kinetic = []
    weight = 2.3 * GRAVITY
    for (qpos, qvel, ctrl), (_, after, _) in pairwise(tape.steps):
        data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, ctrl
        mujoco.mj_forward(model, data)
        mujoco.mj_energyVel(model, data)
        kinetic.append(data.energy[1])
        # Over a step forces are constant and do work on the mean velocity.
        mean = (qvel + after) / 2
        current = data.actuator_force / 0.036
        heat += (current**2 * (0.942 + COMMUTATION * GEAR * np.abs(qvel[wheels]))).sum() * timestep
        hinges += (hinge_friction(mean[wheels]) * np.abs(mean[wheels])).sum() * timestep
        bearings += (bearing * mean**2).sum() * timestep
        slid, sunk = contact_power(model, data, mean)
        sliding, sinking = sliding + slid * timestep, sinking + sunk * timestep
    lifted = weight * (tape.steps[-1][0][2] - tape.steps[0][0][2])
    gained = kinetic[-1] - kinetic[0]
    spent = heat + hinges + bearings + sliding + sinking + lifted + gained
    # Each of the large terms matters, so that none hides another's error.
    assert min(heat, hinges, gained) > 0.05 * electrical
    assert sliding > 0
    assert spent == pytest.approx(electrical, rel=tolerance)
    # Shares of contact damping and lift are those of a robot that shakes a little, not a store of energy.
    assert abs(sinking + lifted) < 0.03 * electrical
