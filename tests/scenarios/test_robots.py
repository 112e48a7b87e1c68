"""Robots by name or file: what their models give for settings."""

import shutil
from pathlib import Path

import pytest

from omni_control.errors import OmniError
from omni_mj.scenarios import models, robots, scenario
from omni_mj.scenarios.settings import Settings

OTHER = """<mujoco><custom>
  <numeric name="motor_friction" data="0.1 0.2"/>
  <numeric name="drive.gear_friction_nm" data="0.01"/>
  <numeric name="drive.roller_damping_nm_s" data="0"/>
  <numeric name="sensors.encoder_counts" data="1024"/>
  {}
</custom></mujoco>"""
LINT = '<numeric name="carpet.lint" data="1e-1"/>'


@pytest.fixture
def other(tmp_path: Path) -> Path:
    path = tmp_path / "other.xml"
    path.write_text(OTHER.format(LINT))
    return path


def test_what_a_model_gives_is_the_default_and_no_setting_overrules_it() -> None:
    """The default robot's numbers: what its owners measured or its datasheet says; see the model."""
    numbers = robots.numbers("ssl_robot")
    assert numbers == {
        "motor_friction": 0.02856, "drive.gear_friction_nm": 0.003, "drive.roller_damping_nm_s": 2e-6,
        "carpet.lint": 0.065,
    }  # fmt: skip
    settings = Settings()
    for name in numbers.keys() - {"motor_friction"}:
        section, field = name.split(".")
        assert getattr(getattr(settings, section), field) == numbers[name]


def test_a_robot_is_a_name_or_a_file(other: Path) -> None:
    assert models.names() == ["ssl_robot"]
    assert models.model_path("ssl_robot") == models.folder() / "ssl_robot.xml"
    assert models.model_path(str(other)) == other


def test_another_robots_numbers_are_the_base_of_its_scenarios(other: Path) -> None:
    made = scenario.scenario("lint", robot=str(other))
    assert made.settings.drive.gear_friction_nm == 0.01
    assert made.settings.sensors.encoder_counts == 1024
    assert made.settings.carpet.lint == 0.2  # the scenario's own
    rect = scenario.scenario("rect", robot=str(other))
    assert rect.settings.carpet.lint == 0.1
    assert scenario.scenario("rect", robot="ssl_robot") == scenario.scenario("rect")
    with pytest.raises(OmniError, match="another robot has other settings"):
        rect.replace(robot="ssl_robot")


def test_what_is_wrong_in_a_model_is_said(other: Path, tmp_path: Path) -> None:
    for custom, says in {
        "": "carpet.lint depends on the robot; give it in the scenario, or under <custom> in ",
        LINT.replace("lint", "lnt"): "carpet.lint depends on the robot",
        LINT.replace("1e-1", "-1"): "carpet.lint must be a number from 0 to 1, not -1",
        LINT.replace("1e-1", "0.1 0.2"): f"carpet.lint in {tmp_path / 'wrong.xml'} must be one number, not '0.1 0.2'",
        LINT + '<numeric name="drive.gear" data="1"/>': "unknown setting drive.gear; did you mean 'drive.gear_fric",
        LINT + "<": "cannot read the robot's model ",
    }.items():
        wrong = tmp_path / "wrong.xml"
        wrong.unlink(missing_ok=True)
        shutil.copy(other, wrong)
        wrong.write_text(OTHER.format(custom))
        with pytest.raises(OmniError) as error:
            scenario.scenario("rect", robot=str(wrong))
        assert str(error.value).startswith(says)
        assert "\n" not in str(error.value)
    assert scenario.scenario("lint", robot=str(other)).settings.carpet.lint == 0.2
