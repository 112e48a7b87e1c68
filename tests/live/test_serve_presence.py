"""Robots come and go by teleport; what cannot be is refused with its reason, and nothing else is lost."""

import numpy as np
import pytest
import serving
from benches.serve import FAST, QUIET, Field, here
from hypothesis import given, settings
from hypothesis import strategies as st
from serving import BLUE, YELLOW, local


def test_robots_come_and_go() -> None:
    """One that leaves is not seen, nor in anybody's way, nor commanded; one that comes is all of that."""
    with here(Field(*QUIET, FAST, blue="2")) as (client, _):
        assert client.codes(0, serving.teleport(1, BLUE, present=False)) == []
        assert list(client.after(local(0, 0.0))) == [("blue", 0)]
        assert client.codes(1, local(1, 1.0)) == ["UNKNOWN_ROBOT"]
        assert client.codes(0, serving.teleport(0, BLUE, x=-0.5, y=0.75)) == []  # where the other stood
        assert client.codes(0, serving.teleport(1, BLUE, None, x=1.0, y=1.0)) == ["ABSENT"]
        assert client.codes(0, serving.teleport(1, BLUE)) == ["ABSENT"]
        assert client.codes(0, serving.teleport(1, BLUE, x=1.0, y=1.0, orientation=0.5)) == []
        assert client.after(b"")["blue", 1] == pytest.approx((1.0, 1.0, 0.5), abs=1e-4)
        # A third has no body: the world is made anew, and all stand where they stood.
        assert client.codes(0, serving.teleport(7, YELLOW, x=-2.0, y=1.0, orientation=1.0)) == []
        seen = client.after(b"")
        assert seen["yellow", 7] == pytest.approx((-2.0, 1.0, 1.0), abs=1e-4)
        assert seen["blue", 1] == pytest.approx((1.0, 1.0, 0.5), abs=1e-3)
        for _ in range(20):
            seen = client.after(local(7, 1.0), team=2)
        assert np.hypot(*np.subtract(seen["yellow", 7][:2], (-2.0, 1.0))) > 0.1


def test_what_cannot_be_is_refused_and_the_rest_is_done() -> None:
    with here(Field(*QUIET, FAST, blue="2", yellow="1")) as (client, _):
        both = serving.teleport(0, BLUE, x=1.0, y=0.0) + serving.teleport(1, BLUE, x=1.05, y=0.0)  # one message, merged
        assert client.codes(0, both) == ["OCCUPIED", "OCCUPIED"]
        config = serving.field(2, serving.message(None, serving.message(1), b"", 70_000))
        assert client.codes(0, config) == ["ROBOT_SPECS", "REALISM", "VISION_PORT"]
        sizes = [serving.message(length, 6000, 1000, 180, 300) for length in (100, 8000)]  # mm
        small, large = (serving.field(2, serving.field(1, serving.field(1, size))) for size in sizes)
        assert client.codes(0, small) == ["GEOMETRY"]
        assert client.codes(0, large) == []
        assert client.codes(0, serving.teleport(0, BLUE, x=4.25, y=0.0)) == ["OCCUPIED"]  # the wall is at 4.3 m
        assert client.codes(0, serving.teleport(0, BLUE, x=4.1, y=0.0)) == []
        for _ in range(20):
            seen = client.after(serving.world(0, 2.0))
        assert seen["blue", 0][0] == pytest.approx(4.3 - 0.09, abs=0.02)
        ball = serving.field(1, serving.field(1, serving.message(0.0, 0.5, None, 3.0)))
        assert client.codes(0, ball) == ["BALL_LIES"]
        assert client.codes(0, serving.teleport(0, BLUE, x=float("nan"))) == ["TELEPORT"]
        assert client.codes(0, serving.teleport(16, BLUE, x=0.0, y=0.0)) == ["ROBOT_ID"]
        assert client.codes(0, serving.teleport(0, BLUE, x=-4.0, y=3.0)) == []
        assert client.after(b"")["blue", 0][:2] == pytest.approx((-4.0, 3.0), abs=2e-3)


@settings(max_examples=15)
@given(st.data())
def test_whatever_is_teleported_nobody_stands_in_another_and_the_world_goes_on(data: st.DataObject) -> None:
    """Places at random, most of them too near: those that are refused stay where they were."""
    field = Field(*QUIET, FAST, blue="3", yellow="1")
    place = st.tuples(st.floats(-5.3, 5.3), st.floats(-3.8, 3.8), st.floats(-10, 10))
    names = {(BLUE, 0): "blue 0", (BLUE, 1): "blue 1", (BLUE, 2): "blue 2", (YELLOW, 0): "yellow 0"}
    for _ in range(3):
        before = field.poses
        near = data.draw(st.lists(place, min_size=4, max_size=4))
        centre = np.array([*data.draw(place)[:2], 0]) * data.draw(st.sampled_from([0.0, 1.0]))
        wanted = {name: centre + np.array(p) * [0.1, 0.1, 1] for name, p in zip(names, near, strict=True)}
        refused = field.place(wanted)
        for name, old, new in zip(names, before, field.poses, strict=True):
            stays = any(names[name] in text.split(" would")[0] for text in refused)
            np.testing.assert_allclose(new[:2], (old if stays else wanted[name])[:2], atol=1e-9)
        field.drive(2, local(0, 1.0))
        assert field.upright
