"""What lasts of residuals: measured as it was put in, and alarms as rare as they are said to be."""

import numpy as np
import pytest

from omni_mj.studies.identify.residuals import ALARM, residuals

STRETCHES, SAMPLES = 20, 45
THERE = np.ones((STRETCHES, SAMPLES), bool)


def drawn(rng: np.random.Generator, lasting: float) -> np.ndarray:
    """White noise of 1 mm, and what is the same all through a stretch."""
    noise = rng.normal(size=(STRETCHES, SAMPLES, 2))
    return 1e-3 * noise + lasting * rng.choice([-1.0, 1.0], (STRETCHES, 1, 2))


def test_noise_is_no_misfit_but_for_the_alarms_that_are_said() -> None:
    """Of 800 draws 8 are expected; more than 20 would be one in ten thousand."""
    rng = np.random.default_rng(0)
    alarms = sum(residuals(drawn(rng, 0.0), THERE, 0.0).misfit for _ in range(800))
    assert 0 < alarms <= 2.5 * ALARM * 800


@pytest.mark.parametrize(("lasting", "misfit"), [(0.2e-3, False), (0.5e-3, True)])
def test_more_than_the_law_lacks_is_one(lasting: float, misfit: bool) -> None:
    """What was put in comes out within a tenth of a mm; of 0.3 mm that are allowed 0.2 are none, 0.5 are one."""
    found = residuals(drawn(np.random.default_rng(1), lasting), THERE, 0.3e-3)
    assert found.lasting == pytest.approx(lasting, abs=1e-4)
    assert found.noise == pytest.approx(1e-3, rel=0.05)
    assert found.misfit == misfit
