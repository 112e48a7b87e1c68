"""Robots: their files, what no robot can be, and what their teams are told, against laws computed another way."""

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import invoke, listed
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import omni_mj as om

ROBOTS = listed("robots")
DEFAULT = "tigers-v2016"
angles = st.lists(st.floats(0, 360), min_size=3, max_size=8)
quick = settings(max_examples=60)


def text_of(robot: str, capsys: pytest.CaptureFixture[str]) -> str:
    capsys.readouterr()
    assert invoke("show", robot) == 0
    return capsys.readouterr().out


def changed(text: str, **values: str) -> str:
    """Return a robot's file with the values of some fields replaced, or without the fields if they are empty."""
    lines = []
    for line in text.splitlines():
        name = line.partition("=")[0].strip()
        if name not in values:
            lines.append(line)
        elif values[name]:
            lines.append(f"{name} = {values[name]}")
    return "\n".join(lines)


def test_a_robots_file_is_the_base_of_its_scenarios(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It may be named, be a file, or what om.load_robot gave; a scenario's values go before its, and it is read anew."""
    other = tmp_path / "other.toml"
    other.write_text(
        changed(
            text_of(DEFAULT, capsys),
            gear_friction_nm="0.01",
            rolling_resistance="0.15",
            encoder_counts="1024",
        )
    )
    made = om.load_scenario("rect", robot=other, carpet={"friction": 0.6})
    assert (made.settings.drivetrain.gear_friction_nm, made.settings.sensors.encoder_counts) == (
        0.01,
        1024,
    )
    assert (made.settings.carpet.rolling_resistance, made.settings.carpet.friction) == (0.15, 0.6)
    assert (
        om.load_scenario(
            "rect", robot=om.load_robot(other), carpet={"rolling_resistance": 0.2}
        ).settings.carpet.rolling_resistance
        == 0.2
    )
    assert om.load_scenario("rect", robot=DEFAULT) == om.load_scenario("rect")
    other.write_text(changed(text_of(DEFAULT, capsys), rolling_resistance="0.25"))
    assert om.load_scenario("rect", robot=other).settings.carpet.rolling_resistance == 0.25


@pytest.mark.parametrize(
    ("values", "more", "words"),
    [
        (
            {"rolling_resistance": ""},
            "",
            "carpet.rolling_resistance depends on the robot; give it in the scenario, or in ",
        ),
        (
            {"rolling_resistance": "-1"},
            "",
            "carpet.rolling_resistance must be greater than or equal to 0 (0 to 1), not -1",
        ),
        ({"azimuths_deg": "[0, 180]"}, "", "wheels.azimuths_deg must have at least 3 items"),
        ({}, "[motr]\ngear = 3", "did you mean 'motor'"),
        ({}, "[body", "not valid TOML"),
    ],
)
def test_what_is_wrong_in_a_robots_file_is_said_in_a_line(
    values: dict[str, str],
    more: str,
    words: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(f"{changed(text_of(DEFAULT, capsys), **values)}\n{more}")
    with pytest.raises(om.OmniError) as error:
        om.load_scenario("rect", robot=str(wrong))
    assert words in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ROBOTS)
def test_every_robots_numbers_fit_together(name: str) -> None:
    """What one number says of another: cells and volts, body and wheels, motor and battery, drags and friction."""
    s = om.load_robot(name).settings
    assert s.firmware.nominal_voltage_v == pytest.approx(3.7 * s.battery.series_cells)  # LiPo
    assert 3.0 * s.battery.series_cells <= s.battery.cut_off_v <= 3.5 * s.battery.series_cells
    # A disc whose mass is within the wheels: 1/2 m r^2 with the arm as r at least, a ring's m r^2
    # at most.
    disc = s.body.mass_kg * s.wheels.arm_m**2
    assert 0.5 * disc < s.body.yaw_inertia_kg_m2 < disc
    assert s.body.tilt_inertia_kg_m2 > s.body.yaw_inertia_kg_m2 / 2
    assert s.drivetrain.roller_friction < s.carpet.friction
    assert s.wheels.arm_m < 0.09  # the league's limit: 180 mm across
    # At the nominal battery it reaches the reference's speed in its fastest direction: back-EMF of
    # the motor at 3 m/s.
    assert (
        s.motor.torque_constant_nm_a * 3.0 / s.wheels.radius_m * s.motor.gear_ratio
        < s.firmware.nominal_voltage_v
    )


def refused(**sections: Any) -> str:
    """Return the message with which a robot is refused; empty if it is not."""
    try:
        om.load_scenario("rect", **sections)
    except om.OmniError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({"wheels": {"rollers": 8, "roller_radius_m": 0.002}}, "it takes 9 at least"),
        ({"wheels": {"roller_radius_m": 0.015}}, "no room for an axle"),
        (
            {"wheels": {"rollers": 30, "model": "two-rollers"}},
            "more than two of a wheel touch the carpet",
        ),
        ({"wheels": {"azimuths_deg": [-60, 0, 60]}}, "41.5 mm outside the polygon"),
        ({"body": {"yaw_inertia_kg_m2": 0.03}}, "at most twice body.tilt_inertia_kg_m2"),
        ({"battery": {"cut_off_v": 17.0}}, "the 16.8 V of battery.series_cells = 4"),
        (
            {"motor": {"resistance_ohm": 4.0}},
            "motor.nominal_rpm with motor.nominal_current_a takes",
        ),
        (
            {"motor": {"no_load_rpm": 5500.0}},
            "motor.no_load_rpm with motor.no_load_current_a takes",
        ),
        ({"motor": {"nominal_torque_nm": 1.0}}, "is not motor.torque_constant_nm_a times"),
    ],
)
def test_what_no_robot_can_be_is_refused_with_the_reason(
    sections: dict[str, Any], words: str
) -> None:
    assert words in refused(**sections)


