"""What loops are late by, against one that is stepped by hand: a mass on a motor, told a speed that grows."""

import numpy as np
import pytest

from omni_mj.robot.motors import Motor
from omni_mj.scenarios import CYCLE_RATE_HZ
from omni_mj.scenarios.scenario import scenario
from omni_mj.scenarios.settings import Settings
from omni_mj.studies.identify.loops import Loops

CYCLE_S, FRAME = 1 / CYCLE_RATE_HZ, 16
BASE = scenario("rect", robot="robojackets").settings
LAG_S = 0.08  # of the mass on stiffness of loop and back-EMF together


@pytest.mark.parametrize("every", [1, 2, 3, 5, 8, 10])
@pytest.mark.parametrize("kp", [0.05, 0.3])
def test_a_loop_follows_a_ramp_by_its_lag_its_wait_and_less_what_it_sees_late(every: int, kp: float) -> None:
    """u - v settles at the acceleration times that; the mean over 60 frames, in which runs and frames repeat."""
    settings = BASE.replace(firmware={"rate_hz": CYCLE_RATE_HZ // every, "kp": kp})
    late = Loops.of(settings)
    assert behind(settings, every) == pytest.approx(LAG_S + late.wait - late.seen, abs=2e-5)


@pytest.mark.parametrize("every", [1, 5, 8])
def test_a_loop_on_a_rate_sees_it_later_than_the_run_before(every: int) -> None:
    """A gyro shows a rate, no difference of angles: what it feeds back is of half a run less ago."""
    settings = BASE.replace(firmware={"rate_hz": CYCLE_RATE_HZ // every})
    late, share = Loops.of(settings), settings.firmware.kp / gain(settings)
    seen = behind(settings, every) + share * every / 2 * CYCLE_S
    assert behind(settings, every, gyro=True) == pytest.approx(seen, abs=2e-5)
    assert late.seen - late.turned * share == pytest.approx(share * every / 2 * CYCLE_S)


def gain(settings: Settings) -> float:
    """Of loop and back-EMF, V s/rad."""
    return settings.firmware.kp + Motor.of(settings.motor).speed_constant


def behind(settings: Settings, every: int, gyro: bool = False) -> float:
    """How far a mass is behind a ramp of one unit a second, s; its motor's back-EMF acts at once."""
    share = settings.firmware.kp / gain(settings)
    frames = 160
    speed, duty = 0.0, 0.0
    angles, speeds, gaps = [0.0] * (every + 2), [0.0, 0.0], []
    for cycle in range(frames * FRAME):
        told = cycle // FRAME * FRAME * CYCLE_S
        if cycle % every == 0:  # sensors are those of the cycle before
            shown = speeds[-2] if gyro else (angles[-2] - angles[-2 - every]) / (every * CYCLE_S)
            duty = told - share * shown
        step = CYCLE_S / LAG_S
        after = (speed * (1 - 0.5 * step * (1 - share)) + step * duty) / (1 + 0.5 * step * (1 - share))
        angles.append(angles[-1] + 0.5 * (speed + after) * CYCLE_S)
        gaps.append(told - 0.5 * (speed + after))
        speed = after
        speeds.append(speed)
    return float(np.mean(gaps[-60 * FRAME :]))
