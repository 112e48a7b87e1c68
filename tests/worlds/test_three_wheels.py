"""A robot of another number of wheels, written from models/ssl_robot.xml: it drives as its own kinematics say."""

import re

import numpy as np
import pytest
from driving import FRAME_S, drive, mujoco, quiet, ramp

from omni_control.kinematics import world_to_body
from omni_mj.scenarios import models
from omni_mj.worlds import build

AZIMUTHS_DEG = (60, 180, 300)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Three wheels, 120 degrees apart, of 18 rollers each: the third and fourth wheel's places change, and one goes."""
    text = models.model_path("ssl_robot").read_text()
    text = re.sub(r'      <frame euler="0 0 300">.*?</frame>\n', "", text, flags=re.DOTALL)
    text = re.sub(r"<(dcmotor|jointpos) name=\"\w+_4\"[^>]*>", "", text)
    text = text.replace('euler="0 0 135"', 'euler="0 0 180"').replace('euler="0 0 225"', 'euler="0 0 300"')
    text = text.replace('count="16" euler="22.5 0 0"', 'count="18" euler="20 0 0"')
    file = tmp_path_factory.mktemp("robots") / "three.xml"
    file.write_text(text)
    return str(file)


def test_its_geometry_is_measured(robot: str) -> None:
    world = build.world(robot)
    np.testing.assert_allclose(np.degrees(world.kinematics.azimuths), AZIMUTHS_DEG)
    assert world.robots[0].rollers.shape == (3, 18)
    assert (world.model.npair, world.model.nu) == (3 * 18, 3)


@pytest.mark.parametrize("wheels", ["rollers", "contact-roller"])
def test_it_drives_where_its_kinematics_say(robot: str, wheels: str) -> None:
    """Forward, sideways and turning: the body's twist is that of wheels that roll, within 1 %, and as commanded."""
    chosen = quiet(firmware={"kp": 1.0, "ki": 20.0, "turn_gain": 0.0}, wheels={"model": wheels})
    twists = np.array([[0.5, 0, 0], [0, 0.5, 0], [0, 0, 6.0]])
    plant = mujoco([chosen] * 3, robot=robot)
    commands = ramp(twists, [2.0, 2.0, 24.0], 75)
    drive(plant, commands[:45])
    before, angle = plant.pose(), plant.telemetry().wheel_angle
    poses = drive(plant, commands[45:])
    telemetry = plant.telemetry()
    assert telemetry.wheel_angle.shape == telemetry.slip.shape == (3, 3)
    seconds = 30 * FRAME_S
    measured = world_to_body(np.diff(poses, axis=0), (poses[1:, :, 2] + poses[:-1, :, 2]) / 2).sum(0) / seconds
    assert plant.geometry is not None
    rolled = plant.geometry.body_twist((telemetry.wheel_angle - angle) / seconds)
    size = np.linalg.norm(twists, axis=1)
    along = twists / size[:, None]
    assert (np.abs((measured - rolled) * along).sum(1) < 0.01 * size).all()
    # The stiff wheel loop lets the wheels do as told: 2 % for the effective radius and what is left of the ramp.
    assert (np.abs((measured - twists) * along).sum(1) < 0.02 * size).all()
    assert np.abs(poses[-1] - before)[[0, 1], [1, 0]].max() < 0.02  # nor does it drift aside


def test_its_motors_and_battery_have_three_wheels_each(robot: str) -> None:
    plant = mujoco([quiet()] * 2, [[0, 0, 0], [0, 1, 0]], robot=robot, places=2)
    drive(plant, ramp([[0.5, 0, 0], [0, 0.5, 0]], 2.0, 5))
    for name, values in vars(plant.telemetry()).items():
        assert values.shape in ((2,), (2, 3)), name
        assert np.isfinite(values).all(), name
