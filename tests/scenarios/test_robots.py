"""Robots by name or file: what their files give for settings."""

import tomllib
from pathlib import Path

import pytest

from omni_control.errors import OmniError
from omni_mj import robots as shipped
from omni_mj.scenarios import robots, scenario
from omni_mj.scenarios.settings import Settings

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
    path.write_text(changed(DEFAULT, gear_friction_nm="0.01", pile="0.15") + "\n[sensors]\nencoder_counts = 1024\n")
    return path


def test_the_default_robot_is_what_settings_are_by_default() -> None:
    settings = Settings()
    for section, fields in robots.sections(robots.DEFAULT).items():
        for field, value in fields.items():
            given = getattr(getattr(settings, section), field)
            assert given == (tuple(value) if isinstance(value, list) else value), (section, field)


def test_every_robot_that_comes_along_is_whole_and_says_what_it_is() -> None:
    for name in shipped.builtin():
        assert robots.description(name)
        assert scenario.scenario("rect", robot=name).robot == name


def test_a_robot_is_a_name_or_a_file(other: Path) -> None:
    assert robots.robot_path(robots.DEFAULT) == shipped.builtin()[robots.DEFAULT]
    assert robots.robot_path(str(other)) == other
    for wrong, says in (
        ("tigers-v201", "unknown robot 'tigers-v201'; did you mean 'tigers-v2016'"),
        ("nowhere/mine.toml", "there is no robot's file nowhere/mine.toml"),
    ):
        with pytest.raises(OmniError, match=says):
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
    """Each number of a robot stands in its file alone, and each file gives what depends on the robot."""
    needed = {(section, field) for section, fields in robots.sections(robots.DEFAULT).items() for field in fields}
    for path in shipped.builtin().values():
        data = tomllib.loads(path.read_text())
        given = {(s, f) for s, fields in data.items() if isinstance(fields, dict) for f in fields}
        assert given >= needed, path
