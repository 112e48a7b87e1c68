"""What robots do that are served: they obey all forms of commands, meet, stop at walls, and when nobody speaks."""

import numpy as np
import pytest
from served import FAST, QUIET, drive, local, pitch_of, put, rims, world

from omni_mj.live.serve.pitch import Pitch
from omni_mj.live.wire.simulation import Team
from omni_mj.live.wire.vision import FieldSize

RADIUS_M = 0.09  # of the rules' envelope
HEADING_RAD = 1e-7  # that one command more or less, and the heading with it, changes a pose, rad and m
SOFT_M = 0.004  # by which hulls, which give way within milliseconds, sink into each other and walls at 3 m/s


def at(pitch: Pitch, robot: int = 0) -> np.ndarray:
    return pitch.plant.pose()[robot]


@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_the_forms_of_a_command_are_the_same_motion(heading: float) -> None:
    """Straight ahead in the robot's axes, in the field's, and by rim speeds v (-sin, cos) of equation 4."""
    x, y = np.cos(heading), np.sin(heading)
    azimuths = np.radians([300, 225, 135, 60])  # front right, back right, back left, front left
    ahead, ends = [-0.5 * np.sin(azimuth) for azimuth in azimuths], []
    for command in (local(0, 0.5), world(0, 0.5 * x, 0.5 * y), rims(0, *ahead)):
        pitch = pitch_of(*QUIET, FAST)
        assert put(pitch, 0, 0, 0, heading) == []
        drive(pitch, 40, command)
        ends.append(at(pitch))
    # 0.33 m, less a lag of 65 ms and a tenth by creep and drag (README): 0.27 m.
    assert ends[0][:2] @ (x, y) == pytest.approx(0.27, abs=0.02)
    # Rim speeds leave turning to the wheels, without the loop on the gyro: a mm and a hundredth of a radian.
    np.testing.assert_allclose(ends[1:], [ends[0]] * 2, atol=0.01)
    assert abs(ends[0][2] - heading) < 0.01


def test_positive_rim_speeds_turn_the_robot_counter_clockwise() -> None:
    """All at v turn it at v / arm, after some lag."""
    pitch = pitch_of(*QUIET, FAST)
    drive(pitch, 60, rims(0, 0.1, 0.1, 0.1, 0.1))
    arm = pitch.plant.squads[0].geometry.arm
    assert at(pitch)[2] == pytest.approx(0.1 / arm, rel=0.2)


@pytest.mark.parametrize("delay", [0, 3])
def test_a_command_acts_in_the_next_cycle_after_the_dead_time(delay: int) -> None:
    """Between frames too: the wheels' motors have voltage first in the cycle that follows."""
    pitch = pitch_of(*QUIET, FAST, f"radio.delay_frames={delay}")
    for _ in range(21):
        pitch.step()
    assert not pitch.command(Team.BLUE, [local(0, 1.0)])[0]
    for _ in range(16 * delay):
        pitch.step()
        assert np.abs(pitch.plant.squads[0]._voltages[(pitch.cycle - 1) % 16]).max() < 0.5
    pitch.step()
    assert np.abs(pitch.plant.squads[0]._voltages[(pitch.cycle - 1) % 16]).max() > 2


@pytest.mark.parametrize("sets", [(), ("vision.rate_hz=75", "vision.delay_s=0.03", "radio.delay_frames=3")])
def test_a_robot_that_spins_drives_where_the_field_s_velocity_leads(sets: tuple[str, ...]) -> None:
    """Its own heading is corrected by images that are old when they arrive, and come between frames.

    An image compared with what the robot held a frame later would put it off by 8/60 rad, 0.13. Images that are
    not taken when frames begin are compared to half a frame, now earlier, now later.
    """
    pitch = pitch_of(*QUIET, FAST, "firmware.timeout_s=0.2", *sets)
    put(pitch, 0, -1.0, 0.0, 0.0)
    for _ in range(7):  # commands come in the middle of frames
        pitch.step()
    drive(pitch, 120, world(0, 0.5, 0.0, 8.0))
    off = pitch.plant.squads[0]._firmware.estimate.heading - pitch.plant.pose()[:, 2]
    assert abs(np.angle(np.exp(1j * off[0]))) < 0.03
    way = at(pitch)[:2] - [-1.0, 0.0]
    assert np.arctan2(way[1], way[0]) == pytest.approx(0.0, abs=0.1)


