"""`omni-mj drive` as a process, with a simulator that is another: what it prints and leaves, what it survives."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import serving
from commands import invoke
from serving import free_port

PATIENCE_S = 120.0  # with processes, on a computer that does much else
PEER = [sys.executable, str(Path(serving.__file__).with_name("peer.py"))]
DRIVE = [sys.executable, "-m", "omni_mj", "drive"]
SHORT = ("--set", "reference.waypoints=[[0, 0], [0.6, 0.3]]", "--set", "reference.settle_s=0.2")
RADIO = """
import socket
from omni_mj.live.radio import Radio
from omni_mj.live.wire.simulation_pb2 import RobotControl


class Mine(Radio):
    def __init__(self, line):
        super().__init__(line)
        self.socket, self.sent = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), 0

    def send(self, commands):
        self.sent += 1
        for each in commands:
            velocity = {"forward": each.forward, "left": each.left, "angular": each.turn}
            packet = RobotControl(robot_commands=[{"id": each.id, "move_command": {"local_velocity": velocity}}])
            self.socket.sendto(packet.SerializeToString(), self.line.host)

    def close(self):
        self.socket.close()
        open("sent.txt", "w").write(str(self.sent))
"""


class Simulator:
    """The peer, in real time."""

    def __init__(self) -> None:
        self.vision, self.port = free_port(), free_port()
        self.options = ("--vision", f"127.0.0.1:{self.vision}", "--commands", f"127.0.0.1:{self.port}")
        self.process: subprocess.Popen[bytes] | None = None

    def start(self, *said: object) -> None:
        where = ("--vision", f"127.0.0.1:{self.vision}", "--port", str(self.port))
        self.process = subprocess.Popen([*PEER, *where, *map(str, said)])

    def kill(self) -> None:
        if self.process:
            self.process.kill()
            self.process.wait()

    def drive(self, *options: object, cwd: Path) -> "subprocess.Popen[str]":
        command = [*DRIVE, *self.options, *map(str, options)]
        return subprocess.Popen(command, cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.fixture
def simulator() -> Iterator[Simulator]:
    made = Simulator()
    yield made
    made.kill()


def until(process: "subprocess.Popen[str]", text: str) -> str:
    """What was printed up to and with a line that holds a text."""
    assert process.stdout
    said = ""
    for line in process.stdout:
        said += line
        if text in line:
            return said
    raise AssertionError(f"{text!r} was never printed, but {said}")


def test_a_simulator_that_is_killed_and_started_again_elsewhere(
    simulator: Simulator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The robot is brought back, the rest of the route is driven, and all that `run` leaves is there, and the table.

    What was live is not repeated, which is said.
    """
    simulator.start("--delay", 1, "--loss", 0.05)
    known = ("--no-pulse", "--set", "radio.delay_frames=1")
    long = ("--set", "reference.waypoints=[[0, 0], [1.2, 0]]", "--out", "drive", "--no-figures", *known)
    process = simulator.drive("--scenario", "rect", *long, cwd=tmp_path)
    until(process, "1 s  robot 0: latency")
    simulator.kill()
    time.sleep(1.0)
    simulator.start("--delay", 1, "--start", -0.2, 0.1, 1.0)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, err
    for text in ("vision has fallen silent", "the clock of camera 0 began anew", "vision is back"):
        assert text in err
    assert re.search(r"robot 0: answers \d\.\d\d frames", out)
    assert "rect, tigers-v2016 on the live plant" in out
    left = {path.name for path in (tmp_path / "drive").iterdir()}
    assert {"summary.json", "trajectory.parquet", "recording.rrd", "report.html", "scenario.toml", "link.json"} <= left
    found = json.loads((tmp_path / "drive" / "link.json").read_text())
    assert found["cameras"]["0"]["restarts"] == 1
    table = pq.read_table(tmp_path / "drive" / "trajectory.parquet").to_pydict()
    assert abs(table["x_m"][-1] - 1.2) < 0.05
    assert "Such robots never do quite the same again" in (tmp_path / "drive" / "report.html").read_text()
    assert invoke("verify", tmp_path / "drive") == 2
    assert "is of omni-mj drive, which was live and is not repeated: what robots" in capsys.readouterr().err
    summary = json.loads((tmp_path / "drive" / "summary.json").read_text())
    assert summary["complete"]
    assert summary["scenarios"]["rect"]["paper"] is None


