"""Teleports add and remove robots. Invalid ones are refused with a reason; others succeed."""

from pathlib import Path

import numpy as np
import pytest
import serve_client
from benches.serve import FAST, QUIET, Field, here
from serve_client import BLUE, YELLOW, local

from omni_mj.live.wire.league_pb2 import SimulatorCommand, SimulatorConfig


def test_robots_come_and_go() -> None:
    """A removed robot is not detected, hit or commanded; an added one is."""
    with here(Field(*QUIET, FAST, blue="2")) as (client, _):
        assert client.codes(0, serve_client.teleport(1, BLUE, present=False)) == []
        assert list(client.after(local(0, 0.0))) == [("blue", 0)]
        assert client.codes(1, local(1, 1.0)) == ["UNKNOWN_ROBOT"]
        assert (
            client.codes(0, serve_client.teleport(0, BLUE, x=-0.5, y=0.75)) == []
        )  # where the other stood
        assert client.codes(0, serve_client.teleport(1, BLUE, None, x=1.0, y=1.0)) == ["ABSENT"]
        assert client.codes(0, serve_client.teleport(1, BLUE)) == ["ABSENT"]
        assert client.codes(0, serve_client.teleport(1, BLUE, x=1.0, y=1.0, orientation=0.5)) == []
        assert client.after(b"")["blue", 1] == pytest.approx((1.0, 1.0, 0.5), abs=1e-4)
        # A third has no body: the world is made anew, and all stand where they stood.
        assert (
            client.codes(0, serve_client.teleport(7, YELLOW, x=-2.0, y=1.0, orientation=1.0)) == []
        )
        seen = client.after(b"")
        assert seen["yellow", 7] == pytest.approx((-2.0, 1.0, 1.0), abs=1e-4)
        assert seen["blue", 1] == pytest.approx((1.0, 1.0, 0.5), abs=1e-3)
        for _ in range(20):
            seen = client.after(local(7, 1.0), team=2)
        assert np.hypot(*np.subtract(seen["yellow", 7][:2], (-2.0, 1.0))) > 0.1


def test_what_cannot_be_is_refused_and_the_rest_is_done() -> None:
    with here(Field(*QUIET, FAST, blue="2", yellow="1")) as (client, _):
        both = serve_client.teleport(0, BLUE, x=1.0, y=0.0) + serve_client.teleport(
            1, BLUE, x=1.05, y=0.0
        )  # one message, merged
        assert client.codes(0, both) == ["OCCUPIED", "OCCUPIED"]
        config = SimulatorConfig(vision_port=70_000)
        packet = SimulatorCommand(config=config).SerializeToString()
        assert client.codes(0, packet) == ["CONFIG"]
        assert client.codes(0, serve_client.teleport(0, BLUE, x=5.15, y=0.0)) == [
            "OCCUPIED"
        ]  # the wall is at 5.2 m
        assert client.codes(0, serve_client.teleport(0, BLUE, x=5.1, y=0.0)) == []
        for ball in ({"x": float("inf")}, {"x": 1.0, "vx": 3.0}, {"y": 0.5, "z": 0.2}, {"vz": 1.0}):
            assert client.codes(0, serve_client.control(teleport_ball=ball)) == ["BALL"]
        assert client.codes(0, serve_client.control(teleport_ball={"x": 1.0})) == []
        assert client.codes(0, serve_client.teleport(0, BLUE, x=float("nan"))) == ["TELEPORT"]
        assert client.codes(0, serve_client.teleport(16, BLUE, x=0.0, y=0.0)) == ["ROBOT_ID"]
        assert client.codes(0, serve_client.teleport(0, BLUE, x=-4.0, y=3.0)) == []
        seen = client.step(b"")
        assert serve_client.robots(seen)["blue", 0][:2] == pytest.approx((-4.0, 3.0), abs=2e-3)
        assert (seen.balls[0].x, seen.balls[0].y) == (1000, 500)


def test_a_world_has_twelve_robots_and_an_absent_one_makes_room() -> None:
    field = Field(*QUIET, FAST, blue="11", yellow="1")
    assert field.put(5, 3.0, 1.0, 0.5, team=YELLOW) == ["OCCUPIED"]
    assert field.teleport(serve_client.teleport(3, BLUE, present=False)) == []
    before = field.poses
    assert field.put(5, 3.0, 1.0, 0.5, team=YELLOW) == []
    np.testing.assert_allclose(field.poses[:-1], before, atol=1e-12)
    field.drive(20, yellow=local(5, 0.8))
    assert np.hypot(*(field.poses[-1, :2] - [3.0, 1.0])) > 0.1
    assert field.upright


def test_a_world_that_becomes_unstable_goes_on_from_where_robots_last_were(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # where MuJoCo logs its warnings
    field, curve = Field(*QUIET, FAST, yellow="2"), local(0, 0.6, 0.3, 1.5)
    field.drive(30, curve, curve)
    assert field.teleport(serve_client.teleport(1, YELLOW, present=False)) == []
    before = field.poses
    field.break_physics()
    field.drive(1, curve, curve)
    np.testing.assert_allclose(field.poses, before, atol=1e-12)
    field.drive(20, curve, curve)
    assert field.upright
    assert (np.hypot(*(field.poses - before)[:, :2].T) > 0.05).all()


@pytest.mark.parametrize("seed", range(12))
def test_whatever_is_teleported_nobody_stands_in_another_and_the_world_goes_on(seed: int) -> None:
    """Places at random, most of them too near: those that are refused stay where they were."""
    field, rng = Field(*QUIET, FAST, blue="3", yellow="1"), np.random.default_rng(seed)
    robots = [(0, BLUE), (1, BLUE), (2, BLUE), (0, YELLOW)]
    for _ in range(3):
        before = field.poses
        wanted = rng.uniform(-1, 1, 2) * [5.3, 3.8] + rng.uniform(-0.5, 0.5, (4, 2))
        wanted = np.clip(wanted, [-5.28, -3.78], [5.28, 3.78])  # beyond, robots are parked
        packets = [
            serve_client.teleport(*name, x=x, y=y)
            for name, (x, y) in zip(robots, wanted, strict=True)
        ]
        refused = " ".join(field.teleport(*packets))
        for name, old, place, new in zip(field.names, before, wanted, field.poses, strict=True):
            expected = old[:2] if f"{name} would" in refused else place
            np.testing.assert_allclose(new[:2], expected, atol=1e-6)
        field.drive(2, local(0, 1.0))
        assert field.upright
