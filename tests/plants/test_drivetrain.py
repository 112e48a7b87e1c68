"""Losses between motor and carpet: efficiency under load, and motors without a battery."""

import mujoco
import numpy as np
import pytest
from benches.plant import (
    RADIUS_M,
    TANGENTS,
    WHEELED_PLANTS,
    PlantOf,
    constant,
    drive,
    noiseless,
    with_settings,
)

import omni_mj as om
from omni_mj.mjcf.robot_builder import build_robot_spec

FORWARD = (1.0, 0.0, 0.0)
STANDING = constant((0, 0, 0), 10, 2)
LOSSLESS = noiseless(
    wheels={"model": "two-rollers"},
    carpet={"rolling_resistance": 0.0},
    drivetrain={
        "roller_friction": 0.0,
        "gear_friction_nm": 0.0,
        "roller_damping_nm_s": 0.0,
        "creep_stiffness": 1000.0,
        "efficiency": 1.0,
    },
    motor={"dry_friction_fraction": 0.0, "no_load_current_a": 0.0},
)


@WHEELED_PLANTS
@pytest.mark.parametrize("efficiency", [0.5, 0.8])
def test_an_efficiency_reduces_forces_and_adds_to_those_of_brakes(
    efficiency: float, plant_of: PlantOf
) -> None:
    """Accelerations have the ratio eta while motors drive, and 2 - eta while they brake.

    2 % and 4 %: rollers are spun up, and carpet is compressed, in proportion to the speed, which is
    higher without losses.
    """
    lossy = LOSSLESS.replace(drivetrain={"efficiency": efficiency})
    plant = plant_of([LOSSLESS, lossy])
    currents = np.sign(TANGENTS[:, 0]) * np.ones((2, 1))
    plant.set_motor_currents(currents)
    drive(plant, STANDING)
    lossless_speed, lossy_speed = plant.twist()[:, 0]
    assert lossless_speed > 0.3
    assert lossy_speed / lossless_speed == pytest.approx(efficiency, rel=0.02)
    plant.set_motor_currents(-0.5 * currents)
    drive(plant, STANDING[:5])
    lossless_change, lossy_change = plant.twist()[:, 0] - [lossless_speed, lossy_speed]
    assert lossy_change / lossless_change == pytest.approx(2 - efficiency, rel=0.04)


@WHEELED_PLANTS
def test_cruising_needs_more_current_the_lower_the_efficiency(plant_of: PlantOf) -> None:
    """The force of the motors is that of rolling resistance over the efficiency."""
    lossy = LOSSLESS.replace(drivetrain={"efficiency": 0.6}, carpet={"rolling_resistance": 0.1})
    plant = plant_of([lossy, lossy.replace(drivetrain={"efficiency": 1.0})])
    drive(plant, constant(FORWARD, 60, 2))
    currents = np.zeros((2, 4))
    for command in constant(FORWARD, 20, 2):
        drive(plant, command[None])
        currents += plant.telemetry().current_mean / 20
    forces = currents @ TANGENTS[:, 0] * lossy.motor.wheel_back_emf_v_s / RADIUS_M
    assert forces[1] / forces[0] == pytest.approx(0.6, rel=0.02)


@pytest.mark.parametrize("plant", ["mujoco", "planar"])
def test_a_robot_coasts_when_its_battery_switches_off(plant: str) -> None:
    """Its deceleration is that of a robot whose motors carry no current, not that of brakes."""
    scenario = om.load_scenario(
        "sprint",
        plant=plant,
        physics={"backend": "numpy"},
        reference={"waypoints": [[0, 0], [3, 0]]},
        wheels={"model": "two-rollers"},
        battery={"resistance_ohm": 0.5, "cut_off_v": 14.2},
    )
    frames = om.run(scenario, ["comp-flc"], seeds=1).frames()
    voltage = frames["battery_voltage_v"].to_numpy()
    speed = np.hypot(*(np.gradient(frames[axis].to_numpy(), 1 / 60) for axis in ("x_m", "y_m")))
    off = np.flatnonzero(voltage <= 0)
    assert speed[off[0]] > 1.5
    coasting = speed[off[3] : off[3] + 30]
    currents = [frames[f"current_{i}_a"].to_numpy()[off[3:]] for i in range(1, 5)]
    np.testing.assert_allclose(currents, 0.0, atol=1e-9)
    # Roll-out drag, 4.4 N, over the mass with rotors; shorted motors brake with 6 m/s^2.
    assert 1.3 < (coasting[0] - coasting[-1]) * 60 / 29 < 2.2


def test_hubs_grow_with_the_wheel() -> None:
    """Discs of constant thickness: mass grows with the square, inertia with its square."""
    hubs = []
    for factor in (1.0, 1.2):
        settings = with_settings(wheels={"radius_m": RADIUS_M * factor, "rollers": 20})
        model = build_robot_spec(settings.mechanics).spec.compile()
        hub = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "wheel_1")
        hubs.append([model.body_mass[hub], model.body_inertia[hub].max()])
    np.testing.assert_allclose(np.divide(hubs[1], hubs[0]), [1.2**2, 1.2**4])
