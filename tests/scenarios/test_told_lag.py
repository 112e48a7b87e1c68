"""What a robot's gains say of its lag, against how its plant answers, and what its file has controllers told."""

import numpy as np
import pytest

import omni_mj as om
from omni_mj import robots as shipped

BEFORE, AFTER, DELAY = 120, 60, 6  # frames
STEP_M_S = 0.04


def measured_lag(robot: str, axis: int) -> float:
    """Lag of small steps up and down, s, over speeds near rest, and from there to rest.

    After a step of a first-order lag tau the way falls behind by the step times tau and the dead time. Creep lets the
    lag grow in proportion to speed.
    """
    base, found = np.linspace(0.15, 0.35, 5), []
    scenario = om.scenario("rect", robot=robot, wheels={"model": "two-rollers"}, vision={"position_noise_m": 0.0})
    for step in (STEP_M_S, -STEP_M_S):
        sim = om.Simulation(scenario, ["p"], seeds=range(len(base)))
        speeds, places = [], []
        for frame in range(BEFORE + AFTER + 20):
            sim.observe()
            command = np.zeros((len(base), 3))
            command[:, axis] = base + (step if frame >= BEFORE else 0.0)
            sim.step(command)
            speeds.append(sim.plant.twist()[:, axis])
            places.append(sim.plant.pose()[:, axis])
        before, after = np.mean(speeds[BEFORE - 20 : BEFORE], axis=0), np.mean(speeds[-20:], axis=0)
        way = places[BEFORE + AFTER - 1] - places[BEFORE - 1]
        found.append(np.array([(after * AFTER / 60 - way) / (after - before) - DELAY / 60, before]))
    lag, speed = np.mean(found, axis=0)
    return float(np.polyfit(speed, lag, 1)[1])


@pytest.mark.parametrize("robot", ["tigers-v2016", "tigers-v2020"])
def test_the_lag_of_a_robot_follows_from_its_gains(robot: str) -> None:
    facts = om.robot(robot).facts
    # Rotors and rolling resistance, which the formula leaves out, and 2 ms of scatter brought to rest: 20 %.
    assert facts["lag_ahead_s"] == pytest.approx(measured_lag(robot, 0), rel=0.2)
    assert facts["lag_aside_s"] == pytest.approx(measured_lag(robot, 1), rel=0.2)


def test_controllers_are_told_about_what_a_robot_s_gains_make_of_it() -> None:
    for name in shipped.builtin():
        robot = om.robot(name)
        if robot.settings.firmware.ki == 0:
            mean = (robot.facts["lag_ahead_s"] + robot.facts["lag_aside_s"]) / 2
            assert robot.settings.control.lag_s == pytest.approx(mean, rel=0.25), name
