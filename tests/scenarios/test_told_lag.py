"""What a robot's gains say of its lag and drag, against how its plant answers, and what controllers are told of it."""

from functools import cache
from pathlib import Path

import compiled
import numpy as np
import pytest

import omni_mj as om
from omni_mj import robots as shipped

BEFORE, AFTER, DELAY = 120, 60, 6  # frames
STEP_M_S = 0.04
UNITS = {"lag": "s", "drag": "m_s"}
ON = {"tigers-v2016": "mujoco", "tigers-v2020": "planar"}  # of either plant


@cache
def measured(robot: str) -> list[tuple[float, float]]:
    """Of both axes: lag of small steps up and down, s, over speeds near rest, and from there to rest; and drag, m/s.

    After a step of a first-order lag tau the way falls behind by the step times tau and the dead time. Creep lets the
    lag grow in proportion to speed. Dry friction costs as much at any speed: what a line through speeds over commands
    is below zero at none.
    """
    compiled.once(plant := ON[robot])
    base = np.linspace(0.15, 0.35, 5)
    fast = {"wheels": {"model": "two-rollers"}, "physics": compiled.NUMBA}
    scenario = om.scenario("rect", plant=plant, robot=robot, vision={"position_noise_m": 0.0}, **fast)
    cases = [(axis, step, speed) for axis in (0, 1) for step in (STEP_M_S, -STEP_M_S) for speed in base]
    rows, axes = np.arange(len(cases)), np.array([axis for axis, _, _ in cases])
    sim = om.Simulation(scenario, ["p"], seeds=range(len(cases)))
    speeds, places = [], []
    for frame in range(BEFORE + AFTER + 20):
        sim.observe()
        command = np.zeros((len(cases), 3))
        command[rows, axes] = [speed + (step if frame >= BEFORE else 0.0) for _, step, speed in cases]
        sim.step(command)
        speeds.append(sim.plant.twist()[rows, axes])
        places.append(sim.plant.pose()[rows, axes])
    before, after = np.mean(speeds[BEFORE - 20 : BEFORE], axis=0), np.mean(speeds[-20:], axis=0)
    way = places[BEFORE + AFTER - 1] - places[BEFORE - 1]
    late = (after * AFTER / 60 - way) / (after - before) - DELAY / 60
    lags, starts = (values.reshape(2, 2, len(base)).mean(1) for values in (late, before))
    return [
        (float(np.polyfit(speed, lag, 1)[1]), -float(np.polyfit(base, speed, 1)[1]))
        for lag, speed in zip(lags, starts, strict=True)
    ]


@pytest.mark.parametrize("axis", [0, 1], ids=["ahead", "aside"])
@pytest.mark.parametrize("robot", ON)
def test_lag_and_drag_of_a_robot_follow_from_its_gains(robot: str, axis: int) -> None:
    facts, (lag, drag) = om.robot(robot).facts, measured(robot)[axis]
    way = ("ahead", "aside")[axis]
    # Rotors and rolling resistance, which the formula leaves out, and 2 ms of scatter brought to rest: 20 %.
    assert facts[f"lag_{way}_s"] == pytest.approx(lag, rel=0.2)
    # Five commands of 0.15 to 0.35 m/s; friction that grows with load and speed of rollers: 25 %.
    assert facts[f"drag_{way}_m_s"] == pytest.approx(drag, rel=0.25)


def test_controllers_are_told_what_a_robot_s_gains_make_of_it() -> None:
    """The mean of ahead and aside, to 0.1 ms and 1 mm/s; where a loop integrates there is no such lag.

    A file that says something else says so because it was measured, and is not far from it.
    """
    for name, path in shipped.builtin().items():
        robot = om.robot(name)
        if robot.settings.firmware.ki == 0:
            said, control, facts = "lag_s" in path.read_text(), robot.settings.control, robot.facts
            lag, drag = ((facts[f"{what}_ahead_{u}"] + facts[f"{what}_aside_{u}"]) / 2 for what, u in UNITS.items())
            assert control.lag_s == pytest.approx(lag, rel=0.25 if said else 0, abs=1e-4), name
            assert control.drag_m_s == pytest.approx(drag, abs=1e-3), name
            assert om.scenario("rect", robot=name).settings.control == control


