"""The plant mujoco: laws of a point mass on carpet, and independence of rows in a batch."""

import math

import numpy as np
import pytest
from benches.plant import (
    FRAME_S,
    GRAVITY,
    MASS_KG,
    SIGMAS,
    constant,
    drive,
    noiseless,
    with_settings,
)
from benches.plant import mujoco as plant_of
from commands import run_python

STARTS = np.array(
    [[0, 0, 0], [1.5, -2, 1], [-3, 0.5, math.pi], [0, 0, -math.pi + 1e-3], [4, 3, 10], [0, 1, -7.0]]
)


def test_robots_start_at_their_start_poses_with_any_heading() -> None:
    n = len(STARTS)
    plant = plant_of([noiseless()] * n, STARTS)
    np.testing.assert_array_equal(plant.pose(), STARTS)  # whole turns of the heading included
    drive(plant, constant([0.0, 0.0, 0.0], 1, n))
    # They settle into the carpet, by a tenth of vision's noise.
    np.testing.assert_allclose(plant.pose(), STARTS, atol=1.3e-4)


def test_motion_does_not_depend_on_position_or_heading() -> None:
    settle, frames, n = 10, 20, len(STARTS)
    plant = plant_of([noiseless()] * n, STARTS)
    # At the start rollers just touch the carpet, and rounding decides which of them carry the first
    # step. At rest this has no effect any more.
    start = drive(plant, np.zeros((settle, n, 3)))[-1]
    c, s = np.cos(start[:, 2]), np.sin(start[:, 2])
    forward, sideways, turn = 0.6, 0.3, 2.0
    command = np.stack(
        [c * forward - s * sideways, s * forward + c * sideways, np.full(n, turn)], axis=1
    )
    x, y, heading = (drive(plant, constant(command, frames, n))[-1] - start).T
    displacement = np.stack([c * x + s * y, c * y - s * x, heading], axis=1)
    # The carpet is the same everywhere and in every direction. 0.05 mm and 0.05 mrad of 180 mm and
    # 0.5 rad: the rest of the settling, and the tolerance of the contact solver.
    np.testing.assert_allclose(displacement, np.tile(displacement[0], (n, 1)), rtol=0, atol=5e-5)
    assert np.hypot(*displacement[0, :2]) > 0.1


def test_headings_are_unwrapped() -> None:
    start, turn_rate = 3.0, 10.0
    plant, commands = (
        plant_of([noiseless()] * 2, [[0, 0, start]] * 2),
        [[0, 0, turn_rate], [0, 0, -turn_rate]],
    )
    heading = drive(plant, constant(commands, 90, 2))[..., 2]
    # The heading is continuous at pi: between frames it changes at most by the command.
    assert np.abs(np.diff(heading, axis=0)).max() < 1.1 * turn_rate * FRAME_S
    assert np.abs(heading[-1] - start).min() > 4 * math.pi


def test_disturbing_force_pushes_a_sliding_robot_by_newtons_law() -> None:
    frames, n, force = 40, 20, 50.0
    # The faster wheels suffice, because they get no commands here.
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
    """Robots that slip, saturate and are pushed, on any number of threads and alone."""
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
        single = drive(plant_of([settings], start[[row]], [seeds[row]]), commands[:, [row]])
        np.testing.assert_array_equal(single, serial[:, [row]])


def test_threads_follow_the_affinity_of_the_process() -> None:
    """A process that is bound to one processor runs many robots on its only thread."""
    code = (
        "import os, omni_mj as om; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))});"
        "om.Simulation(om.load_scenario('rect'), ['p'], range(16)).step();"
        "print(len(os.listdir('/proc/self/task')))"
    )
    assert run_python(code=code).stdout.split() == ["1"]