@quick
@given(st.floats(0.02, 0.05), st.floats(0.08, 0.4), st.integers(8, 40))
def test_rollers_close_a_wheel_where_their_barrels_meet(
    radius: float, share: float, count: int
) -> None:
    """Drawn: a roller's profile is the wheel's circle; halfway to the next one it must be outside the rollers' axes.

    Axes are chords whose middles are at R - r.
    """
    closes = math.cos(math.pi / count) * radius > radius * (1 - share)
    wheels = {
        "radius_m": radius,
        "rollers": count,
        "roller_radius_m": max(share * radius, 0.002),
        "arm_m": 0.4,
    }
    if share * radius >= 0.002:
        assert ("do not close a wheel" in refused(wheels=wheels)) != closes


@quick
@given(angles, st.floats(-0.09, 0.09))
def test_a_robot_stands_where_wheels_can_bear_it(azimuths: list[float], x: float) -> None:
    """By linear programming: loads that are not negative, with the weight's sum and moments."""
    from scipy.optimize import linprog

    arm, around = 0.4, np.sort(np.radians(azimuths))
    if np.diff([*around, around[0] + math.tau]).min() < 0.2:
        return
    balance = np.stack([np.ones(len(around)), arm * np.cos(around), arm * np.sin(around)])
    stands = linprog(np.zeros(len(around)), A_eq=balance, b_eq=[1.0, x, 0.0]).status == 0
    message = refused(wheels={"azimuths_deg": azimuths, "arm_m": arm}, body={"com_x_m": x})
    assert ("outside the polygon" in message) != stands or abs(
        float(message.split(" is ")[1].split(" mm")[0])
    ) < 1e-3


# What teams are told.


def driven(robot: str, commands: NDArray, **more: Any) -> om.Simulation:
    """Return a simulation without vision noise after commands (frames, n, 3)."""
    scenario = om.load_scenario(
        "rect", plant="planar", robot=robot, vision={"position_noise_m": 0.0}, **more
    )
    simulation = om.Simulation(scenario, ["p"], seeds=range(commands.shape[1]))
    for command in commands:
        simulation.observe()
        simulation.step(command)
    return simulation


@cache
def measured(robot: str) -> list[tuple[float, float]]:
    """Return lag, s, and drag, m/s, ahead and aside, of small steps up and down from several speeds, brought to rest.

    After a step of a first-order lag tau the way falls behind by the step times tau and the dead
    time. Creep lets the lag grow in proportion to speed. Dry friction costs as much at any speed:
    what a line through speeds over commands is below zero at none.
    """
    before, after, delay, step = 120, 60, 6, 0.04
    base = np.linspace(0.15, 0.35, 5)
    cases = [(axis, sign * step, speed) for axis in (0, 1) for sign in (1, -1) for speed in base]
    rows, axes = np.arange(len(cases)), np.array([axis for axis, _, _ in cases])
    scenario = om.load_scenario(
        "rect", plant="planar", robot=robot, vision={"position_noise_m": 0.0}
    )
    sim = om.Simulation(scenario, ["p"], seeds=range(len(cases)))
    speeds, places = [], []
    for frame in range(before + after + 20):
        sim.observe()
        command = np.zeros((len(cases), 3))
        command[rows, axes] = [
            speed + (change if frame >= before else 0.0) for _, change, speed in cases
        ]
        sim.step(command)
        speeds.append(sim.plant.twist()[rows, axes])
        places.append(sim.plant.pose()[rows, axes])
    first, last = np.mean(speeds[before - 20 : before], axis=0), np.mean(speeds[-20:], axis=0)
    distance = places[before + after - 1] - places[before - 1]
    late = (last * after / 60 - distance) / (last - first) - delay / 60
    lags, starts = (values.reshape(2, 2, len(base)).mean(1) for values in (late, first))
    return [
        (float(np.polyfit(speed, lag, 1)[1]), -float(np.polyfit(base, speed, 1)[1]))
        for lag, speed in zip(lags, starts, strict=True)
    ]


