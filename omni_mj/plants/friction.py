"""Dry and viscous friction of each robot's wheels, rollers and gears, in its world's copy of the model's fields."""

from collections.abc import Sequence

import numpy as np
from mujoco.batch import Batch

from omni_mj.onboard.motor import Motor
from omni_mj.onboard.traction import Traction
from omni_mj.plants.variation import Drawn
from omni_mj.scenarios.settings import Settings, column
from omni_mj.worlds.build import World
from omni_mj.worlds.columns import Columns


def set_up(batch: Batch, world: World, settings: Sequence[Settings], drawn: Drawn, creeps: bool) -> Traction:
    """Write it into a batch's worlds.

    Args:
        batch: of the robots' worlds.
        world: as built.
        settings: of each robot.
        drawn: what their seeds drew for them.
        creeps: whether the carpet's friction is slip hinges' rather than contacts'.

    Returns:
        What carpet and creep do to the robots from step to step.
    """
    drive, robots, n = [s.drive for s in settings], world.robots, len(settings)
    if not creeps:
        pairs, friction = batch.expand("pair_friction"), column([s.carpet for s in settings], "friction")
        for direction in range(2):
            Columns(pairs[:, :, direction], world.pairs).set(friction)
    motors, hubs = [Motor.of(s.motor) for s in settings], np.array([robot.wheel_dofs for robot in robots])
    dry, damping = batch.expand("dof_frictionloss"), batch.expand("dof_damping")
    Columns(dry, hubs).set(column(motors, "wheel_dry") + column(drive, "gear_friction_nm"))
    Columns(damping, hubs).set(column(motors, "wheel_viscous"))
    rollers = np.array([robot.roller_dofs.ravel() for robot in robots])
    Columns(damping, rollers).set(column(drive, "roller_damping_nm_s"))
    centre = world.model.body_ipos[robots[0].chassis] + np.column_stack([drawn.centre, np.zeros(n)])
    inertia = world.model.dof_invweight0[robots[0].slip_dofs] if creeps else np.ones(1)
    timestep = world.model.opt.timestep
    return Traction(settings, world.kinematics, centre, inertia, timestep, drawn.friction, drawn.wear)
