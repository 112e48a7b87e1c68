"""Robots by name or file: what their files give for settings."""

import tomllib
from pathlib import Path

import pytest

from omni_control.errors import OmniError
from omni_mj import robots as shipped
from omni_mj.scenarios import robots, scenario
from omni_mj.scenarios.settings import Settings
from omni_mj.worlds import build

DEFAULT = shipped.builtin()[robots.DEFAULT].read_text()


def changed(text: str, **values: str) -> str:
    """A robot's file with the values of some fields replaced, or with the fields gone where they are empty."""
    lines = []
    for line in text.splitlines():
        name = line.partition("=")[0].strip()
        if name not in values:
            lines.append(line)
        elif values[name]:
            lines.append(f"{name} = {values[name]}")
    return "\n".join(lines)


@pytest.fixture
def other(tmp_path: Path) -> Path:
    path = tmp_path / "other.toml"
    path.write_text(changed(DEFAULT, gear_friction_nm="0.01", pile="0.15", encoder_counts="1024"))
    return path


def test_the_default_robot_is_what_settings_are_by_default() -> None:
    settings = Settings()
    for section, fields in robots.sections(robots.DEFAULT).items():
        for field, value in fields.items():
            given = getattr(getattr(settings, section), field)
            assert given == (tuple(value) if isinstance(value, list) else value), (section, field)


def test_seven_robots_come_along() -> None:
    tigers = {"tigers-v2016", "tigers-v2020", "tigers-v2020-planetary"}
    assert set(shipped.builtin()) == tigers | {"robojackets", "roboteam-twente", "ssl-a-team", "ubc-thunderbots"}


@pytest.mark.parametrize("name", shipped.builtin())
def test_every_robot_that_comes_along_is_whole_and_drives_what_it_says(name: str) -> None:
    assert robots.description(name)
    made = scenario.scenario("rect", robot=name)
    assert made.robot == name
    for section, fields in robots.sections(name).items():
        for field, value in fields.items():
            given = getattr(getattr(made.settings, section), field)
            assert given == (tuple(value) if isinstance(value, list) else value), (section, field)


@pytest.mark.parametrize("name", shipped.builtin())
def test_every_robots_numbers_fit_together(name: str) -> None:
    """What one number says of another: cells and volts, body and wheels, motor and battery, drags and friction."""
    s = scenario.scenario("rect", robot=name).settings
    assert s.firmware.nominal_voltage_v == pytest.approx(3.7 * s.battery.cells)  # LiPo
    assert 3.0 * s.battery.cells <= s.battery.cut_off_v <= 3.5 * s.battery.cells
    # A disc whose mass is within the wheels: 1/2 m r^2 with the arm as r at least, a ring's m r^2 at most.
    disc = s.body.mass_kg * s.wheels.arm_m**2
    assert 0.5 * disc < s.body.yaw_inertia_kg_m2 < disc
    # In every direction along the floor half of a flat disc's, and more for its height.
    assert s.body.tilt_inertia_kg_m2 > s.body.yaw_inertia_kg_m2 / 2
    assert s.drive.roller_friction < s.carpet.friction
    # The league's limit (SSL rules): 180 mm across.
    assert s.wheels.arm_m < 0.09
    # At the nominal battery it reaches the reference's speed in its fastest direction: back-EMF of the motor at 3 m/s.
    rotor = 3.0 / s.wheels.radius_m * s.motor.gear
    assert s.motor.constant_nm_a * rotor < s.firmware.nominal_voltage_v
    # And it is built and stands with its weight on its wheels.
    world = build.world(s)
    assert world.weight == pytest.approx(s.body.mass_kg * 9.81, rel=1e-9)
    assert world.kinematics.arm == s.wheels.arm_m


