"""The physical robot as a point mass on carpet with a battery, and as a row of a batch."""

import math

import numpy as np
import pytest
from benches.plant import (
    ARM_M,
    FRAME_S,
    GRAVITY,
    MASS_KG,
    RADIUS_M,
    SIGMAS,
    constant,
    drive,
    noiseless,
    with_settings,
)
from benches.plant import mujoco as plant_of

from omni_mj.config.settings import Settings

STARTS = np.array(
    [[0, 0, 0], [1.5, -2, 1], [-3, 0.5, math.pi], [0, 0, -math.pi + 1e-3], [4, 3, 10], [0, 1, -7.0]]
)


def test_robots_start_where_they_are_told_with_any_heading() -> None:
    n = len(STARTS)
    plant = plant_of([noiseless()] * n, STARTS)
    np.testing.assert_array_equal(plant.pose(), STARTS)  # whole turns of the heading included
    drive(plant, constant([0.0, 0.0, 0.0], 1, n))
    # Settling into the carpet, not a jump: a tenth of vision's noise.
    np.testing.assert_allclose(plant.pose(), STARTS, atol=1.3e-4)


def test_motion_does_not_depend_on_place_or_heading() -> None:
    settle, frames, n = 10, 20, len(STARTS)
    plant = plant_of([noiseless()] * n, STARTS)
    # Rollers that just touch the carpet: which of them carry the very first step is a matter of
    # rounding. At rest that is forgotten.
    start = drive(plant, np.zeros((settle, n, 3)))[-1]
    c, s = np.cos(start[:, 2]), np.sin(start[:, 2])
    forward, left, turn = 0.6, 0.3, 2.0
    command = np.stack([c * forward - s * left, s * forward + c * left, np.full(n, turn)], axis=1)
    x, y, turned = (drive(plant, constant(command, frames, n))[-1] - start).T
    moved = np.stack([c * x + s * y, c * y - s * x, turned], axis=1)
    # The carpet is the same everywhere and in every direction. 0.05 mm and 0.05 mrad of 180 mm and
    # 0.5 rad: what is left of the settling and of the contact solver's tolerance.
    np.testing.assert_allclose(moved, np.tile(moved[0], (n, 1)), rtol=0, atol=5e-5)
    assert np.hypot(*moved[0, :2]) > 0.1


def test_heading_counts_full_turns() -> None:
    spin_up, start, turn_rate = 20, 3.0, 10.0
    plant, commands = (
        plant_of([noiseless()] * 2, [[0, 0, start]] * 2),
        [[0, 0, turn_rate], [0, 0, -turn_rate]],
    )
    heading = drive(plant, constant(commands, spin_up, 2))[..., 2]
    begun = plant.telemetry().wheel_angle.mean(1)
    heading = np.append(heading, drive(plant, constant(commands, 85, 2))[1:, :, 2], axis=0)
    # Continuous across the seam at pi: between frames at most what the command allows.
    assert np.abs(np.diff(heading, axis=0)).max() < 1.1 * turn_rate * FRAME_S
    # Wheels count their own turns: l heading = r angle, once they no longer slide, less what they
    # creep: the pile's drag is the share p of the load, which creeps by p / C of the travel. 0.5 %
    # for the effective radius and the rollers' viscous bearings.
    creep = Settings().carpet.rolling_resistance / Settings().drivetrain.creep_stiffness
    rolled = (plant.telemetry().wheel_angle.mean(1) - begun) * RADIUS_M / ARM_M / (1 + creep)
    np.testing.assert_allclose(heading[-1] - heading[spin_up], rolled, rtol=5e-3)
    assert np.abs(heading[-1] - start).min() > 4 * math.pi


def test_nothing_drives_faster_than_the_carpets_friction_allows() -> None:
    frames, directions = 30, np.array([[1.0, 0, 0], [0, 1.0, 0], [-0.7, 0.7, 0]])
    friction = np.repeat([0.02, 0.05, 0.1], 3)
    # Nothing but that friction: pile and bearings of the robot would take more than it gives.
    free = {"roller_friction": 0.0}
    plant = plant_of(
        [
            noiseless(carpet={"friction": mu, "rolling_resistance": 0.0}, drivetrain=free)
            for mu in friction
        ]
    )
    distance = np.linalg.norm(
        drive(plant, constant(np.tile(directions, (3, 1)), frames, 9))[-1, :, :2], axis=1
    )
    bound = 0.5 * friction * GRAVITY * (frames * FRAME_S) ** 2
    assert (distance <= bound).all()
    # The wheels' share of it is at least that of driving to the left, 0.586 (see test_wheels), less
    # what two of the wheels lose once they have caught up.
    assert (distance >= 0.5 * bound).all()


def test_disturbing_force_pushes_a_sliding_robot_by_newtons_law() -> None:
    frames, n, force = 40, 20, 50.0
    # Of the wheels nothing is asked here, so that the faster ones do.
    carpet = {"friction": 0.01, "rolling_resistance": 0.0}
    settings = noiseless(
        carpet=carpet, disturbance={"force_n": force}, wheels={"model": "two-rollers"}
    )
    plant = plant_of([settings] * n, seeds=range(n))
    position = drive(plant, constant([0.0, 0.0, 0.0], frames, n))[..., :2]
    # A force constant within each frame gives x(k+1) - 2 x(k) + x(k-1) = T^2 (a(k) + a(k-1)) / 2.
    mean_force = MASS_KG * np.diff(position, n=2, axis=0) / FRAME_S**2
    # Bounded by the amplitude, to which friction, mu m g = 0.26 N, may add.
    assert np.abs(mean_force).max() <= force + 0.01 * MASS_KG * GRAVITY
    # The mean of two uniform numbers deviates by f / sqrt(3) / sqrt(2). 1560 samples, of which
    # every other one is independent: the deviation is known to 1 / sqrt(1560), the mean to sigma
    # sqrt(2 / 1560).
    sigma, samples = force / math.sqrt(6), mean_force.size
    assert mean_force.std() == pytest.approx(sigma, rel=SIGMAS / math.sqrt(samples))
    assert mean_force.mean() == pytest.approx(0.0, abs=SIGMAS * sigma * math.sqrt(2 / samples))


def test_neither_threads_nor_the_batch_change_a_bit() -> None:
    """Robots that slip, saturate and are pushed, each otherwise, on any number of threads and alone."""
    settings, seeds, start = (
        with_settings(disturbance={"force_n": 10.0}),
        [3, 1, 4, 1, 5],
        STARTS[:5],
    )
    commands = np.random.default_rng(1).normal(scale=1.5, size=(15, 5, 3))
    serial = drive(plant_of([settings] * 5, start, seeds, threads=1), commands)
    for threads in (2, 3, None):
        parallel = drive(plant_of([settings] * 5, start, seeds, threads=threads), commands)
        np.testing.assert_array_equal(parallel, serial)
    for row in range(5):
        alone = drive(plant_of([settings], start[[row]], [seeds[row]]), commands[:, [row]])
        np.testing.assert_array_equal(alone, serial[:, [row]])
