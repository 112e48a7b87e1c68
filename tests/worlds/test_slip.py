"""Wheels without creep: contacts that slide, and the speed at which they do."""

import numpy as np
from benches.plant import FRAME_S, RADIUS_M, TANGENTS, constant, drive, quiet
from benches.plant import mujoco as plant_of

from omni_mj.worlds import build

OLD = quiet(wheels={"creep": "off"})
WORLD = build.world(OLD)
ROBOT = WORLD.robots[0]


def test_the_plant_reports_slip_where_there_is_some() -> None:
    # Told to be at 2 m/s at once on ice: for a tenth of a second the wheels spin at about that speed under a robot that
    # hardly moves. On carpet at rest, nothing slides.
    plant = plant_of([OLD.replace(carpet={"friction": 0.02}), OLD])
    drive(plant, constant([[2.0, 0.0, 0.0], [0.0, 0.0, 0.0]], 12, 2))
    telemetry = plant.telemetry()
    rims = np.abs(telemetry.wheel_speed[0]) * RADIUS_M
    hub = np.abs(TANGENTS[:, 0]) * plant.pose()[0, 0] / (12 * FRAME_S) * 2
    # 10 %: the robot's speed is taken as twice its mean, and rollers spin a little.
    np.testing.assert_allclose(telemetry.slip[0], rims - hub, rtol=0.1)
    assert telemetry.slip[0].min() > 1.0
    assert telemetry.slip[1].max() < 1e-3


def test_wheels_without_creep_are_those_of_a_contact_that_slides() -> None:
    """Rims that are part of their hubs, contacts with the carpet's own friction, which limits it."""
    model = WORLD.model
    assert (model.nv, ROBOT.slip_dofs.size, model.opt.impratio) == (74, 0, 10.0)
    np.testing.assert_array_equal(model.pair_solreffriction[:, :2], [[0.0035, 1.0]] * 64)
    plant = plant_of([OLD.replace(carpet={"friction": 0.3})])
    np.testing.assert_array_equal(plant._batch.expand("pair_friction")[0, :, :2], 0.3)
    poses = drive(plant, constant([3.0, 0.0, 0.0], 20, 1))
    bound = 0.5 * 0.3 * 9.81 * (20 * FRAME_S) ** 2
    assert 0.2 * bound < poses[-1, 0, 0] < bound  # drag takes a third of it, and wheels pull aside
