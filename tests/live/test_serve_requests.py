"""Requests of clients: each is done or answered; none costs others their turn."""

import sys
import time

import numpy as np
import pytest
import serve_client
from benches.serve import FAST, QUIET, Field, here
from serve_client import BLUE, YELLOW, local, wheels, world

from omni_control.errors import OmniError
from omni_mj.live.serve.inbox import MAX_CLIENTS, MAX_QUEUE, Inbox
from omni_mj.live.sockets import Address, MessageCounter, Receiver
from omni_mj.live.wire.league_pb2 import (
    AnyMessage,
    ErForceRealism,
    Geometry,
    RealismConfig,
    RobotCommand,
    RobotControl,
    RobotControlResponse,
    RobotId,
    RobotLimits,
    RobotSpecs,
    SimulatorCommand,
    SimulatorConfig,
    TeleportBall,
    TeleportRobot,
    WheelAngles,
)

ER_FORCE = b"type.googleapis.com/sslsim.RealismConfigErForce"
UNKNOWN = b"\x98\x06\x01"  # field 99, 1


def configure(*specs: RobotSpecs, realism: bytes | None = None, url: bytes = ER_FORCE) -> bytes:
    """A packet to the simulator: specs of robots, and realism."""
    config = SimulatorConfig(robot_specs=specs)
    if realism is not None:
        config.realism_config.CopyFrom(
            RealismConfig(custom=[AnyMessage(type_url=url, value=realism)])
        )
    return SimulatorCommand(config=config).SerializeToString()


def answers(field: Field, packet: bytes) -> list[str]:
    """The errors of a configuration, code and message."""
    errors = field.pitch.configure(SimulatorCommand.FromString(packet).config)
    return [f"{error.code} {error.message}" for error in errors]


@pytest.fixture
def inbox():
    messages, port = MessageCounter(), Receiver(Address(serve_client.LOOPBACK, 0), "127.0.0.1")
    made, clients = Inbox({BLUE: port}, messages), [serve_client.udp() for _ in range(MAX_CLIENTS)]

    def send(number: int, data: bytes) -> None:
        clients[number].sendto(data, port.address)
        made.receive(1.0)

    yield made, send, messages
    made.close()
    for connection in (port, *clients):
        connection.close()


def test_a_client_that_sends_much_delays_another_by_one_packet(inbox) -> None:
    """The newest packets of each client are handled in turn, in the order in which they came."""
    received, send, messages = inbox
    for number in range(3 * MAX_QUEUE):
        send(0, b"%d" % number)
    send(1, b"first")
    send(1, b"second")
    order = [received.take().data for _ in range(4)]
    assert order == [b"%d" % (2 * MAX_QUEUE), b"first", b"%d" % (2 * MAX_QUEUE + 1), b"second"]
    assert messages["packets too fast"] == 2 * MAX_QUEUE


def test_clients_are_bounded_and_silent_ones_make_room(inbox) -> None:
    received, send, messages = inbox
    for number in range(MAX_CLIENTS):
        send(number, b"mine")
    with serve_client.udp() as late:
        late.sendto(b"late", received._ports[BLUE].address)
        received.receive(1.0)
        assert messages["packets of too many clients"] == 1
        assert [received.take().data for _ in range(MAX_CLIENTS)] == [b"mine"] * MAX_CLIENTS
        assert received.take() is None
        time.sleep(0.3)
        late.sendto(b"late", received._ports[BLUE].address)
        received.receive(1.0)
        assert received.take().data == b"late"
    assert messages["packets of too many clients"] == 1
    send(0, b"again")
    assert received.take().data == b"again"


def test_a_flood_of_small_packets_is_read_in_portions(inbox) -> None:
    """The simulation goes on in between, and no packet of the flood displaces a known client."""
    received, send, messages = inbox
    for number in range(MAX_CLIENTS):
        send(number, b"mine")
    with serve_client.udp() as late:
        for _ in range(1500):
            late.sendto(b"late", received._ports[BLUE].address)
        counts = [0]
        for _ in range(3000):
            received.receive(0.0)
            counts.append(messages["packets of too many clients"])
    assert counts[1] < min(counts[-1], 1000)
    assert [received.take().data for _ in range(MAX_CLIENTS)] == [b"mine"] * MAX_CLIENTS


