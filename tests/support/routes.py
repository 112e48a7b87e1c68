"""Way-points at random, and robots that do exactly what a reference says, for tests of references."""

import math

import numpy as np
from hypothesis import strategies as st

from omni_control import IteratedReference, MotionLimits, TimedReference

T = 1 / 60
SNAP_M = 1e-9  # a leg's last frame is put on the way-point from at most so far away, a change of velocity of 1e-9 / T


def micro(limit: float) -> st.SearchStrategy[float]:
    """Numbers on a grid of 1e-6, so that way-points coincide or are farther apart than a reference's snap."""
    return st.integers(-int(limit * 1e6), int(limit * 1e6)).map(lambda i: i / 1e6)


poses = st.tuples(micro(3), micro(3), micro(7))
paths = st.lists(poses, min_size=2, max_size=4)


def is_led_past_every_way_point(path: list[tuple[float, ...]], limit: MotionLimits) -> None:
    """A robot that obeys an iterated reference passes within its arrival radius of each way-point, in order.

    It ends on the last with nothing left to cover.
    """
    timed, iterated = TimedReference(path, limit, T), IteratedReference(path, limit, T, n=1)
    pose, seen, twist = np.array([path[0]]), 0, np.zeros((1, 3))
    weakest = min(limit.acceleration, limit.side_acceleration or limit.acceleration)
    # It need not stop at a way-point, but may overrun one at speed: per way-point, once more the time to stop.
    overrun = limit.speed / weakest + limit.turn_rate / limit.turn_acceleration
    for frame in range(timed.frames + len(path) * math.ceil(overrun / T)):
        _, twist = iterated.at(frame, pose)
        if seen < len(path) and np.hypot(*(pose[0] - path[seen])[:2]) < iterated.arrival_radius:
            seen += 1
        pose = pose + twist * T
    assert seen == len(path)
    # The last step before rest covers what is left exactly, to the rounding of poses of size 7.
    np.testing.assert_allclose(pose[0], path[-1], rtol=0, atol=1e-12)
    np.testing.assert_allclose(twist, 0, atol=1e-12 / T)
