"""In lockstep, runs over the wire are the same to the bit, and those of the loop that runs in one process."""

from itertools import count

import numpy as np
import pytest
import serving
from foreign import field
from served import here, pitch_of
from serving import Client, served

from omni_mj.scenarios import scenario
from omni_mj.simulate.simulation import Simulation

STEPS = 40
FLOAT32_M = 4e-7  # what a place of up to 4 m loses on the wire, in mm as a 32-bit number: 2^-24 of it, and rounding
NOISY = "vision.cameras=2", "radio.jitter_frames=2", "radio.loss_probability=0.1", "firmware.timeout_s=0.05"


def taped(client: Client) -> list[bytes]:
    """All that comes back from a run of two teams in which everything is used."""
    answers: list[bytes] = []
    for k in range(STEPS):
        answers.append(client.ask(1, serving.world(0, 1.0, 0.3) + serving.wheels(1, 0.5, -0.2, 0.4, 0.1)))
        answers.append(client.ask(2, serving.local(0, 0.8, 0.2, k / 10)))
        if k == STEPS // 2:
            answers.append(client.ask(0, serving.teleport(1, 2, x=-1.0, y=1.0, orientation=0.5)))
    client.vision.settimeout(0.2)
    seen = dict[bytes, None]()  # before the first command all is sent again, more or less often
    for _ in count():
        try:
            seen[client.vision.recv(65536)] = None
        except TimeoutError:
            return [*answers, *seen]
    raise AssertionError


def test_a_run_is_the_same_to_the_bit_and_another_seed_is_another() -> None:
    """Of the same options, in a process of its own and in this one."""
    sets = [word for each in NOISY for word in ("--set", each)]
    with served("--lockstep", "--blue", "2", "--yellow", "1", "--seed", "3", "--scenario", "worn", *sets) as (
        client,
        _,
    ):
        alone = taped(client)
    tapes = []
    for seed in (3, 4):
        with here(pitch_of(*NOISY, blue="2", yellow="1", scenario="worn", seed=seed)) as (client, _):
            tapes.append(taped(client))
    assert tapes[0] == alone
    assert tapes[1] != alone
    # 2 packets a step, each with an answer and an image of either camera; one image before; the geometry each second.
    assert 6 * STEPS + 2 <= len(alone) <= 6 * STEPS + 8


@pytest.mark.parametrize("delay", [0, 4])
def test_the_loop_in_one_process_is_reproduced_over_the_wire(delay: int) -> None:
    """With the same dead time, the same noise and misses, and the same team, whose computer now is a client.

    In one process the heading that is sent with commands is the filter's, here it is the camera's, for commands of the
    protocol have none; the robot's own heading is corrected by either, which makes the whole difference: the camera's
    noise of 0.01 rad, by a gain of 2/s at 60 Hz, is 0.01 sqrt(2/60/2) = 1.3 mrad, times the 0.67 m of the route 0.9 mm.
    """
    route = "reference.waypoints=[[0, 0, 0], [0.6, 0.3, 0.5]]", "reference.settle_s=0", f"radio.delay_frames={delay}"
    chosen = scenario.load("rect", route, {"controllers": ("comp-flc",)})
    log, team = Simulation(chosen).run(), Simulation(chosen).team
    seen = np.full((log.length, 3), np.nan)
    with here(pitch_of(*route, scenario="rect")) as (client, _):
        detection = client.newest()
        for k in range(log.length):
            seen[k] = serving.robots(detection).get(("blue", 0), [np.nan] * 3)
            team.observe(seen[[k]])
            detection = client.step(serving.world(0, *map(float, team.command()[0])))
    there, way = log.channel("vision")[:, 0], log.channel("ref")[:, 0, :2]
    np.testing.assert_array_equal(np.isnan(seen), np.isnan(there))  # missed in the same frames
    np.testing.assert_allclose(seen[0], there[0], atol=FLOAT32_M)  # the same noise
    known = ~np.isnan(there[:, 0])
    assert np.abs(seen - there)[known, :2].max() < 0.9e-3
    errors = [np.abs(found[:, :2] - way)[known].max(0) for found in (seen, there)]
    np.testing.assert_allclose(*errors, atol=0.9e-3)


def test_both_teams_make_a_step_where_both_must() -> None:
    with here(pitch_of(yellow="1"), "both") as (client, _):
        before = serving.captured(client.newest())
        for _ in range(3):
            client.ask(1, serving.local(0, 1.0))
        client.vision.settimeout(0.1)
        with pytest.raises(TimeoutError):
            client.detection()
        client.vision.settimeout(serving.PATIENCE_S)
        client.ask(2, b"")
        assert serving.captured(client.newest()) == pytest.approx(before + 1 / 60)


def test_a_client_that_comes_late_or_lost_a_packet_is_shown_the_last_image_again() -> None:
    with here(pitch_of()) as (client, _):
        seen = client.step(serving.local(0, 1.0))
        assert client.ask(0, b"") == b""
        assert client.detection() == seen
        assert serving.codes(client.ask(0, serving.speed(2.0))) == ["LOCKSTEP"]


def test_kicks_are_refused_once_and_robots_answer() -> None:
    with here(pitch_of(blue="2,7")) as (client, server):
        answer = client.ask(1, serving.kick(7) + serving.local(2, 0.1))
        assert serving.codes(answer) == ["NO_KICK"]
        # feedback: number, no contact with the ball
        robots = [field(2, field(1, number) + field(2, 0)) for number in (7, 2)]
        assert answer.endswith(b"".join(robots))
        assert serving.codes(client.ask(1, serving.kick(7))) == []
        assert serving.codes(client.ask(1, serving.local(3, 0.1))) == ["UNKNOWN_ROBOT"]
        assert serving.codes(client.ask(2, serving.local(2, 0.1))) == ["UNKNOWN_ROBOT"]
        assert serving.codes(client.ask(1, serving.local(2, float("nan")))) == ["VELOCITY"]
        assert server.notes.counts["kicks"] == 2
