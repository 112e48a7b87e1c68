"""From packets to poses at a tick: capture times, several cameras, wrong numbers; clocks, latencies, sockets."""

import math
import random
import socket
import time
from collections.abc import Sequence

import numpy as np
import pytest
from benches import live_link as link
from benches.live_link import PERIOD_S, PERSISTENCE, Address, Camera, Clock, Receiver
from hypothesis import given, settings
from hypothesis import strategies as st
from serving import LOOPBACK

from omni_control.errors import OmniError

TWIST = np.array([[1.0, -0.5, 2.0]])
ALLOWED_M = 1e-6  # of numbers that were floats in mm
JITTER_S = 0.003  # mean of what packets take above the least, exponentially distributed
FRAMES = 240


def moving(time_s: float) -> np.ndarray:
    """A robot that drives steadily, as `TWIST` says."""
    return np.array([0.3, 0.2, 0.1]) + TWIST[0] * time_s


@given(age=st.floats(0, 0.04), later=st.floats(0, 0.03), offset=st.floats(-1e3, 1e3))
@settings(max_examples=50, deadline=None)
def test_detections_are_brought_to_the_tick_from_their_capture(age: float, later: float, offset: float) -> None:
    """Of a robot that drives steadily all poses agree, however old they are, whatever the peer's clock says."""
    camera = Camera(5)
    for frame in range(30):
        time_s = frame * PERIOD_S
        camera.see(frame, [(5, *moving(time_s - age))], age=age, offset=offset)
        pose = camera.at(time_s + later, TWIST)
    assert camera.seen.all()
    np.testing.assert_allclose(pose[0], moving(time_s + later), atol=1e-5)
    by_camera = Camera(5)
    by_camera.see(0, [(5, *moving(-age))], age=age, offset=offset)
    np.testing.assert_allclose(by_camera.at(offset, TWIST, leader=0)[0], moving(0.0), atol=1e-5)


def test_a_robot_is_seen_once_per_detection_and_carried_on_between() -> None:
    camera, twist = Camera(5, 6), np.repeat(TWIST, 2, axis=0)
    camera.see(0, [(5, *moving(0.0))])
    camera.at(0.0, twist)
    assert camera.seen.tolist() == [True, False]
    pose = camera.at(PERIOD_S, twist)
    assert not camera.seen.any()
    np.testing.assert_allclose(pose[0], moving(PERIOD_S), atol=ALLOWED_M)
    assert np.isnan(pose[1]).all()


def test_the_usual_rate_is_that_of_frames_that_nothing_held_up() -> None:
    """A camera of 65 a second whose computer stalls for 45 ms now and then sends 60.6, and is none of 60."""
    camera, time_s = Camera(5), 0.0
    for frame in range(300):
        time_s += 1 / 65 + (0.045 if frame % 40 == 39 else 0.0)
        camera.see(frame, [], at=time_s, offset=time_s - frame * PERIOD_S)
    found = camera.vision.cameras[0]
    assert found.stamped_hz == pytest.approx(1 / (1 / 65 + 0.045 / 40), rel=1e-2)
    assert found.usual_hz == pytest.approx(65)


def test_headings_count_full_turns() -> None:
    camera = Camera(0)
    for frame in range(60):
        camera.see(frame, [(0, 0.0, 0.0, (0.15 * frame + np.pi) % (2 * np.pi) - np.pi)])
        pose = camera.at(frame * PERIOD_S, np.array([[0.0, 0.0, 9.0]]))
    assert pose[0, 2] == pytest.approx(0.15 * 59, abs=1e-6)


def test_cameras_that_differ_agree_after_a_robot_was_seen_by_both() -> None:
    """It comes from the one into the view of both, 2 cm apart, and leaves into that of the other: nothing jumps."""
    both, bias, path = Camera(0), np.array([0.02, -0.02, 0.03]), []
    for frame in range(180):
        pose = np.array([0.01 * frame, 0.0, 0.0])
        for camera, (first, last) in enumerate([(0, 120), (60, 180)]):
            if first <= frame < last:
                both.see(frame, [(0, *(pose + camera * bias))], camera=camera)
        path.append(both.at(frame * PERIOD_S, np.array([[0.6, 0.0, 0.0]]))[0] - pose)
    np.testing.assert_allclose(path, np.zeros((180, 3)), atol=1e-3)
    one, other = (both.vision.cameras[number].bias_m_m_rad for number in (0, 1))
    np.testing.assert_allclose(other - one, bias, atol=1e-3)


