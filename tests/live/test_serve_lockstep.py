"""In lockstep, runs over the network equal each other and the in-process loop bit for bit."""

import numpy as np
import pytest
import serve_client
from benches.drive import connect_in_lockstep, drive_live, live_scenario
from benches.serve import Field, here
from serve_client import LOOPBACK, Client, local, world

import omni_mj as om
from omni_control.errors import OmniError
from omni_mj.live.live_loop import Live
from omni_mj.live.wire.league_pb2 import RobotCommand, RobotControl, RobotControlResponse

STEPS = 40
# What a place of up to 4 m loses on the wire, in mm as a 32-bit number: 2^-24 of it, and rounding
FLOAT32_M = 4e-7
NOISY = (
    "vision.cameras=2",
    "radio.jitter_frames=2",
    "radio.loss_probability=0.1",
    "firmware.timeout_s=0.05",
)


def taped(client: Client) -> list[bytes]:
    """All that comes back from a run of two teams in which everything is used."""
    answers: list[bytes] = []
    for k in range(STEPS):
        answers.append(
            client.ask(1, world(0, 1.0, 0.3) + serve_client.wheels(1, 0.5, -0.2, 0.4, 0.1))
        )
        answers.append(client.ask(2, local(0, 0.8, 0.2, k / 10)))
        if k == STEPS // 2:
            answers.append(
                client.ask(0, serve_client.teleport(1, 2, x=-1.0, y=1.0, orientation=0.5))
            )
    client.vision.settimeout(0.2)
    seen = dict[bytes, None]()  # before the first command all is sent again, more or less often
    while True:
        try:
            seen[client.vision.recv(65536)] = None
        except TimeoutError:
            return [*answers, *seen]


def test_a_run_is_the_same_to_the_bit_and_another_seed_is_another() -> None:
    """Of the same options, in a process of its own and in this one."""
    sets = [word for setting in NOISY for word in ("--set", setting)]
    client = Client()
    options = (
        "--lockstep",
        "--blue",
        "2",
        "--yellow",
        "1",
        "--seed",
        "3",
        "--scenario",
        "worn-robots",
    )
    with serve_client.served(*options, *sets, client=client):
        separate = taped(client)
    client.close()
    tapes = []
    for seed in (3, 4):
        with here(Field(*NOISY, blue="2", yellow="1", scenario="worn-robots", seed=seed)) as (
            client,
            _,
        ):
            tapes.append(taped(client))
    assert tapes[0] == separate
    assert tapes[1] != separate
    # 2 packets a step, each with an answer and an image of either camera; one image before; the
    # geometry each second.
    assert 6 * STEPS + 2 <= len(separate) <= 6 * STEPS + 8


@pytest.mark.parametrize("delay", [4])
def test_the_loop_in_one_process_is_reproduced_over_the_wire(delay: int) -> None:
    """With the same dead time, noise, misses and team, whose computer is a client here.

    In one process the heading that is sent with commands is the filter's, here it is the camera's,
    for commands of the protocol have none; the robot's own heading is corrected by either, which
    makes the whole difference: the camera's noise of 0.01 rad, by a gain of 2/s at 60 Hz, is 0.01
    sqrt(2/60/2) = 1.3 mrad, times the 0.67 m of the route 0.9 mm.
    """
    route = {"waypoints": [[0, 0, 0], [0.6, 0.3, 0.5]], "settle_s": 0}
    chosen = om.load_scenario(
        "rect", controllers=["comp-flc"], reference=route, radio={"delay_frames": delay}
    )
    log, team = om.Simulation(chosen).run(), om.Simulation(chosen).team
    seen = np.full((log.length, 3), np.nan)
    sets = (
        f"reference.waypoints={route['waypoints']}",
        "reference.settle_s=0",
        f"radio.delay_frames={delay}",
    )
    field = Field(*sets, scenario="rect")
    assert field.put(0, 0.0, 0.0, 0.0) == []
    with here(field) as (client, _):
        detection = client.newest()
        for k in range(log.length):
            seen[k] = serve_client.robots(detection).get(("blue", 0), [np.nan] * 3)
            team.observe(seen[[k]])
            detection = client.step(world(0, *map(float, team.command()[0])))
    expected, way = log.channel("vision")[:, 0], log.channel("ref")[:, 0, :2]
    np.testing.assert_array_equal(np.isnan(seen), np.isnan(expected))  # missed in the same frames
    np.testing.assert_allclose(seen[0], expected[0], atol=FLOAT32_M)  # the same noise
    known = ~np.isnan(expected[:, 0])
    assert np.abs(seen - expected)[known, :2].max() < 0.9e-3
    errors = [np.abs(found[:, :2] - way)[known].max(0) for found in (seen, expected)]
    np.testing.assert_allclose(*errors, atol=0.9e-3)


