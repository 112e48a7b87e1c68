"""Drag of a rolling robot: carpet, roller bearings, gears and motors, each by its own law."""

import numpy as np
import pytest
from benches.plant import (
    MASS_KG,
    OUTWARD,
    RADIUS_M,
    TANGENTS,
    compute_loads,
    mujoco,
    noiseless,
)
from benches.robot import DEFAULT_MOTOR
from benches.step_recorder import StepRecorder
from numpy.typing import NDArray

from omni_mj.config.resolve import resolve_settings
from omni_mj.config.settings import Settings

HUB_INERTIA = 9e-6 + 1e-6 + 16 * (0.0015 * 0.0225**2 + 6e-8)  # models/ssl_robot.xml; hub and rim
DIRECTIONS = np.array([[1.0, 0.0], [0.0, 1.0], [0.7071, 0.7071], [-1.0, 0.0]])
# As the sections of settings, each alone and all together.
DRAGS = {
    "rolling_resistance": (0.1, 0.0, 0.0, 0.0),
    "bearings": (0.0, 0.06, 0.0, 0.0),
    "gears": (0.0, 0.0, 0.02, 0.0),
    "motors": (0.0, 0.0, 0.0, 1.0),
    "all": (0.08, 0.04, 0.01, 1.0),
    "twice the mass": (0.1, 0.05, 0.0, 0.0),
}
HEAVY = {"mass_kg": 5.3, "tilt_inertia_kg_m2": 0.0075}

AFTER = 96  # steps, in which the start is forgotten


def settings(
    pile: float, bearing: float, gear: float, motor: float, **sections: dict[str, float]
) -> Settings:
    """Return settings with these frictions; that of the motor is relative to nominal."""
    no_load = {"no_load_current_a": motor * resolve_settings().motor.no_load_current_a}
    drive = {"roller_friction": bearing, "gear_friction_nm": gear, "roller_damping_nm_s": 0.0}
    return noiseless(
        carpet={"rolling_resistance": pile}, drivetrain=drive, motor=no_load, **sections
    )


def rolled_out(chosen: list[Settings], speed: float = 1.2, frames: int = 18) -> StepRecorder:
    """Return robots that roll at a speed, one per direction and setting, without motor current."""
    directions = np.tile(DIRECTIONS, (len(chosen), 1))
    plant = mujoco([settings_i for settings_i in chosen for _ in DIRECTIONS])
    world, velocity = plant._world, plant._batch.bind("qvel")
    velocity[:, :2] = speed * directions
    velocity[:, world.robots[0].wheel_dofs] = speed * directions @ TANGENTS.T / RADIUS_M
    plant.set_motor_currents(np.zeros((len(directions), len(TANGENTS))))
    return StepRecorder(plant).drive(np.zeros((frames, len(directions), 3)))


def expected(chosen: Settings, motor: float, row: int, tape: StepRecorder) -> float:
    """Return the deceleration, m/s^2, by d'Alembert: drag of wheels, inertia of hubs and rotors.

    The friction of the motors is relative to nominal.
    """
    direction = DIRECTIONS[row]
    rim_share, axial_share = np.abs(TANGENTS @ direction), np.abs(OUTWARD @ direction)
    # The motor's viscous friction falls with the speed, and a fitted slope is that of the mean.
    mean = np.linalg.norm(tape.twist()[AFTER:, row, :2], axis=1).mean()
    friction = (
        motor * DEFAULT_MOTOR.friction(mean * rim_share / RADIUS_M)
        + chosen.drivetrain.gear_friction_nm
    )
    mass = chosen.body.mass_kg
    inertia = HUB_INERTIA + chosen.motor.rotor_inertia_kg_m2 * chosen.motor.gear_ratio**2
    drag = chosen.carpet.rolling_resistance + chosen.drivetrain.roller_friction * axial_share
    deceleration = 0.0
    for _ in range(5):
        load = mass / MASS_KG * compute_loads(-deceleration * direction)
        force = drag * load + friction * rim_share / RADIUS_M
        deceleration = force.sum() / (mass + (inertia * rim_share**2).sum() / RADIUS_M**2)
    return float(deceleration)


def decelerations(tape: StepRecorder) -> NDArray:
    """Return the deceleration of each row along its direction, m/s^2, after a transient."""
    speed = (
        tape.twist()[AFTER:, :, :2] * np.tile(DIRECTIONS, (tape.twist().shape[1] // 4, 1))
    ).sum(-1)
    return np.asarray(-np.polyfit(np.arange(len(speed)) / 960, speed, 1)[0])


@pytest.fixture(scope="module")
def rolling() -> NDArray:
    """Return the deceleration by rollers on a soft carpet without drag, per direction, m/s^2."""
    return decelerations(rolled_out([settings(0.0, 0.0, 0.0, 0.0)]))


@pytest.mark.parametrize("name", DRAGS)
def test_coasting_follows_the_drag_coefficients(name: str, rolling: NDArray) -> None:
    body = HEAVY if name == "twice the mass" else {}
    chosen, motor = settings(*DRAGS[name], body=body), DRAGS[name][3]
    tape = rolled_out([chosen])
    law = [expected(chosen, motor, row, tape) for row in range(len(DIRECTIONS))]
    # 1.5 %: rims slip; 0.01 m/s^2: rollers that come down take less if the robot brakes.
    assert decelerations(tape) - rolling == pytest.approx(law, rel=0.015, abs=0.01)


def test_the_default_robot_rolls_out_as_published(rolling: NDArray) -> None:
    """TIGERs publish 4.44 N for their v2016, from moves at 0.5 to 1.5 m/s, of 1.06 on average.

    They measured forward only. Sideways the bearings of rollers brake more, and the law predicts
    4.8 N; diagonally motors and gears brake less, 3.9 N.
    """
    robot = noiseless()
    tape = rolled_out([robot], speed=1.06, frames=30)
    forward, _, _, backward = decelerations(tape) * robot.body.mass_kg
    # 10 %: mass times deceleration, or with what turns in it.
    assert [forward, backward] == pytest.approx([4.44, 4.44], rel=0.1)
    law = [expected(robot, 1.0, row, tape) for row in range(len(DIRECTIONS))]
    # As above, plus the rollers' viscous friction.
    assert decelerations(tape) - rolling == pytest.approx(law, rel=0.02, abs=0.02)
