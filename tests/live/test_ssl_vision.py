"""From packets to measured poses: capture times, several cameras, bad packets, clocks, sockets."""

import math
import socket
import time

import numpy as np
import pytest
from benches import vision_packets
from benches.vision_packets import PERIOD_S, Address, Camera, PeerClock, Receiver
from hypothesis import given, settings
from hypothesis import strategies as st
from serve_client import LOOPBACK, RobotSeen

JITTER_S = 0.003  # mean of what packets take above the least, exponentially distributed


@given(age=st.floats(0, 0.04), later=st.floats(0, 0.03), offset=st.floats(-1e3, 1e3))
@settings(max_examples=50)
def test_detections_are_as_old_as_their_stamps_say(age: float, later: float, offset: float) -> None:
    """Whatever the peer's clock says; headings are in (-pi, pi]."""
    camera, time_s = Camera(5), 29 * PERIOD_S
    for frame in range(30):
        camera.see(frame, [(5, 1.0, -2.0, 4.0)], age=age, offset=offset)
    (pose,), (seen_before,) = camera.at(time_s + later)
    np.testing.assert_allclose(pose, [1.0, -2.0, 4.0 - 2 * np.pi], atol=1e-6)
    assert seen_before == pytest.approx(age + later, abs=1e-5)
    assert np.isnan(camera.at(time_s + later)[0]).all()  # told once


@pytest.mark.parametrize("age", [-0.001, 0.26, 10.0, 1.7e9])
def test_a_packet_of_absurd_age_counts_as_new(age: float) -> None:
    """Its time of capture is of another clock than its time of sending."""
    camera = Camera(5)
    for frame in range(30):
        camera.see(frame, [(5, 1.0, -2.0, 0.5)], age=age)
    _, (seen_before,) = camera.at(29 * PERIOD_S + 0.01)
    assert seen_before == pytest.approx(0.01, abs=1e-5)


def test_the_rate_is_that_of_frames_that_nothing_held_up() -> None:
    """A camera of 65 a second whose computer stalls for 45 ms now and then is none of 60."""
    camera, time_s = Camera(5), 0.0
    for frame in range(300):
        time_s += 1 / 65 + (0.045 if frame % 40 == 39 else 0.0)
        camera.see(frame, [], at=time_s, offset=time_s - frame * PERIOD_S)
    assert camera.vision.cameras[0].rate_hz == pytest.approx(65)


def test_of_several_robots_of_a_number_the_one_counts_that_is_near() -> None:
    """In one image or in two; a few detections of another robot do not move the median pose."""
    camera = Camera(3)
    for frame in range(9):
        camera.see(frame, [(3, 0.1, 0.0, 0.5 + np.pi * (frame == 4))])
    camera.see(9, [(3, 5.0, 0.0, 0.5), (3, 0.1, 0.0, 0.5)])
    camera.see(9, [(3, 0.2, 0.0, 0.5)], camera=1)
    assert camera.at(0.0, (0.11, 0.0, 0.0))[0][0, 0] == pytest.approx(0.1)
    np.testing.assert_allclose(camera.vision.median_poses(), [[0.1, 0.0, 0.5]], atol=1e-6)


def test_frames_that_are_late_or_came_before_count_once_and_others_are_not_ours() -> None:
    camera = Camera(0)
    assert [
        frame for frame in (0, 2, 1, 2, 3) if camera.see(frame, [(0, 0.0, 0.0, 0.0)], at=0.1)
    ] == [0, 2, 3]
    assert camera.vision.cameras[0].frames == 3
    yellow = Camera(0, color="yellow")
    yellow.see(0, [(0, 1.0, 1.0, 0.0)])
    assert np.isnan(yellow.at(0.0)[0]).all()
    assert yellow.vision.seen_ids() == []


@pytest.mark.parametrize(
    "robot", [(0, math.nan, 0.0, 0.0), (0, 1e6, 0.0, 0.0), (0, 0.0, 0.0, math.inf)], ids=str
)
def test_places_that_are_none_are_bad_packets(robot: RobotSeen) -> None:
    camera = Camera(0)
    assert not any(camera.see(frame, [robot]) for frame in range(3))
    assert camera.vision.messages == {"bad packet": 3}
    (said,) = camera.said
    assert "somebody" in said


def fed(offset: float, rate: float, seconds: float, seed: int = 0) -> tuple[PeerClock, float]:
    """A clock after packets from a peer whose clock runs `rate` times as fast, and our time."""
    rng, clock = np.random.default_rng(seed), PeerClock()
    for k in range(round(seconds / PERIOD_S)):
        ours = 100.0 + k * PERIOD_S
        arrival = ours + rng.exponential(JITTER_S)
        clock.add(offset + rate * ours, arrival)
        assert (
            clock.local_time(offset + rate * ours) <= arrival + 1e-6
        )  # no packet arrives before it was sent
    return clock, ours


