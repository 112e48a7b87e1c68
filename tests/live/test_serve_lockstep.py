"""In lockstep, runs over the wire are the same to the bit, and those of the loop that runs in one process."""

import numpy as np
import pytest
import serving
from foreign import field
from serving import Client, served

from omni_mj.scenarios import scenario
from omni_mj.simulate.simulation import Simulation

ROUTE = ["reference.waypoints=[[0, 0, 0], [0.6, 0.3, 0.5]]", "reference.settle_s=0.2"]
FLOAT32_M = 4e-7  # what a place of up to 4 m loses on the wire, in mm as a 32-bit number: 2^-24 of it, and rounding


def taped(seed: int) -> list[bytes]:
    """All that comes back from a run of two teams in which everything is used."""
    options = "--lockstep", "--blue", "2", "--yellow", "1", "--seed", str(seed), "--scenario", "worn"
    noisy = "--set", "vision.cameras=2", "--set", "radio.jitter_frames=2", "--set", "radio.loss_probability=0.1"
    tape: list[bytes] = []
    with served(*options, *noisy) as (client, _):
        client.vision.settimeout(0.3)
        for k in range(40):
            both = serving.world(0, 1.0, 0.3) + serving.wheels(1, 0.5, -0.2, 0.4, 0.1)
            tape.append(client.ask(1, both))
            tape.append(client.ask(2, serving.local(0, 0.8, 0.2, k / 10)))
            if k == 20:
                tape.append(client.ask(0, serving.teleport(1, 2, x=-1.0, y=1.0, orientation=0.5)))
        while True:
            try:
                tape.append(client.vision.recv(65536))
            except TimeoutError:
                break
    invitations = tape[81:].index(tape[81:][2]) if False else 0
    return tape[invitations:]


def unique(tape: list[bytes]) -> list[bytes]:
    """Without what was sent again before the first command, of which there may be more or less."""
    return list(dict.fromkeys(tape))


def test_a_run_is_the_same_to_the_bit_and_another_seed_is_another() -> None:
    first, again, other = unique(taped(3)), unique(taped(3)), unique(taped(4))
    assert first == again
    assert first != other
    # 80 steps of the first camera and about as many images of the second
    assert len([packet for packet in first if 1 in serving.fields(packet)]) > 150


@pytest.mark.parametrize("delay", [0, 4])
def test_the_loop_in_one_process_is_reproduced_over_the_wire(delay: int) -> None:
    """With the same dead time, the same noise and losses, and the same team, whose computer now is a client.

    In one process the heading that is sent with commands is the filter's, here it is the camera's, for commands of the
    protocol have none; the robot's own heading is corrected by either, which makes the whole difference: the camera's
    noise of 0.01 rad, by a gain of 2/s at 60 Hz, is 0.01 sqrt(2/60/2) = 1.3 mrad, times the 0.67 m of the route 0.9 mm.
    """
    options = [*ROUTE, f"radio.delay_frames={delay}", "vision.position_noise_m=0"]
    chosen = scenario.load("rect", options, {"controllers": ("comp-flc",)})
    alone = Simulation(chosen)
    log = alone.run()
    team = Simulation(chosen).team
    sets = [word for each in options for word in ("--set", each)]
    seen = np.full((log.length, 3), np.nan)
    with served("--lockstep", "--scenario", "rect", *sets) as (client, _):
        detection = client.newest()
        for k in range(log.length):
            seen[k] = serving.robots(detection).get(("blue", 0), [np.nan] * 3)
            team.observe(seen[[k]])
            detection = client.step(serving.world(0, *map(float, team.command()[0])))
    there = log.channel("vision")[:, 0]
    assert (np.isnan(seen) == np.isnan(there)).all()  # missed in the same frames
    known = ~np.isnan(seen[:, 0])
    assert np.abs(seen - there)[known, :2].max() < 1e-3
    np.testing.assert_allclose(seen[0], there[0], atol=FLOAT32_M)  # the same noise
    way, error = log.channel("ref")[:, 0, :2], log.channel("pose")[:, 0, :2]
    ours = np.hypot(*(seen[:, :2] - way)[known].T)
    theirs = np.hypot(*(error - way)[known].T)
    assert abs(ours.max() - theirs.max()) < 0.02 * theirs.max()


def test_both_teams_make_a_step_where_both_must() -> None:
    with served("--lockstep", "both", "--yellow", "1") as (client, _):
        before = serving.captured(client.newest())
        for _ in range(3):
            client.ask(1, serving.local(0, 1.0))
            client.ask(1, serving.local(0, 1.0))
        client.vision.settimeout(0.3)
        with pytest.raises(TimeoutError):
            client.detection()
        client.vision.settimeout(serving.PATIENCE_S)
        client.ask(2, b"")
        assert serving.captured(client.newest()) == pytest.approx(before + 1 / 60)


def test_a_client_that_comes_late_or_lost_a_packet_is_shown_the_last_image_again() -> None:
    with served("--lockstep") as (client, _):
        seen = client.step(serving.local(0, 1.0))
        assert client.ask(0, b"") == b""
        assert client.detection() == seen
        assert serving.codes(client.ask(0, serving.speed(2.0))) == ["LOCKSTEP"]


def test_kicks_are_refused_once_and_robots_answer() -> None:
    with served("--lockstep", "--blue", "2,7") as (client, _):
        answer = client.ask(1, serving.kick(7) + serving.local(2, 0.1))
        assert serving.codes(answer) == ["NO_KICK"]
        # feedback: id {number, team}, no contact with the ball
        robots = [field(2, field(1, field(1, number) + field(2, 2)) + field(2, 0)) for number in (7, 2)]
        assert answer.endswith(b"".join(robots))
        assert serving.codes(client.ask(1, serving.kick(7))) == []
        assert serving.codes(client.ask(1, serving.local(3, 0.1))) == ["UNKNOWN_ROBOT"]
        assert serving.codes(client.ask(2, serving.local(2, 0.1))) == ["UNKNOWN_ROBOT"]
        assert isinstance(client, Client)