def test_ctrl_c_saves_what_there_is(simulator: Simulator, tmp_path: Path) -> None:
    simulator.start()
    said = "--no-pulse", "--out", "drive", "--no-figures", "--no-record", "--set", "reference.laps=20"
    process = simulator.drive("--scenario", "rect", *said, cwd=tmp_path)
    until(process, "1 s  robot 0")
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert "interrupted; what was recorded until then is in drive" in err
    assert pq.read_table(tmp_path / "drive" / "trajectory.parquet").num_rows >= 60


def test_listening_only_and_a_radio_of_ones_own(simulator: Simulator, tmp_path: Path) -> None:
    simulator.start("--noise", 0.001, "--cameras", 2, "--junk", 0.2)
    process = simulator.drive("--dry-run", "--duration", 2.5, cwd=tmp_path)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    assert re.search(r"camera 0: (59|60)\.\d\d frames a second of its clock", out)
    noise = re.search(r"blue 0: at .*noise (\d\.\d\d) mm", out)
    assert noise
    assert 0.8 < float(noise[1]) < 1.2  # 1 mm by 100 detections and more, whose median is known to a tenth
    assert "bad packet" in out
    assert err.count("is skipped") == 1

    simulator.kill()
    simulator.start("--lockstep")  # nothing that is sent then depends on how busy this computer is
    (tmp_path / "radio.py").write_text(RADIO)
    said = ("--scenario", "rect", *SHORT, "--radio", "radio.py:Mine", "--duration", 0.5, "--out", "drive")
    said = (*said, "--rate", "vision")
    process = simulator.drive(*said, "--no-figures", "--no-record", "--quiet", cwd=tmp_path)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, out) == (0, ""), err
    assert int((tmp_path / "sent.txt").read_text()) > 90  # a pulse of 66 frames, the way, and half a second
    assert pq.read_table(tmp_path / "drive" / "trajectory.parquet").num_rows == 30


WRONG = {
    ("--scenario", "rect", "--controller", "oracle"): "oracle must be given the true pose",
    ("--scenario", "rect", "--id", 1, "--id", 2): "the scenario has places for 1",
    ("--scenario", "rect", "--id", 1, "--id", 1, "--here"): "each once",
    ("--scenario", "rect", "--commands", "192.0.2.1"): "name the interface",
    ("--scenario", "rect", "--vision", "nowhere"): "nobody knows the host",
    ("--scenario", "rect", "--duration", 0): "not in the range",
    ("--scenario", "fault-push"): "the plant live has no push",
    ("--scenario", "fault-vision"): "[[fault]]",
    (): "--scenario is missing",
}


@pytest.mark.parametrize(("said", "reason"), WRONG.items(), ids=list(WRONG.values()))
def test_what_cannot_be_is_said_in_a_line(
    said: tuple[object, ...], reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert invoke("drive", *said, "--out", tmp_path / "out") == 2
    err = capsys.readouterr().err
    assert reason in err
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_nobody_is_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It says where it listened, and leaves no folder behind; a run on the live plant names `drive`."""
    where = f"127.0.0.1:{free_port()}"
    assert invoke("drive", "--scenario", "rect", "--vision", where, "--wait", 0.2, "--out", tmp_path / "out") == 2
    assert f"no vision came to {where}" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert invoke("run", "--scenario", "rect", "--plant", "live", "--out", tmp_path / "out") == 2
    assert "omni-mj drive" in capsys.readouterr().err


@pytest.mark.parametrize("what", ["--dry-run", "--no-record"])
def test_one_signal_ends_the_wait_for_vision(tmp_path: Path, capsys: pytest.CaptureFixture[str], what: str) -> None:
    before = signal.getsignal(signal.SIGTERM)

    def end() -> None:
        while signal.getsignal(signal.SIGTERM) is before:
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=end, daemon=True).start()
    where = ("--vision", f"127.0.0.1:{free_port()}", "--wait", PATIENCE_S, "--out", tmp_path / "out")
    assert invoke("drive", "--scenario", "rect", what, *where) == 128 + signal.SIGTERM
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: terminated; ")
