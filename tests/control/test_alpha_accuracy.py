"""How well controllers know alpha while they drive: bias, steps and standstill, with the default noise of vision."""

from functools import cache

import numpy as np
import pytest
from closed_loop import Equation7, Run, T, drive, limited, vision

from omni_control import MotionLimits, TimedReference, Told
from omni_control.controllers import make
from omni_control.estimation import belief
from omni_control.kinematics import Array

DELAY, WINDOW, LEAD, REST, STEP_AT = 6, 15, 15, 120, 150  # frames; robots are at 1.8 m/s when alpha steps
CONSTANT = (0.55, 0.7, 0.85, 1.0, 1.05)
STEPS = ((1.0, 0.7), (0.7, 1.0), (0.8, 0.9))
RANDOM = "uniform in [0.7, 1], new in every frame"
CASES = (*CONSTANT, RANDOM, *STEPS)
EACH = 10  # robots of each case


def alphas(rng: np.random.Generator, frames: int) -> Array:
    """Factors (frames, robots, 3), the same for all axes but at random."""
    columns = []
    for case in CASES:
        if isinstance(case, str):
            columns.append(rng.uniform(0.7, 1.0, (frames, EACH, 3)))
        else:
            before, after = case if isinstance(case, tuple) else (case, case)
            values = np.where(np.arange(frames) < STEP_AT, before, after)
            columns.append(np.broadcast_to(values[:, None, None], (frames, EACH, 3)))
    return np.concatenate(columns, axis=1)


@cache
def there_and_back(controller: str) -> Run:
    """All robots, on a way of 3.9 m along both axes at once, back, and then at rest for two seconds."""
    path = [[0.0, 0.0, 0.0], [3.0, 2.5, 0.0], [0.0, 0.0, 0.0]]
    reference = TimedReference(path, MotionLimits(), T, settle_frames=REST).after_rest(LEAD)
    rng, n = np.random.default_rng(0), EACH * len(CASES)
    plant = Equation7(np.zeros((n, 3)), alphas(rng, reference.frames), DELAY)
    told = Told(T, DELAY, lag_s=0, drag_m_s=0)
    made = make(controller, told, reference, n)
    return drive(made, plant, vision(rng, reference.frames, n), limits=limited)


def rows(case: object) -> slice:
    first = EACH * CASES.index(case)  # type: ignore[arg-type]
    return slice(first, first + EACH)


def fast(run: Run) -> Array:
    """Where (frames, n, 2) robots were commanded more than 0.1 m in the window that ends in the frame."""
    commanded = T * np.cumsum(run.sent[..., :2], axis=0)
    felt = np.zeros_like(commanded)  # from the start to the frame
    felt[DELAY + 1 :] = commanded[: -DELAY - 1]
    before = np.zeros_like(felt)
    before[WINDOW:] = felt[:-WINDOW]
    chosen = np.abs(felt - before) > 0.1
    chosen[: LEAD + DELAY + 60] = False  # the first second of motion
    return chosen


def test_on_average_alpha_is_right_within_one_per_cent() -> None:
    """Both estimators, over thousands of estimates of robots that have driven for a second.

    Measured: 0.04 % for the sliding window of comp-flc; for the identifier of adaptive-comp-flc 0.1 to 1.2 %, and 5 %
    at 0.55, which is six standard deviations from what it believes beforehand.
    """
    for alpha in [*CONSTANT, RANDOM]:
        for controller in ["comp-flc", "adaptive-comp-flc"]:
            true, run = 0.85 if isinstance(alpha, str) else alpha, there_and_back(controller)
            estimates = run.alpha_hat[:, rows(alpha), :2][fast(run)[:, rows(alpha)]]
            assert estimates.size > 4000
            unbelievable = controller != "comp-flc" and true < 0.6
            within = 0.06 if unbelievable else 0.01 if controller == "comp-flc" else 0.015
            assert estimates.mean() == pytest.approx(true, rel=within)
            # 1.3 mm at both ends of a window of 0.1 m and more, filtered; an average of alphas that scatter by 0.09.
            assert estimates.std() < (0.06 if unbelievable else 0.03 if alpha == RANDOM else 0.01)


def test_the_window_of_comp_flc_knows_a_new_alpha_after_half_a_second() -> None:
    """It does so after a quarter, the length of its window: then no displacement from before the step is left."""
    for step in STEPS:
        estimates = there_and_back("comp-flc").alpha_hat[STEP_AT:, rows(step), :2]
        before, after = step
        assert estimates[0].mean() == pytest.approx(before, abs=0.01)
        assert estimates[18].mean() == pytest.approx(after, rel=0.03)
        assert estimates[30].mean() == pytest.approx(after, rel=0.01)
        assert np.abs(estimates[30] - after).max() < 0.05


def test_the_identifier_of_adaptive_comp_flc_remembers_for_longer() -> None:
    """By design it takes alpha to change over 12 s, to tell latency and lag from it: a sixth of the way in 1.5 s.

    What a step is beyond that, it takes for a push. It does not go past the new value.
    """
    for step in STEPS:
        before, after = step
        estimates = there_and_back("adaptive-comp-flc").alpha_hat[STEP_AT:, rows(step), :2].mean((1, 2))
        way = (estimates - before) / (after - before)
        assert way[0] == pytest.approx(0.0, abs=0.06)  # an error of 0.6 % of a step of 0.1
        assert way[90] > 0.15
        assert way.max() < 1.1


def test_at_standstill_alpha_hardly_changes() -> None:
    """Held in place for a second and a half by commands that answer to the noise of vision.

    They are some millimetres in a window. The filter believes that they were obeyed, so that the window of comp-flc
    walks towards 1, by some hundredths a second. The identifier returns to what it believed of 1 / alpha, by its law.
    """
    for controller in ["comp-flc", "adaptive-comp-flc"]:
        for alpha in CONSTANT:
            estimates = there_and_back(controller).alpha_hat[:, rows(alpha), :2].mean((1, 2))
            arrived, expected = estimates[-REST + 2 * WINDOW], estimates[-REST + 2 * WINDOW]
            assert arrived == pytest.approx(alpha, abs=0.06)
            if controller != "comp-flc":
                left = np.exp(-(REST - 2 * WINDOW - 1) * T / belief.KEPT_S)
                expected = 1 / (belief.EFFORT + left * (1 / arrived - belief.EFFORT))
            # Means of ten robots' alphas are not those of their inverses: 0.01.
            assert estimates[-1] == pytest.approx(expected, abs=0.05 if controller == "comp-flc" else 0.01)


def test_alpha_is_sane_whatever_the_noise() -> None:
    """Noise of 13 cm and 1 rad, of which the controller is not told, on robots that hardly move."""
    for controller in ["comp-flc", "adaptive-comp-flc"]:
        reference = TimedReference([[0, 0, 0], [0.2, 0.1, 1.0]], MotionLimits(), T)
        rng, n = np.random.default_rng(0), 30
        made = make(controller, Told(T, DELAY), reference, n)
        plant = Equation7(np.zeros((n, 3)), 0.8, DELAY)
        run = drive(made, plant, vision(rng, 120, n, times=100.0, gaps=0.01), limits=limited)
        # The bounds: of the window 0.5 to 1.1, of the identifiers of driving and turning 1/1.9 to 1/0.8.
        low, high = (0.5, 1.1) if controller == "comp-flc" else (1 / 1.9, 1 / 0.8)
        assert run.alpha_hat.min() >= low
        assert run.alpha_hat.max() <= high
        assert np.isfinite(run.sent).all()
