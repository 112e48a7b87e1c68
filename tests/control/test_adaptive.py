"""Laws of adaptive-comp-flc in closed loop with robots that answer as its model says, and without noise."""

import numpy as np
import pytest
from closed_loop import BodyFrame, Run, T, believe_nothing, commands_for, drive, limited, seen_at

from omni_control import IteratedReference, MotionLimits, TimedReference, Told
from omni_control.controllers import make
from omni_control.controllers.adaptive import AdaptiveCompFlc
from omni_control.estimation import identify
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
    told = Told(T, delay, lag_s=0, drag_m_s=drag_m_s, position_noise_m=0, heading_noise_rad=0)
    return AdaptiveCompFlc(told, reference, n)


def exact(n: int, frames: int) -> Array:
    """Vision without noise."""
    return np.zeros((frames, n, 3))


def distances(run: Run, reference: TimedReference) -> Array:
    """Distance of each robot from the reference (frames, n), m."""
    off = run.pose - reference.poses[: len(run.pose), None]
    return np.hypot(off[..., 0], off[..., 1])


def ahead(run: Run, delay: int) -> Array:
    """Predicted poses less the true ones `delay` frames later, (frames - delay, n, 3)."""
    return run.predicted[: len(run.pose) - delay] - run.pose[delay:]


@pytest.fixture
def knows_the_latency(monkeypatch: pytest.MonkeyPatch) -> None:
    """No latency but the one told is compared, and nothing is believed beforehand of alpha and drag."""
    monkeypatch.setattr(identify, "REACH_FRAMES", 0)
    believe_nothing(monkeypatch)


@pytest.mark.usefixtures("knows_the_latency")
def test_a_robot_that_is_known_is_predicted_and_led_exactly() -> None:
    """A second after alpha began to show, `predicted` is the true pose at the end of the latency.

    What was amiss until then dies out: to nothing in position, at 3 / s in heading.
    """
    for delay in (0, 1, 12):
        reference, alpha = timed(PATH), np.array([[0.8] * 3, [1.05] * 3, [0.6, 0.7, 0.9]])
        run = drive(
            controller(reference, 3, delay),
            BodyFrame(np.zeros((3, 3)), delay, alpha, 0.0),
            exact(3, reference.frames),
            limits=limited,
        )
        known = LEAD + delay + SECOND
        # The least squares of 60 frames and more, and 12 additions to poses of size 1.
        np.testing.assert_allclose(run.alpha_hat[known:] - alpha, 0, atol=1e-7)
        np.testing.assert_allclose(ahead(run, delay)[known:], 0, atol=1e-9)
        off, settled = np.abs(run.pose - reference.poses[:, None]), known + 2 * SECOND
        # The fuzzy controller's 15 / s leave 1e-13 of centimetres after two seconds: the rest is rounding.
        assert off[settled:, :2, :2].max() < 1e-12
        # Robots with axes that differ turn by w T / 2 on average within the frame for which commands are rotated.
        assert off[settled:, 2, :2].max() < 3e-4
        # Half a radian at the most, 3 s later exp(-9).
        assert off[settled + SECOND :, :, 2].max() < 1e-4


@pytest.mark.usefixtures("knows_the_latency")
def test_a_robot_with_dry_friction_that_is_known_is_predicted_exactly() -> None:
    """On a way with one heading: the prediction of how far a robot turns leaves drag out.

    It is led to half a millimetre: from rest, friction is not what it is for a robot that moves.
    """
    for delay in [0, 6]:
        reference, alpha = timed(STRAIGHT), np.array([[0.8] * 3, [1.05] * 3, [0.6, 0.7, 0.9]])
        plant = BodyFrame(np.array(STRAIGHT[:1] * 3), delay, alpha, 0.03)
        adaptive = controller(reference, 3, delay, drag_m_s=0.04)
        adaptive.plant._drag_sigma = 1e6  # nothing is believed of drag beforehand but the noise that it makes
        run = drive(adaptive, plant, exact(3, reference.frames), limits=limited)
        known = LEAD + delay + SECOND
        np.testing.assert_allclose((run.alpha_hat[known:] - alpha)[..., :2], 0, atol=1e-7)
        np.testing.assert_allclose(ahead(run, delay)[known:], 0, atol=1e-9)
        assert np.abs(run.pose - reference.poses[:, None])[known + SECOND :].max() < 5e-4