def test_many_new_clients_delay_the_oldest_one_by_one_packet(inbox) -> None:
    received, send, _ = inbox
    send(0, b"hello")
    assert received.take().data == b"hello"
    for number in range(1, MAX_CLIENTS):
        send(number, b"flood")
    send(0, b"mine")
    assert b"mine" in [received.take().data for _ in range(2)]


@pytest.mark.skipif(sys.platform != "linux", reason="needs a kernel queue for each client")
def test_a_flood_that_fills_the_kernel_queue_loses_no_packet_of_a_known_client(inbox) -> None:
    """Its packet is there after one portion of the flood, and the port remains taken."""
    received, send, _ = inbox
    port = received._ports[BLUE].address
    for data in (b"first", b"second"):
        send(0, data)
        assert received.take().data == data
    with serve_client.udp() as hostile:
        for _ in range(8000):
            hostile.sendto(b"flood", port)
    send(0, b"third")
    assert b"third" in [received.take().data for _ in range(2)]
    assert received.take() is not None  # the flood's portion is bounded, and waits
    with pytest.raises(OmniError, match="in use"):
        Receiver(port, serve_client.LOOPBACK)


def test_a_flood_of_large_packets_stops_neither_vision_nor_another_client() -> None:
    """Of 16 kB each, with thousands of commands or teleports; of 52 kB they are not even read."""
    commands = [RobotCommand(id=1)] * 3000
    flood = (
        RobotControl(robot_commands=commands).SerializeToString(),
        serve_client.teleport(1, BLUE, present=False) * 800,
        b"\x0a\x02\x08\x01" * 13_000,
    )
    field = Field(*QUIET, FAST, blue="2")
    with here(field, False) as (client, server), serve_client.udp() as hostile:
        began, n_answers = time.monotonic(), 0
        first = client.newest().frame_number
        while time.monotonic() - began < 1.0:
            for packet in flood:
                for port in client.ports:
                    hostile.sendto(packet, (serve_client.LOOPBACK, port))
            assert client.codes(1, local(0, 0.5)) == []
            n_answers += 1
        lost = server.messages["ms late in all"] / 1e3
        assert client.newest().frame_number - first > 0.8 * 60 * (1.0 - lost)
        assert n_answers >= 5  # on a busy machine
    assert len(field.names) == 2
    assert server.messages["refused: TOO_MANY"] >= 5
    assert server.messages["bad packets"] >= 5


def test_each_kind_of_refusal_is_counted_and_said_once_at_every_port() -> None:
    field = Field(*QUIET, FAST, blue="2")
    with here(field) as (client, server):
        for _ in range(3):
            assert client.codes(0, serve_client.teleport(16, BLUE, x=0.0, y=0.0)) == ["ROBOT_ID"]
            for port in (1, 2):
                assert client.codes(port, local(9, 1.0)) == ["UNKNOWN_ROBOT"]
        counts = {kind: server.messages[kind] for kind in server.messages if "refused" in kind}
        for option in ("roll", "by_force", "roll"):
            assert client.codes(0, serve_client.control(teleport_ball={option: True})) == ["OPTION"]
    assert counts == {"refused: ROBOT_ID": 3, "refused: UNKNOWN_ROBOT": 6}
    assert len(field.said) == 4


def test_what_does_not_apply_is_answered() -> None:
    with here(Field(*QUIET, FAST, blue="2")) as (client, _):
        for option in ("by_force", "roll", "teleport_safely"):
            ball = TeleportBall(x=1.0, y=0.5, **{option: True})
            assert client.codes(0, serve_client.control(teleport_ball=ball)) == ["OPTION"]
        robot = TeleportRobot(id=RobotId(id=0, team=BLUE), x=1.0, y=1.0, by_force=True)
        assert client.codes(0, serve_client.control(teleport_robot=[robot])) == ["OPTION"]
        seen = client.step(b"")
        assert (seen.balls[0].x, seen.balls[0].y) == (1000, 500)
        assert serve_client.robots(seen)["blue", 0][:2] == pytest.approx((1, 1), abs=1e-3)
        for port in range(3):
            assert client.codes(port, UNKNOWN) == ["UNKNOWN_FIELD"]
        nested = serve_client.control(teleport_ball=TeleportBall.FromString(UNKNOWN))
        assert client.codes(0, nested) == ["UNKNOWN_FIELD"]
        geometry = Geometry.FromString(
            client.packet("geometry").geometry.SerializeToString() + b"\x1a\x00"  # models
        )
        packet = SimulatorCommand(config=SimulatorConfig(geometry=geometry)).SerializeToString()
        assert client.codes(0, packet) == ["UNKNOWN_FIELD"]
        with serve_client.udp() as other:
            config = SimulatorConfig(vision_port=other.getsockname()[1])
            packet = SimulatorCommand(config=config).SerializeToString()
            assert client.codes(0, packet) == []
            client.codes(1, local(0, 0.0))
            assert other.recv(65536)


