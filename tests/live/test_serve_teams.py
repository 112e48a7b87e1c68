"""Teams of different robots in one world: each is the one that its file says, whoever stands beside it."""

import re
from pathlib import Path

import numpy as np
import pytest
from served import FAST, QUIET, drive, local, pitch_of, put, rims

import omni_mj as om
from omni_control.errors import OmniError
from omni_mj.live.serve.log import Block, Tape
from omni_mj.live.serve.pitch import Pitch
from omni_mj.live.wire.simulation import Team

OLD, NEW = "tigers-v2016", "tigers-v2020"  # of other masses, wheels, gears, motors and batteries
SOLVED_M = 1e-5  # one solver for all robots of a world, whose iterations end a little elsewhere with others in it


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


def driven(pitch: Pitch, frames: int = 30) -> Pitch:
    """Both teams drive a curve, forward and to the left in their own axes."""
    command = local(0, 0.6, 0.3, 1.5)
    drive(pitch, frames, command, yellow=(command,))
    return pitch


@pytest.mark.parametrize("kernel", ["numpy", "jax"])
def test_a_robot_drives_among_others_as_it_does_among_its_own(three: str, kernel: str) -> None:
    """Blue drives as blue of a world of its kind, yellow as yellow of one of its own, and they are told apart."""
    if kernel == "numba":
        pytest.importorskip("numba")
    sets = *QUIET, FAST, f"physics.kernel={kernel}"
    mixed, *alike = (
        driven(pitch_of(*sets, yellow="1", robot=blue, yellow_robot=yellow))
        for blue, yellow in ((NEW, three), (NEW, NEW), (three, three))
    )
    both = [pitch.plant for pitch in alike]
    np.testing.assert_allclose(mixed.plant.pose(), [both[0].pose()[0], both[1].pose()[1]], atol=SOLVED_M)
    assert np.abs(both[0].pose() - both[1].pose()).max() > 5e-3, "the kinds do not drive alike"
    told, own = mixed.plant.telemetry(), [plant.telemetry() for plant in both]
    np.testing.assert_allclose(told.battery, [own[0].battery[0], own[1].battery[1]], atol=1e-3)
    np.testing.assert_allclose(told.current_mean[1, :3], own[1].current_mean[1], atol=0.01)
    assert np.isnan(told.current_mean[1, 3])  # of the wheel that it does not have
    assert mixed.plant.wheels == [4, 3]


def test_a_heavy_robot_pushes_a_light_one(three: str) -> None:
    """They roll into each other at the same speed: together they keep the momentum of the heavier one."""
    pitch = pitch_of(*QUIET, FAST, "firmware.timeout_s=0.05", yellow="1", robot=OLD, yellow_robot=three)
    model = pitch.plant.squads[0]._world.model
    masses = [model.body_subtreemass[squad._world.robots[0].chassis] for squad in pitch.plant.squads]
    assert masses == pytest.approx([2.65, 4.1])
    for squad in pitch.plant.squads:
        squad.hold(np.zeros_like(squad.telemetry().current))
    assert put(pitch, 0, -0.1, 0.0, 0.0, twist=(1.0, 0.0, 0.0)) == []
    assert put(pitch, 0, 0.1, 0.0, np.pi, team=Team.YELLOW, twist=(-1.0, 0.0, 0.0)) == []
    before = np.array(masses) @ pitch.plant.twist()[:, 0]
    drive(pitch, 2)
    after = pitch.plant.twist()[:, 0]
    # Not counted: creep and drag in two frames, and rotors, which by their gears weigh another 0.4 kg a robot. Of
    # robots that weigh the same nothing would be left.
    assert np.array(masses) @ after == pytest.approx(before, rel=0.35)
    assert before == pytest.approx(2.65 - 4.1)


def test_rim_speeds_are_of_robots_with_four_wheels(three: str) -> None:
    pitch = pitch_of(*QUIET, FAST, yellow="1", robot=NEW, yellow_robot=three)
    assert [refusal.code for refusal in pitch.command(Team.YELLOW, [rims(0, 0.1, 0.1, 0.1, 0.1)])[0]] == ["WHEELS"]
    drive(pitch, 30, rims(0, 0.1, 0.1, 0.1, 0.1), yellow=(local(0, 0.0, 0.0, 1.0),))
    assert (pitch.plant.twist()[:, 2] > 0.5).all()