def test_another_robots_number_or_a_mirrored_heading_is_not_believed_unless_it_lasts() -> None:
    def still(seen: Sequence[link.Robot], frames: int) -> np.ndarray:
        for _ in range(frames):
            camera.see(next(counter), seen)
            pose = camera.at(0.0)
        return pose[0]

    camera, counter = Camera(3), iter(range(1000))
    still([(3, 0.0, 0.0, 0.5)], 10)
    assert still([(3, 5.0, 0.0, 0.5)], 1)[0] == pytest.approx(0.0)
    assert still([(3, 5.0, 0.0, 0.5), (3, 0.01, 0.0, 0.5)], 1)[0] == pytest.approx(0.01)
    assert camera.notes.counts == {"wrong id": 2}
    assert still([(3, 0.0, 0.0, 0.5 - np.pi)], 3)[2] == pytest.approx(0.5)
    assert camera.notes.counts["mirrored"] == 3
    still([(3, 0.0, 0.0, 0.5)], 1)
    assert still([(3, 5.0, 0.0, 0.5)], PERSISTENCE + 2)[0] == pytest.approx(5.0)
    assert camera.notes.counts["moved"] == 1
    turned = still([(3, 5.0, 0.0, 0.5 - np.pi)], PERSISTENCE + 2)[2]
    assert math.cos(turned - 0.5 + np.pi) == pytest.approx(1.0)


def test_frames_that_are_late_or_came_before_count_once_and_others_are_not_ours() -> None:
    camera = Camera(0)
    assert [camera.see(frame, [(0, 0.0, 0.0, 0.0)], at=0.1) for frame in (0, 2, 1, 2, 3)] == [
        True,
        True,
        False,
        False,
        True,
    ]
    found = camera.vision.cameras[0]
    assert (found.frames, found.late, found.lost) == (3, 2, 1)
    yellow = Camera(0, colour="yellow")
    yellow.see(0, [(0, 1.0, 1.0, 0.0)])
    assert np.isnan(yellow.at(0.0)).all()


@pytest.mark.parametrize("robot", [(0, math.nan, 0.0, 0.0), (0, 1e6, 0.0, 0.0), (0, 0.0, 0.0, math.inf)], ids=str)
def test_places_that_are_none_are_bad_packets(robot: link.Robot) -> None:
    camera = Camera(0)
    assert not any(camera.see(frame, [robot], "somebody") for frame in range(3))
    assert camera.notes.counts == {"bad packet": 3}
    assert len(camera.said) == 1
    assert "somebody" in camera.said[0]


def test_bad_packets_are_counted_and_good_ones_are_read_whatever_comes_between() -> None:
    camera, poses, rng = Camera(0), [], random.Random(3)
    for frame in range(500):
        camera.see(frame, [(0, 0.001 * frame, 0.0, 0.0)], camera=7)
        bad = bytearray(camera.packet(frame, [(5, 1.0, 0.0, 0.0)])[: rng.randrange(60)] or b"\xff")
        bad[rng.randrange(len(bad))] ^= 1 << rng.randrange(8)
        camera.vision.add(bytes(bad), frame * PERIOD_S)
        poses.append(camera.at(frame * PERIOD_S)[0, 0])
    assert camera.notes.counts["bad packet"] > 200
    np.testing.assert_allclose(poses, 0.001 * np.arange(500), atol=0.05)


