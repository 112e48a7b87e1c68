"""From packets to poses at a tick: capture times, several cameras, wrong numbers; clocks, sockets."""

import math
import socket
import time
from collections.abc import Sequence

import numpy as np
import pytest
from benches import live_link as link
from benches.live_link import PERIOD_S, Address, Camera, Clock, Receiver
from hypothesis import given, settings
from hypothesis import strategies as st
from serving import LOOPBACK

TWIST = np.array([[1.0, -0.5, 2.0]])
ALLOWED_M = 1e-6  # of numbers that were floats in mm
JITTER_S = 0.003  # mean of what packets take above the least, exponentially distributed


def moving(time_s: float) -> np.ndarray:
    """A robot that drives steadily, as `TWIST` says."""
    return np.array([0.3, 0.2, 0.1]) + TWIST[0] * time_s


@given(age=st.floats(0, 0.04), later=st.floats(0, 0.03), offset=st.floats(-1e3, 1e3))
@settings(max_examples=50)
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


def test_the_usual_rate_is_that_of_frames_that_nothing_held_up() -> None:
    """A camera of 65 a second whose computer stalls for 45 ms now and then is none of 60."""
    camera, time_s = Camera(5), 0.0
    for frame in range(300):
        time_s += 1 / 65 + (0.045 if frame % 40 == 39 else 0.0)
        camera.see(frame, [], at=time_s, offset=time_s - frame * PERIOD_S)
    found = camera.vision.cameras[0]
    assert found.stamped_hz == pytest.approx(65)


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
    assert still([(3, 5.0, 0.0, 0.5)], 60)[0] == pytest.approx(5.0)  # at 5 m/s, within a second
    turned = still([(3, 5.0, 0.0, 0.5 - np.pi)], 17)[2]  # a quarter of a second
    assert math.cos(turned - 0.5 + np.pi) == pytest.approx(1.0)


def test_frames_that_are_late_or_came_before_count_once_and_others_are_not_ours() -> None:
    camera = Camera(0)
    counted = [frame for frame in (0, 2, 1, 2, 3) if camera.see(frame, [(0, 0.0, 0.0, 0.0)], at=0.1)]
    assert counted == [0, 2, 3]
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
@settings(max_examples=25)
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


def test_a_simulation_that_is_held_is_followed_but_packets_that_were_held_up_are_not() -> None:
    """When this computer was busy for 0.3 s, packets that waited arrive at one time, and the line stays.

    When stamps go on where they were, two seconds later, all packets are late by as much: no restart.
    """
    clock, now = fed(0.0, 1.0, 5.0)
    before = clock.ours(now)
    for k in range(18):
        clock.add(now + k * PERIOD_S, now + 0.3)
    assert clock.ours(now) == pytest.approx(before, abs=1e-4)
    now += 18 * PERIOD_S
    for k in range(60):
        clock.add(now + k * PERIOD_S, now + 2.0 + k * PERIOD_S)
    assert clock.restarts == 0
    assert clock.ours(now + 59 * PERIOD_S) == pytest.approx(now + 2.0 + 59 * PERIOD_S, abs=1e-3)


def test_nothing_leaves_this_computer_unasked() -> None:
    receiver = Receiver(Address("224.5.23.2", 0))
    sender = link.sender()
    assert sender.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 0
    sender.sendto(b"hello", ("224.5.23.2", receiver.address.port))
    assert receiver.wait(time.monotonic() + 5)
    ((data, _, source),) = receiver.packets()
    assert (data, source.host) == (b"hello", LOOPBACK)
    for each in (receiver, sender):
        each.close()