def test_whoever_takes_the_body_of_the_other_team_s_robot_is_its_own_team_s(three: str) -> None:
    """A world has 12 bodies; one that a blue robot leaves becomes a yellow one, with three wheels."""
    pitch = pitch_of(*QUIET, FAST, blue="11", yellow="1", robot=NEW, yellow_robot=three)
    assert pitch.place({}, {(Team.BLUE, 3)}) == []
    before = np.delete(pitch.plant.pose(), 3, axis=0)
    assert put(pitch, 5, 3.0, 1.0, 0.5, team=Team.YELLOW) == []
    assert pitch.plant.wheels == [4, 4, 4, 3, *[4] * 7, 3]
    np.testing.assert_allclose(np.delete(pitch.plant.pose(), 3, axis=0), before, atol=1e-12)
    drive(pitch, 20, yellow=(local(5, 0.8),))
    assert np.hypot(*(pitch.plant.pose()[3, :2] - [3.0, 1.0])) > 0.1
    assert pitch.plant.driven.all()


def test_wheels_that_a_robot_does_not_have_are_recorded_as_nothing(three: str) -> None:
    pitch, blocks = pitch_of(*QUIET, FAST, yellow="1", robot=three, yellow_robot=NEW), list[Block]()
    tape = Tape(pitch, [blocks.append])
    drive(pitch, 1, local(0, 0.5))
    tape.add()
    tape.flush()
    (voltages,) = blocks[0].log.channel("voltage")
    missing = {name: np.isnan(voltage).tolist() for name, voltage in zip(blocks[0].names, voltages, strict=True)}
    assert missing == {"blue 0": [False, False, False, True], "yellow 0": [False] * 4}


def test_wheels_that_creep_and_wheels_that_do_not_take_two_worlds(tmp_path: Path) -> None:
    file = robot(tmp_path, {r"\[wheels\]": '[wheels]\ncreep = "off"'})
    with pytest.raises(OmniError, match=r"--yellow-robot .*: robots of one world have the same wheels\.creep"):
        pitch_of(yellow="1", robot=NEW, yellow_robot=file)


def test_a_carpet_leans_under_both_teams_or_under_neither(tmp_path: Path) -> None:
    """By 20 degrees: robots whose motors are off roll down, slower than a thing that slides without friction."""
    file = tmp_path / "slope.toml"
    tilt = '[[fault]]\nkind = "tilt"\nat = 0.0\nangle_deg = 20.0\n'
    file.write_text(tilt)
    pitch = pitch_of(*QUIET, FAST, yellow="1", robot=OLD, yellow_robot=NEW, scenario=str(file))
    for squad in pitch.plant.squads:
        squad.hold(np.zeros((1, 4)))  # no currents: robots roll
    drive(pitch, 15)
    rolled = pitch.plant.twist()[:, 0]
    assert (rolled > 0.05).all()
    assert (rolled < 9.81 * np.sin(np.radians(20)) * 15 / 60).all()
    file.write_text(f"{tilt}robots = [0]\n")
    with pytest.raises(OmniError, match="their faults must have the same tilts"):
        pitch_of(blue="0,", yellow="1,", robot=OLD, yellow_robot=NEW, scenario=str(file))


def test_a_world_that_becomes_unstable_goes_on_from_where_both_teams_last_were(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # where MuJoCo logs its warnings
    pitch = driven(pitch_of(*QUIET, FAST, yellow="2", robot=OLD, yellow_robot=NEW))
    assert pitch.place({}, {(Team.YELLOW, 1)}) == []
    before = pitch.plant.pose()[:2]
    pitch.plant._batch.bind("qvel")[0, 3] = 1e12
    driven(pitch, 1)
    np.testing.assert_array_equal(pitch.plant.pose()[:2], before)
    assert pitch.plant.unstable
    driven(pitch, 20)
    assert pitch.plant.driven.tolist() == [True, True, False]
    assert (np.hypot(*(pitch.plant.pose()[:2] - before)[:, :2].T) > 0.05).all()