def test_two_that_send_as_one_camera_are_named_and_there_is_an_end_to_what_is_told() -> None:
    """As when a simulator was left running; each takes the other's clock for one that began anew."""
    camera = Camera(5)
    for frame in range(200):
        camera.see(frame, [(5, 0.0, 0.0, 0.0)], f"peer {frame % 2}", offset=-1e6 * (frame % 2))
    assert sum("camera 0 is sent by peer 1 now, by peer 0 before" in text for text in camera.said) == 1
    assert len(camera.said) < 50


def fed(offset: float, rate: float, seconds: float, seed: int = 0) -> tuple[Clock, float]:
    """A clock that has heard packets of a peer whose clock is `rate` times ours, and our time at the end."""
    rng, clock = np.random.default_rng(seed), Clock()
    for k in range(round(seconds / PERIOD_S)):
        ours = 100.0 + k * PERIOD_S
        arrival = ours + rng.exponential(JITTER_S)
        assert not clock.add(offset + rate * ours, arrival)
        assert clock.ours(offset + rate * ours) <= arrival + 1e-6  # no packet arrives before it was sent
    return clock, ours


@given(st.floats(-1e6, 2e9), st.floats(0.8, 1.25), st.integers(0, 1000))
@settings(max_examples=25, deadline=None)
def test_offset_and_rate_of_a_clock_are_found_through_jitter(offset: float, rate: float, seed: int) -> None:
    """Of 15 packets in each quarter of a second the fastest is JITTER_S / 15 late, with as much spread.

    Over the 40 of ten seconds a line's value at its end has twice the spread over the root of 40; ten times that is
    allowed, and that the line lies below the fastest of all, by five times the spread of one. Their times' variance is
    8.3 s^2: the rate's spread is 1.1e-5, of which ten times is allowed.
    """
    clock, now = fed(offset, rate, 10.0, seed)
    spread = JITTER_S / 15
    resolution = 1e-6 if abs(offset) > 1e7 else 1e-9  # of numbers as large as times since 1970
    allowed = 6 * spread + 20 * spread / np.sqrt(40) + resolution
    assert clock.ours(offset + rate * now) == pytest.approx(now, abs=allowed)
    assert clock.rate == pytest.approx(rate, rel=1.1e-4)
    assert clock.theirs(clock.ours(offset + 3.0)) == pytest.approx(offset + 3.0, abs=1e-6)


@pytest.mark.parametrize("jump", [-100.0, -1.0, 1.0, 1e9], ids=str)
def test_a_peer_that_is_started_anew_is_noticed_at_once(jump: float) -> None:
    clock, now = fed(0.0, 1.0, 5.0)
    stamp = now + PERIOD_S + jump
    assert clock.add(stamp, now + PERIOD_S)
    assert clock.restarts == 1
    assert clock.ours(stamp) == pytest.approx(now + PERIOD_S, abs=1e-9)


@pytest.mark.parametrize(("held_s", "followed"), [(2.0, True), (0.3, False)])
def test_a_simulation_that_is_held_is_followed_but_packets_that_were_held_up_are_not(
    held_s: float, followed: bool
) -> None:
    """Stamps go on where they were, two seconds later: no restart, but all packets are late by as much.

    When this computer was busy for 0.3 s, those that waited arrive at one time, and the line stays.
    """
    clock, now = fed(0.0, 1.0, 5.0)
    before = clock.ours(now)
    for k in range(60 if followed else 18):
        clock.add(now + k * PERIOD_S, now + held_s + (k * PERIOD_S if followed else 0.0))
    assert clock.restarts == 0
    if followed:
        assert clock.ours(now + 59 * PERIOD_S) == pytest.approx(now + held_s + 59 * PERIOD_S, abs=1e-3)
    else:
        assert clock.ours(now) == pytest.approx(before, abs=1e-4)


def swung(frame: np.ndarray, latency: float) -> np.ndarray:
    """What a swing of 1 rad/s at 1 Hz has led to, of commands that are held for a frame each, summed frame by frame."""
    turned = [sum(np.sin(2 * np.pi * j * PERIOD_S) * min(max(k - latency - j, 0), 1) for j in range(k)) for k in frame]
    return np.array(turned) * PERIOD_S


