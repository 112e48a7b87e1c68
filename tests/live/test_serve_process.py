"""The process: real time, other speeds, pauses, bad packets, restarts, recordings, and its end."""

import random
import re
import signal
import time
from pathlib import Path

import numpy as np
import own_robot
import polars as pl
import pytest
import serve_client
from benches.serve import FAST, QUIET, Field, here
from commands import invoke
from serve_client import BLUE, LOOPBACK, YELLOW, Client, local, served

import omni_mj as om
from omni_mj.live.sockets import MessageCounter

SLACK_S = 0.35  # by which a busy machine may be late in a second, and then catches up


@pytest.mark.parametrize("speed", [0.5, 2.0])
def test_time_goes_as_fast_as_it_is_told(speed: float) -> None:
    with here(Field(*QUIET, FAST), False, speed) as (client, server):
        first, began, lost = (
            client.newest().t_capture,
            time.monotonic(),
            server.messages["ms late in all"],
        )
        for _ in range(50):
            last = client.packet().detection.t_capture
        real, lost = time.monotonic() - began, (server.messages["ms late in all"] - lost) / 1e3
        # No image is lost, and time stamps skip the time that a busy machine loses.
        assert last - first == pytest.approx(50 / 60 + speed * lost, abs=0.01)
        assert -SLACK_S < real - (last - first) / speed < SLACK_S


def test_time_stamps_do_not_drift_by_a_stall() -> None:
    """Time stamps leave out no time, even if the terminal takes 0.3 s to print that time is lost.

    Up to 0.1 s are caught up later, so the newest images may be that late for a while.
    """
    field = Field(*QUIET, FAST)
    field.pitch.messages = MessageCounter(lambda text: time.sleep(0.3))
    with here(field, False) as (client, server):
        client.packet()
        server.after_frame = lambda: time.sleep(0.2 * (not server.messages["times too slow"]))
        while not server.messages["ms late in all"]:
            client.packet()
        ages = [time.time() - client.packet().detection.t_capture for _ in range(30)]
    assert min(ages) < 0.1


def test_a_pause_holds_robots_and_the_next_speed_lets_them_go_on() -> None:
    """Without a jump: time that has passed in the pause is none."""
    field = Field(*QUIET, FAST, "firmware.timeout_s=0")
    with here(field, False) as (client, _):
        client.ask(1, local(0, 0.5))
        for _ in range(2):
            assert client.codes(0, serve_client.control(simulation_speed=0.0)) == []
        paused = client.newest()
        client.vision.settimeout(0.3)
        with pytest.raises(TimeoutError):
            client.packet()
        client.vision.settimeout(serve_client.PATIENCE_S)
        for bad in (-1.0, float("nan")):
            assert client.codes(0, serve_client.control(simulation_speed=bad)) == ["SPEED"]
        client.ask(0, serve_client.control(simulation_speed=1.0))
        assert sum("pause" in text for text in field.said) == 2
        gap = client.packet().detection.t_capture - paused.t_capture
        assert gap == pytest.approx(1 / 60, abs=1e-6)


def test_bad_packets_are_counted_and_skipped_and_the_rest_is_obeyed() -> None:
    """Thousands of random, truncated or reversed packets do not move robots, which still drive."""
    rng, good = (
        random.Random(0),
        [serve_client.teleport(0, 2, x=1.0, y=1.0), local(0, 1.0) + local(1, 0.5, 0.2)],
    )
    with here(Field(*QUIET, FAST, blue="2")) as (client, server):
        with serve_client.udp() as hostile:
            for number in range(3000):
                packet = bytearray(
                    good[number % 2]
                    if rng.random() < 0.5
                    else rng.randbytes(1 + rng.randrange(100))
                )
                for _ in range(rng.randrange(4)):
                    packet[rng.randrange(len(packet))] = rng.randrange(256)
                hostile.sendto(
                    packet[: rng.randrange(len(packet) + 1)], (LOOPBACK, client.ports[number % 2])
                )
        start = client.after(local(1, 1.0))["blue", 1]
        for _ in range(30):
            seen = client.after(local(1, 1.0))["blue", 1]
        assert np.hypot(*np.subtract(seen, start)[:2]) > 0.1
        assert (
            server.messages["bad packets"] > 10
        )  # how many come through is up to the system's buffers


def test_either_side_is_killed_and_comes_back_and_what_ends_it_ends_it_cleanly(
    capsys: pytest.CaptureFixture[str],
) -> None:
    client = Client()
    with served("--set", FAST, client=client):
        ports = client.ports
        client.ask(1, local(0, 0.5))
    client.commands.sendto(local(0, 0.5), (LOOPBACK, ports[1]))  # to nobody
    with served("--set", FAST, client=client, ports=ports) as process:
        assert invoke("serve", "--control-port", 0, "--blue-port", ports[1]) == 2
        assert "in use" in capsys.readouterr().err
        client.close()
        client = Client()  # a team that was started anew: of other ports
        client.ports = ports
        assert client.codes(1, local(0, 0.5)) == []
        out, error = serve_client.ended(process)
    assert process.returncode == 143
    assert "s simulated" in out
    assert "blue commands" in out
    assert error.splitlines()[-1].startswith("error: terminated; ")
    assert "Traceback" not in error
    client.close()


