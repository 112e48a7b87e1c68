"""Game logs of the league: robots chosen, cameras merged, clocks bridged; what comes out is what was driven."""

import gzip
import tempfile
from pathlib import Path

import compiled
import game_logs
import numpy as np
import pytest
from commands import invoke, strict
from game_logs import EPOCH_S
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from synthetic import Truth, logs

import omni_mj as om
from omni_mj.studies.identify import identify
from omni_mj.studies.identify.logs import Log, read

SETTINGS, TRUTH = om.scenario("rect").settings, Truth()
HEAD = "time_s,vx_cmd_world_m_s,vy_cmd_world_m_s,w_cmd_rad_s"


def circle(seconds: float, rate: float = 60.0) -> tuple[NDArray, NDArray]:
    """Times and poses of a robot that goes around a circle of 0.5 m in 2 s, turning as it goes, without noise."""
    time = np.arange(round(seconds * rate)) / rate
    return time, np.column_stack([0.5 * np.cos(np.pi * time), 0.5 * np.sin(np.pi * time), np.pi * time])


@pytest.fixture(scope="module")
def driven() -> tuple[NDArray, NDArray, NDArray]:
    """Of known truth: times, poses and commands at 30 Hz."""
    made = logs(SETTINGS, [TRUTH], 9.3, rate=30.0, seed=1)
    return made.time, made.pose[:, 0], made.command[:, 0]


def test_a_robot_with_its_commands_is_identified_as_from_a_table(
    driven: tuple[NDArray, NDArray, NDArray], tmp_path: Path
) -> None:
    """Latency and creep stiffness of the truth are within five standard errors, in a log with two more robots.

    Commands are at times of their own, in between the images, on vision's clock.
    """
    time, poses, commands = driven
    other = poses[::-1]
    robots = {("blue", 3): poses, ("blue", 4): other, ("yellow", 3): other}
    log = game_logs.write(tmp_path / "game.log.gz", game_logs.of(time, robots))
    table = np.column_stack([EPOCH_S + time, commands])
    np.savetxt(tmp_path / "sent.csv", table, fmt="%.9f", delimiter=",", header=HEAD, comments="")
    words = (f"{log},{tmp_path}/sent.csv", "--team", "blue", "--id", "3", "--out", tmp_path / "out", "--quiet")
    assert invoke("identify", *words) == 0
    found = strict(tmp_path / "out" / "identify.json")
    assert found["logs"] == ["game.log.gz (blue 3)"]
    for name, truth in (("latency_s", TRUTH.late), ("creep_stiffness", TRUTH.stiffness)):
        told = found["estimates"][f"commands.{name}"]
        assert told["value"] == pytest.approx(truth, abs=5 * told["standard_error"])


def test_our_simulated_robot_from_a_log_of_its_vision(tmp_path: Path) -> None:
    """The same poses and commands as a table and as a game log with a file of commands: the same numbers.

    Each to its standard error: lengths in mm of 4 bytes lose a micrometre, and the search ends elsewhere.
    """
    route = {
        "waypoints": [[0, 0], [1.2, 0.3], [0.4, 0.7], [0.4, -0.5], [0, 0]],
        "max_acceleration_m_s2": 2.0,
        "settle_s": 0.1,
    }
    compiled.once("mujoco")
    rect = om.scenario("rect", reference=route, wheels={"model": "two-rollers"}, physics=compiled.NUMBA)
    result = om.run(rect, ["comp-flc"], seeds=[0])
    frames = result.frames()
    time = np.arange(frames.num_rows) / 60
    poses = np.column_stack([frames[f"vision_{name}"].to_numpy() for name in ("x_m", "y_m", "heading_rad")])
    log = game_logs.write(tmp_path / "game.log", game_logs.of(time, {("yellow", 0): poses}))
    sent = np.column_stack([frames[f"command_{name}"].to_numpy() for name in ("vx_m_s", "vy_m_s", "w_rad_s")])
    np.savetxt(
        tmp_path / "sent.csv",
        np.column_stack([EPOCH_S + time, sent]),
        fmt="%.17g",
        delimiter=",",
        header=HEAD,
        comments="",
    )
    head = ",".join(["time_s,x_m,y_m,heading_rad", *HEAD.split(",")[1:]])
    table = np.column_stack([time, poses, sent])
    np.savetxt(tmp_path / "own.csv", table, fmt="%.17g", delimiter=",", header=head, comments="")
    by_log, by_table = (identify([each]) for each in (f"{log},{tmp_path}/sent.csv", tmp_path / "own.csv"))
    table_of = {(e.name, e.source): e for e in by_table.estimates}
    commanded = [e for e in by_log.estimates if e.source == "commands"]
    assert len(commanded) >= 8
    for e in commanded:
        assert e.value == pytest.approx(table_of[e.name, e.source].value, abs=e.error), e.name


def test_which_robots_are_in_a_log_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    time, poses = circle(4.0)
    rest = np.zeros_like(poses)
    log = game_logs.write(tmp_path / "game.log", game_logs.of(time, {("blue", 3): poses, ("yellow", 11): rest}))
    for words, says in (
        ((), "which robot is meant; name one, as game.log:yellow:11, or --team and --id; it holds "),
        (("--team", "blue", "--id", "4"), "there is no blue 4; name one, "),
    ):
        assert invoke("identify", log, *words) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert says in error
        # Nineteen chords of 0.2 s.
        assert "yellow 11 moves 0.0 m in 4 s; blue 3 moves 5.9 m in 4 s" in error
    assert invoke("identify", log, "--team", "blue", "--out", tmp_path / "out") == 0
    printed = capsys.readouterr().out
    assert "note: game.log (blue 3): poses alone: noise of 0.0" in printed
    assert "up to 1.5" in printed, "pi / 2 m/s"
    assert "poses alone tell nothing of latency" in printed