@given(st.floats(0.0, 12.0), st.floats(0.5, 1.2), st.integers(0, 99))
@settings(max_examples=15, deadline=None)
def test_latency_and_gain_are_found(latency: float, gain: float, seed: int) -> None:
    """Headings with 0.01 rad of noise of which some are missing, positions with 1 mm.

    Headings swing by 0.7 rad/s times the gain (rms), 12 mrad a frame: from 216 of them noise leaves 0.06 frames of the
    latency over the gain, and of the swing's size, 0.11 rad, 0.6 % over the gain. Allowed are five of these deviations.
    Positions move over the window by 16 mm more or less a frame later, ten times as well known.
    """
    frame, rng = np.arange(FRAMES), np.random.default_rng(seed)
    sent, led = np.sin(2 * np.pi * frame * PERIOD_S), gain * swung(frame, latency)
    heading = led + 0.01 * rng.normal(size=FRAMES)
    heading[rng.random(FRAMES) < 0.1] = np.nan
    found = link.fit_turning(sent, (heading + 3.0 + np.pi) % (2 * np.pi) - np.pi)
    assert found.latency == pytest.approx(latency, abs=0.3 / gain)
    assert found.gain == pytest.approx(gain, rel=0.03 / gain)
    position = np.column_stack([led, -2 * led]) + 0.001 * rng.normal(size=(FRAMES, 2))
    found = link.fit_driving(np.column_stack([sent, -2 * sent]), position)
    assert found.latency == pytest.approx(latency, abs=0.1)
    assert found.gain == pytest.approx(gain, rel=0.02)


def test_a_robot_that_does_not_answer_is_recognised() -> None:
    rng, sent = np.random.default_rng(0), np.sin(np.arange(FRAMES) / 10)
    assert not link.fit_turning(sent, 0.01 * rng.normal(size=FRAMES)).gain > 0.3
    assert not link.fit_turning(sent, np.full(FRAMES, np.nan)).gain > 0.3
    assert np.isnan(link.fit_driving(np.column_stack([sent, sent]), np.zeros((FRAMES, 2)))).all()


def test_a_group_reaches_this_computer_with_a_time_to_live_of_zero() -> None:
    receiver = Receiver(Address("224.5.23.2", 0))
    another = Receiver(Address("224.5.23.2", receiver.address.port))
    sender = link.sender()
    try:
        assert sender.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 0
        assert sender.getsockname()[0] == LOOPBACK
        sender.sendto(b"hello", ("224.5.23.2", receiver.address.port))
        for each in (receiver, another):
            assert each.wait(time.monotonic() + 5)
            ((data, arrival, source),) = each.packets()
            assert (data, source.host) == (b"hello", LOOPBACK)
            assert arrival <= time.monotonic()
            assert not each.wait(time.monotonic())
    finally:
        for each in (receiver, another, sender):
            each.close()


def test_what_cannot_be_listened_to_is_said() -> None:
    receiver = Receiver(Address(LOOPBACK, 0))
    with pytest.raises(OmniError, match=f"cannot listen to {receiver.address}.*in use"):
        Receiver(receiver.address)
    receiver.close()
    for interface in ("8.8.8.8", "nonsense", ""):
        with pytest.raises(OmniError, match="by the interface"):
            Receiver(Address("224.5.23.2", 0), interface)


def test_addresses_are_read_and_nothing_leaves_this_computer_unasked() -> None:
    assert link.address("127.0.0.1:10301", 1) == Address(LOOPBACK, 10301)
    assert link.address("localhost", 7) == Address(LOOPBACK, 7)
    for text in ("", ":1", "127.0.0.1:", "127.0.0.1:0", "127.0.0.1:65536", "127.0.0.1:x", "::1", "a b:1"):
        with pytest.raises(OmniError, match=r"no address|nobody knows"):
            link.address(text, 1)
    link.check_local(Address("127.0.0.1", 1), LOOPBACK)
    link.check_local(Address("192.0.2.1", 1), "192.0.2.9")
    with pytest.raises(OmniError, match="--interface"):
        link.check_local(Address("192.0.2.1", 1), LOOPBACK)
