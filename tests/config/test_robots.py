"""Robots: their files, contradictory numbers, and the assumptions of their teams."""

import math
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import invoke, list_names
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import omni_mj as om

ROBOTS = list_names("robots")
DEFAULT = "tigers-v2016"
angles = st.lists(st.floats(0, 360), min_size=3, max_size=8)
quick = settings(max_examples=60)


def show_robot(robot: str, capsys: pytest.CaptureFixture[str]) -> str:
    capsys.readouterr()
    assert invoke("show", robot) == 0
    return capsys.readouterr().out


def replace_values(text: str, **values: str) -> str:
    """Replace values of fields in a robot's file; an empty value removes the field."""
    lines = []
    for line in text.splitlines():
        name = line.partition("=")[0].strip()
        if name not in values:
            lines.append(line)
        elif values[name]:
            lines.append(f"{name} = {values[name]}")
    return "\n".join(lines)


def test_robot_file_gives_the_defaults_of_its_scenarios(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Give a robot as a name, a file or a Robot; the scenario's values take precedence."""
    other = tmp_path / "other.toml"
    other.write_text(
        replace_values(
            show_robot(DEFAULT, capsys),
            gear_friction_nm="0.01",
            rolling_resistance="0.15",
            encoder_counts="1024",
        )
    )
    chosen = om.load_scenario("rect", robot=other, carpet={"friction": 0.6}).settings
    assert chosen.drivetrain.gear_friction_nm == 0.01
    assert chosen.sensors.encoder_counts == 1024
    assert (chosen.carpet.rolling_resistance, chosen.carpet.friction) == (0.15, 0.6)
    robot, carpet = om.load_robot(other), {"rolling_resistance": 0.2}
    chosen = om.load_scenario("rect", robot=robot, carpet=carpet).settings
    assert chosen.carpet.rolling_resistance == 0.2
    assert om.load_scenario("rect", robot=DEFAULT) == om.load_scenario("rect")
    other.write_text(replace_values(show_robot(DEFAULT, capsys), rolling_resistance="0.25"))
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
def test_error_in_a_robot_file_is_one_line(
    values: dict[str, str],
    more: str,
    words: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    wrong = tmp_path / "wrong.toml"
    text = replace_values(show_robot(DEFAULT, capsys), **values)
    wrong.write_text(f"{text}\n{more}")
    with pytest.raises(om.OmniError) as error:
        om.load_scenario("rect", robot=str(wrong))
    assert words in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ROBOTS)
def test_numbers_of_every_robot_are_consistent(name: str) -> None:
    """Check relations of cells and voltage, body and wheels, motor and battery, and frictions."""
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
    # At 3 m/s, about the paper's limit of speed, the back-EMF is below the nominal voltage.
    back_emf = s.motor.wheel_back_emf_v_s * 3.0 / s.wheels.radius_m
    assert back_emf < s.firmware.nominal_voltage_v


def find_error(**sections: Any) -> str:
    """Return the error message of a scenario with these sections; empty without an error."""
    try:
        om.load_scenario("rect", **sections)
    except om.OmniError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({"wheels": {"rollers": 8, "roller_radius_m": 0.002}}, "take at least 9"),
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
            "motor.nominal_rpm and motor.nominal_current_a need",
        ),
        (
            {"motor": {"no_load_rpm": 5500.0}},
            "motor.no_load_rpm and motor.no_load_current_a need",
        ),
        ({"motor": {"nominal_torque_nm": 1.0}}, "is not motor.torque_constant_nm_a times"),
    ],
)
def test_contradictory_robots_are_rejected_with_the_reason(
    sections: dict[str, Any], words: str
) -> None:
    assert words in find_error(**sections)


@quick
@given(st.floats(0.02, 0.05), st.floats(0.08, 0.4), st.integers(8, 40))
def test_rollers_must_close_a_wheel(radius: float, radius_ratio: float, count: int) -> None:
    """Halfway between rollers, their profile must be outside their axes, chords at R - r."""
    closes = math.cos(math.pi / count) * radius > radius * (1 - radius_ratio)
    wheels = {
        "radius_m": radius,
        "rollers": count,
        "roller_radius_m": max(radius_ratio * radius, 0.002),
        "arm_m": 0.4,
    }
    if radius_ratio * radius >= 0.002:
        assert ("do not close a wheel" in find_error(wheels=wheels)) != closes


@quick
@given(angles, st.floats(-0.09, 0.09))
def test_center_of_mass_must_be_supported(azimuths: list[float], x: float) -> None:
    """Compare with linear programming: nonnegative loads that balance weight and moments."""
    from scipy.optimize import linprog

    arm, angles_rad = 0.4, np.sort(np.radians(azimuths))
    if np.diff([*angles_rad, angles_rad[0] + math.tau]).min() < 0.2:
        return
    balance = np.stack(
        [np.ones(len(angles_rad)), arm * np.cos(angles_rad), arm * np.sin(angles_rad)]
    )
    is_supported = linprog(np.zeros(len(angles_rad)), A_eq=balance, b_eq=[1.0, x, 0.0]).status == 0
    message = find_error(wheels={"azimuths_deg": azimuths, "arm_m": arm}, body={"com_x_m": x})
    assert ("outside the polygon" in message) != is_supported or abs(
        float(message.split(" is ")[1].split(" mm")[0])
    ) < 1e-3


