"""Game logs of the league: robots chosen, cameras followed, clocks that jump; what comes out is what was driven."""

import gzip
import tempfile
from pathlib import Path

import game_logs
import numpy as np
import pytest
from benches.studies import Log, read
from commands import invoke, strict
from game_logs import EPOCH_S
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from synthetic import COMMAND, POSE, Drive, Truth, driven

import omni_mj as om

HEAD = ",".join(("time_s", *COMMAND))


def circle(seconds: float, rate: float = 60.0) -> tuple[NDArray, NDArray]:
    """Times and poses of a robot that goes around a circle of 0.5 m in 2 s, turning as it goes, without noise."""
    time = np.arange(round(seconds * rate)) / rate
    return time, np.column_stack([0.5 * np.cos(np.pi * time), 0.5 * np.sin(np.pi * time), np.pi * time])


def sent(path: Path, table: NDArray, head: str = HEAD) -> Path:
    np.savetxt(path, table, fmt="%.9f", delimiter=",", header=head, comments="")
    return path


def test_a_robot_with_its_commands_is_identified(tmp_path: Path) -> None:
    """Latency and creep stiffness within five standard errors, in a log with two more robots."""
    log, truth = driven(drive=Drive(9.3, 30.0, speed=1.6), wheels=False), Truth()
    poses, commands = (np.stack([log[name] for name in names], 1) for names in (POSE, COMMAND))
    robots = {("blue", 3): poses, ("blue", 4): poses[::-1], ("yellow", 3): poses[::-1]}
    game = game_logs.write(tmp_path / "game.log.gz", game_logs.of(log["time_s"], robots))
    file = sent(tmp_path / "sent.csv", np.column_stack([EPOCH_S + log["time_s"], commands]))
    words = (f"{game},{file}", "--team", "blue", "--id", "3", "--out", tmp_path / "out", "--quiet")
    assert invoke("identify", *words) == 0
    found = strict(tmp_path / "out" / "identify.json")
    assert found["logs"] == ["game.log.gz (blue 3)"]
    for name, value in (("latency_s", truth.late), ("creep_stiffness", truth.stiffness)):
        told = found["estimates"][f"commands.{name}"]
        assert told["value"] == pytest.approx(value, abs=5 * told["standard_error"])


def test_which_robots_are_in_a_log_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    time, poses = circle(4.0)
    rest = np.zeros_like(poses)
    log = game_logs.write(tmp_path / "game.log", game_logs.of(time, {("blue", 3): poses, ("yellow", 11): rest}))
    for words, says in (
        ((), "which robot is meant; name one, as game.log:yellow:11"),
        (("--team", "blue", "--id", "4"), "there is no blue 4"),
    ):
        assert invoke("identify", log, *words) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert says in error
        # Nineteen chords of 0.2 s.
        assert "yellow 11 moves 0.0 m in 4 s; blue 3 moves 5.9 m in 4 s" in error
    assert invoke("identify", log, "--team", "blue", "--out", tmp_path / "out") == 0
    printed = capsys.readouterr().out
    assert "poses alone, up to 1.5" in printed, "pi / 2 m/s"
    assert "tell nothing of latency" in printed


def test_a_robot_is_followed_in_one_camera_as_long_as_that_sees_it() -> None:
    """Two halves of the field, 2 cm apart, overlapping by 30 cm: no step of 2 cm within a piece."""
    frames = []
    for number, t in enumerate(circle(6.0)[0]):
        for camera, late, off in ((0, 0.0, (0.0, 0.0)), (1, 0.004, (0.02, -0.01))):
            at = np.pi * (t + late)
            pose = np.array([0.5 * np.cos(at), 0.5 * np.sin(at), at])
            if (camera == 0 and pose[0] < 0.15) or (camera == 1 and pose[0] > -0.15):
                data = game_logs.image(number, EPOCH_S + t + late, {("blue", 1): pose}, camera, offset=off)
                frames.append(game_logs.message(EPOCH_S + t + late + 0.01, data))
    found = merged(frames)
    pieces = found.pieces()
    assert 5 <= len(pieces) <= 8, "twice a round"
    for piece in pieces:
        steps = np.hypot(*np.diff(found.pose[piece, :2], axis=0).T)
        np.testing.assert_allclose(steps, 0.5 * np.pi / 60, rtol=0.01)


