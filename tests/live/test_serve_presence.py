"""Robots come and go by teleport; what cannot be is refused with its reason, and nothing else is lost."""

import numpy as np
import pytest
import serving
from hypothesis import given, settings
from hypothesis import strategies as st
from served import FAST, QUIET, drive, here, local, pitch_of, put

from omni_mj.live.serve.pitch import label
from omni_mj.live.wire.simulation import Team

BLUE, YELLOW = 2, 1  # on the wire


def test_a_teleport_puts_a_robot_where_it_says_with_the_velocity_it_says() -> None:
    pitch = pitch_of(*QUIET, FAST, "firmware.timeout_s=0")
    drive(pitch, 20, local(0, 1.5))
    assert put(pitch, 0, 2.0, -1.0, 2.5, twist=(-0.8, 0.6, 0.0)) == []
    np.testing.assert_allclose(pitch.plant.pose()[0], [2.0, -1.0, 2.5], atol=1e-12)
    turned = np.array([[np.cos(2.5), np.sin(2.5)], [-np.sin(2.5), np.cos(2.5)]]) @ [-0.8, 0.6]
    drive(pitch, 6, local(0, *turned))
    # Told to go on at the metre a second at which it rolls, it is 0.1 s further, but for creep and drag: a
    # tenth (README).
    way = pitch.plant.pose()[0, :2] - [2.0, -1.0]
    np.testing.assert_allclose(way, [-0.08, 0.06], atol=0.01)


def test_robots_come_and_go() -> None:
    """One that leaves is not seen, nor in anybody's way, nor commanded; one that comes is all of that."""
    with here(pitch_of(*QUIET, FAST, blue="2")) as (client, server):
        assert serving.codes(client.ask(0, serving.teleport(1, BLUE, present=False))) == []
        seen = serving.robots(client.step(serving.local(0, 0.0)))
        assert list(seen) == [("blue", 0)]
        assert serving.codes(client.ask(1, serving.local(1, 1.0))) == ["UNKNOWN_ROBOT"]
        assert serving.codes(client.ask(0, serving.teleport(0, BLUE, x=-0.5, y=0.75))) == []  # where the other stood
        assert serving.codes(client.ask(0, serving.teleport(1, BLUE, None, x=1.0, y=1.0))) == ["ABSENT"]
        assert serving.codes(client.ask(0, serving.teleport(1, BLUE))) == ["NOWHERE"]
        assert serving.codes(client.ask(0, serving.teleport(1, BLUE, x=1.0, y=1.0, orientation=0.5))) == []
        seen = serving.robots(client.step(b""))
        assert seen["blue", 1] == pytest.approx((1.0, 1.0, 0.5), abs=1e-4)
        # A third has no body: the world is made anew, and all stand where they stood.
        assert serving.codes(client.ask(0, serving.teleport(7, YELLOW, x=-2.0, y=1.0, orientation=1.0))) == []
        seen = serving.robots(client.step(b""))
        assert seen["yellow", 7] == pytest.approx((-2.0, 1.0, 1.0), abs=1e-4)
        assert seen["blue", 1] == pytest.approx((1.0, 1.0, 0.5), abs=1e-3)
        for _ in range(20):
            seen = serving.robots(client.step(serving.local(7, 1.0), team=2))
        assert np.hypot(*np.subtract(seen["yellow", 7][:2], (-2.0, 1.0))) > 0.1
        assert len(server.pitch.names) == 3


def test_what_cannot_be_is_refused_and_the_rest_is_done() -> None:
    with here(pitch_of(*QUIET, FAST, blue="2", yellow="1")) as (client, _):
        both = serving.teleport(0, BLUE, x=1.0, y=0.0) + serving.teleport(1, BLUE, x=1.05, y=0.0)  # one message, merged
        assert serving.codes(client.ask(0, both)) == ["OCCUPIED", "OCCUPIED"]
        for code, packet in (
            ("TELEPORT", serving.teleport(0, BLUE, x=float("nan"))),
            ("OCCUPIED", serving.teleport(0, BLUE, x=5.15, y=0.0)),  # in a wall
            ("ROBOT_ID", serving.teleport(16, BLUE, x=0.0, y=0.0)),
        ):
            assert serving.codes(client.ask(0, packet)) == [code]
        assert serving.codes(client.ask(0, serving.teleport(0, BLUE, x=-5.0, y=3.5))) == []
        assert serving.robots(client.step(b""))["blue", 0][:2] == pytest.approx((-5.0, 3.5), abs=1e-4)