def field_config(geometry: Geometry, length: int, width: int, margin: int) -> bytes:
    """A packet to the simulator: a field, its lengths in mm, with the lines of another."""
    changed = Geometry.FromString(geometry.SerializeToString())
    size = changed.field
    size.field_length, size.field_width, size.boundary_width = length, width, margin
    return SimulatorCommand(config=SimulatorConfig(geometry=changed)).SerializeToString()


@pytest.mark.parametrize("is_empty", [False, True], ids=["with robots", "without robots"])
def test_a_field_of_a_client_has_its_walls_and_is_sent_back(is_empty: bool) -> None:
    """Robots keep their poses; cameras cover the new field, in equal parts."""
    field = Field(*QUIET, FAST, "vision.cameras=2", blue="1", yellow="0")
    with here(field) as (client, _):
        own = client.packet("geometry").geometry
        assert client.codes(0, serve_client.teleport(0, BLUE, x=0.5, y=0.25)) == []
        if is_empty:
            client.ask(0, serve_client.teleport(0, BLUE, present=False))
        assert client.codes(0, field_config(own, 2000, 1500, 250)) == []
        geometry = client.packet("geometry").geometry
        while geometry == own:
            geometry = client.packet("geometry").geometry
        if is_empty:
            client.ask(0, serve_client.teleport(0, BLUE, present=True, x=0.5, y=0.25))
        np.testing.assert_allclose(field.poses[0, :2], [0.5, 0.25], atol=1e-4)
        for _ in range(50):
            client.codes(1, world(0, 2.0))
        assert field.poses[0, 0] == pytest.approx(1.25 - 0.09, abs=0.01)
        # The robot would stand in a wall; too small; too large a margin
        for bad in ((1500, 1500, 500), (100, 1500, 500), (9000, 6000, 5001)):
            assert client.codes(0, field_config(own, *bad)) == ["GEOMETRY"]
    assert geometry.field.field_lines == own.field.field_lines
    assert [camera.tx for camera in geometry.calib] == [625, -625]
    assert any("would stand in a wall" in text for text in field.said)


def test_specs_of_a_robot_limit_its_velocity_and_others_are_answered() -> None:
    """Its own dimensions are no error; a limit of its speed holds for all forms of commands."""
    field, name = Field(*QUIET, FAST), RobotId(id=0, team=BLUE)
    mass_kg = field.pitch.rows[0].settings.body.mass_kg
    angles = dict(zip(("front_right", "back_right"), np.radians([60, 135]), strict=True))
    angles |= dict(zip(("back_left", "front_left"), np.radians([225, 300]), strict=True))
    own = RobotSpecs(
        id=name,
        radius=0.09,
        height=0.15,
        mass=mass_kg,
        wheel_angles=WheelAngles(**angles),
        limits=RobotLimits(vel_absolute_max=0.3, vel_angular_max=1.0),
    )
    assert answers(field, configure(own)) == []
    rims = [-2 * float(np.sin(azimuth)) for azimuth in np.radians([300, 225, 135, 60])]
    for command in (local(0, 2.0), world(0, 2.0), wheels(0, *rims)):
        assert field.put(0, -3.0, 0.0, 0.0) == []
        field.drive(40, command)
        assert 0.2 < field.twists[0, 0] < 0.31
    field.drive(40, local(0, 0.0, 0.0, 5.0))
    assert 0.8 < field.twists[0, 2] < 1.1
    other = RobotSpecs(id=name, mass=1.0, max_linear_kick_speed=6.5, custom=[AnyMessage()])
    other.limits.acc_brake_absolute_max = 3.0
    (text,) = answers(field, configure(other))
    assert text.endswith("mass, max_linear_kick_speed, acc_brake_absolute_max, custom")
    for wrong in (
        RobotSpecs(id=name, mass=float("nan")),
        RobotSpecs(id=name, limits=RobotLimits(vel_absolute_max=-1.0)),
        RobotSpecs(id=RobotId(id=3)),
    ):
        (text,) = answers(field, configure(wrong))
        assert text.split()[0] in ("SPECS", "ROBOT_ID")