# Assumptions of the team.


def simulate(robot: str, commands: NDArray) -> tuple[NDArray, NDArray]:
    """Return poses and twists after each of the commands (frames, n, 3), without vision noise."""
    vision = {"position_noise_m": 0.0}
    scenario = om.load_scenario("rect", plant="planar", robot=robot, vision=vision)
    simulation = om.Simulation(scenario, ["p"], seeds=range(commands.shape[1]))
    poses, twists = [], []
    for command in commands:
        simulation.observe()
        simulation.step(command)
        poses.append(simulation.plant.pose())
        twists.append(simulation.plant.twist())
    return np.array(poses), np.array(twists)


def test_traction_limits_are_those_against_drag() -> None:
    """Figures of docs/explanation/physics.md for tigers-v2016."""
    facts = om.load_robot("tigers-v2016").facts
    limits = facts["traction_limit_forward_m_s2"], facts["traction_limit_sideways_m_s2"]
    assert limits == pytest.approx((4.7, 2.36), abs=0.03)
    asked = om.load_scenario("league").settings.reference.max_sideways_acceleration_m_s2
    assert asked / limits[1] == pytest.approx(0.64, abs=0.01)


@cache
def measure_lag_and_friction_loss(robot: str) -> list[tuple[float, float]]:
    """Return lag, s, and friction loss, m/s, forward and sideways, by small steps of speed.

    After a step of a first-order system, the missing distance is the step times the sum of lag and
    dead time. Creep adds a lag in proportion to speed. Dry friction costs the same speed always. So
    both results are values extrapolated to rest: of lag over speed, and of speed over command.
    """
    frames_before, frames_after, delay, step = 120, 60, 6, 0.04
    base = np.linspace(0.25, 0.45, 5)  # well above the friction loss
    cases = [(axis, sign * step, speed) for axis in (0, 1) for sign in (1, -1) for speed in base]
    rows, axes = np.arange(len(cases)), np.array([axis for axis, _, _ in cases])
    commands = np.zeros((frames_before + frames_after + 20, len(cases), 3))
    commands[:, rows, axes] = [speed for _, _, speed in cases]
    commands[frames_before:, rows, axes] += [change for _, change, _ in cases]
    positions, speeds = (values[:, rows, axes] for values in simulate(robot, commands))
    start_speeds = speeds[frames_before - 20 : frames_before].mean(0)
    end_speeds = speeds[-20:].mean(0)
    distance = positions[frames_before + frames_after - 1] - positions[frames_before - 1]
    lag_s = (end_speeds * frames_after / 60 - distance) / (end_speeds - start_speeds) - delay / 60
    lags, starts = (values.reshape(2, 2, len(base)).mean(1) for values in (lag_s, start_speeds))
    return [
        (float(np.polyfit(speed, lag, 1)[1]), -float(np.polyfit(base, speed, 1)[1]))
        for lag, speed in zip(lags, starts, strict=True)
    ]


def test_closed_form_of_lag_and_friction_loss_matches_simulation() -> None:
    """Allow 20 and 25 % for rotor inertia and other effects that the formulas neglect."""
    facts = om.load_robot("tigers-v2020").facts
    for side, (lag, friction_loss) in zip(
        ("forward", "sideways"), measure_lag_and_friction_loss("tigers-v2020"), strict=True
    ):
        assert facts[f"lag_{side}_s"] == pytest.approx(lag, rel=0.2)
        assert facts[f"friction_loss_{side}_m_s"] == pytest.approx(friction_loss, rel=0.25)


@pytest.mark.parametrize("name", ROBOTS)
def test_assumptions_match_the_simulated_robot(name: str) -> None:
    """Lag and friction loss are means of both axes. Alpha is that at 1 m/s without dry friction.

    With integral action, alpha is unknown. Files may replace these values by measured ones.
    """
    robot = om.load_robot(name)
    facts, assumed = robot.facts, robot.settings.control
    assert om.load_scenario("rect", robot=name).settings.control == assumed
    if robot.settings.firmware.ki:
        assert (assumed.assumed_alpha_forward, assumed.assumed_alpha_sideways) == (0, 0)
        return
    assert assumed.assumed_lag_s == pytest.approx(
        (facts["lag_forward_s"] + facts["lag_sideways_s"]) / 2, rel=0.25
    )
    assert assumed.assumed_friction_loss_m_s == pytest.approx(
        (facts["friction_loss_forward_m_s"] + facts["friction_loss_sideways_m_s"]) / 2, abs=1e-3
    )
    _, twists = simulate(name, np.tile(np.eye(3)[:2], (90, 1, 1)))
    reached = np.diag(twists[-1, :, :2])
    reached = reached / (
        1 - np.array([facts["friction_loss_forward_m_s"], facts["friction_loss_sideways_m_s"]])
    )
    assert (assumed.assumed_alpha_forward, assumed.assumed_alpha_sideways) == pytest.approx(
        tuple(reached), abs=0.015
    )


