"""Teams of different robots in one world: each is the one that its file says, whoever stands beside it."""

import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from benches.serve import FAST, QUIET, Field
from serving import BLUE, YELLOW, local, wheels

import omni_mj as om
from omni_control.errors import OmniError

OLD, NEW = "tigers-v2016", "tigers-v2020"  # of other masses, wheels, gears, motors and batteries
SOLVED_M = 1e-5  # one solver for all robots of a world, whose iterations end a little elsewhere with others in it
CURVE = local(0, 0.6, 0.3, 1.5)


def robot(folder: Path, changes: dict[str, str]) -> str:
    """The file of a robot that differs from a v2016 in lines of its file."""
    text = (Path(om.__file__).parent / "robots" / f"{OLD}.toml").read_text()
    for pattern, new in changes.items():
        text, count = re.subn(rf"^{pattern}", new, text, flags=re.MULTILINE)
        assert count == 1, pattern
    file = folder / "other.toml"
    file.write_text(text)
    return str(file)


@pytest.fixture
def three(tmp_path: Path) -> str:
    """The file of a v2016 with three wheels and more mass."""
    return robot(tmp_path, {r"azimuths_deg = .*": "azimuths_deg = [60, 180, 300]", r"mass_kg = \S+": "mass_kg = 4.1"})


def test_a_robot_drives_among_others_as_it_does_among_its_own(three: str) -> None:
    """Blue drives as blue of a world of its kind, yellow as yellow of one of its own, and they are told apart."""
    mixed, *alike = (
        Field(*QUIET, FAST, yellow="1", robot=blue, yellow_robot=yellow)
        for blue, yellow in ((NEW, three), (NEW, NEW), (three, three))
    )
    for field in (mixed, *alike):
        field.drive(30, CURVE, CURVE)
    np.testing.assert_allclose(mixed.poses, [alike[0].poses[0], alike[1].poses[1]], atol=SOLVED_M)
    assert np.abs(alike[0].poses - alike[1].poses).max() > 5e-3, "the kinds do not drive alike"
    ours, own = mixed.telemetry, [field.telemetry for field in alike]
    np.testing.assert_allclose(ours.battery, [own[0].battery[0], own[1].battery[1]], atol=1e-3)
    np.testing.assert_allclose(ours.current_mean[1, :3], own[1].current_mean[1], atol=0.01)
    assert np.isnan(ours.current_mean[1, 3])  # of the wheel that it does not have


def test_rim_speeds_are_of_robots_with_four_wheels(three: str) -> None:
    field = Field(*QUIET, FAST, yellow="1", robot=NEW, yellow_robot=three)
    turn = wheels(0, 0.1, 0.1, 0.1, 0.1)
    assert field.command(turn, YELLOW) == ["WHEELS"]
    field.drive(30, turn, local(0, 0.0, 0.0, 1.0))
    assert (field.twists[:, 2] > 0.5).all()  # counter-clockwise


def test_a_robot_that_takes_the_place_of_one_of_the_other_team_has_its_own_wheels(three: str, tmp_path: Path) -> None:
    """And the table has nothing of wheels that a robot does not have."""
    field = Field(*QUIET, FAST, blue="11", yellow="1", robot=NEW, yellow_robot=three)
    assert field.put(5, 3.0, 1.0, 0.5, team=YELLOW) == ["TOO_MANY"]  # twelve at most
    assert field.place({}, away=[(BLUE, 3)]) == []
    before = field.poses
    assert field.put(5, 3.0, 1.0, 0.5, team=YELLOW) == []
    np.testing.assert_allclose(field.poses[:-1], before, atol=1e-12)
    field.record(tmp_path / "trajectory.parquet")
    field.drive(20, yellow=local(5, 0.8))
    field.finish()
    assert np.hypot(*(field.poses[-1, :2] - [3.0, 1.0])) > 0.1
    assert field.upright
    table = pl.read_parquet(tmp_path / "trajectory.parquet").filter(pl.col("frame") == 20)
    fourth = dict(table.group_by("controller").agg(pl.col("voltage_4_v").is_nan().all()).iter_rows())
    assert fourth == {"blue": False, "yellow": True}


def test_wheels_that_creep_and_wheels_that_do_not_take_two_worlds(tmp_path: Path) -> None:
    file = robot(tmp_path, {r"\[wheels\]": '[wheels]\ncreep = "off"'})
    with pytest.raises(OmniError, match=r"--yellow-robot .*: robots of one world have the same wheels\.creep"):
        Field(yellow="1", robot=NEW, yellow_robot=file)


def test_a_carpet_leans_under_both_teams(tmp_path: Path) -> None:
    """By 20 degrees: robots whose motors are off roll down, slower than a thing that slides without friction."""
    file = tmp_path / "slope.toml"
    file.write_text('[[fault]]\nkind = "tilt"\nat = 0.0\nangle_deg = 20.0\n')
    field = Field(*QUIET, FAST, yellow="1", robot=OLD, yellow_robot=NEW, scenario=str(file))
    field.release()
    field.drive(15)
    rolled = field.twists[:, 0]
    assert (rolled > 0.05).all()
    assert (rolled < 9.81 * np.sin(np.radians(20)) * 15 / 60).all()


def test_a_world_that_becomes_unstable_goes_on_from_where_both_teams_last_were(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # where MuJoCo logs its warnings
    field = Field(*QUIET, FAST, yellow="2", robot=OLD, yellow_robot=NEW)
    field.drive(30, CURVE, CURVE)
    assert field.place({}, away=[(YELLOW, 1)]) == []
    before = field.poses
    field.break_physics()
    field.drive(1, CURVE, CURVE)
    np.testing.assert_allclose(field.poses, before, atol=1e-12)
    field.drive(20, CURVE, CURVE)
    assert field.upright
    assert (np.hypot(*(field.poses - before)[:, :2].T) > 0.05).all()