def test_cameras_that_disagree_are_merged_where_they_overlap() -> None:
    """Two halves of the field, 2 cm apart, overlapping by 30 cm: the path is that of the first, without steps."""
    time, _ = circle(6.0)
    # Cameras take their images at times of their own.
    frames = []
    for number, t in enumerate(time):
        for camera, late, off in ((0, 0.0, (0.0, 0.0)), (1, 0.004, (0.02, -0.01))):
            at = np.pi * (t + late)
            pose = np.array([0.5 * np.cos(at), 0.5 * np.sin(at), at])
            if (camera == 0 and pose[0] < 0.15) or (camera == 1 and pose[0] > -0.15):
                data = game_logs.image(number, EPOCH_S + t + late, {("blue", 1): pose}, camera, offset=off)
                frames.append(game_logs.message(EPOCH_S + t + late + 0.01, data))
    found = merged(frames)
    expected = np.pi * found.time + found.pose[0, 2]
    start = found.pose[0, :2] - 0.5 * np.array([np.cos(expected[0]), np.sin(expected[0])])
    circles = 0.5 * np.column_stack([np.cos(expected), np.sin(expected)]) + start
    # Straight lines between images of a circle miss it by 0.2 mm; the clock of the second starts 4 ms late.
    assert np.abs(found.pose[:, :2] - circles).max() < 2e-3
    assert len(found.pieces()) == 1
    assert any(
        "cameras 0 and 1 differ by up to 22 mm" in note or "cameras 1 and 0 differ by up to 22 mm" in note
        for note in found.notes
    )


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
    there = ~lost
    np.testing.assert_allclose(found.time, time[there], atol=1e-6)
    np.testing.assert_allclose(found.pose, poses[there], atol=1e-6)
    assert [piece.start for piece in found.pieces()] == [0, int((time <= 2.5).sum())]
    assert any("the clock of camera 0 jumped 1 times" in note for note in found.notes)


def test_mistaken_sightings_are_left_out_and_a_robot_that_was_carried_is_cut() -> None:
    """Single images 2 m away are another's; a robot that stays away was carried."""
    time, poses = circle(5.0)
    poses[[40, 90, 91]] += [2.0, 0.0, 0.0]
    poses[200:] += [1.5, 1.0, 0.0]
    found = merged(game_logs.of(time, {("blue", 1): poses}))
    assert len(found.time) == len(time) - 3 - 4, "three mistakes, and four until it is believed to be there"
    assert len(found.pieces()) == 2
    assert any("1 times it is not known where it came from" in note for note in found.notes)


def test_commands_of_another_clock_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    time, poses = circle(3.0)
    log = game_logs.write(tmp_path / "game.log", game_logs.of(time, {("blue", 1): poses}))
    sent = tmp_path / "sent.csv"
    cases = (
        (np.column_stack([time, poses]), HEAD, "time_s must be of the clock of vision, t_capture in s"),
        (np.column_stack([EPOCH_S + time, poses])[::-1], HEAD, "sent.csv: time_s does not increase"),
        (np.column_stack([EPOCH_S + time, poses]), HEAD.replace("vy", "vz"), "commands are time_s and vx_cmd_world"),
    )
    for table, head, says in cases:
        np.savetxt(sent, table, fmt="%.9f", delimiter=",", header=head, comments="")
        assert invoke("identify", f"{log},{sent}") == 2
        error = capsys.readouterr().err
        assert says in error
        assert error.count("\n") == 1


def log_or_line(file: Path) -> Log | None:
    """The only log in a file, or nothing, if there is a line that says why."""
    try:
        (found,) = read(file)
    except om.OmniError as error:
        message = str(error)
    else:
        return found
    assert "\n" not in message
    assert "game.log" in message
    return None


WHOLE = game_logs.whole(game_logs.of(*(lambda t, p: (t, {("blue", 1): p}))(*circle(1.0))))


@settings(deadline=None, max_examples=60, derandomize=True)
@given(cut=st.integers(0, len(WHOLE) - 1), packed=st.booleans())
def test_a_log_that_is_cut_off_counts_as_far_as_it_goes(
    cut: int, packed: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Wherever it ends: it is read up to there with a note, or there is too little of it, in a line."""
    file = tmp_path_factory.mktemp("cut") / ("game.log.gz" if packed else "game.log")
    file.write_bytes(gzip.compress(WHOLE)[: cut * 40 // len(WHOLE) + cut // 20] if packed else WHOLE[:cut])
    found = log_or_line(file)
    assert found is None or len(found.time) >= 30


@settings(deadline=None, max_examples=100, derandomize=True)
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
    cases = (
        (b"", "is no game log: it begins with b''"),
        (b"time_s,x_m\n" * 9, "is no game log: it begins with b'time_s,x_m"),
        (WHOLE[:12] + b"\0\0\0\2" + WHOLE[16:], "is a game log of version 2; only 1 is known"),
        (WHOLE[:16] + game_logs.message(0.0, b"", kind=3), "holds no images of SSL-Vision"),
        (WHOLE[:16] + game_logs.message(0.0, b"\xff\xff", kind=4), "message 1 is no packet of vision"),
        (WHOLE[:16] + b"\xff" * 40, "message 1 is said to be of kind -1 and -1 bytes"),
        (b"\x1f\x8b" + WHOLE, "cannot be read beyond message 0"),
    )
    for content, says in cases:
        (tmp_path / "game.log").write_bytes(content)
        assert invoke("identify", tmp_path / "game.log") == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert says in error
    assert invoke("identify", tmp_path / "none.log.gz") == 2
    assert "there is no log" in capsys.readouterr().err
