"""From packets to poses at a tick: capture times, several cameras, wrong numbers and headings, bad packets."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from wire_messages import bad_packets

from omni_mj.live.cameras import Camera
from omni_mj.live.notes import Notes
from omni_mj.live.vision import PERSIST, Vision
from omni_mj.live.wire import encode
from omni_mj.live.wire.vision import DetectedRobot, Detection, VisionPacket

PERIOD_S = 1 / 60
TWIST = np.array([[1.0, -0.5, 2.0]])
ALLOWED_M = 1e-6  # of numbers that were floats in mm
Robot = tuple[int, float, float, float]


def packet(frame: int, robots: Sequence[Robot], *, camera: int = 0, age: float = 0.0, offset: float = 0.0) -> bytes:
    seen = tuple(DetectedRobot(*robot) for robot in robots)
    sent = offset + frame * PERIOD_S
    return encode(VisionPacket(Detection(frame, sent - age, sent, camera, (), (), seen)))


def moving(time: float) -> np.ndarray:
    """A robot that drives steadily, as `TWIST` says."""
    return np.array([0.3, 0.2, 0.1]) + TWIST[0] * time


@given(age=st.floats(0, 0.04), later=st.floats(0, 0.03), offset=st.floats(-1e3, 1e3))
@settings(max_examples=50, deadline=None)
def test_detections_are_brought_to_the_tick_from_their_capture(age: float, later: float, offset: float) -> None:
    """Of a robot that drives steadily all poses agree, however old they are, whatever the peer's clock says."""
    vision = Vision("blue", [5], Notes())
    for frame in range(30):
        time = frame * PERIOD_S
        vision.add(packet(frame, [(5, *moving(time - age))], age=age, offset=offset), time)
        pose, seen = vision.at(time + later, PERIOD_S, TWIST)
    assert seen.all()
    np.testing.assert_allclose(pose[0], moving(time + later), atol=1e-5)
    by_camera, _ = Vision("blue", [5], Notes()), None
    by_camera.add(packet(0, [(5, *moving(-age))], age=age, offset=offset), 0.0)
    pose, _ = by_camera.at(offset, PERIOD_S, TWIST, leader=0)
    np.testing.assert_allclose(pose[0], moving(0.0), atol=1e-5)


def test_a_robot_is_seen_once_per_detection_and_carried_on_between() -> None:
    vision = Vision("blue", [5, 6], Notes())
    vision.add(packet(0, [(5, *moving(0.0))]), 0.0)
    twist = np.repeat(TWIST, 2, axis=0)
    assert vision.at(0.0, PERIOD_S, twist)[1].tolist() == [True, False]
    pose, seen = vision.at(PERIOD_S, PERIOD_S, twist)
    assert not seen.any()
    np.testing.assert_allclose(pose[0], moving(PERIOD_S), atol=ALLOWED_M)
    assert np.isnan(pose[1]).all()


def test_the_usual_rate_is_that_of_frames_that_nothing_held_up() -> None:
    """A camera of 65 a second whose computer stalls for 45 ms now and then sends 60.6, and is none of 60."""
    camera, time = Camera(), 0.0
    assert math.isnan(camera.usual_hz)
    for frame in range(300):
        time += 1 / 65 + (0.045 if frame % 40 == 39 else 0.0)
        camera.add(Detection(frame, time - 0.01, time, 0, (), (), ()), time)
    assert camera.stamped_hz == pytest.approx(1 / (1 / 65 + 0.045 / 40), rel=1e-2)
    assert camera.usual_hz == pytest.approx(65)


def test_headings_count_full_turns() -> None:
    vision = Vision("blue", [0], Notes())
    for frame in range(60):
        heading = 0.15 * frame
        vision.add(packet(frame, [(0, 0.0, 0.0, (heading + np.pi) % (2 * np.pi) - np.pi)]), frame * PERIOD_S)
        pose, _ = vision.at(frame * PERIOD_S, PERIOD_S, np.array([[0.0, 0.0, 9.0]]))
    assert pose[0, 2] == pytest.approx(0.15 * 59, abs=1e-6)


def test_cameras_that_differ_agree_after_a_robot_was_seen_by_both() -> None:
    """It comes from the one into the view of both, 2 cm apart, and leaves into that of the other: nothing jumps."""
    vision, bias, path = Vision("blue", [0], Notes()), np.array([0.02, -0.02, 0.03]), []
    for frame in range(180):
        pose = np.array([0.01 * frame, 0.0, 0.0])
        for camera, (first, last) in enumerate([(0, 120), (60, 180)]):
            if first <= frame < last:
                vision.add(packet(frame, [(0, *(pose + camera * bias))], camera=camera), frame * PERIOD_S)
        path.append(vision.at(frame * PERIOD_S, PERIOD_S, np.array([[0.6, 0.0, 0.0]]))[0][0] - pose)
    np.testing.assert_allclose(path, np.zeros((180, 3)), atol=1e-3)
    np.testing.assert_allclose(vision.cameras[1].bias - vision.cameras[0].bias, bias, atol=1e-3)


