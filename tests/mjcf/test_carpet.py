"""Laws of the whole robot on its carpet, driven through the plant with its sensors' noise off."""

import copy

import numpy as np
import pytest
from benches.plant import (
    FRAME_S,
    GRAVITY,
    MASS_KG,
    STIFF,
    TANGENTS,
    compute_loads,
    constant,
    drive,
    noiseless,
    read_sensors,
    receive_at_once,
)
from benches.plant import mujoco as plant_of
from benches.robot import CYCLES

from omni_mj.config.resolve import resolve_settings
from omni_mj.mjcf import world_builder

# A stiff wheel loop, so that the firmware does not hide the contact.
SHARP = {"firmware": STIFF}


def test_a_robot_that_stands_or_has_stopped_does_not_creep() -> None:
    """At the start, and after driving, at arbitrary angles of wheels and rollers."""
    twists = np.array([[0.0, 0.0, 0.0], [0.7, 0.2, 0.0], [-0.3, 0.6, 2.0], [0.0, 0.0, -4.0]])
    start = np.array([[0.3, -0.2, 0.7], *np.zeros((3, 3))])
    commands = np.concatenate([constant(twists, 30, 4), constant([0, 0, 0], 240, 4)])
    poses = drive(plant_of([noiseless()] * 4, start), commands)
    stood = poses[-1] - poses[-181]  # the last 3 s
    # A league's bound of 0.1 mm in 10 s, and as much at the rim of the robot for the heading.
    assert np.hypot(stood[:, 0], stood[:, 1]).max() < 0.3e-4
    assert np.abs(stood[:, 2]).max() * 0.08 < 0.3e-4
    assert np.abs(poses[-1, 0] - start[0]).max() < 1e-4, "nor does it jump when it settles"


def test_friction_wheel_angles_and_loads_limit_the_acceleration() -> None:
    """Each spinning wheel pulls along its rim with mu times its load, which acceleration shifts."""
    frictions, expected = (0.3, 0.6, 0.9), []
    for friction in frictions:
        for axis in (0, 1):
            pull = np.abs(TANGENTS[:, axis])
            a = friction * GRAVITY * pull.mean()
            for _ in range(50):
                load = compute_loads(a * (np.arange(2) == axis)) / MASS_KG
                a = friction * float(pull @ load)
            expected.append(a)
    free = {"roller_friction": 0.0, "roller_damping_nm_s": 0.0}
    settings = [
        noiseless(carpet={"friction": f, "rolling_resistance": 0.0}, drivetrain=free, **SHARP)
        for f in frictions
        for _ in range(2)
    ]
    commands = constant([[3.6, 0, 0], [0, 3.6, 0]] * 3, 16, 6)
    poses = drive(plant_of(settings), commands)
    # From the second frame, when the wheels spin, to where they still do.
    seconds = np.arange(2, 17) * FRAME_S
    fits = [2 * np.polyfit(seconds, poses[2:, i, i % 2], 2)[0] for i in range(6)]
    # 4 %: rims and rollers roll with the robot, which adds 1.5 % to its mass, and rollers that come
    # down are spun up.
    assert fits == pytest.approx(expected, rel=0.04)
    assert (fits < np.array(expected)).all()


@pytest.mark.parametrize("substeps", [1, 3])
def test_sensors_lag_by_a_cycle_at_any_time_step(substeps: int) -> None:
    plant = plant_of([noiseless(physics={"substeps": substeps})])
    true, measured = [], []
    for _ in range(6 * CYCLES):
        commanded = plant.telemetry()
        true.append([*commanded.wheel_angle[0], plant.twist()[0, 2]])
        plant.advance_cycles(1, receive_at_once(np.array([[0.5, 0.2, 3.0]])))
        measured.append(read_sensors(plant))
    # The gyro feels the chassis's own axis, which tilts by less than a milliradian.
    np.testing.assert_allclose(np.array(measured)[:, :4], np.array(true)[:, :4], rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.array(measured)[:, 4], np.array(true)[:, 4], rtol=0, atol=1e-3)
    assert np.abs(np.diff(true, axis=0)).max() > 1e-3


def test_plants_do_not_change_the_shared_world() -> None:
    original = copy.copy(world_builder.build_world(resolve_settings()).model)
    drive(
        plant_of([noiseless(carpet={"friction": 0.3}, physics={"substeps": 2})]),
        constant([1, 0, 0], 2, 1),
    )
    model = world_builder.build_world(resolve_settings()).model
    for name in (
        "actuator_ctrllimited",
        "pair_friction",
        "dof_damping",
        "dof_frictionloss",
        "actuator_gainprm",
    ):
        np.testing.assert_array_equal(getattr(model, name), getattr(original, name))
    assert model.opt.timestep == original.opt.timestep
