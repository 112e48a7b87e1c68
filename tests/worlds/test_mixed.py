"""Robots of several shapes in one world: each has the numbers that it has alone."""

import mujoco
import numpy as np
import pytest

import omni_mj as om
from omni_mj.worlds import build

NAMES = "tigers-v2020", "tigers-v2016", "tigers-v2020", "robojackets"


@pytest.mark.parametrize("wheels", ["rollers", "two-rollers"])
def test_each_robot_is_the_one_alone(wheels: str) -> None:
    each = [om.robot(name).settings.replace(wheels={"model": wheels}) for name in NAMES]
    worlds, alone = build.mixed(each), [build.world(settings) for settings in each]
    model = worlds[0].model
    assert [len(world.robots) for world in worlds] == [2, 1, 1]
    assert all(world.model is model and world.standing is worlds[0].standing for world in worlds)
    found = [worlds[0].robots[0], worlds[1].robots[0], worlds[0].robots[1], worlds[2].robots[0]]
    assert [model.body(robot.chassis).name for robot in found] == [f"robot_{i}/chassis" for i in (1, 2, 3, 4)]
    kinds = worlds[0], worlds[1], worlds[0], worlds[2]
    for robot, world, kind, settings in zip(found, alone, kinds, each, strict=True):
        own = world.robots[0]
        assert model.body_subtreemass[robot.chassis] == pytest.approx(settings.body.mass_kg)
        for name in ("dof_armature", "dof_damping", "dof_frictionloss", "dof_solref", "dof_solimp"):
            dofs = getattr(model, name)[robot.dofs], getattr(world.model, name)[own.dofs]
            np.testing.assert_array_equal(*dofs, err_msg=name)
        motors = model.actuator_gear[robot.motors], world.model.actuator_gear[own.motors]
        np.testing.assert_array_equal(*motors)
        np.testing.assert_array_equal(worlds[0].standing[robot.qpos], world.standing[own.qpos])
        np.testing.assert_array_equal(kind.kinematics.matrix, world.kinematics.matrix)
        pairs, theirs = (
            np.flatnonzero(one.body_rootid[one.geom_bodyid[one.pair_geom2]] == whose.chassis)
            for one, whose in ((model, robot), (world.model, own))
        )
        assert pairs.size
        for name in ("pair_solref", "pair_solreffriction", "pair_solimp", "pair_friction"):
            np.testing.assert_array_equal(getattr(model, name)[pairs], getattr(world.model, name)[theirs])


def test_loads_are_of_their_own_wheels() -> None:
    """Standing apart, each robot's wheels carry its weight, of 2.46, 2.65 and 2.2 kg: with all its rollers."""
    each = [om.robot(name).settings for name in NAMES]
    worlds = build.mixed(each)
    data = mujoco.MjData(worlds[0].model)
    data.qpos = worlds[0].standing
    for place, robot in enumerate(robot for world in worlds for robot in world.robots):
        data.qpos[robot.qpos[1]] = 0.5 * place
    mujoco.mj_step(worlds[0].model, data, nstep=200)
    for world in worlds:
        for robot, loads in zip(world.robots, world.loads, strict=True):
            weight = world.model.body_subtreemass[robot.chassis] * 9.81
            assert data.sensordata[loads].sum() == pytest.approx(weight, rel=1e-3)


def test_a_hull_reaches_as_far_as_its_cylinder() -> None:
    assert build.world().reach == 0.09  # models/ssl_robot.xml