def test_two_robots_change_places_in_one_packet() -> None:
    pitch = pitch_of(*QUIET, FAST, blue="2")
    first, second = pitch.plant.pose()
    still = np.zeros(3)
    assert pitch.place({(Team.BLUE, 0): (second, still), (Team.BLUE, 1): (first, still)}, set()) == []
    np.testing.assert_allclose(pitch.plant.pose(), [second, first], atol=1e-12)


def test_a_world_has_twelve_robots_at_most() -> None:
    pitch = pitch_of(*QUIET, FAST, blue="6", yellow="6")
    assert put(pitch, 6, 3.0, 0.0, 0.0) == ["TOO_MANY"]
    assert pitch.place({}, {(Team.BLUE, 5)}) == []
    assert put(pitch, 6, 3.0, 0.0, 0.0) == []  # in the body of the one that left
    assert pitch.numbers(Team.BLUE) == [0, 1, 2, 3, 4, 6]
    assert pitch.place({}, {(Team.BLUE, 0)}) == []
    others = pitch.plant.pose()[1:]
    assert put(pitch, 7, 3.0, 1.0, 0.5, team=Team.YELLOW) == []  # in that of one of the other team
    assert pitch.numbers(Team.YELLOW) == [*range(6), 7]
    np.testing.assert_allclose(pitch.plant.pose(), [[3.0, 1.0, 0.5], *others], atol=1e-12)


def test_several_come_at_once_each_in_a_body_of_its_own() -> None:
    """Two in the bodies of two that left, one that comes back in its own, and one more for which there was none."""
    pitch, still = pitch_of(*QUIET, FAST, blue="3", yellow="1"), np.zeros(3)
    assert pitch.place({}, {(Team.BLUE, number) for number in range(3)}) == []
    places = {number: np.array([number / 3 - 2, 1.0, 0.5]) for number in (7, 2, 8, 9)}
    assert pitch.place({(Team.BLUE, number): (pose, still) for number, pose in places.items()}, set()) == []
    assert pitch.numbers(Team.BLUE) == [2, 7, 8, 9]
    for number, pose in places.items():
        np.testing.assert_allclose(pitch.pose((Team.BLUE, number)), pose, atol=1e-12)
    assert len(pitch.names) == 5


@settings(deadline=None, max_examples=15, derandomize=True)
@given(st.data())
def test_whatever_is_teleported_nobody_stands_in_another_and_the_world_goes_on(data: st.DataObject) -> None:
    """Places at random, most of them too near: those that are refused stay where they were."""
    pitch = pitch_of(*QUIET, FAST, blue="3", yellow="1")
    place = st.tuples(st.floats(-5.3, 5.3), st.floats(-3.8, 3.8), st.floats(-10, 10))
    names = [(Team.BLUE, 0), (Team.BLUE, 1), (Team.BLUE, 2), (Team.YELLOW, 0)]
    for _ in range(3):
        before = dict(zip(names, pitch.plant.pose(), strict=True))
        near = data.draw(st.lists(place, min_size=4, max_size=4))
        centre = np.array([*data.draw(place)[:2], 0]) * data.draw(st.sampled_from([0.0, 1.0]))
        wanted = {
            name: (centre + np.array(p) * [0.1, 0.1, 1], np.zeros(3)) for name, p in zip(names, near, strict=True)
        }
        refused = pitch.place(dict(wanted), set())
        for name, pose in zip(names, pitch.plant.pose(), strict=True):
            stays = any(refusal.text.startswith(f"{label(name)} ") for refusal in refused)
            np.testing.assert_allclose(pose[:2], (before[name] if stays else wanted[name][0])[:2], atol=1e-9)
        drive(pitch, 2, local(0, 1.0))
        assert pitch.plant.driven.all()
        assert not pitch.plant.unstable
