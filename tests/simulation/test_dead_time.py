"""Laws of dead time in the loop, and of its compensation."""

import numpy as np
import pytest
from benches.short_simulations import (
    COMPENSATED,
    FLC,
    FRAME_S,
    IDEAL,
    Grid,
    batch,
    command_ages,
    run,
    run_to_end,
)
from numpy.typing import NDArray

# A gyro without error: one with would turn a standing robot until vision's heading arrives.
GYRO = ("sensors.gyro_noise_rad_s=0", "sensors.gyro_bias_rad_s=0")
MUJOCO = ("drivetrain.efficiency=1", *GYRO)
ACCELERATION = 0.826  # of the reference (paper, section 2)


def errors(trajectory: Grid) -> NDArray:
    """Return the largest errors of the first seed in x and y, shape (controllers, 2), m."""
    return np.abs(trajectory.channel("pose") - trajectory.channel("ref"))[:, :, 0, :2].max(0)


def test_the_applied_command_was_sent_k_d_frames_earlier() -> None:
    """For every dead time up to half a second, both controllers and two seeds."""
    delays = range(31)
    log = run_to_end(
        batch([(f"radio.delay_frames={delay}",) for delay in delays], ("flc", "comp-flc"), (0, 7))
    )
    assert (log.lengths == log.length).all()
    for row, delay in enumerate(np.repeat(delays, 4)):
        command, applied = log.channel("command")[:, row], log.channel("applied")[:, row]
        # Copies: equal to the last bit, zero before.
        np.testing.assert_array_equal(applied[delay:], command[: log.length - delay])
        assert (applied[:delay] == 0).all()


@pytest.mark.parametrize("delay", [0, 3, 6])
def test_the_applied_command_is_delayed_on_the_mujoco_plant_too(delay: int) -> None:
    trajectory = run("mujoco", (f"radio.delay_frames={delay}", *MUJOCO))
    command, applied = trajectory.channel("command"), trajectory.channel("applied")
    np.testing.assert_array_equal(applied[delay:], command[: len(command) - delay])
    # Until the first command arrives, the robot stands; it settles into the carpet by a tenth of
    # vision's noise.
    np.testing.assert_allclose(trajectory.channel("pose")[: delay + 1], 0.0, atol=1.3e-4)


def test_with_jitter_the_applied_command_was_sent_about_k_d_frames_earlier() -> None:
    """For every dead time up to 12 frames, and every jitter that it allows."""
    # Without an image a command is given again, and its age cannot be told
    sees = "vision.miss_probability=0"
    delays_and_jitters = [(delay, jitter) for delay in range(1, 13) for jitter in range(delay + 1)]
    cases = [
        (f"radio.delay_frames={delay}", f"radio.jitter_frames={jitter}", sees)
        for delay, jitter in delays_and_jitters
    ]
    log = run_to_end(batch(cases, ("comp-flc",), (3,)))
    command, applied = (log.channel(name)[:, None] for name in ("command", "applied"))
    for (delay, jitter), age in zip(
        delays_and_jitters, command_ages(command, applied)[:, 0].T, strict=True
    ):
        settled = age[delay + jitter :]
        assert ((delay - jitter <= settled) & (settled <= delay + jitter)).all()
        assert (np.diff(age) <= 1).all()  # never back to an older one
        assert len(np.unique(settled)) > 1 or jitter == 0


@pytest.mark.parametrize("delay", [1, 3, 6, 12])
def test_the_predicted_pose_is_the_pose_k_d_frames_later(delay: int) -> None:
    trajectory = run("kinematic", (*IDEAL, f"radio.delay_frames={delay}"))
    predicted, pose = (
        trajectory.channel("predicted")[:, COMPENSATED],
        trajectory.channel("pose")[:, COMPENSATED],
    )
    # Equations 7, 10 and 11 agree exactly when alpha is 1. The team is told a lag of 1e-9 s, which
    # costs as much of the speed.
    np.testing.assert_allclose(predicted[:-delay], pose[delay:], rtol=0, atol=1e-9)


@pytest.mark.parametrize("delay", [1, 3, 6, 12])
def test_with_compensation_the_only_error_is_the_late_start(delay: int) -> None:
    trajectory = run(
        "kinematic", (*IDEAL, f"radio.delay_frames={delay}", "reference.initial_rest_s=0")
    )
    # The reference starts at once and gains a T per frame; the robot stands for k_d frames and
    # knows it: it lags by a T^2 (1 + 2 + ... + k_d), and never by more. Rounding of sums.
    late = ACCELERATION * FRAME_S**2 * delay * (delay + 1) / 2
    assert errors(trajectory)[COMPENSATED, 0] == pytest.approx(late, rel=1e-9)
    assert errors(trajectory)[COMPENSATED, 1] == 0.0
    # One that rests for the dead time first is followed without any, but for the lag of 1e-9 s that
    # is told.
    fair = run(
        "kinematic",
        (*IDEAL, f"radio.delay_frames={delay}", f"reference.initial_rest_s={delay * FRAME_S}"),
    )
    assert errors(fair)[COMPENSATED].max() < 1e-9


def test_without_compensation_errors_grow_with_dead_time_on_the_mujoco_plant() -> None:
    none, short, long = (
        errors(run("mujoco", (f"radio.delay_frames={d}", *MUJOCO)))[:, 0] for d in (0, 3, 6)
    )
    # As above, with noise of vision, and with wheels that creep, which late or not costs 12 mm:
    # that is not the dead time's; no compensator of a dead time takes it away.
    assert none[FLC] < short[FLC] < long[FLC]
    assert long[FLC] > 2 * none[FLC]
    assert short[COMPENSATED] < short[FLC]
    assert long[COMPENSATED] < long[FLC]
    # What the compensated one loses to twice the delay is less than what it saves.
    assert long[COMPENSATED] - none[COMPENSATED] < 0.5 * (long[FLC] - long[COMPENSATED])
