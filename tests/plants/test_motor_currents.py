"""Current setpoints of the drivers: zero for a roll-out, or any current."""

import numpy as np
import pytest
from benches.plant import WHEELED_PLANTS, PlantOf, constant, drive, noiseless

SETTINGS = noiseless(
    carpet={"rolling_resistance": 0.05},
    drivetrain={"roller_friction": 0.05},
)
FORWARD = (1.0, 0.0, 0.0)


@WHEELED_PLANTS
def test_a_robot_without_currents_rolls_out_while_the_other_brakes(plant_of: PlantOf) -> None:
    """Afterwards it applies commands again."""
    plant = plant_of([SETTINGS] * 2)
    drive(plant, constant(FORWARD, 40, 2))
    plant.set_motor_currents(np.array([[0.0] * 4, [np.nan] * 4]))
    drive(plant, constant((0, 0, 0), 3, 2))
    assert plant.telemetry().current_peak[1] > 1
    drive(plant, constant((0, 0, 0), 15, 2))
    rolling, braked = plant.twist()[:, 0]
    assert plant.telemetry().current_peak[0] < 1e-12  # rounding of duty times voltage
    assert rolling > 0.3
    assert abs(braked) < 0.05
    plant.set_motor_currents(np.full((2, 4), np.nan))
    drive(plant, constant((0, 0, 0), 18, 2))
    assert abs(plant.twist()[0, 0]) < 0.05


@WHEELED_PLANTS
def test_currents_are_held_as_far_as_the_battery_can_drive_them(plant_of: PlantOf) -> None:
    """The battery can drive 1 A, but not 100 A."""
    plant = plant_of([SETTINGS] * 2)
    directions = np.array([-1.0, -1.0, 1.0, 1.0])
    plant.set_motor_currents(np.array([1.0 * directions, 100.0 * directions]))
    drive(plant, constant(FORWARD, 6, 2))
    np.testing.assert_allclose(plant.telemetry().current_mean[0], directions, rtol=1e-12)
    assert plant.telemetry().duty_peak[1] == pytest.approx(1)
    assert plant.telemetry().current_peak[1] < 100
