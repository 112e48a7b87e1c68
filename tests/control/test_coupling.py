"""Driving turns robots whose wheels do not all give way alike: what turning adds for it, finds of it, and undoes."""

import numpy as np
import pytest
from benches.simulating import finished
from scipy.integrate import solve_ivp

from omni_control.estimation.turning import Turning
from omni_mj.scenarios import scenario
from omni_mj.simulate.simulation import Simulation

T = 1 / 60
ASIDE = (  # as fast sideways as ahead, at what the wheels still hold without sliding
    "reference.waypoints=[[0, 0], [0, 2.5], [0, 0]]",
    "reference.max_acceleration_m_s2=2.5",
    "reference.max_side_acceleration_m_s2=2.5",
    "reference.max_jerk_m_s3=10",
    "physics.kernel=numpy",
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
    sigma = found.sigma[:, 6:8].T
    assert (np.abs(found.coupling - true) < 3 * sigma).all()
    assert sigma.max() < 0.25 / 2


@pytest.mark.parametrize(("sliding", "off"), [(0.0, 0.02), (0.4, 0.02), (0.0, 0.5), (0.7, 0.5), (1.0, 0.5)])
def test_of_what_slides_or_surprises_a_share_is_learned(sliding: float, off: float) -> None:
    """A frame's correction by a gain K, of parameters by a share of it: B K.

    Whatever the gain, by Joseph's form P = (1 - B K h) P (1 - B K h)' + B K r K' B', of the prediction that a frame
    without vision leaves. The share: 1, less by what slides, and by what surprises more than 1.5 times as expected.
    """

    def driven(measured: float) -> Turning:
        found = Turning(np.zeros(1), T, 0.01, 0.02, 0.04)
        for k in range(40):
            found.update(
                np.array([0.02 * np.sin(k)]), np.array([np.cos(k)]), np.ones(1), shortfall=np.array([0.3 + 0.1j])
            )
        found.surprise[:] = 1.0
        found.update(
            np.array([measured]), np.ones(1), np.ones(1), shortfall=np.array([0.2j]), sliding=np.full(1, sliding)
        )
        return found

    before = driven(np.nan)
    predicted = before.variance[0]
    after = driven(float(before.heading[0]) + off)
    certain = 1 / (predicted[0, 0] + 0.01**2)
    surprise = 1 + (min(off**2 * certain, 50) - 1) / 10
    share = np.diag([1.0] * 3 + [(1 - sliding) * min(1.5 / surprise, 1)] * 6)
    gain = share @ predicted[:, :1] * certain
    left = np.eye(9) - gain @ np.eye(9)[:1]
    np.testing.assert_allclose(after.variance[0], left @ predicted @ left.T + gain @ gain.T * 0.01**2, atol=1e-12)
    found = [[getattr(one, name)[0] for name in ("heading", "rate", "bias", "lag")] for one in (before, after)]
    np.testing.assert_allclose(found[1], found[0] + gain[:4, 0] * off, atol=1e-12)
    assert after.surprise[0] == pytest.approx(surprise)


def test_wheels_that_slide_leave_a_robot_what_it_was() -> None:
    """Turned at random by up to 40 rad/s^2 while it drives and slides for two seconds: alpha and coupling stay.

    Taken for a robot that holds, the same ones come to be what none is. Headings are followed as well, and a second
    afterwards turn by nothing else than commands.
    """
    found = []
    for sliding in (1.0, 0.0):
        rng, n = np.random.default_rng(4), 10
        turning, heading, rate = Turning(np.zeros(n), T, 0.01, 0.02), np.zeros(n), np.zeros(n)
        extremes = []
        for k in range(240):
            slides = 60 <= k < 180
            command, missing = 2 * np.sin(np.full(n, k * T * 3)), np.full(n, 0.8 * np.sin(2 * np.pi * k * T / 1.3) + 0j)
            if k % 12 == 0:
                turned = rng.uniform(-40, 40, n)
            for _ in range(20):
                rate = rate + T / 20 * ((command - 1.02 * rate) / 0.02 + turned * slides)
                heading = heading + T / 20 * rate
            seen = heading + rng.normal(0, 0.01, n)
            turning.update(seen, command, np.ones(n), shortfall=missing * slides, sliding=np.full(n, sliding * slides))
            extremes.append([np.abs(turning.coupling).max(), (1 / turning.effort).max(), -(1 / turning.effort).min()])
            if sliding:
                assert np.abs(turning.heading - heading).max() < 0.1
        found.append(np.max(extremes, axis=0))
        assert np.abs(turning.bias).max() < 0.1
    assert (found[0] <= [0.8, 1.1, -0.7]).all(), found
    assert (found[1] > found[0]).all(), found
    assert found[1][0] > 0.8


def test_a_robot_that_drives_aside_keeps_its_heading() -> None:
    """Of tigers-v2020, whose centre is 5 mm back: on the way back within 3 degrees, comp-flc-lag more than 4 off.

    Before that it cannot know.
    """
    head = {"plant": "planar", "robot": "tigers-v2020", "controllers": ("adaptive-comp-flc", "comp-flc-lag")}
    driven = finished(Simulation(scenario.load("rect", ASIDE, head)))
    adaptive, knows_nothing = np.abs(np.degrees(driven.channel("pose")[:, :, 0, 2])).T
    back = len(adaptive) // 2
    assert knows_nothing[back:].max() > 4.0
    assert adaptive[back:].max() < 3.0
