"""Driving turns robots whose wheels do not all give way alike: what turning adds for it, finds of it, and undoes."""

import compiled
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from simulating import finished

from omni_control.estimation.turning import Turning
from omni_mj.scenarios import scenario
from omni_mj.simulate.simulation import Simulation

T = 1 / 60
ASIDE = (  # as fast sideways as ahead, at what the wheels still hold without sliding
    "reference.waypoints=[[0, 0], [0, 2.5], [0, 0]]",
    "reference.max_acceleration_m_s2=2.5",
    "reference.max_side_acceleration_m_s2=2.5",
    "reference.max_jerk_m_s3=10",
    "physics.kernel=numba",
)


def test_a_shortfall_turns_like_a_command_against_it() -> None:
    """tau w' + g w = u + b - k e, from rest, by scipy; `follow` goes the same way, and `ask` leads to what is asked."""
    turning, rest, missing = Turning(np.zeros(1), T, 0.01, 0.02), np.zeros(1), np.array([0.3 - 0.5j])
    turning.lag, turning.effort, turning.bias = np.array([0.03]), np.array([1.2]), np.array([0.1])
    turning.coupling = np.array([[-0.2], [0.4]])
    pushed = 2.0 + 0.1 - (-0.2 * 0.3 + 0.4 * -0.5)
    end = solve_ivp(lambda _, s: [s[1], (pushed - 1.2 * s[1]) / 0.03], (0, 0.1), [0, 0], rtol=1e-9, atol=1e-12).y[:, -1]
    stepped = turning.step(rest, rest, np.array([2.0]), 0.1, rest, missing)
    np.testing.assert_allclose(np.ravel(stepped), end, rtol=1e-6)
    followed = turning.follow(np.array([[2.0]]), np.array([[0.1]]), np.zeros((1, 1)), missing[None])
    assert followed[-1, 0] == pytest.approx(end[0])
    command = turning.ask(np.array([1.0]), np.array([1.3]), rest, missing)
    assert turning.step(rest, np.array([1.0]), command, T, rest, missing)[1][0] == pytest.approx(1.3)


def test_coupling_is_identified() -> None:
    """Of robots that drive to and fro along both axes, within three of the filter's own standard deviations.

    Robots are integrated in 20 steps a frame. The doubt of 0.25 rad/m that there was is less than half.
    """
    rng, n, frames = np.random.default_rng(3), 12, 480
    true = rng.uniform(-0.4, 0.4, (2, n))
    found = Turning(np.zeros(n), T, 0.01, 0.02)
    heading, rate = np.zeros((2, n))
    for k in range(frames):
        missing = np.full(n, 0.5 * np.sin(2 * np.pi * k * T / 1.7) + 0.5j * np.sin(2 * np.pi * k * T / 2.3))
        for _ in range(20):
            turned = -(true[0] * missing.real + true[1] * missing.imag)
            rate = rate + T / 20 * (turned - 1.02 * rate) / 0.008
            heading = heading + T / 20 * rate
        found.update(heading + rng.normal(0, 0.01, n), np.zeros(n), np.zeros(n), shortfall=missing)
    sigma = found.sigma[:, 6:].T
    assert (np.abs(found.coupling - true) < 3 * sigma).all()
    assert sigma.max() < 0.25 / 2


def test_a_robot_that_drives_aside_keeps_its_heading() -> None:
    """Of tigers-v2020, whose centre is 5 mm back: on the way back within 3 degrees, comp-flc-lag more than 4 off.

    Before that it cannot know.
    """
    compiled.once("planar")
    head = {"plant": "planar", "robot": "tigers-v2020", "controllers": ("adaptive-comp-flc", "comp-flc-lag")}
    driven = finished(Simulation(scenario.load("rect", ASIDE, head)))
    adaptive, knows_nothing = np.abs(np.degrees(driven.channel("pose")[:, :, 0, 2])).T
    back = len(adaptive) // 2
    assert knows_nothing[back:].max() > 4.0
    assert adaptive[back:].max() < 3.0