@given(st.floats(-1e6, 2e9), st.floats(0.8, 1.25), st.integers(0, 1000))
@settings(max_examples=25)
def test_offset_and_rate_of_a_clock_are_found_through_jitter(
    offset: float, rate: float, seed: int
) -> None:
    """The fastest of 15 packets per quarter second is late by JITTER_S / 15, with the same spread.

    Over the 40 of ten seconds a line's value at its end has twice the spread over the root of 40;
    ten times that is allowed, and that the line lies below the fastest of all, by five times the
    spread of one. Their times' variance is 8.3 s^2: the rate's spread is 1.1e-5, of which ten times
    is allowed.
    """
    clock, now = fed(offset, rate, 10.0, seed)
    spread = JITTER_S / 15
    resolution = 1e-6 if abs(offset) > 1e7 else 1e-9  # of numbers as large as times since 1970
    allowed = 6 * spread + 20 * spread / np.sqrt(40) + resolution
    assert clock.local_time(offset + rate * now) == pytest.approx(now, abs=allowed)
    assert clock.rate == pytest.approx(rate, rel=1.1e-4)


def test_packets_that_were_held_up_are_not_followed() -> None:
    """If this computer was busy for 0.3 s, packets arrive at once; the clock is unchanged."""
    clock, now = fed(0.0, 1.0, 5.0)
    before = clock.local_time(now)
    for k in range(60):
        clock.add(now + k * PERIOD_S, now + max(0.3, k * PERIOD_S))
    assert clock.local_time(now) == pytest.approx(before, abs=1e-4)


@pytest.mark.parametrize("stall", [0.1, 0.5, 3.0])
def test_a_stall_that_shifts_time_stamps_is_followed_within_two_seconds(stall: float) -> None:
    """From then on all packets are later by as much; the rate is that of before."""
    clock, now = fed(0.0, 1.0, 10.0)
    rng = np.random.default_rng(1)
    for k in range(1, 120):
        stamp = now + k * PERIOD_S
        clock.add(stamp, stamp + stall + rng.exponential(JITTER_S))
    assert clock.local_time(stamp) == pytest.approx(stamp + stall, abs=JITTER_S)
    assert clock.rate == pytest.approx(1.0, rel=2e-3)


def test_a_camera_that_begins_again_is_seen_again() -> None:
    """Its program was restarted, and its time stamps begin with 0; this is said once."""
    camera = Camera(0)
    for frame in range(300):
        camera.see(frame, [(0, 1.0, 0.0, 0.0)])
    for frame in range(30):
        assert camera.see(frame, [(0, 2.0, 0.0, 0.0)], at=6.0 + frame * PERIOD_S)
    (pose,), (age,) = camera.at(6.0 + 29 * PERIOD_S)
    assert pose[0] == pytest.approx(2.0)
    assert age == pytest.approx(0.0, abs=1e-6)
    assert camera.vision.messages == {"camera restarted": 1}


@pytest.mark.parametrize("backwards", [(0,), (1,), (0, 2)])
def test_a_camera_that_sees_a_robot_backwards_does_not_count(backwards: tuple[int, ...]) -> None:
    """If another camera sees it as it is, even a little further from where it is expected."""
    camera, heading = Camera(3), 3.0
    for frame in range(9):
        for number in range(3):
            turn = np.pi * (number in backwards and frame == 8)
            seen = (3, 0.1 + 0.01 * number, 0.0, heading + turn)
            camera.see(frame, [seen], camera=number)
    (pose,), _ = camera.at(8 * PERIOD_S, (0.1, 0.0, -heading + 2 * np.pi - 0.28))
    nearest = min({0, 1, 2} - set(backwards))
    np.testing.assert_allclose(pose, [0.1 + 0.01 * nearest, 0.0, heading], atol=1e-6)
    median = camera.vision.median_poses()[0]
    np.testing.assert_allclose(median, [0.11, 0.0, heading], atol=1e-6)
    # Another robot of this number, a meter away, does not count whatever its heading is.
    camera.see(9, [(3, 0.1, 0.0, heading + np.pi)])
    camera.see(9, [(3, 1.1, 0.0, heading)], camera=1)
    (pose,), _ = camera.at(9 * PERIOD_S, (0.1, 0.0, heading))
    assert pose[0] == pytest.approx(0.1)


def test_packets_of_any_content_need_bounded_memory_and_print_one_line() -> None:
    """Cameras and robots have bounded numbers, and kinds of messages are bounded."""
    camera = Camera(0)
    assert not camera.see(0, [(0, 0.0, 0.0, 0.0)], camera=10_000)
    assert not camera.see(0, [(4_000_000, 0.0, 0.0, 0.0)])
    assert not camera.see(0, [(0, 0.0, 0.0, 0.0)] * 1000)
    assert camera.vision.messages == {"bad packet": 3}
    assert len(camera.said) == 1
    for number in range(1000):
        camera.vision.messages.add(f"refused: {number}", "\x1b[2Jno\nline")
    assert len(camera.vision.messages) <= 101
    assert camera.said[1] == "\\x1b[2Jno line"


def test_nothing_leaves_this_computer_unasked() -> None:
    receiver = Receiver(Address("224.5.23.2", 0), LOOPBACK)
    sender = vision_packets.sender(LOOPBACK)
    assert sender.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 0
    sender.sendto(b"hello", ("224.5.23.2", receiver.address.port))
    assert receiver.wait(time.monotonic() + 5)
    ((data, _, source),) = receiver.packets()
    assert (data, source.host) == (b"hello", LOOPBACK)
    for each in (receiver, sender):
        each.close()