def test_time_stamps_recover_from_a_stall() -> None:
    """After 0.4 s in which the process was stopped, images are stamped by the clock again."""
    client = Client()
    with served("--set", FAST, client=client) as process:
        for _ in range(2):
            client.newest()
            ages = [time.time() - client.packet().detection.t_capture for _ in range(10)]
            assert min(ages) == pytest.approx(0.0, abs=0.09)
            process.send_signal(signal.SIGSTOP)
            time.sleep(0.4)
            process.send_signal(signal.SIGCONT)
            time.sleep(0.2)
        _, error = serve_client.ended(process)
    client.close()
    assert "simulated time falls behind" in error


def test_own_models_are_served_and_the_start_names_plant_and_load(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, text = (
        tmp_path / "mine.xml",
        '<geom class="hull" size="0.09 0.05" pos="0 0 0.08" type="cylinder"/>',
    )
    model.write_text(own_robot.written([60, 180, 300], more=text))
    ports = [word for port in ("control", "blue", "yellow") for word in (f"--{port}-port", 0)]
    assert invoke("serve", "--model", model, "--duration", 0.05, *ports) == 0
    out = capsys.readouterr().out
    assert str(model) in out
    assert re.search(r"physics +mujoco, wheels.model rollers; about \d+% of one core", out)


MISTAKES = {
    ("--blue", "x"): "--blue must be the number of robots",
    (
        "--blue",
        "0",
        "--yellow",
        "0",
    ): "--blue and --yellow together must be 1 to 12 robots, got 0",
    ("--blue", "1,16"): "their numbers from 0 to 15",
    ("--plant", "kinematic"): "serve needs the plant mujoco or planar, got kinematic",
    ("--plant", "planar", "--blue", "16", "--yellow", "7"): "must be 1 to 22 robots, got 23",
    ("--blue", "13"): "(--plant planar: 22)",
    ("--speed", "-1"): "-1.0 is not in the range 0<=x<=1000",
    ("--vision", "127.0.0.1:65536"): "is not an address",
    ("--vision", "10.0.0.1:10020"): "10.0.0.1 is another computer",
    ("--interface", "203.0.113.1"): "on the interface '203.0.113.1'",
}


@pytest.mark.parametrize("options", MISTAKES, ids=" ".join)
def test_mistakes_are_told_in_a_line(
    options: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert invoke("serve", *options) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert MISTAKES[options] in line


def test_robots_that_come_and_go_are_recorded_frame_by_frame(tmp_path: Path) -> None:
    """Memory does not grow: the table is written in parts, in which is what a kill would leave."""
    field = Field(*QUIET, FAST, blue="2", yellow="1")
    field.record(tmp_path / "trajectory.parquet")
    field.drive(40, local(0, 0.5))
    assert field.teleport(serve_client.teleport(1, BLUE, present=False)) == []
    field.drive(5, local(0, 0.5))
    assert field.put(9, 2.0, 2.0, 0.0, team=YELLOW) == []
    field.drive(605, local(0, 0.5))
    (part,) = tmp_path.iterdir()
    assert len(pl.read_parquet(part)) > 3 * 500
    for number, team in ((0, BLUE), (0, YELLOW), (9, YELLOW)):
        assert field.teleport(serve_client.teleport(number, team, present=False)) == []
    field.drive(3)
    field.finish()
    assert [path.name for path in tmp_path.iterdir()] == ["trajectory.parquet"]
    table = pl.read_parquet(tmp_path / "trajectory.parquet")
    counts = {
        key: len(rows)
        for key, rows in table.partition_by("controller", "slot", as_dict=True).items()
    }
    assert counts == {("blue", 0): 650, ("blue", 1): 40, ("yellow", 0): 650, ("yellow", 9): 605}
    blue = table.filter((pl.col("controller") == "blue") & (pl.col("slot") == 0)).sort("frame")
    assert blue["frame"].to_list() == list(range(1, 651))
    np.testing.assert_allclose(blue["time_s"], np.arange(1, 651) / 60)
    assert (blue["command_vx_m_s"] == 0.5).all()


def test_a_process_that_is_ended_leaves_a_whole_table_and_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, client = tmp_path / "run", Client()
    options = (
        "--lockstep",
        "--set",
        FAST,
        "--yellow",
        "1",
        "--robot",
        "tigers-v2020",
        "--out",
        str(out),
    )
    with served(*options, client=client) as process:
        for _ in range(45):
            client.step(local(0, 0.5))
        _, error = serve_client.ended(process, signal.SIGINT)
    client.close()
    assert process.returncode == 130
    last = error.splitlines()[-1]
    assert last.startswith("error: interrupted; 0.8 s were simulated; ")
    assert last.endswith(str(out))
    files = {"trajectory.parquet", "recording.rrd", "scenario.toml", "provenance.json"}
    assert files <= {path.name for path in out.iterdir()}
    times = {path.name: path.stat().st_mtime_ns for path in out.iterdir() if path.is_file()}
    assert times["provenance.json"] == min(times.values()), (
        "by which --overwrite knows a folder, whenever it is killed"
    )
    assert om.load_scenario(out / "scenario.toml").robot == "tigers-v2020"
    assert len(pl.read_parquet(out / "trajectory.parquet")) == 2 * 45
    for command in ("verify", "report"):
        assert invoke(command, out) == 2
        assert "omni-mj serve" in capsys.readouterr().err
