"""`omni-mj drive` as a process with another simulator: output, files, and failures."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import polars as pl
import pyarrow.parquet as pq
import pytest
from benches.drive import run_peer
from commands import invoke
from serve_client import Client, free_port, served

import omni_mj as om

PATIENCE_S = 120.0  # with processes, on a computer that does much else
OUT = "--scenario", "rect", "--out", "drive", "--no-figures"


def drive(folder: Path, ports: tuple[int, int], *options: object) -> "subprocess.Popen[str]":
    """The command, which hears vision at the first port and commands at the second."""
    where = "--vision", f"127.0.0.1:{ports[0]}", "--commands", f"127.0.0.1:{ports[1]}"
    command = [sys.executable, "-m", "omni_mj", "drive", *where, *map(str, options)]
    return subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def wait_for(process: "subprocess.Popen[str]", text: str) -> None:
    """Read what is printed up to a line that holds a text."""
    assert process.stdout
    assert any(text in line for line in process.stdout), f"{text!r} was never printed"


def test_vision_that_falls_silent_ends_the_drive_and_all_is_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It leaves the files of `run`. `verify` says that a live drive cannot be repeated."""
    ports = free_port(), free_port()
    known = (
        "--no-pulse",
        "--set",
        "radio.delay_frames=1",
        "--set",
        "reference.laps=20",  # so that a busy computer, which skips frames, does not end it
    )
    with run_peer(ports, "--delay", 1, "--loss", 0.05, "--tell", 75) as peer:
        process = drive(tmp_path, ports, *OUT, *known)
        wait_for(peer, "heard")
    out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert re.search(r"was not detected for 3 s at \d\.\d* s\n", err)
    assert re.search(r"robot 0: fitted latency \d\.\d\d frames", out)
    folder = tmp_path / "drive"
    left = {path.name for path in folder.iterdir()}
    assert {
        "summary.json",
        "trajectory.parquet",
        "recording.rrd",
        "report.html",
        "scenario.toml",
        "link.json",
    } <= left
    assert json.loads((folder / "link.json").read_text())["cameras"]["0"]["frames"] > 100
    assert pq.read_table(folder / "trajectory.parquet").num_rows >= 60
    assert invoke("verify", folder) == 2
    assert "is a result of omni-mj drive, which verify does not repeat" in capsys.readouterr().err


def test_ctrl_c_saves_what_there_is(tmp_path: Path) -> None:
    ports = free_port(), free_port()
    with run_peer(ports, "--tell", 75, "--loss", 0.1) as peer:
        process = drive(
            tmp_path, ports, *OUT, "--no-pulse", "--no-record", "--set", "reference.laps=20"
        )
        wait_for(peer, "heard")
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert "interrupted; the frames so far are in drive" in err
    rows = pl.read_parquet(tmp_path / "drive" / "trajectory.parquet")
    assert len(rows) >= 60
    # Errors are those of frames in which the robot was detected.
    seen = rows.filter(pl.col("vision_valid"))
    assert 0 < len(seen) < len(rows)
    summary = json.loads((tmp_path / "drive" / "summary.json").read_text())
    errors = summary["scenarios"]["rect"]["results"]["adaptive-comp-flc"]["error_m"]["x"]
    error = np.abs(seen["x_m"] - seen["ref_x_m"])
    assert errors["mean"]["mean"] == pytest.approx(error.mean(), rel=1e-9)
    assert errors["max"]["mean"] == pytest.approx(error.max(), rel=1e-9)


def test_a_drive_of_served_robots_is_identified(tmp_path: Path) -> None:
    """The drive knows nothing of the wheels. Estimates are within four standard errors."""
    client = Client()
    client.close()  # the drive listens at its port of vision
    route = "reference.waypoints=[[0, 0], [0.8, 0], [0.8, 0.8]]"
    options = *OUT, "--clock", "vision", "--controller", "comp-flc", "--no-record", "--set", route
    with served("--lockstep", "--plant", "planar", client=client):
        process = drive(tmp_path, (client.vision_port, client.ports[1]), *options)
        _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, err
    log = tmp_path / "drive" / "trajectory.parquet"
    assert pl.read_parquet(log)["wheel_angle_1_rad"].is_nan().all()
    result = om.identify(log)
    for name, truth in (("creep_stiffness", 4.35), ("dead_time_s", 0.0)):
        estimate = result.estimates[f"commands.{name}"]
        assert estimate.is_identified
        assert abs(estimate.value - truth) < 4 * estimate.standard_error, name


def test_listening_only(tmp_path: Path) -> None:
    ports = free_port(), free_port()
    with run_peer(ports, "--noise", 0.001, "--cameras", 2, "--junk", 0.2):
        process = drive(tmp_path, ports, "--dry-run", "--duration", 2.5)
        out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    assert re.search(r"camera 0: (59|60)\.\d\d Hz by its clock", out)
    noise = re.findall(r"blue 0: at .*noise (\d\.\d\d) mm", out)
    assert len(noise) == 2
    for each in noise:
        assert (
            0.8 < float(each) < 1.2
        )  # 1 mm by 100 detections and more, whose median is known to a tenth
    assert "bad packet" in out
    assert err.count("skipped") == 1


WRONG = {
    ("--scenario", "rect", "--controller", "oracle"): "oracle needs the true pose",
    ("--scenario", "rect", "--id", 1, "--id", 1): "at most 12 different",
    ("--scenario", "rect", "--commands", "192.0.2.1"): "with --interface",
    ("--scenario", "rect", "--vision", "nowhere"): "unknown host",
    ("--scenario", "rect", "--duration", 0): "not in the range",
    ("--scenario", "fault-push"): "the plant live has no push",
    ("--scenario", "fault-vision-loss"): "[[fault]]",
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
    """The message names the address, and no folder is left. `run` on plant live names `drive`."""
    where = f"127.0.0.1:{free_port()}"
    assert (
        invoke(
            "drive",
            "--scenario",
            "rect",
            "--vision",
            where,
            "--wait",
            0.2,
            "--out",
            tmp_path / "out",
        )
        == 2
    )
    assert f"no vision packet arrived at {where}" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert invoke("run", "--scenario", "rect", "--plant", "live", "--out", tmp_path / "out") == 2
    assert "omni-mj drive" in capsys.readouterr().err


@pytest.mark.parametrize("what", ["--dry-run", "--no-record"])
def test_one_signal_ends_the_wait_for_vision(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], what: str
) -> None:
    before = signal.getsignal(signal.SIGTERM)

    def end() -> None:
        while signal.getsignal(signal.SIGTERM) is before:
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=end, daemon=True).start()
    where = (
        "--vision",
        f"127.0.0.1:{free_port()}",
        "--wait",
        PATIENCE_S,
        "--out",
        tmp_path / "out",
    )
    assert invoke("drive", "--scenario", "rect", what, *where) == 128 + signal.SIGTERM
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: terminated; ")