def test_realism_changes_noise_delay_and_losses_and_the_rest_is_answered() -> None:
    field = Field(FAST)
    exact = ErForceRealism(
        stddev_robot_p=0.0, stddev_robot_phi=0.0, missing_robot_detections=0.0, vision_delay=10**8
    ).SerializeToString()
    assert answers(field, configure(realism=exact)) == []
    (image,) = field.look()
    np.testing.assert_allclose(image.poses, field.poses, atol=1e-12)
    assert image.sent_s == pytest.approx(0.1)
    lossy = ErForceRealism(robot_command_loss=0.9).SerializeToString()
    assert answers(field, configure(realism=lossy)) == []
    field.drive(3, local(0, 1.0))
    assert np.abs(field.twists).max() < 0.3
    ball = exact + b"\x0d\x00\x00\x80\x3f"  # stddev_ball_p
    assert answers(field, configure(realism=ball))[0].startswith("UNKNOWN_FIELD ErForceRealism")
    for wrong in (
        ErForceRealism(robot_command_loss=2.0).SerializeToString(),
        ErForceRealism(stddev_robot_p=float("nan")).SerializeToString(),
        b"\xff",
    ):
        assert answers(field, configure(realism=wrong))[0].startswith("REALISM ")
    for url in (b"other", b"\xff"):
        assert answers(field, configure(realism=exact, url=url))[0].startswith("REALISM ")


def test_the_ball_is_at_the_dribbler_where_both_touch() -> None:
    """In front of the robot's face, 75 mm from its center, and within its width of 70 mm."""
    touching = {(0.095, 0.0): True, (0.095, 0.03): True, (0.095, 0.05): False}
    touching |= {(0.12, 0.0): False, (-0.095, 0.0): False, (0.03, 0.0): False}
    with here(Field(*QUIET, FAST, blue="2")) as (client, _):
        client.codes(0, serve_client.teleport(1, BLUE, x=1.0, y=-1.0, orientation=2.0))
        cosine, sine = np.cos(2.0), np.sin(2.0)
        for (x, y), expected in touching.items():
            place = {"x": 1.0 + cosine * x - sine * y, "y": -1.0 + sine * x + cosine * y}
            client.codes(0, serve_client.control(teleport_ball=place))
            answer = RobotControlResponse.FromString(client.ask(1, local(0, 0.0) + local(1, 0.0)))
            contacts = {robot.id: robot.dribbler_ball_contact for robot in answer.feedback}
            assert contacts == {0: False, 1: expected}, (x, y)


def test_robots_are_parked_beyond_the_walls_and_come_back() -> None:
    with here(Field(*QUIET, FAST, blue="2", yellow="1")) as (client, _):
        for number in (0, 1):
            assert client.codes(0, serve_client.teleport(number, BLUE, None, x=0.0, y=-4.5)) == []
        assert list(client.after(local(0, 0.0), team=2)) == [("yellow", 0)]
        assert client.codes(1, local(0, 1.0)) == ["UNKNOWN_ROBOT"]
        back = serve_client.teleport(0, BLUE, None, y=-1.0, orientation=1.0)
        assert client.codes(0, back) == []
        seen = client.after(local(0, 0.0), team=2)
        assert seen["blue", 0] == pytest.approx((0.0, -1.0, 1.0), abs=1e-3)
        moving = serve_client.teleport(1, BLUE, None, x=0.0, y=9.0, v_x=1.0)
        assert client.codes(0, moving) == ["OPTION"]
        assert client.codes(0, serve_client.teleport(1, YELLOW, x=0.0, y=3.75)) == ["OCCUPIED"]
