"""adaptive-comp-flc compared with the paper's controllers on the paper's plant."""

import numpy as np
import pytest
from benches.short_simulations import COMPENSATED, FLC, batch, run_to_end
from numpy.typing import NDArray

CONTROLLERS = ("flc", "comp-flc", "adaptive-comp-flc")
ADAPTIVE = 2
SEEDS = 3
TWO_SIDES = "reference.waypoints=[[-1,-0.75],[1,-0.75],[1,0]]", "reference.settle_s=0.5"
KNOWN = "alpha 1.0"


def alpha(value: float) -> tuple[str, ...]:
    return (f"kinematic.alpha_low={value}", f"kinematic.alpha_high={value}")


UNKNOWN = {
    "alpha lasting for 10 s": (),
    "alpha anew in each frame, jitter of 2 frames": (
        "kinematic.alpha_correlation_time_s=0",
        "radio.jitter_frames=2",
    ),
    "alpha 0.5": alpha(0.5),
    "alpha 0.7, delay 2": (*alpha(0.7), "radio.delay_frames=2"),
    "alpha 1.1": alpha(1.1),
    "delay 3 frames longer than told": ("control.delay_error_frames=-3",),
    "delay 3 frames shorter than told": ("control.delay_error_frames=3",),
}


@pytest.fixture(scope="module")
def errors() -> dict[str, tuple[NDArray, NDArray]]:
    """Return maximum and mean position error on two sides of the rectangle, m."""
    cases = {**UNKNOWN, KNOWN: alpha(1.0)}
    log = run_to_end(batch(list(cases.values()), CONTROLLERS, range(SEEDS), TWO_SIDES))
    assert (log.lengths == log.length).all()
    off = (log.channel("pose") - log.channel("ref")).reshape(
        log.length, len(cases), len(CONTROLLERS), SEEDS, 3
    )
    distance = np.hypot(off[..., 0], off[..., 1])
    return dict(zip(cases, zip(distance.max(0), distance.mean(0), strict=True), strict=True))


@pytest.mark.parametrize("case", UNKNOWN)
def test_the_adaptive_controller_is_better_with_unknown_parameters(
    case: str, errors: dict[str, tuple[NDArray, NDArray]]
) -> None:
    """Its maximum and mean errors are smaller with every seed, in the median by a third.

    Measured: the largest error is 0.07 to 0.51 of that of comp-flc, the mean one 0.03 to 0.35.
    """
    for error in errors[case]:
        assert (error[ADAPTIVE] < error[[FLC, COMPENSATED]]).all()
        assert np.median(error[ADAPTIVE]) < np.median(error[COMPENSATED]) * 2 / 3


def test_the_adaptive_controller_is_nearly_as_good_with_known_parameters(
    errors: dict[str, tuple[NDArray, NDArray]],
) -> None:
    """With alpha = 1 and the nominal dead time, estimating both costs 2 mm.

    The causes are vision noise, 1.3 mm per axis, in the estimates, and the prior alpha of 0.9.
    """
    largest, mean = errors[KNOWN]
    assert np.median(largest[ADAPTIVE] - largest[COMPENSATED]) < 0.003
    assert np.median(mean[ADAPTIVE] - mean[COMPENSATED]) < 0.001
    assert (largest[ADAPTIVE] < largest[FLC] / 2).all()
