"""Wheels on the carpet: rolling, traction and rest against rigid-body kinematics, Newton's and Coulomb's laws."""

from dataclasses import dataclass

import numpy as np
import pytest
from benches.plant import ARM_M, FRAME_S, RADIUS_M, TANGENTS, constant, drive, quiet
from benches.plant import mujoco as plant_of
from numpy.typing import NDArray

from omni_control.kinematics import world_to_body
from omni_mj.scenarios.settings import Settings
from omni_mj.worlds import build

# No drag, so that at a constant speed there is nothing to creep for but wheels that pull against each other, as they do
# where they droop differently; and rubber that hardly creeps for that.
FREE = {
    "carpet": {"pile": 0.0},
    "drive": {"roller_friction": 0.0, "roller_damping_nm_s": 0.0, "gear_friction_nm": 0.02, "creep_stiffness": 1e3},
}
EIGHT_DIRECTIONS = np.radians(np.arange(0, 360, 45))
SPEED = 0.5
# Eight translations, and both turns at the same rim speed.
TWISTS = np.concatenate(
    [
        np.stack([SPEED * np.cos(EIGHT_DIRECTIONS), SPEED * np.sin(EIGHT_DIRECTIONS), np.zeros(8)], axis=1),
        [[0, 0, SPEED / ARM_M], [0, 0, -SPEED / ARM_M]],
    ]
)


@dataclass
class Cruise:
    """Mean body twists and wheel speeds of robots that have reached their speed."""

    twist: NDArray  # (n, 3)
    wheels: NDArray  # (n, 4) rad/s
    friction: float  # dry, of motor and gear, at a wheel, N m


@pytest.fixture(scope="module")
def cruise() -> Cruise:
    n, frames = len(TWISTS), 45
    plant = plant_of([quiet(**FREE)] * n)
    drive(plant, constant(TWISTS, 30, n))
    wheel_angle = plant.telemetry().wheel_angle
    poses = drive(plant, constant(TWISTS, frames, n))
    steps, headings = np.diff(poses, axis=0), (poses[1:, :, 2] + poses[:-1, :, 2]) / 2
    seconds = frames * FRAME_S
    travelled = world_to_body(steps, headings).sum(0)
    hub = plant._world.robots[0].wheel_dofs[0]
    friction = float(plant._batch.expand("dof_frictionloss")[0, hub])
    return Cruise(travelled / seconds, (plant.telemetry().wheel_angle - wheel_angle) / seconds, friction)


def test_body_twist_is_that_of_the_measured_wheel_speeds(cruise: Cruise) -> None:
    kinematics = build.world().kinematics
    to_rim = np.array([1, 1, ARM_M])  # turns weigh as the speed of the rim
    error = (kinematics.body_twist(cruise.wheels) - cruise.twist) * to_rim
    # The wheels sink into the soft carpet, and MuJoCo's contact point lies halfway: an effective radius 0.2 % below the
    # nominal one. The rest of the 0.3 % is polygons of rollers.
    assert (np.linalg.norm(error, axis=1) <= 0.003 * np.linalg.norm(cruise.twist * to_rim, axis=1)).all()


def test_each_wheel_rolls_without_slip(cruise: Cruise) -> None:
    # Rigid body: the velocity at wheel i is v + w x p_i, and its part along the tangent is the rim's speed. Stronger
    # than the least squares of equation 3, which would average opposite slips away.
    along = cruise.twist[:, :2] @ TANGENTS.T + ARM_M * cruise.twist[:, 2:]
    fastest = np.abs(along).max(axis=1, keepdims=True)
    # 0.3 % of the fastest wheel: as above.
    assert (np.abs(RADIUS_M * cruise.wheels - along) <= 0.003 * fastest).all()


def test_the_wheel_loop_droops_under_dry_friction(cruise: Cruise) -> None:
    # At a constant speed each motor's current overcomes the dry friction of motor and gear, and the voltage its drop:
    # (K gear + k_p) (wanted - w) = (R + X gear |w|) I. In a turn all wheels lag by that, and the turn-rate loop, g = 1,
    # halves it; driving forward, the lag is that of the mean of the pulls, weighted by the tangents.
    motor = Settings().motor
    constant, along = motor.constant_nm_a * motor.gear, np.abs(TANGENTS[:, 0])

    def lag(rims: NDArray) -> NDArray:
        resistance = motor.resistance_ohm + motor.commutation_ohm_s * motor.gear * rims / RADIUS_M
        return resistance * cruise.friction / constant / (constant + 0.3) * RADIUS_M

    # 2 %: effective radius, rolling losses and the battery's sag, which are not in this balance.
    forward = SPEED - (lag(SPEED * along) * along).sum() / (along**2).sum()
    np.testing.assert_allclose(cruise.twist[[0, 4], 0], [forward, -forward], rtol=0.02)
    turn = (SPEED - float(lag(np.array(SPEED))) / 2) / ARM_M
    np.testing.assert_allclose(cruise.twist[[8, 9], 2], [turn, -turn], rtol=0.02)
