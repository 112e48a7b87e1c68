"""The process: real time, other speeds, pauses; bad packets, restarts of either side, and its end."""

import random
import signal
import socket
import time

import numpy as np
import pytest
import serving
from served import FAST, QUIET, here, pitch_of
from serving import LOOPBACK, Client, served
from wire_messages import bad_packets

SLACK_S = 0.35  # by which a busy machine may be late in a second, and then catches up


def elapsed(client: Client, frames: int) -> tuple[float, float]:
    """Simulated and real time between detections that are some frames apart."""
    first, began = serving.captured(client.newest()), time.monotonic()
    for _ in range(frames):
        last = serving.captured(client.detection())
    return last - first, time.monotonic() - began


@pytest.mark.parametrize("speed", [0.5, 1.0, 2.0])
def test_time_goes_as_fast_as_it_is_told(speed: float) -> None:
    with here(pitch_of(*QUIET, FAST), "", speed) as (client, server):
        client.newest()
        lost = server.lost_s
        simulated, real = elapsed(client, 50)
        lost = server.lost_s - lost
        assert simulated == pytest.approx(50 / 60, abs=1e-6)  # no image is lost
        assert -SLACK_S < real - simulated / speed < lost + SLACK_S


def test_a_pause_holds_robots_and_the_next_speed_lets_them_go_on() -> None:
    """Without a jump: time that has passed in the pause is none."""
    with here(pitch_of(*QUIET, FAST, "firmware.timeout_s=0"), "") as (client, _):
        client.ask(1, serving.local(0, 0.5))
        assert serving.codes(client.ask(0, serving.speed(0.0))) == []
        paused = client.newest()
        client.vision.settimeout(0.3)
        with pytest.raises(TimeoutError):
            client.detection()
        client.vision.settimeout(serving.PATIENCE_S)
        assert serving.codes(client.ask(0, serving.speed(-1.0))) == ["SPEED"]
        assert serving.codes(client.ask(0, serving.speed(float("nan")))) == ["SPEED"]
        client.ask(0, serving.speed(1.0))
        gap = serving.captured(client.detection()) - serving.captured(paused)
        assert gap == pytest.approx(1 / 60, abs=1e-6)


def test_robots_drive_in_real_time_and_stop_when_nobody_speaks() -> None:
    """At 1 m/s for half a second, then silence: 0.1 s more, and the way of braking, v / (2 x 4 m/s^2) at most."""
    with here(pitch_of(*QUIET, FAST), "") as (client, _):
        start = serving.robots(client.newest())["blue", 0]
        for _ in range(30):
            client.ask(1, serving.local(0, 1.0))
            where = serving.robots(client.detection())["blue", 0]
        driven = where[0] - start[0]
        assert driven > 0.2
        first = serving.captured(client.newest())
        while serving.captured(detection := client.detection()) < first + 0.6:
            pass
        stopped = serving.robots(detection)["blue", 0]
        assert stopped[0] - where[0] < 0.1 + 0.13 + SLACK_S
        assert serving.robots(client.detection())["blue", 0] == pytest.approx(stopped, abs=1e-5)


def test_vision_is_multicast_where_nothing_else_is_said() -> None:
    """Or to the group that is named: to any number of listeners on this computer."""
    listeners = []
    for _ in range(2):
        listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(("224.5.23.2", listeners[0].getsockname()[1] if listeners else 0))
        member = socket.inet_aton("224.5.23.2") + socket.inet_aton(LOOPBACK)
        listener.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        listener.settimeout(serving.PATIENCE_S)
        listeners.append(listener)
    port = listeners[0].getsockname()[1]
    with here(pitch_of(), "") as (client, server):
        client.ask(0, serving.field(2, serving.field(4, port)))  # config: the port of vision
        server.publisher.to = server.publisher.to._replace(host="224.5.23.2")
        heard = [listener.recv(65536) for listener in listeners]
    assert 1 in serving.fields(heard[0]) or 2 in serving.fields(heard[0])
    for listener in listeners:
        listener.close()


def test_bad_packets_are_counted_and_skipped_and_the_rest_is_obeyed() -> None:
    """Thousands that are random, cut off or turned about; then the robots are where they were, and still drive."""
    count = 4000
    with here(pitch_of(*QUIET, FAST, blue="2"), "") as (client, server):
        start = serving.robots(client.newest())
        rng = random.Random(0)
        for number, packet in enumerate(bad_packets(1, count)):
            client.commands.sendto(packet, (LOOPBACK, client.ports[number % 3]))
            if number % 100 == 0:
                client.ask(1, serving.local(0, rng.random()))
        assert server.notes.counts["bad packets"] > 10  # how many come through is up to the system's buffers
        client.commands.close()  # answers to those that were commands after all wait there; one may have set the speed
        client.commands = serving.udp()
        client.ask(0, serving.speed(1.0))
        client.newest()
        for _ in range(30):
            client.commands.sendto(serving.local(1, 1.0), (LOOPBACK, client.ports[1]))
            seen = serving.robots(client.detection())
        assert np.hypot(*np.subtract(seen["blue", 1], start["blue", 1])[:2]) > 0.1


def test_either_side_is_killed_and_comes_back_and_what_ends_it_ends_it_cleanly() -> None:
    client = Client()
    with served("--set", FAST, client=client) as (_, process):
        ports = client.ports
        client.ask(1, serving.local(0, 0.5))
        process.send_signal(signal.SIGKILL)
        process.wait(serving.PATIENCE_S)
    client.commands.sendto(serving.local(0, 0.5), (LOOPBACK, ports[1]))  # to nobody
    with served("--set", FAST, client=client, ports=ports) as (_, process):
        client.close()
        client = Client()  # a team that was started anew: of other ports
        client.ports = ports
        assert serving.codes(client.ask(1, serving.local(0, 0.5))) == []
        out, error = serving.ended(process)
        assert process.returncode == 143
        assert "s simulated" in out
        assert "blue commands" in out
        assert error.splitlines()[-1].startswith("error: terminated; ")
        assert "Traceback" not in error
    client.close()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--blue", "x"], "--blue takes how many robots, such as 3, or their numbers, such as 0,4,7, not 'x'"),
        (["--blue", "0", "--yellow", "0"], "a world has 1 to 12 robots, --blue and --yellow together, not 0"),
        (["--blue", "1,1"], "--blue: robots have different numbers from 0 to 15, not '1,1'"),
        (["--plant", "kinematic"], "No such option"),
        (["--speed", "-1"], "--speed must be a number from 0 to 1000, not -1"),
        (["--vision", "10.0.0.1:10020"], "10.0.0.1 is another computer"),
        (["--interface", "203.0.113.1"], "cannot send by the interface '203.0.113.1'"),
    ],
)
def test_mistakes_are_told_in_a_line(options: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    from omni_mj.cli import console
    from omni_mj.cli.main import cli

    with pytest.raises(SystemExit) as end:
        console.invoke(cli, ["serve", *options])
    assert end.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert says in line