def test_robots_told_wrong_are_found_out_and_tracked() -> None:
    """Latencies from 3 to 9 frames under one controller told 6, alpha from 0.6 to 1.1, drag: on the way after 2 s.

    Within 2.5 mm in position and 0.05 rad in heading, from 1 cm and 0.2 rad at first. The latency is known to half a
    frame, which is 7 mm at 0.8 m/s for the prediction but nothing for a way that goes on as before.
    """
    n, rng, reference = 13, np.random.default_rng(0), timed(PATH)
    latency = np.repeat(np.linspace(3, 9, n)[:, None], 3, axis=1)
    alpha, drag = rng.uniform(0.6, 1.1, (n, 1)) * np.ones(3), rng.uniform(0, 0.03, (n, 1)) * np.ones(3)
    plant = BodyFrame(np.zeros((n, 3)), latency, alpha, drag)
    run = drive(controller(reference, n, 6, drag_m_s=0.04), plant, exact(n, reference.frames), limits=limited)
    distance, late = distances(run, reference), LEAD + 2 * SECOND
    turned = np.abs(run.pose[..., 2] - reference.poses[:, None, 2])
    assert distance.max() < 0.03
    assert distance[late:].max() < 0.0025
    assert turned.max() < 0.5
    assert turned[late:].max() < 0.05
    assert np.abs(run.latency_hat[late:] - latency).max() < 0.5


def test_a_lag_that_is_told_counts_as_dead_time() -> None:
    """A dead time of 6 frames and a lag of 20 ms, or 7.2 frames and none: one and the same controller."""
    reference, n = timed(PATH), 3
    runs = []
    for told in (Told(T, 6, lag_s=0.02), Told(T, 6, lag_s=1.2 * T)):
        plant = BodyFrame(np.zeros((n, 3)), [[6.0], [7.0], [7.5]], 0.8, 0.0)
        runs.append(drive(AdaptiveCompFlc(told, reference, n), plant, exact(n, 2 * SECOND), limits=limited))
    # 0.02 s are 1.2 frames but for the last bit; the guess that is not on a half frame is rounded by none.
    np.testing.assert_allclose(runs[0].sent, runs[1].sent, rtol=0, atol=1e-9)
    np.testing.assert_allclose(runs[0].latency_hat[0], 7.2, rtol=0, atol=0.01)


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
        run = drive(controller(reference, n, delay, drag_m_s=0.04), plant, exact(n, 9 * SECOND), limits=limited)
        for point in path[1:]:
            # Within the 2 cm at which a way-point counts as reached, and as much that the prediction may be off.
            assert np.hypot(*np.moveaxis(run.pose[..., :2] - point[:2], -1, 0)).min(0).max() < 0.04
        np.testing.assert_allclose(run.pose[-1], np.repeat(path[-1:], n, axis=0), rtol=0, atol=0.005)
        assert np.abs(run.sent[-1]).max() < 0.05


def test_at_first_it_is_comp_flc() -> None:
    """With nothing learned, alpha 1 and the latency told: the first command is that of comp-flc.

    So it is for dead times of 7 frames and more, around which as many latencies are shorter as longer: the mean of
    those that are possible is then the one told. Of 6 frames it is 6.1, of none 2.
    """
    rng, n = np.random.default_rng(0), 5
    told, reference = Told(T, 8, lag_s=0.0), timed(PATH)
    pose = rng.normal(0, 0.05, (n, 3))
    commands = []
    for name in ("comp-flc", "adaptive-comp-flc"):
        first = make(name, told, reference, n)
        commands.append(first.command(30, seen_at(told, pose, commands_for(first), np.zeros((n, 3)), pose)))
    np.testing.assert_allclose(commands[1], commands[0], rtol=0, atol=1e-12)
