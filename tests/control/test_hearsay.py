"""Two filters that share a parameter and tell each other of it know what one filter of both would know."""

import numpy as np
import pytest
from closed_loop import BodyFrame, T, drive, limited, vision

from omni_control import MotionLimits, TimedReference, Told
from omni_control.controllers.adaptive import AdaptiveCompFlc
from omni_control.estimation.hearsay import condition, conditioned
from omni_control.kinematics import Array

DELAY = 6
TURNS = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.5], [0.0, 0.0, -1.5]]


def corrected(state: Array, variance: Array, row: Array, seen: float, noise: float) -> tuple[Array, Array]:
    """The textbook's correction by a scalar that is `row` times the state, with a noise of that variance."""
    gain = variance @ row / (row @ variance @ row + noise)
    return state + gain * (seen - row @ state), variance - np.outer(gain, row @ variance)


def test_filters_that_tell_each_other_are_one_filter_of_both() -> None:
    """States (a1, a2, l) and (b1, b2, l), known apart but for l, against (a1, a2, b1, b2, l), over 20 observations."""
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(2, 3, 3))
    one, other = roots @ roots.swapaxes(1, 2)
    other[2, 2] = one[2, 2]
    one, other = (each + 3 * one[2, 2] * np.diag([1.0, 1.0, 0.0]) for each in (one, other))  # that they can be
    a, b = np.append(rng.normal(size=2), 0.3), np.append(rng.normal(size=2), 0.3)
    both, places = np.zeros((5, 5)), ([0, 1, 4], [2, 3, 4])
    for variance, place in zip((one, other), places, strict=True):
        both[np.ix_(place, place)] = variance
    # Given l they are independent: what they have in common goes by it alone.
    both[:2, 2:4] = np.outer(one[:2, 2], other[:2, 2]) / one[2, 2]
    both[2:4, :2] = both[:2, 2:4].T
    state, filters = np.concatenate([a[:2], b]), [[a, one], [b, other]]
    for k in range(20):
        i, row, seen = k % 2, rng.normal(size=3), rng.normal()
        thought, doubt = filters[i][0][2], filters[i][1][2, 2]
        filters[i] = list(corrected(*filters[i], row, seen, 0.2))
        longer, left = filters[i][0][2] - thought, filters[i][1][2, 2] / doubt
        hears, by_loops = filters[1 - i], [each.copy() for each in filters[1 - i]]
        found = conditioned(hears[0][None], hears[1][None], 2, np.array([longer]), np.array([left]))
        condition(by_loops[0], by_loops[1], 2, longer, left)
        filters[1 - i] = [found[0][0], found[1][0]]
        for each, by_loop in zip(filters[1 - i], by_loops, strict=True):
            np.testing.assert_allclose(by_loop, each, rtol=0, atol=1e-12)
        whole = np.zeros(5)
        whole[places[i]] = row
        state, both = corrected(state, both, whole, seen, 0.2)
        for (mean, variance), place in zip(filters, places, strict=True):
            np.testing.assert_allclose(mean, state[place], rtol=0, atol=1e-9)
            np.testing.assert_allclose(variance, both[np.ix_(place, place)], rtol=0, atol=1e-9)


@pytest.mark.parametrize(("alpha", "tells"), [((1.0, 1.0), True), (None, False)])
def test_headings_tell_the_latency_of_robots_that_only_turn(alpha: tuple[float, float] | None, tells: bool) -> None:
    """Told six frames, truly 4 to 8: within 0.4 frames after two turns, with usual noise, and sure of it.

    Where nobody knows what robots reach, turning tells nothing: the little that they leave their place has to.
    """
    latency = np.array([4.0, 5.0, 6.5, 8.0])
    n, reference = len(latency), TimedReference(TURNS, MotionLimits(), T).after_rest(15)
    told = Told(T, DELAY, lag_s=0, drag_m_s=0, creep_s2_m=0, alpha=alpha)
    plant = BodyFrame(np.zeros((n, 3)), latency[:, None], np.array([1.0, 1.0, 1 / 1.02]), 0.0)
    controller = AdaptiveCompFlc(told, reference, n)
    drive(controller, plant, vision(np.random.default_rng(0), reference.frames, n), limits=limited)
    found, doubt = controller.plant.latency, controller.plant.sigma[:, 6]
    np.testing.assert_allclose(controller.turning.sigma[:, 8], doubt, rtol=1e-6)  # they agree
    if tells:
        np.testing.assert_allclose(found, latency, rtol=0, atol=0.4)
    assert (doubt < 0.3).all() if tells else (doubt > 0.6).all()