def merged(frames: list[bytes]) -> Log:
    """The only log in a file of these messages."""
    with tempfile.TemporaryDirectory() as folder:
        (found,) = read(game_logs.write(Path(folder) / "game.log", frames))
    return found


def test_clocks_that_restart_and_images_that_are_lost() -> None:
    """Vision was started anew after 2 s: its clock jumps, the recorder's does not; later some are lost."""
    time, poses = circle(5.0)
    lost = (time > 2.5) & (time < 3.0)
    frames = []
    for number, (t, pose) in enumerate(zip(time, poses, strict=True)):
        clock = EPOCH_S if t < 2 else 7.0
        seen = {("blue", 1): np.full(3, np.nan) if lost[number] else pose}
        frames.append(game_logs.message(EPOCH_S + t + 0.006, game_logs.image(number, clock + t, seen)))
    found = merged(frames)
    np.testing.assert_allclose(found.pose, poses[~lost], atol=1e-6)
    assert [piece.start for piece in found.pieces()] == [0, int((time < 2).sum()), int((time <= 2.5).sum())]
    assert np.diff(found.time).min() > 0.016


def test_mistaken_sightings_are_left_out_and_a_robot_that_was_carried_is_cut() -> None:
    """Single images 2 m away are another's; a robot that stays away was carried."""
    time, poses = circle(5.0)
    poses[[40, 90, 91]] += [2.0, 0.0, 0.0]
    poses[200:] += [1.5, 1.0, 0.0]
    found = merged(game_logs.of(time, {("blue", 1): poses}))
    assert len(found.time) == len(time) - 3 - 4, "three mistakes, and four until it is believed to be there"
    assert len(found.pieces()) == 2


def test_commands_of_another_clock_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    time, poses = circle(3.0)
    log = game_logs.write(tmp_path / "game.log", game_logs.of(time, {("blue", 1): poses}))
    for table, head, says in (
        (np.column_stack([time, poses]), HEAD, "time_s must be of the clock of vision"),
        (np.column_stack([EPOCH_S + time, poses])[::-1], HEAD, "sent.csv: time_s does not increase"),
        (np.column_stack([EPOCH_S + time, poses]), HEAD.replace("vy", "vz"), "commands are time_s and vx_cmd_world"),
    ):
        assert invoke("identify", f"{log},{sent(tmp_path / 'sent.csv', table, head)}") == 2
        error = capsys.readouterr().err
        assert says in error
        assert error.count("\n") == 1


def log_or_line(file: Path) -> Log | None:
    """The only log in a file, or nothing, if there is a line that says why."""
    try:
        return read(file)[0]
    except om.OmniError as error:
        message = str(error)
    assert "\n" not in message
    assert "game.log" in message
    return None


WHOLE = game_logs.whole(game_logs.of(*(lambda t, p: (t, {("blue", 1): p}))(*circle(1.0))))


@settings(max_examples=40)
@given(cut=st.integers(0, len(WHOLE) - 1), packed=st.booleans())
def test_a_log_that_is_cut_off_counts_as_far_as_it_goes(
    cut: int, packed: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Wherever it ends: it is read up to there with a note, or there is too little of it, in a line."""
    file = tmp_path_factory.mktemp("cut") / ("game.log.gz" if packed else "game.log")
    file.write_bytes(gzip.compress(WHOLE)[: cut * 40 // len(WHOLE) + cut // 20] if packed else WHOLE[:cut])
    found = log_or_line(file)
    assert found is None or len(found.time) >= 30


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
        (b"", "is no game log"),
        (b"time_s,x_m\n" * 9, "is no game log"),
        (WHOLE[:12] + b"\0\0\0\2" + WHOLE[16:], "of version 2"),
        (WHOLE[:16] + game_logs.message(0.0, b"", kind=3), "no images of SSL-Vision"),
        (WHOLE[:16] + game_logs.message(0.0, b"\xff\xff", kind=4), "message 1 is no packet of vision"),
        (WHOLE[:16] + b"\xff" * 40, "message 1 is said to be of kind -1"),
        (b"\x1f\x8b" + WHOLE, "cannot be read beyond message 0"),
    ):
        (tmp_path / "game.log").write_bytes(content)
        assert invoke("identify", tmp_path / "game.log") == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert says in error
    assert invoke("identify", tmp_path / "none.log.gz") == 2
    assert "there is no log" in capsys.readouterr().err
