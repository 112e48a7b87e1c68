"""Worlds of a field and n robots: indices of parts, and invalid robots."""

import mujoco
import numpy as np
import pytest
from benches.plant import with_settings

from omni_control.errors import OmniError
from omni_mj.config.resolve import resolve_settings
from omni_mj.config.robot_files import find_models_folder
from omni_mj.mjcf import world_builder


def test_rollers_reach_the_bottom_in_order() -> None:
    world = world_builder.build_world(resolve_settings())
    data = mujoco.MjData(world.model)
    robot = world.robots[0]
    for turn in range(16):
        data.qpos[robot.wheel_qpos] = turn * 2 * np.pi / 16
        mujoco.mj_kinematics(world.model, data)
        lowest = robot.rollers[np.arange(4), data.xpos[robot.rollers, 2].argmin(1)]
        assert lowest.tolist() == robot.rollers[:, turn].tolist()


def test_the_default_field_is_that_of_the_file() -> None:
    """To the bit; carpets of other sizes end at the walls."""
    file = mujoco.MjModel.from_xml_path(str(find_models_folder() / "field.xml"))
    default, other = (
        world_builder.build_world(with_settings(world=world)).model
        for world in ({}, {"field_length_m": 12.0, "field_margin_m": 0.0})
    )
    for geom in range(file.ngeom):
        name = file.geom(geom).name
        np.testing.assert_array_equal(default.geom(name).pos, file.geom(name).pos)
        np.testing.assert_array_equal(default.geom(name).size, file.geom(name).size)
    assert other.geom("carpet").size.tolist() == [6.0, 3.0, 0.1]
    walls = other.geom_pos[1:5, :2].tolist()
    assert walls == [[6, 0], [0, 3], [-6, 0], [0, -3]]


def test_impossible_robots_are_rejected_with_one_line() -> None:
    light = {"mass_kg": 0.5, "yaw_inertia_kg_m2": 2e-3, "tilt_inertia_kg_m2": 2e-3}
    for sections, message in (
        (
            {
                "body": light,
                "wheels": {"rollers": 40, "azimuths_deg": [0, 50, 100, 150, 200, 250, 300]},
            },
            "more than",
        ),
        ({"body": {"yaw_inertia_kg_m2": 1e-3}}, "principal inertias"),
    ):
        with pytest.raises(OmniError, match=message) as error:
            world_builder.build_world(with_settings(**sections))
        assert str(error.value).startswith("body.")
        assert "\n" not in str(error.value)


def test_mass_and_center_of_mass_are_those_of_the_settings() -> None:
    body = {
        "mass_kg": 3.1,
        "com_x_m": -0.005,
        "com_height_m": 0.05,
        "yaw_inertia_kg_m2": 0.016,
    }
    for wheels in ({}, {"model": "two-rollers"}, {"azimuths_deg": [60, 180, 300], "arm_m": 0.07}):
        world = world_builder.build_world(
            with_settings(body=body | {"tilt_inertia_kg_m2": 0.009}, wheels=wheels)
        )
        data = mujoco.MjData(world.model)
        mujoco.mj_forward(world.model, data)
        chassis = world.robots[0].chassis
        assert world.model.body_subtreemass[chassis] == pytest.approx(3.1)
        np.testing.assert_allclose(data.subtree_com[chassis], [-0.005, 0, 0.05], atol=1e-12)
        full = np.zeros((world.model.nv, world.model.nv))
        mujoco.mj_fullM(world.model, data, full)
        # About the robot's origin on the carpet, by the parallel axis theorem.
        expected = np.array([0.009, 0.009, 0.016]) + 3.1 * np.array(
            [0.05**2, 0.05**2 + 0.005**2, 0.005**2]
        )
        np.testing.assert_allclose(np.diag(full)[3:6], expected, rtol=1e-9)


def test_load_sensors_belong_to_their_wheels() -> None:
    """The wheels of each robot carry its weight."""
    world = world_builder.build_world(resolve_settings(), robots_per_world=3)
    data = mujoco.MjData(world.model)
    data.qpos = world.rest_qpos
    for slot, robot in enumerate(world.robots):
        data.qpos[robot.qpos[1]] = 0.5 * slot
    mujoco.mj_step(world.model, data, nstep=200)
    for robot, loads in zip(world.robots, world.load_addresses, strict=True):
        weight = world.model.body_subtreemass[robot.chassis] * 9.81
        assert data.sensordata[loads].sum() == pytest.approx(weight, rel=1e-3)


def test_hull_radius_is_that_of_the_cylinder() -> None:
    assert world_builder.build_world(resolve_settings()).hull_radius == 0.09  # models/ssl_robot.xml
