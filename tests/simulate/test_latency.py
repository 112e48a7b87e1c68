"""The latency that adaptive-comp-flc finds while it drives, on both plants, after two seconds of motion.

In the two seconds robots speed up for 1.56 s and then brake, with the default noise of vision. The controller is told a
dead time of 6 frames, whatever it is.
"""

from functools import cache

import numpy as np
import pytest
from driving import FRAME_S, rows
from numpy.typing import NDArray
from simulating import Grid, simulation

from omni_mj.link.radio import Received
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.scenarios.settings import Settings

TOLD, LEAD = 6, 15
DELAYS = (2, 3, 4, 6, 8, 10, 12)
AFTER_TWO_SECONDS = LEAD + 120
AHEAD, ASIDE = 0, 1
LEGS = {AHEAD: "[[-1, -0.75, 0], [1, -0.75, 0]]", ASIDE: "[[-1, -0.75, 0], [-1, 1.25, 0]]"}
CONSTANT = ("kinematic.alpha_low=0.85", "kinematic.alpha_high=0.85")
ANEW = ("kinematic.alpha_time_s=0",)  # the default of the setting: uniform in [0.7, 1], new in every frame
LASTING = ()  # as in the scenario: the same distribution, lasting for 10 s
# Wheels without creep, which adds a lag that grows with speed and is no latency (tests/worlds/test_creep.py).
MUJOCO = ("wheels.creep=off",)


def drive(plant: str, delay: int, axis: int, seeds: int, overrides: tuple[str, ...]) -> Grid:
    """What robots did until they had moved for two seconds along an axis of theirs."""
    told = f"control.delay_error_frames={TOLD - delay}"
    settings = (f"radio.delay_frames={delay}", told, f"reference.waypoints={LEGS[axis]}", *overrides)
    simulated = simulation(plant, settings, ("adaptive-comp-flc",), seeds=seeds, route=())
    while simulated.frame <= AFTER_TWO_SECONDS:
        simulated.step()
    return Grid(simulated.log)


def found(trajectory: Grid, axis: int) -> NDArray:
    """Latency (seeds,) along an axis, in frames."""
    return trajectory.channel("latency_hat")[-1, 0, :, axis]


@cache
def errors_on_the_kinematic_plant(alpha: tuple[str, ...]) -> NDArray:
    """Latency found less the true dead time, (delays, seeds), for dead times from 2 to 12 frames."""
    return np.array([found(drive("kinematic", delay, AHEAD, 30, alpha), AHEAD) - delay for delay in DELAYS])


@pytest.mark.parametrize(("alpha", "share"), [(CONSTANT, 1.0), (ANEW, 0.87), (LASTING, 0.65)])
def test_on_the_kinematic_plant_the_dead_time_is_found_within_half_a_frame(
    alpha: tuple[str, ...], share: float
) -> None:
    """The median of 30 seeds at each dead time in any case, and most of all seeds, by what alpha does.

    Of 100 seeds, all are within half a frame where alpha is constant (0.7, 0.85 or 1; 90 % within a sixth), 92 % where
    it is new in every frame, and 71 % where it lasts for 10 s: an alpha that changes while a robot speeds up looks
    like a latency. Shares of 210 spread by 3 %.
    """
    error = errors_on_the_kinematic_plant(alpha)
    assert np.abs(np.median(error, axis=1)).max() < 0.5
    assert (np.abs(error) < 0.5).mean() >= share


def test_nothing_is_left_of_the_guess() -> None:
    """From 4 frames too few to 6 too many: the latency found is no nearer to the one told where that is far off."""
    medians = np.median(errors_on_the_kinematic_plant(CONSTANT), axis=1)
    slope = np.polyfit(DELAYS, medians, 1)[0]
    # A guess that weighed a tenth would leave -0.1; 7 medians of 30 errors of 0.1 frames spread by 0.003 a frame.
    assert abs(slope) < 0.02


@pytest.mark.parametrize("jitter", [1, 2, 3])
def test_under_jitter_the_mean_age_of_what_is_obeyed_is_found(jitter: int) -> None:
    """A robot obeys the newest command that has arrived: with jitter, one that is younger than the dead time."""
    trajectory = drive("kinematic", TOLD, AHEAD, 30, (*CONSTANT, f"radio.jitter_frames={jitter}"))
    command, applied = (trajectory.channel(name)[:, 0] for name in ("command", "applied"))
    moving = np.arange(LEAD + 20, AFTER_TWO_SECONDS)
    # Noise makes every command new, so that what is obeyed tells when it was sent.
    sent = (command[:, None] == applied[None, moving]).all(-1).argmax(0)
    age = (moving[:, None] - sent).mean()
    assert age < TOLD
    error = found(trajectory, AHEAD) - age
    # Single packets are up to `jitter` frames off the mean; the estimate averages over them.
    assert abs(np.median(error)) < 0.5
    assert (np.abs(error) < 0.5).mean() > 0.75


@cache
def impulse_responses(axis: int) -> NDArray:
    """Mean delay (speeds,), in frames, by which a robot without dead time answers to a command of one frame.

    A pulse of 0.1 m/s on top of a steady 0.5 or 1 m/s; what it adds to the way in each frame after it is the impulse
    response, whose first moment is the latency of whatever is slow in comparison.
    """
    speeds, frames, pulse_at = np.repeat([0.5, 1.0], 2), 90, 60
    plant, way = MujocoPlant(rows([Settings(wheels={"creep": "off"})] * len(speeds)), np.zeros((len(speeds), 3))), []
    for frame in range(frames):
        command = np.zeros((len(speeds), 3))
        command[:, axis] = speeds * min(1, frame / 30)
        if frame == pulse_at:
            command[::2, axis] += 0.1
        way.append(plant.pose()[:, axis])
        plant.advance(Received.at_once(command))
    response = np.diff(np.array(way)[:, ::2] - np.array(way)[:, 1::2], axis=0)[pulse_at:]
    # All of the pulse arrives, but for what slips.
    np.testing.assert_allclose(response.sum(0), 0.1 * FRAME_S, rtol=0.05)
    return (np.arange(len(response))[:, None] * response).sum(0) / response.sum(0)


@pytest.mark.parametrize(("axis", "low", "high"), [(AHEAD, 0.8, 1.2), (ASIDE, 1.4, 2.1)])
def test_wheel_loops_delay_by_a_frame_ahead_and_more_aside(axis: int, low: float, high: float) -> None:
    """What the wheel loops' 20 ms (1.2 frames) are in driving: slip adds to it aside, more the faster."""
    lag = impulse_responses(axis)
    assert (lag > low).all()
    assert (lag < high).all()


@pytest.mark.parametrize("delay", [2, 6, 12])
@pytest.mark.parametrize("axis", [AHEAD, ASIDE])
def test_on_the_mujoco_plant_dead_time_and_lag_are_found_within_half_a_frame(axis: int, delay: int) -> None:
    """The effective latency: the dead time, and what an impulse shows of the lag, of which 1.2 are told."""
    expected = delay + impulse_responses(axis).mean()
    error = found(drive("mujoco", delay, axis, 5, MUJOCO), axis) - expected
    assert abs(np.median(error)) < 0.5
    assert np.abs(error).max() < 1.0
