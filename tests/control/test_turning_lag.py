"""What is believed of the lag of turning, beside what robots do: a law fitted to how they answer turn rates."""

import numpy as np
import pytest
from benches.plant import FRAME_S, drive, rows
from numpy.typing import NDArray
from scipy.optimize import least_squares

from omni_control.estimation.turning import RUBBED_M_S, Turning
from omni_mj.plants.planar import PlanarPlant
from omni_mj.scenarios import scenario

STEPS = 8  # of the law, in a frame


def followed(rates: NDArray, arm: float, lag: float, effort: float, friction: float, creep: float) -> NDArray:
    """Headings (frames + 1,) by (lag + g T l |w|) w' = u - c n - g w, in small steps."""
    rate, headings = 0.0, [0.0]
    for command in rates:
        heading = headings[-1]
        for _ in range(STEPS):
            rubbed = friction * np.clip(rate * arm / RUBBED_M_S, -1, 1)
            late, final = abs(lag) / effort + abs(creep) * arm * abs(rate), (command - rubbed) / effort
            before, rate = rate, final + (rate - final) * np.exp(-FRAME_S / STEPS / late)
            heading += FRAME_S / STEPS * (before + rate) / 2
        headings.append(heading)
    return np.array(headings)


@pytest.mark.parametrize("robot", ["tigers-v2016", "tigers-v2020", "robojackets", "ssl-a-team"])
def test_turning_lags_as_it_is_believed_to(robot: str) -> None:
    """On the spot, at three frequencies at once; loops that integrate have no single lag, and are not asked."""
    quiet = ["sensors.gyro_noise_rad_s=0", "sensors.gyro_bias_rad_s=0"]
    settings = scenario.load("rect", quiet, {"robot": robot}).settings
    time = np.arange(240) * FRAME_S
    rates = 1.5 * np.sin(2 * np.pi * time / 1.1) + 1.5 * np.sin(2 * np.pi * time / 0.37)
    rates += 0.6 * np.sin(2 * np.pi * time / 0.21)
    plant = PlanarPlant(rows([settings], robot=robot), np.zeros((1, 3)))
    headings = drive(plant, rates[:, None, None] * [0, 0, 1])[:, 0, 2]
    arm, told = settings.wheels.arm_m, settings.control
    found = least_squares(
        lambda law: followed(rates, arm, *law) - headings, [0.01, 1.0, 0.1, 0.01], x_scale=[0.01, 1, 0.1, 0.01]
    )
    assert np.sqrt(np.mean(found.fun**2)) < 0.005  # the law holds, of headings of up to half a radian
    turning = Turning(np.zeros(1), FRAME_S, 0.01, told.lag_s, told.drag_m_s, settings.wheels.kinematics)
    # Half of its own doubt. Were it the lag of driving, halved by the gyro's loop, it would be beyond.
    assert turning.lag[0] == pytest.approx(abs(found.x[0]), abs=turning.sigma[0, 3] / 2)
    assert abs(found.x[0]) < told.lag_s / 4