def test_packets_to_the_simulator_repeat_the_last_image_and_kicks_are_ignored() -> None:
    with here(Field(blue="2,7")) as (client, server):
        seen = client.step(local(2, 1.0))
        assert client.ask(0, b"") == b""
        assert client.packet().detection == seen
        assert client.codes(0, serve_client.control(simulation_speed=2.0)) == ["SPEED"]
        kick = RobotControl(robot_commands=[RobotCommand(id=7, kick_speed=5.0)]).SerializeToString()
        answer = RobotControlResponse.FromString(client.ask(1, kick + local(2, 0.1)))
        assert [(robot.id, robot.dribbler_ball_contact) for robot in answer.feedback] == [
            (7, False),
            (2, False),
        ]
        assert not answer.errors
        assert server.messages["kicks"] == 1


def drive_in_lockstep(*sets: str, pulse: bool = False) -> tuple[np.ndarray, Live]:
    """Drive a robot of `serve`; return true poses, (frames, 3), and the drive."""
    field, truth = Field(*sets, plant="planar"), []
    with here(field) as (client, server):
        port = serve_client.free_port()
        server.vision = server.vision._replace(port=port)
        server.after_frame = lambda: truth.append(field.poses[0])
        options = connect_in_lockstep(
            f"{LOOPBACK}:{port}", f"{LOOPBACK}:{client.ports[1]}", pulse=pulse
        )
        live = drive_live(live_scenario("comp-flc"), options)
    return np.array(truth), live


@pytest.mark.parametrize(
    "sets",
    [
        ("vision.cameras=2", "vision.delay_s=0.03"),
        ("vision.rate_hz=75", "radio.delay_frames=3"),
    ],
    ids=" ".join,
)
def test_a_drive_in_lockstep_is_repeatable_and_knows_where_the_robot_is(
    sets: tuple[str, ...],
) -> None:
    """Whatever the delays and rates of the cameras; a first image comes before the first command.

    Noise is 1.3 mm. Frames begin up to one period apart from those of the simulator, which costs
    nothing where the best offset between them is taken in steps of a tenth of a frame.
    """
    truth, live = drive_in_lockstep(*sets)
    repeated_truth, repeated_live = drive_in_lockstep(*sets)
    belief, repeated_belief = (run.log.channel("pose")[:, 0] for run in (live, repeated_live))
    np.testing.assert_array_equal(belief, repeated_belief)
    n = min(len(truth), len(repeated_truth))
    np.testing.assert_array_equal(truth[:n], repeated_truth[:n])
    frames, errors = np.arange(len(belief)), []
    for offset in np.arange(0, len(truth) - len(belief), 0.1):
        shifted = [np.interp(frames + offset, np.arange(len(truth)), truth[:, k]) for k in (0, 1)]
        errors.append(np.abs(np.transpose(shifted) - belief[:, :2]).max())
    assert min(errors) < 0.015


def test_the_measured_dead_time_does_not_depend_on_the_age_of_images() -> None:
    """Within half a frame: a robot turns later than commanded by the lag of its wheels."""
    sets = "radio.delay_frames=3", "vision.cameras=2"
    runs = [drive_in_lockstep(f"vision.delay_s={s}", *sets, pulse=True)[1] for s in (0.0, 0.2)]
    delays = [live.scenario.settings.radio.delay_frames for live in runs]
    assert delays == pytest.approx([3.2, 3.2], abs=0.5)


def test_an_age_that_is_not_believed_is_named() -> None:
    """Robots that are seen a second later seem not to turn during the pulse."""
    with pytest.raises(OmniError, match=r"not seen to turn.* sent 1 s after .* from 0 to 0\.25 s"):
        drive_in_lockstep("vision.delay_s=1", pulse=True)