def test_a_robot_is_a_name_or_a_file(other: Path) -> None:
    assert robots.robot_path(robots.DEFAULT) == shipped.builtin()[robots.DEFAULT]
    assert robots.robot_path(str(other)) == other
    for wrong, says in (
        ("tigers-v201", "unknown robot 'tigers-v201'; did you mean 'tigers-v2016'"),
        ("nowhere/mine.toml", "there is no robot's file nowhere/mine.toml"),
        ("models/ssl_robot.xml", r"a robot is a \.toml file of settings, not 'models/ssl_robot\.xml'; choose from "),
    ):
        with pytest.raises(OmniError, match=f"^{says}.*$"):
            scenario.scenario("rect", robot=wrong)


def test_another_robots_numbers_are_the_base_of_its_scenarios(other: Path) -> None:
    made = scenario.scenario("rect", robot=str(other), carpet={"friction": 0.6})
    assert (made.settings.drive.gear_friction_nm, made.settings.sensors.encoder_counts) == (0.01, 1024)
    assert (made.settings.carpet.pile, made.settings.carpet.friction) == (0.15, 0.6)
    assert scenario.scenario("rect", robot=str(other), carpet={"pile": 0.2}).settings.carpet.pile == 0.2
    assert scenario.load("rect", ["carpet.pile=0.3"], {"robot": str(other)}).settings.carpet.pile == 0.3
    assert scenario.scenario("rect", robot=robots.DEFAULT) == scenario.scenario("rect")
    with pytest.raises(OmniError, match="another robot has other settings"):
        made.replace(robot=robots.DEFAULT)


def test_a_robots_file_that_has_changed_is_read_again(other: Path) -> None:
    assert scenario.scenario("rect", robot=str(other)).settings.carpet.pile == 0.15
    other.write_text(changed(DEFAULT, pile="0.25"))
    assert scenario.scenario("rect", robot=str(other)).settings.carpet.pile == 0.25


def test_what_is_wrong_in_a_robots_file_is_said_in_a_line(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.toml"
    for text, says in (
        (changed(DEFAULT, pile=""), "carpet.pile depends on the robot; give it in the scenario, or in "),
        (changed(DEFAULT, pile="-1"), "carpet.pile must be a number from 0 to 1, not -1"),
        (changed(DEFAULT, pile="[0.1, 0.2]"), "carpet.pile must be a number from 0 to 1, not [0.1, 0.2]"),
        (changed(DEFAULT, azimuths_deg="[0, 180]"), "wheels.azimuths_deg must be a list of 3 to 8 numbers in deg"),
        (f"{DEFAULT}\npyle = 0.1", "unknown setting carpet.pyle; did you mean 'carpet.pile'"),
        (f"{DEFAULT}\n[motr]\ngear = 3", "unknown section motr; did you mean 'motor'"),
        (f"mass_kg = 3\n{DEFAULT}", "the robot's file "),
        ("[body", f"the robot's file {wrong} is not valid TOML"),
    ):
        wrong.write_text(text)
        robots._read.cache_clear()  # files that are written within a tick of the file system's clock
        with pytest.raises(OmniError) as error:
            scenario.scenario("rect", robot=str(wrong))
        assert str(error.value).startswith(says)
        assert "\n" not in str(error.value)
    wrong.write_text(changed(DEFAULT, pile=""))
    robots._read.cache_clear()
    assert scenario.scenario("rect", robot=str(wrong), carpet={"pile": 0.2}).settings.carpet.pile == 0.2


def test_the_files_repeat_no_section_and_no_default_of_another_home() -> None:
    """Each number of a robot stands in its file alone, and each file gives what depends on the robot.

    What its team is told follows from these.
    """
    sections = robots.sections(robots.DEFAULT).items()
    needed = {(section, field) for section, fields in sections for field in fields if section != "control"}
    for path in shipped.builtin().values():
        data = tomllib.loads(path.read_text())
        given = {(s, f) for s, fields in data.items() if isinstance(fields, dict) for f in fields}
        assert given >= needed, path