def still(vision: Vision, seen: Sequence[Robot], frames: int, first: int = 0) -> np.ndarray:
    for frame in range(first, first + frames):
        vision.add(packet(frame, seen), frame * PERIOD_S)
        pose, _ = vision.at(frame * PERIOD_S, PERIOD_S, np.zeros((1, 3)))
    return pose[0]


def test_another_robots_number_is_not_believed_unless_it_lasts() -> None:
    notes = Notes()
    vision = Vision("blue", [3], notes)
    still(vision, [(3, 0.0, 0.0, 0.0)], 10)
    assert still(vision, [(3, 5.0, 0.0, 0.0)], 1, first=10)[0] == pytest.approx(0.0)
    assert still(vision, [(3, 5.0, 0.0, 0.0), (3, 0.01, 0.0, 0.0)], 1, first=11)[0] == pytest.approx(0.01)
    assert notes.counts == {"wrong id": 2}
    assert still(vision, [(3, 5.0, 0.0, 0.0)], PERSIST + 2, first=12)[0] == pytest.approx(5.0)
    assert notes.counts["moved"] == 1


def test_a_mirrored_heading_is_turned_back_unless_it_lasts() -> None:
    notes = Notes()
    vision = Vision("blue", [3], notes)
    still(vision, [(3, 0.0, 0.0, 0.5)], 10)
    assert still(vision, [(3, 0.0, 0.0, 0.5 - np.pi)], 3, first=10)[2] == pytest.approx(0.5)
    assert notes.counts == {"mirrored": 3}
    turned = still(vision, [(3, 0.0, 0.0, 0.5 - np.pi)], PERSIST + 1, first=13)[2]
    assert math.cos(turned - 0.5 + np.pi) == pytest.approx(1.0)
    assert notes.counts["turned"] == 1


def test_frames_that_are_late_or_came_before_count_once() -> None:
    vision = Vision("blue", [0], Notes())
    frames = {frame: packet(frame, [(0, 0.1 * frame, 0.0, 0.0)]) for frame in range(4)}
    taken = [vision.add(frames[frame], 0.1) is not None for frame in (0, 2, 1, 2, 3)]
    assert taken == [True, True, False, False, True]
    camera = vision.cameras[0]
    assert (camera.frames, camera.late, camera.lost) == (3, 2, 1)


def test_the_other_team_and_other_numbers_are_not_ours() -> None:
    vision = Vision("yellow", [0], Notes())
    vision.add(packet(0, [(0, 1.0, 1.0, 0.0)]), 0.0)
    assert not vision.at(0.0, PERIOD_S, np.zeros((1, 3)))[1].any()


@pytest.mark.parametrize("robot", [(0, math.nan, 0.0, 0.0), (0, 1e6, 0.0, 0.0), (0, 0.0, 0.0, math.inf)], ids=str)
def test_places_that_are_none_are_bad_packets(robot: Robot) -> None:
    told: list[str] = []
    notes = Notes(told.append)
    vision = Vision("blue", [0], notes)
    for frame in range(3):
        assert vision.add(packet(frame, [robot]), 0.0, "somebody") is None
    assert notes.counts == {"bad packet": 3}
    assert len(told) == 1
    assert "somebody" in told[0]


def test_bad_packets_are_counted_and_change_nothing() -> None:
    """Whatever comes between them, good ones are read."""
    notes = Notes()
    vision, poses = Vision("blue", [0], notes), []
    for frame, bad in enumerate(bad_packets(3, 1000)):
        vision.add(packet(frame, [(0, 0.001 * frame, 0.0, 0.0)], camera=7), frame * PERIOD_S)
        if not bad.startswith(b"\\x0a"):  # changed bits may be another place
            vision.add(bad, frame * PERIOD_S)
        poses.append(vision.at(frame * PERIOD_S, PERIOD_S, np.zeros((1, 3)))[0][0, 0])
    assert notes.counts["bad packet"] > 200
    np.testing.assert_allclose(poses, 0.001 * np.arange(1000), atol=0.05)


def test_two_that_send_as_one_camera_are_named_and_there_is_an_end_to_what_is_told() -> None:
    """As when a simulator was left running; each takes the other's clock for one that began anew."""
    told: list[str] = []
    vision = Vision("blue", [5], Notes(told.append))
    for frame in range(200):
        vision.add(packet(frame, [(5, 0.0, 0.0, 0.0)], offset=-1e6 * (frame % 2)), frame / 60, f"peer {frame % 2}")
    assert sum("camera 0 is sent by peer 1 now, by peer 0 before" in text for text in told) == 1
    assert len(told) < 50
