"""Served robots: all forms of commands, collisions, walls, and the stop without commands."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benches.serve import CYCLES, FAST, QUIET, Field
from serve_client import local, wheels, world

import omni_mj as om
from omni_mj.network.radio import ReceivedCommand
from omni_mj.plants.planar_plant import PlanarPlant

RADIUS_M = 0.09  # of the rules' envelope
# By which one command more or less, and the heading with it, changes a pose, rad and m
HEADING_RAD = 1e-7
# By which hulls, which give way within milliseconds, sink into walls at 3 m/s
SOFT_M = 0.007


@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_the_forms_of_a_command_are_the_same_motion(heading: float) -> None:
    """Forward in the body frame, in the world frame, and by rim speeds (equation 4)."""
    x, y = np.cos(heading), np.sin(heading)
    azimuths = np.radians([300, 225, 135, 60])  # front right, back right, back left, front left
    ahead, ends = [float(-0.5 * np.sin(azimuth)) for azimuth in azimuths], []
    for command in (local(0, 0.5), world(0, 0.5 * x, 0.5 * y), wheels(0, *ahead)):
        field = Field(*QUIET, FAST)
        assert field.put(0, 0, 0, heading) == []
        field.drive(40, command)
        ends.append(field.poses[0])
    # 0.33 m, less a lag of 65 ms and a tenth by creep and drag: 0.27 m.
    assert ends[0][:2] @ (x, y) == pytest.approx(0.27, abs=0.02)
    # Rim speeds leave turning to the wheels, without the loop on the gyro: a cm and a hundredth of
    # a radian.
    np.testing.assert_allclose(ends[1:], [ends[0]] * 2, atol=0.01)
    assert abs(ends[0][2] - heading) < 0.01


def test_rim_speeds_are_of_robots_with_four_wheels(tmp_path: Path) -> None:
    """The default robot with three wheels refuses them; that with four turns counter-clockwise."""
    text = (Path(om.__file__).parent / "robots" / "tigers-v2016.toml").read_text()
    file, turn = tmp_path / "three.toml", wheels(0, 0.1, 0.1, 0.1, 0.1)
    file.write_text(re.sub("azimuths_deg = .*", "azimuths_deg = [60, 180, 300]", text))
    three, four = Field(*QUIET, FAST, robot=str(file)), Field(*QUIET, FAST)
    assert three.command(turn) == ["WHEELS"]
    three.drive(30, local(0, 0.0, 0.0, 1.0))
    four.drive(30, turn)
    for field in (three, four):
        assert (field.twists[:, 2] > 0.5).all()


@pytest.mark.parametrize("delay", [0, 2.3125, 3])
def test_a_command_acts_in_the_next_cycle_after_the_dead_time(delay: float) -> None:
    """Between frames too: the wheels' motors have voltage first in the cycle that follows."""
    field = Field(*QUIET, FAST, f"radio.delay_frames={delay}")
    field.cycles(21)
    assert field.command(local(0, 1.0)) == []
    for _ in range(round(16 * delay)):
        field.cycles(1)
        assert field.voltage() < 0.5
    field.cycles(1)
    assert field.voltage() > 2


@pytest.mark.parametrize(
    "sets", [(), ("vision.rate_hz=75", "vision.delay_s=0.03", "radio.delay_frames=3")]
)
def test_a_robot_that_spins_drives_where_the_field_s_velocity_leads(sets: tuple[str, ...]) -> None:
    """Delayed images that arrive between frames correct the robot's own heading.

    An image compared with the robot's heading a frame later would put it off by 8/60 rad, 0.13.
    Images that are not taken when frames begin are compared to half a frame, now earlier, now
    later.
    """
    field = Field(*QUIET, FAST, "firmware.timeout_s=0.2", *sets)
    field.put(0, -1.0, 0.0, 0.0)
    field.cycles(7)  # commands come in the middle of frames
    field.drive(120, world(0, 0.5, 0.0, 8.0))
    error = field.heading_estimates() - field.poses[:, 2]
    assert abs(np.angle(np.exp(1j * error[0]))) < 0.03
    x, y = field.poses[0, :2] - [-1.0, 0.0]
    assert np.arctan2(y, x) == pytest.approx(0.0, abs=0.1)


def test_a_measured_heading_that_is_older_than_the_robot_s_memory_is_ignored() -> None:
    """A team commands for 4 s after its last image; robots remember their headings for 2 s.

    An old image compared with another moment's heading would put a turning robot off by radians.
    """
    field, command = Field(*QUIET, FAST, "firmware.timeout_s=0.2"), world(0, 0, 0, 3.0)
    field.put(0, 0.0, 0.0, 0.0)
    field.drive(10, command)
    for _ in range(240):
        assert field.command(command) == []
        for _ in range(CYCLES):
            field.pitch.advance()  # without publishing
    error = field.heading_estimates() - field.poses[:, 2]
    assert abs(np.angle(np.exp(1j * error[0]))) < 0.02
    assert abs(field.poses[0, 2]) > 0.1


