"""Game logs of the league: robots chosen, cameras apart, clocks that jump; what comes out is what was driven."""

import gzip
import struct
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import pytest
from benches.studies import read
from commands import invoke, strict
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from serving import vision
from synthetic import COMMAND, LATE_S, POSE, STIFFNESS, driven

import omni_mj as om

HEAD = ",".join(("time_s", *COMMAND))
EPOCH_S = 1_700_000_000.0
Robots = Mapping[tuple[str, int], NDArray]  # team and number -> pose (3,) or poses (frames, 3), NaN where unseen


def image(number: int, taken: float, robots: Robots, camera: int = 0, offset: float = 0.0) -> bytes:
    """Return the packet of one camera's image; its x is off by `offset`, y by half of that to the other side."""
    teams: dict[str, list[tuple[int, float, float, float]]] = {"yellow": [], "blue": []}
    for (team, robot), pose in robots.items():
        if np.isfinite(pose).all():
            heading = np.arctan2(np.sin(pose[2]), np.cos(pose[2]))
            teams[team].append((robot, float(pose[0] + offset), float(pose[1] - offset / 2), float(heading)))
    more = {"yellow": teams["yellow"], "camera": camera, "captured": taken, "sent": taken + 0.005}
    return vision(number, teams["blue"], **more)


def message(receipt_s: float, data: bytes, kind: int = 4) -> bytes:
    """Return a message as recorders of the league write it."""
    return struct.pack(">qii", round(receipt_s * 1e9), kind, len(data)) + data


def whole(messages: Iterable[bytes]) -> bytes:
    """Return a file of messages."""
    return struct.pack(">12si", b"SSL_LOG_FILE", 1) + b"".join(messages)


def game(times: NDArray, robots: Robots) -> bytes:
    """Return the file of one camera that sees all, with a referee's messages in between."""
    frames = []
    for number, taken in enumerate(EPOCH_S + times):
        now = {robot: poses[number] for robot, poses in robots.items()}
        frames.append(message(taken + 0.006, image(number, float(taken), now)))
        if number % 50 == 0:
            frames.append(message(taken + 0.007, b"\x08\x01", kind=3))
    return whole(frames)


def circle(seconds: float, rate: float = 60.0) -> tuple[NDArray, NDArray]:
    """Times and poses of a robot that goes around a circle of 0.5 m in 2 s, turning as it goes, without noise."""
    time = np.arange(round(seconds * rate)) / rate
    return time, np.column_stack([0.5 * np.cos(np.pi * time), 0.5 * np.sin(np.pi * time), np.pi * time])


def sent(path: Path, table: NDArray, head: str = HEAD) -> Path:
    np.savetxt(path, table, fmt="%.9f", delimiter=",", header=head, comments="")
    return path


