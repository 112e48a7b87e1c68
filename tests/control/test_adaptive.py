"""Laws of adaptive-comp-flc in closed loop with robots that answer as its model says, and without noise."""

import numpy as np
from closed_loop import BodyFrame, Run, T, drive, limited

from omni_control import IteratedReference, MotionLimits, TimedReference, Told
from omni_control.controllers.adaptive import AdaptiveCompFlc
from omni_control.kinematics import Array
from omni_control.reference import Reference

LIMITS = MotionLimits()
PATH = [[0.0, 0.0, 0.0], [1.2, 0.4, 1.5], [0.5, 0.8, -1.0], [0.0, 0.0, 0.0]]
STRAIGHT = [[0.0, 0.0, 0.5], [1.0, 0.7, 0.5], [0.0, 0.0, 0.5]]
LEAD, SECOND = 15, 60


def timed(path: list[list[float]]) -> TimedReference:
    return TimedReference(path, LIMITS, T, settle_frames=SECOND).after_rest(LEAD)


def controller(reference: Reference, n: int, delay: int, drag_m_s: float = 0.0) -> AdaptiveCompFlc:
    """One that is told that its vision is exact, and that there is no lag."""
    exact = {"position_noise_m": 0.0, "heading_noise_rad": 0.0}
    told = Told(T, delay, lag_s=0, drag_m_s=drag_m_s, creep_s2_m=0, **exact)
    return AdaptiveCompFlc(told, reference, n)


def exact(n: int, frames: int) -> Array:
    """Vision without noise."""
    return np.zeros((frames, n, 3))


def distances(run: Run, reference: TimedReference) -> Array:
    """Distance of each robot from the reference (frames, n), m."""
    off = run.pose - reference.poses[: len(run.pose), None]
    return np.hypot(off[..., 0], off[..., 1])


def test_robots_told_wrong_are_found_out_and_tracked() -> None:
    """Latencies from 3 to 9 frames under one controller told 6, alpha from 0.6 to 1.1, drag: on the way after 2 s.

    Within 1 cm in position and 0.25 rad in heading, whose alpha it takes to be near 1; from 2 cm and 0.3 rad at first.
    The latency is known to a frame or so, best where alpha is what it believes, 0.9.
    """
    n, rng, reference = 13, np.random.default_rng(0), timed(PATH)
    latency = np.repeat(np.linspace(3, 9, n)[:, None], 3, axis=1)
    alpha, drag = rng.uniform(0.6, 1.1, (n, 1)) * np.ones(3), rng.uniform(0, 0.03, (n, 1)) * np.ones(3)
    plant = BodyFrame(np.zeros((n, 3)), latency, alpha, drag)
    run = drive(controller(reference, n, 6, drag_m_s=0.04), plant, exact(n, reference.frames), limits=limited)
    distance, late = distances(run, reference), LEAD + 2 * SECOND
    turned = np.abs(run.pose[..., 2] - reference.poses[:, None, 2])
    assert distance.max() < 0.03
    assert distance[late:].max() < 0.01
    assert turned.max() < 0.5
    assert turned[late:].max() < 0.25
    wrong, little = np.abs(run.latency_hat[late:] - latency), np.abs(latency[:, 0] - 6) <= 2
    assert wrong[:, little].max() < 1.2
    assert wrong.max() < 1.6


def test_neither_delay_nor_lag_works_as_well() -> None:
    """Told nought and nought, a robot that answers at once is not taken for one that answers late for long."""
    reference = timed(PATH)
    plant = BodyFrame(np.zeros((2, 3)), 0, [[1.0], [0.7]], 0.0)
    run = drive(controller(reference, 2, 0), plant, exact(2, reference.frames), limits=limited)
    assert np.isfinite(run.sent).all()
    assert distances(run, reference).max() < 0.01
    assert np.median(run.latency_hat[LEAD + 2 * SECOND :], axis=0).max() < 1.0


def test_the_reference_planned_anew_leads_through_all_way_points() -> None:
    """Iterated from the predicted pose it has no timetable; robots pass near every way-point and stop at the last."""
    for delay in [0, 12]:
        n, path = 3, np.array(PATH)
        reference = IteratedReference(PATH, LIMITS, T, n, rest_frames=LEAD)
        plant = BodyFrame(np.repeat(path[:1], n, axis=0), delay, [[1.0], [0.8], [0.6]], 0.01)
        run = drive(controller(reference, n, delay, drag_m_s=0.04), plant, exact(n, 7 * SECOND), limits=limited)
        for point in path[1:]:
            # Within the 2 cm at which a way-point counts as reached, and as much that the prediction may be off.
            assert np.hypot(*np.moveaxis(run.pose[..., :2] - point[:2], -1, 0)).min(0).max() < 0.04
        np.testing.assert_allclose(run.pose[-1], np.repeat(path[-1:], n, axis=0), rtol=0, atol=0.005)
        assert np.abs(run.sent[-1]).max() < 0.05