def test_robots_stop_that_receive_nothing_for_a_tenth_of_a_second() -> None:
    """After one command a robot drives for 96 cycles, then brakes as if commanded to stop."""
    silent, told = (Field(*QUIET, FAST) for _ in range(2))
    for field in (silent, told):
        field.command(local(0, 1.5))
        field.cycles(96)
    assert told.command(local(0, 0.0)) == []
    assert silent.twists[0, 0] > 0.3
    for field in (silent, told):
        field.cycles(400)
    np.testing.assert_allclose(silent.poses, told.poses, atol=HEADING_RAD)
    assert np.abs(silent.twists).max() < 0.01


@pytest.mark.parametrize(
    ("sets", "walls"),
    [
        ((), (5.2, 3.7)),
        (("world.field_length_m=12", "world.field_width_m=9"), (6.7, 5.2)),
        (("world.field_length_m=2", "world.field_margin_m=0"), (1.0, 3.0)),
    ],
)
def test_walls_hold_a_robot_that_drives_into_a_corner(
    sets: tuple[str, ...], walls: tuple[float, float]
) -> None:
    field, room = Field(*QUIET, FAST, *sets), np.array(walls) - RADIUS_M
    assert field.put(0, walls[0] - 0.7, walls[1] - 0.7, 1.0) == []
    for _ in range(50):
        field.drive(1, world(0, 2.0, 2.0))
        assert (field.poses[0, :2] < room + SOFT_M).all()
    assert (field.poses[0, :2] > room - 0.02).all()


def test_teams_start_apart_within_a_small_field() -> None:
    size = "world.field_length_m=3", "world.field_width_m=2", "world.field_margin_m=0"
    poses = Field(*QUIET, *size, blue="11", yellow="11", plant="planar").poses
    assert (np.abs(poses[:, :2]) < np.array([1.5, 1.0]) - RADIUS_M).all()
    distances = np.linalg.norm(poses[:, None, :2] - poses[:, :2], axis=2)
    assert distances[np.triu_indices(22, 1)].min() > 2 * RADIUS_M


def test_a_teleport_gives_the_velocity_it_says() -> None:
    """A robot placed and commanded at 1 m/s is 0.1 m further after 0.1 s, less creep and drag."""
    field = Field(*QUIET, FAST, "firmware.timeout_s=0")
    field.drive(20, local(0, 1.5))
    assert field.put(0, 2.0, -1.0, 2.5, v_x=-0.8, v_y=0.6) == []
    np.testing.assert_allclose(field.poses[0], [2.0, -1.0, 2.5], atol=1e-12)
    forward, left = np.array([[np.cos(2.5), np.sin(2.5)], [-np.sin(2.5), np.cos(2.5)]]) @ [
        -0.8,
        0.6,
    ]
    field.drive(6, local(0, forward, left))
    np.testing.assert_allclose(field.poses[0, :2] - [2.0, -1.0], [-0.08, 0.06], atol=0.01)


def test_robots_of_the_plant_planar_move_as_in_a_run() -> None:
    """To the bit, if commands come when frames begin; two teams of eleven, at 100 images/s."""
    field = Field(*QUIET, "vision.rate_hz=100", blue="11", yellow="11", plant="planar")
    rows = field.pitch.rows
    command = np.array([0.75, 0.25, 1.0])
    alone = PlanarPlant([replace(rows[0], slot=0)], field.poses[:1])
    images = []
    for _ in range(12):
        alone.advance(ReceivedCommand(command[None], np.full(1, np.nan), np.zeros(1, int)))
        assert field.command(world(0, *command)) == []
        for _ in range(16):  # without publishing, so that commands have no measured heading
            images += field.pitch.take_images()
            field.pitch.advance()
    assert len(images) == 20
    np.testing.assert_array_equal(field.poses[0], alone.pose()[0])


@pytest.mark.parametrize("form", ["local", "world", "wheels"])
def test_no_wheel_turns_after_the_command_timeout(form: str) -> None:
    """Whatever the last command was; before the timeout all wheels turn."""
    packets = {"local": local(0, 1.0, 0.0, 5.0), "world": world(0, 0.3, 1.0, 5.0)}
    packets["wheels"] = wheels(0, 0.8, 0.8, 0.8, 0.8)
    field = Field(*QUIET, FAST, "firmware.timeout_s=0.1", plant="planar")
    speeds = field.pitch.plant.telemetry
    field.drive(20, packets[form])
    assert np.abs(speeds().wheel_speed).max() > 10
    field.cycles(40 * CYCLES)
    assert np.abs(speeds().wheel_speed).max() < 0.05