def test_a_robot_with_its_commands_is_identified(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Latency and creep stiffness within five standard errors, in a log with two more robots."""
    log = driven(9.3, 30, speed=1.6, wheels=False)
    commands = np.column_stack([EPOCH_S + log["time_s"], *(log[name] for name in COMMAND)])
    poses = np.stack([log[name] for name in POSE], 1)
    robots = {("blue", 3): poses, ("blue", 4): poses[::-1], ("yellow", 3): poses[::-1]}
    path = tmp_path / "game.log.gz"
    path.write_bytes(gzip.compress(game(log["time_s"], robots)))
    file = sent(tmp_path / "sent.csv", commands)
    assert invoke("identify", f"{path}:blue:3,{file}", "--out", tmp_path / "out", "--quiet") == 0
    found = strict(tmp_path / "out" / "identify.json")
    assert found["logs"] == ["game.log.gz (blue 3, camera 0)"]
    for name, value in (("latency_s", LATE_S), ("creep_stiffness", STIFFNESS)):
        told = found["estimates"][f"commands.{name}"]
        assert told["value"] == pytest.approx(value, abs=5 * told["standard_error"])
    for word in (path, f"{path}:blue:3", f"{path}:blue:5,{file}"):
        assert invoke("identify", word) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert "robots are :yellow:3, :blue:3, :blue:4" in error


def test_each_camera_and_each_start_of_vision_is_a_log_of_its_own(tmp_path: Path) -> None:
    """Two halves of the field, 2 cm apart; vision was started anew after 2 s, and some images are lost."""
    frames = []
    time, poses = circle(5.0)
    lost = (time > 2.5) & (time < 2.6)
    for number, (t, pose) in enumerate(zip(time, poses, strict=True)):
        clock = EPOCH_S + t - 10 * (t >= 2)
        for camera, off in ((0, 0.0), (1, 0.02)):
            seen = {("blue", 1): np.full(3, np.nan) if lost[number] else pose}
            frames.append(message(EPOCH_S + t + 0.01, image(number, clock, seen, camera, off)))
    path = tmp_path / "game.log"
    path.write_bytes(whole(frames))
    clock = EPOCH_S - 20 + np.arange(0, 40, 0.01)
    file = sent(tmp_path / "sent.csv", np.column_stack([clock, np.sin(clock), 0 * clock, 0 * clock]))
    logs = read(f"{path}:blue:1,{file}")
    assert [log.name[-9:] for log in logs] == ["camera 0)"] * 2 + ["camera 1)"] * 2
    for log, off in zip(logs, (0.0, 0.0, 0.02, 0.02), strict=True):
        radius = np.hypot(log.pose[:, 0] - off, log.pose[:, 1] + off / 2)
        np.testing.assert_allclose(radius, 0.5, atol=1e-6)
        before_gap = np.diff(log.time, append=np.inf) > 0.03
        mean = np.sin(log.time + 0.5 / 60 - 0.005)  # over a frame, of commands that hold for 10 ms
        np.testing.assert_allclose(log.command[~before_gap, 0], mean[~before_gap], atol=1e-3)


def test_commands_of_another_clock_are_refused(tmp_path: Path) -> None:
    time, poses = circle(3.0)
    log = tmp_path / "game.log"
    log.write_bytes(game(time, {("blue", 1): poses}))
    for table, head, says in (
        (np.column_stack([time, poses]), HEAD, "time_s must be by the clock of vision"),
        (np.column_stack([EPOCH_S + time, poses])[::-1], HEAD, "sent.csv: time_s does not increase"),
        (np.column_stack([EPOCH_S + time, poses]), HEAD.replace("vy", "vz"), "neither commands nor wheels"),
    ):
        with pytest.raises(om.OmniError, match=says) as error:
            read(f"{log}:blue:1,{sent(tmp_path / 'sent.csv', table, head)}")
        assert "\n" not in str(error.value)


TIME, POSES = circle(1.0)
WHOLE = game(TIME, {("blue", 1): POSES})


def log_or_line(file: Path) -> None:
    """Read the only log in a file, or require that there is a line that says why not."""
    table = np.column_stack([EPOCH_S - 1 + np.arange(0, 3, 0.01), np.zeros((300, 3))])
    try:
        (log,) = read(f"{file}:blue:1,{sent(file.with_suffix('.csv'), table)}")
    except om.OmniError as error:
        line = str(error)
    else:
        line = ""
        assert len(log.time) >= 30
    assert "\n" not in line


@settings(max_examples=40)
@given(cut=st.integers(0, len(WHOLE) - 1), packed=st.booleans())
def test_a_log_that_is_cut_off_counts_as_far_as_it_goes(
    cut: int, packed: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    file = tmp_path_factory.mktemp("cut") / ("game.log.gz" if packed else "game.log")
    file.write_bytes(gzip.compress(WHOLE)[: cut * 40 // len(WHOLE) + cut // 20] if packed else WHOLE[:cut])
    log_or_line(file)


@settings(max_examples=60)
@given(data=st.data())
def test_a_damaged_log_is_a_line(data: st.DataObject, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Some bytes are others: it is read all the same, if they are numbers of poses, or there is a line."""
    spoilt = bytearray(WHOLE)
    for _ in range(data.draw(st.integers(1, 8))):
        spoilt[data.draw(st.integers(0, len(WHOLE) - 1))] = data.draw(st.integers(0, 255))
    file = tmp_path_factory.mktemp("damaged") / "game.log"
    file.write_bytes(bytes(spoilt))
    log_or_line(file)


def test_what_is_no_game_log_is_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for content, says in (
        (b"time_s,x_m\n" * 9, "is no game log"),
        (WHOLE[:16] + message(0.0, b"", kind=3), "robots are not in it"),
        (WHOLE[:16] + message(0.0, b"\xff\xff", kind=4), "is damaged"),
        (WHOLE[:16] + b"\xff" * 40, "a message has -1 bytes"),
    ):
        (tmp_path / "game.log").write_bytes(content)
        assert invoke("identify", tmp_path / "game.log") == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert says in error
    assert invoke("identify", tmp_path / "none.log.gz") == 2
    assert "there is no log" in capsys.readouterr().err
