"""Bound of the mean position error by what any controller can know.

Let a robot follow commands exactly, but turned by the error c of the firmware's heading. At the
speed v it then deviates sideways by e:

    e(k+1) = e(k) + T v c(k),    c(k+1) = (1 - T g) c(k) + T w(k),

with the heading gain g of the firmware and the noise w of its gyro. Vision measures e with noise. A
command of now acts one dead time later, so that the best controller leaves the error of the Kalman
filter's prediction over the dead time. Deviations forward, model errors, losses and limits of
commands are left out, so that no controller reaches the bound.
"""

import math

import numpy as np
import scipy.linalg

from omni_mj.config import PERIOD_S, reference_factory
from omni_mj.config.faults import WHEELED_PLANTS
from omni_mj.config.scenario import Scenario

MIN_NOISE_M = 1e-6  # of the measured position; keeps the Riccati equation solvable


def compute_mean_error_bound(scenario: Scenario) -> float:
    """Return the bound of the mean position error, m; 0 on plants without firmware.

    The speed is the root mean square of the reference's.
    """
    if scenario.plant not in WHEELED_PLANTS:
        return 0.0
    settings = scenario.settings
    start_pose = settings.world.start_poses[0]
    poses = reference_factory.build_timed_reference(settings, start_pose).poses
    velocity = np.diff(poses[:, :2], axis=0) / PERIOD_S
    speed = math.sqrt((velocity**2).sum(1).mean())
    transition = np.array(
        [[1.0, PERIOD_S * speed], [0.0, 1 - PERIOD_S * settings.firmware.heading_gain]]
    )
    process_noise = np.diag([0.0, (PERIOD_S * settings.sensors.gyro_noise_rad_s) ** 2])
    vision_noise = max(settings.vision.position_noise_m, MIN_NOISE_M)
    covariance = scipy.linalg.solve_discrete_are(
        transition.T, np.array([[1.0], [0.0]]), process_noise, [[vision_noise**2]]
    )
    for _ in range(math.floor(settings.radio.mean_delay_frames)):
        covariance = transition @ covariance @ transition.T + process_noise
    return math.sqrt(2 / math.pi * float(covariance[0, 0]))  # mean of a normal number's size