@pytest.mark.parametrize("axis", [0, 1], ids=["ahead", "aside"])
def test_what_robots_reach_is_told_as_creep_makes_of_their_drag(axis: int) -> None:
    """Share of a steady command of 1 m/s that they reach on planar, without what dry friction costs.

    Within 0.015, a fifth of what is doubted of it (`omni_control.estimation.belief.KNOWN`), but for robots whose loops
    integrate, of which it is not told.
    """
    for name in shipped.builtin():
        robot = om.robot(name)
        told = (robot.settings.control.alpha_forward, robot.settings.control.alpha_sideways)[axis]
        if robot.settings.firmware.ki:
            assert told == 0, name
            continue
        sim = om.Simulation(om.scenario("rect", plant="planar", robot=name), ["p"], seeds=[0])
        command = np.zeros((1, 3))
        command[0, axis] = 1.0
        for _ in range(90):
            sim.observe()
            sim.step(command)
        reached = sim.plant.twist()[0, axis] / (1 - robot.facts[("drag_ahead_m_s", "drag_aside_m_s")[axis]])
        assert told == pytest.approx(reached, abs=0.015), name
        assert robot.facts[("told_alpha_ahead", "told_alpha_aside")[axis]] == told


def test_a_team_that_takes_robots_not_to_creep_takes_them_to_reach_what_they_are_told() -> None:
    """Where wheels do not creep drag costs nothing; half the creep costs half the effort."""
    told = [om.scenario("rect", control={"creep_s2_m": creep}).settings.control for creep in (0.0, 0.03465, 0.0693)]
    efforts = np.array([[1 / each.alpha_forward, 1 / each.alpha_sideways] for each in told])
    np.testing.assert_allclose(efforts[0], 1.0, atol=1e-12)
    np.testing.assert_allclose(2 * (efforts[1] - 1), efforts[2] - 1, atol=2e-3)  # told to 0.001
    assert told[2] == om.scenario("rect").settings.control
    said = om.scenario("rect", control={"creep_s2_m": 0.0, "alpha_sideways": 0.9}).settings.control
    assert (said.alpha_forward, said.alpha_sideways) == (1.0, 0.9)


def test_controllers_are_told_alpha_where_it_is_known() -> None:
    """Not on equation 7's plant, nor where a file or a scenario says that nobody knows it."""
    cases = ("planar", {}, True), ("kinematic", {}, False), ("planar", {"alpha_forward": 0.0}, False)
    for plant, control, known in cases:
        scenario = om.scenario("rect", plant=plant, control=control)
        told = om.Simulation(scenario, ["p"], seeds=[0]).team.controllers[0].told
        assert told.alpha == ((scenario.settings.control.alpha_forward, 0.833) if known else None)


def test_softer_loops_are_told_to_lag_and_what_is_said_wins(tmp_path: Path) -> None:
    own, text = tmp_path / "own.toml", shipped.builtin()["tigers-v2020"].read_text()
    own.write_text(text.replace("kp = 0.4", "kp = 0.2"))
    motor, told = om.robot("tigers-v2020").settings.motor, om.robot("tigers-v2020").settings.control.lag_s
    emf = motor.gear * motor.constant_nm_a
    # In inverse proportion to the loop's gain and back-EMF together; told to 0.1 ms of 90.
    assert om.robot(own).settings.control.lag_s == pytest.approx(told * (0.4 + emf) / (0.2 + emf), rel=2e-3)
    own.write_text(text + "\n[control]\nlag_s = 0.07\n")
    assert om.robot(own).settings.control.lag_s == 0.07
    assert om.robot(own).settings.control.drag_m_s == om.robot("tigers-v2020").settings.control.drag_m_s
    assert om.scenario("rect", robot=own, control={"lag_s": 0.03}).settings.control.lag_s == 0.03


def test_what_a_scenario_makes_of_a_robot_its_team_is_not_told() -> None:
    assert om.scenario("lint").settings.control == om.scenario("rect").settings.control
