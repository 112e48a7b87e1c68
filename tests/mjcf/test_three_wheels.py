"""A robot of another number of wheels: it drives as its own kinematics say."""

import numpy as np
import pytest
from benches.plant import FRAME_S, STIFF, drive, mujoco, noiseless, ramp

from omni_control.kinematics import world_to_body
from omni_mj.mjcf import world_builder
from omni_mj.plants.telemetry import TELEMETRY_NAMES

AZIMUTHS_DEG = (60, 180, 300)
THREE = {"azimuths_deg": AZIMUTHS_DEG, "rollers": 18}


def test_its_geometry_is_that_of_its_settings() -> None:
    world = world_builder.build_world(noiseless(wheels=THREE))
    np.testing.assert_allclose(np.degrees(world.kinematics.azimuths), AZIMUTHS_DEG)
    assert world.robots[0].rollers.shape == (3, 18)
    assert (world.model.npair, world.model.nu) == (3 * 18, 3)


@pytest.mark.parametrize("wheels", ["rollers", "two-rollers"])
def test_it_moves_as_its_kinematics_predict(wheels: str) -> None:
    """Forward, sideways and turning: the body twist is that of creeping wheels, as commanded."""
    # A carpet and rollers without drag, so that at a constant speed there is nothing to creep for.
    free = {"carpet": {"rolling_resistance": 0.0}, "drivetrain": {"roller_friction": 0.0}}
    chosen = noiseless(firmware=STIFF, wheels=THREE | {"model": wheels}, **free)
    twists = np.array([[0.5, 0, 0], [0, 0.5, 0], [0, 0, 6.0]])
    plant = mujoco([chosen] * 3)
    commands = ramp(twists, [2.0, 2.0, 24.0], 75)
    drive(plant, commands[:45])
    initial, angle = plant.pose(), plant.telemetry().wheel_angle
    poses = drive(plant, commands[45:])
    telemetry = plant.telemetry()
    assert telemetry.wheel_angle.shape == telemetry.slip.shape == (3, 3)
    seconds = 30 * FRAME_S
    measured = (
        world_to_body(np.diff(poses, axis=0), (poses[1:, :, 2] + poses[:-1, :, 2]) / 2).sum(0)
        / seconds
    )
    assert plant.geometry is not None
    rolled = plant.geometry.body_twist((telemetry.wheel_angle - angle) / seconds)
    size = np.linalg.norm(twists, axis=1)
    axle = twists / size[:, None]
    assert (np.abs((measured - rolled) * axle).sum(1) < 0.01 * size).all()
    # The stiff wheel loop lets the wheels do as told: 2 % for the effective radius and what is left
    # of the ramp.
    assert (np.abs((measured - twists) * axle).sum(1) < 0.02 * size).all()
    assert np.abs(poses[-1] - initial)[[0, 1], [1, 0]].max() < 0.02  # nor does it drift aside


def test_its_motors_and_battery_have_three_wheels_each() -> None:
    plant = mujoco([noiseless(wheels=THREE)] * 2, [[0, 0, 0], [0, 1, 0]], per_world=2)
    drive(plant, ramp([[0.5, 0, 0], [0, 0.5, 0]], 2.0, 5))
    for name in TELEMETRY_NAMES:
        values = getattr(plant.telemetry(), name)
        assert values.shape in ((2,), (2, 3)), name
        assert np.isfinite(values).all(), name