def test_robots_stop_that_hear_nothing_for_a_tenth_of_a_second() -> None:
    """Told once, a robot drives for 96 cycles and then brakes, as one does that is told to stand in that cycle.

    But for the vision's heading that comes with the second command, a billionth of a radian from the robot's own.
    """
    silent, told = (pitch_of(*QUIET, FAST) for _ in range(2))
    for pitch in (silent, told):
        pitch.command(Team.BLUE, [local(0, 1.5)])
        for _ in range(96):
            pitch.step()
    assert told.command(Team.BLUE, [local(0, 0.0)])[0] == []
    assert silent.plant.twist()[0, 0] > 0.3
    for _ in range(400):
        silent.step()
        told.step()
    np.testing.assert_allclose(silent.plant.pose(), told.plant.pose(), atol=HEADING_RAD)
    assert np.abs(silent.plant.twist()).max() < 0.01


def test_a_robot_that_is_told_often_enough_goes_on_and_one_may_be_told_never_to_stop() -> None:
    often, never = pitch_of(*QUIET, FAST), pitch_of(*QUIET, FAST, "firmware.timeout_s=0")
    drive(often, 48, local(0, 1.0), each=6)  # every 0.1 s, just in time
    drive(never, 48, local(0, 1.0), each=100)
    np.testing.assert_allclose(often.plant.pose(), never.plant.pose(), atol=HEADING_RAD)


@pytest.mark.parametrize("others", [0, 1])
def test_walls_hold_robots_that_drive_into_them(others: int) -> None:
    """A lone one too, at full speed, straight and into a corner."""
    pitch, room = pitch_of(*QUIET, FAST, blue="1", yellow=str(others)), np.array([5.2, 3.7]) - RADIUS_M
    for start, command, reached in (
        ((4.2, 0, 0.5), world(0, 3.0), [True, False]),
        ((-1, 2.9, 0.0), world(0, 0.0, 3.0), [False, True]),
        ((4.5, 3.0, 1.0), world(0, 2.0, 2.0), [True, True]),
    ):
        assert put(pitch, 0, *start) == []
        deepest = np.zeros(2)
        for _ in range(50):
            drive(pitch, 1, command)
            deepest = np.maximum(deepest, at(pitch)[:2])
        assert (deepest < room + SOFT_M).all()
        assert ((at(pitch)[:2] > room - 0.02) == reached).all()


def test_robots_that_meet_do_not_overlap() -> None:
    """Head on, off the middle, of both teams, each at 2 m/s, and a heap of four that push into one point."""
    pitch = pitch_of(*QUIET, FAST, blue="2", yellow="2")
    for number, team, x, y in ((0, Team.BLUE, -0.6, 0.03), (1, Team.BLUE, 0, 0.6)):
        assert put(pitch, number, x, y, 0.0, team=team) == []
    for number, x, y in ((0, 0.6, -0.03), (1, 0, -0.6)):
        assert put(pitch, number, x, y, 0.0, team=Team.YELLOW) == []
    least = np.inf
    for _ in range(70):
        aims = [local(number, *(4 * -pose[:2])) for number, pose in zip((0, 1, 0, 1), pitch.plant.pose(), strict=True)]
        drive(pitch, 1, *aims[:2], yellow=tuple(aims[2:]))
        places = pitch.plant.pose()[:, :2]
        apart = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1)) + np.eye(4)
        least = min(least, apart.min())
    assert 2 * RADIUS_M - 2 * SOFT_M < least < 2 * RADIUS_M + 0.02  # they did meet
    assert pitch.plant.driven.all()


def test_robots_do_not_touch_the_ball_which_lies_where_it_is_put() -> None:
    pitch = pitch_of(*QUIET, FAST)
    put(pitch, 0, -0.2, 0, 0)
    drive(pitch, 30, local(0, 1.0))
    assert at(pitch)[0] > 0.1
    assert pitch.look()[0].ball == pytest.approx([0, 0])


def test_another_field_has_other_walls() -> None:
    pitch = pitch_of(*QUIET, FAST)
    assert put(pitch, 0, 0, 0, 0) == []
    pitch.resize(FieldSize(2.0, 1.5, 0.5, 0.1, 0.25))
    assert put(pitch, 0, 0.9, 0, 0) == []
    drive(pitch, 40, world(0, 2.0))
    assert at(pitch)[0] == pytest.approx(1.25 - RADIUS_M, abs=0.02)
    with pytest.raises(Exception, match="blue 0 would stand in a wall"):
        pitch.resize(FieldSize(1.5, 1.5, 0.5, 0.1, 0.25))
    with pytest.raises(Exception, match=r"not 0\.1 x 1 m"):
        pitch.resize(FieldSize(0.1, 1, 0.5, 0.1, 0.25))
    assert pitch.plant.surface == pytest.approx([2.5, 2.0])