def test_lag_and_drag_of_a_robot_follow_from_its_gains() -> None:
    """Rotors and rolling resistance, which the formula leaves out, and scatter: 20 and 25 %."""
    facts = om.load_robot("tigers-v2020").facts
    for side, (lag, drag) in zip(("forward", "sideways"), measured("tigers-v2020"), strict=True):
        assert facts[f"lag_{side}_s"] == pytest.approx(lag, rel=0.2)
        assert facts[f"drag_{side}_m_s"] == pytest.approx(drag, rel=0.25)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_team_is_told_what_its_robots_gains_and_creep_make_of_them(name: str) -> None:
    """Lag and drag are means of both axes; alpha is the share of a steady 1 m/s reached, without dry friction's cost.

    Of loops that integrate, alpha is not known. A file that says something else says so because it
    was measured.
    """
    robot = om.load_robot(name)
    facts, told = robot.facts, robot.settings.control
    assert om.load_scenario("rect", robot=name).settings.control == told
    if robot.settings.firmware.ki:
        assert (told.assumed_alpha_forward, told.assumed_alpha_sideways) == (0, 0)
        return
    assert told.assumed_lag_s == pytest.approx(
        (facts["lag_forward_s"] + facts["lag_sideways_s"]) / 2, rel=0.25
    )
    assert told.assumed_drag_m_s == pytest.approx(
        (facts["drag_forward_m_s"] + facts["drag_sideways_m_s"]) / 2, abs=1e-3
    )
    reached = np.diag(driven(name, np.tile(np.eye(3)[:2], (90, 1, 1))).plant.twist()[:, :2])
    reached = reached / (1 - np.array([facts["drag_forward_m_s"], facts["drag_sideways_m_s"]]))
    assert (told.assumed_alpha_forward, told.assumed_alpha_sideways) == pytest.approx(
        tuple(reached), abs=0.015
    )


def test_what_is_told_can_be_said_and_does_not_follow_from_what_a_scenario_changes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Softer loops of the robot's file lag in inverse proportion to gain and back-EMF together; told to 0.1 ms."""
    text = changed(text_of("tigers-v2020", capsys)).partition("\n[control]")[0]
    own = tmp_path / "own.toml"
    own.write_text(changed(text, kp="0.2"))
    robot = om.load_robot("tigers-v2020").settings
    emf = robot.motor.gear_ratio * robot.motor.torque_constant_nm_a
    assert om.load_robot(own).settings.control.assumed_lag_s == pytest.approx(
        robot.control.assumed_lag_s * (0.4 + emf) / (0.2 + emf), rel=2e-3
    )
    own.write_text(text + "\n[control]\nassumed_lag_s = 0.07\n")
    assert om.load_robot(own).settings.control.assumed_lag_s == 0.07
    assert om.load_robot(own).settings.control.assumed_drag_m_s == robot.control.assumed_drag_m_s
    assert (
        om.load_scenario(
            "rect", robot=own, control={"assumed_lag_s": 0.03}
        ).settings.control.assumed_lag_s
        == 0.03
    )
    assert (
        om.load_scenario("roller-debris").settings.control
        == om.load_scenario("rect").settings.control
    )


def test_a_team_that_takes_robots_not_to_creep_takes_them_to_reach_what_they_are_told() -> None:
    """Where wheels do not creep drag costs nothing; half the creep costs half the effort."""
    full = om.load_scenario("rect").settings.control.assumed_creep_s2_m
    told = [
        om.load_scenario("rect", control={"assumed_creep_s2_m": creep}).settings.control
        for creep in (0.0, full / 2, full)
    ]
    efforts = np.array(
        [[1 / each.assumed_alpha_forward, 1 / each.assumed_alpha_sideways] for each in told]
    )
    np.testing.assert_allclose(efforts[0], 1.0, atol=1e-12)
    np.testing.assert_allclose(2 * (efforts[1] - 1), efforts[2] - 1, atol=2e-3)  # told to 0.001
    assert told[2] == om.load_scenario("rect").settings.control