def test_assumptions_follow_the_robot_file_and_ignore_the_scenario(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The lag of softer loops is inversely proportional to gain plus back-EMF constant."""
    text = replace_values(show_robot("tigers-v2020", capsys)).partition("\n[control]")[0]
    robot_file = tmp_path / "soft.toml"
    robot_file.write_text(replace_values(text, kp="0.2"))
    robot = om.load_robot("tigers-v2020").settings
    emf = robot.motor.wheel_back_emf_v_s
    assert om.load_robot(robot_file).settings.control.assumed_lag_s == pytest.approx(
        robot.control.assumed_lag_s * (0.4 + emf) / (0.2 + emf), rel=2e-3
    )
    robot_file.write_text(text + "\n[control]\nassumed_lag_s = 0.07\n")
    assert om.load_robot(robot_file).settings.control.assumed_lag_s == 0.07
    assert (
        om.load_robot(robot_file).settings.control.assumed_friction_loss_m_s
        == robot.control.assumed_friction_loss_m_s
    )
    assert (
        om.load_scenario(
            "rect", robot=robot_file, control={"assumed_lag_s": 0.03}
        ).settings.control.assumed_lag_s
        == 0.03
    )
    assert (
        om.load_scenario("roller-debris").settings.control
        == om.load_scenario("rect").settings.control
    )


def test_assumed_alpha_scales_with_assumed_creep() -> None:
    """Without creep, alpha is 1. With half of the creep, 1/alpha - 1 is half as large."""
    full = om.load_scenario("rect").settings.control.assumed_creep_s2_m
    assumed = [
        om.load_scenario("rect", control={"assumed_creep_s2_m": creep}).settings.control
        for creep in (0.0, full / 2, full)
    ]
    inverse_gains = np.array(
        [
            [1 / control.assumed_alpha_forward, 1 / control.assumed_alpha_sideways]
            for control in assumed
        ]
    )
    np.testing.assert_allclose(inverse_gains[0], 1.0, atol=1e-12)
    np.testing.assert_allclose(
        2 * (inverse_gains[1] - 1), inverse_gains[2] - 1, atol=2e-3
    )  # rounded to 0.001
    assert assumed[2] == om.load_scenario("rect").settings.control


def test_toml_may_have_a_byte_order_mark(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """UTF-16, which other editors write, is one line on stderr."""
    text = (Path(om.__file__).parent / "robots" / f"{DEFAULT}.toml").read_text("utf-8")
    robot, scenario = tmp_path / "robot.toml", tmp_path / "scenario.toml"
    robot.write_text(text, "utf-8-sig")
    scenario.write_text('plant = "kinematic"', "utf-8-sig")
    assert om.load_robot(str(robot)).settings == om.load_robot(DEFAULT).settings
    assert om.load_scenario(scenario).plant == "kinematic"
    for encoding in ("utf-16", "utf-16-be"):
        robot.write_text(text, encoding)
        assert invoke("show", robot) == 2
        error = capsys.readouterr().err
        assert "UTF-16; save it as UTF-8" in error
        assert error.count("\n") == 1


@pytest.mark.parametrize("ratio", [0.3, 1 / 3.6, 0.999])
def test_a_gear_written_the_other_way_round_is_named(ratio: float) -> None:
    """With its inverse, which is allowed."""
    message = find_error(motor={"gear_ratio": ratio})
    assert f"not {ratio!r}; did you mean {1 / ratio:.3g}?" in message
    assert not find_error(motor={"gear_ratio": float(f"{1 / ratio:.3g}")})


def test_azimuths_in_other_conventions_are_named() -> None:
    """Radians, directions of rolling, from the left; not other orders of valid layouts."""
    for azimuths, meant in (
        ([1.047, 2.356, 3.927, 5.236], "[60.0, 135.0, 225.0, 300.0]?"),
        ([-30, 45, 135, 210], "or [60.0, 135.0, 225.0, 300.0]?"),
        ([30, 150, 270], "[300.0, 60.0, 180.0] or"),
    ):
        with warnings.catch_warnings(record=True) as caught:
            message = find_error(wheels={"azimuths_deg": azimuths})
        assert meant in message + "".join(str(warning.message) for warning in caught)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for n in range(3, 9):
            layout = [360 / n * (i + 0.5) for i in range(n)]
            assert not find_error(wheels={"azimuths_deg": layout[1:] + layout[:1]})
            assert not find_error(wheels={"azimuths_deg": [-azimuth for azimuth in layout]})
        assert not find_error(wheels={"azimuths_deg": [50, 130, 200, 330]})
    assert "(0 to 0.001 kg m^2), not 0.135" in find_error(motor={"rotor_inertia_kg_m2": 0.135})


def test_long_lists_of_wrong_values_stop_at_the_first_few() -> None:
    """Of each setting, but all settings are named."""
    message = find_error(reference={"waypoints": [["x", 0]] * 5000}, radio={"delay_frames": -1})
    lines = message.splitlines()
    assert len(lines) < 20
    assert any(line.startswith("and 49") for line in lines)
    assert "radio.delay_frames" in message
