"""Dead times that are not whole frames: a command acts within a frame, and teams know it."""

from typing import Any

import numpy as np
import pytest
from benches.camera_and_radio import make_fault, make_radio
from benches.short_simulations import (
    COMPENSATED,
    FAST,
    FRAME_S,
    IDEAL,
    assert_rows_equal,
    batch,
    isolate_row,
    run,
    run_to_end,
    simulation,
    variants,
)
from hypothesis import given
from hypothesis import strategies as st

import omni_mj as om

CYCLES = 16  # of 1/960 s in a frame
DELAYS = st.floats(0, 12)


@given(st.lists(DELAYS, min_size=1, max_size=4), st.booleans())
def test_a_command_acts_from_the_nearest_cycle_on(delays: list[float], is_fault: bool) -> None:
    """Also with the dead time of a fault. The command of a frame is the mean over its cycles."""
    faults = [[make_fault("radio-delay", delay_frames=d)] for d in delays] if is_fault else ()
    settings = [{"delay_frames": 2 if is_fault else d} for d in delays]
    link = make_radio(settings, faults, ticks_per_frame=CYCLES)
    rng = np.random.default_rng(0)
    commands = rng.normal(size=(16, len(delays), 3))
    headings = rng.normal(size=(16, len(delays)))
    applied = []
    for command, heading in zip(commands, headings, strict=True):
        frame = link.exchange(command, heading)
        by_cycle = [segment.command for n, segment in frame.split() for _ in range(n)]
        assert len(by_cycle) == CYCLES
        np.testing.assert_allclose(frame.command, np.mean(by_cycle, axis=0), rtol=0, atol=1e-12)
        applied += by_cycle
        # A heading is used at the next frame boundary, with its age then.
        for row in np.flatnonzero(~np.isnan(frame.heading)):
            k = len(applied) // CYCLES - 1
            assert frame.heading[row] == headings[k - frame.age[row], row]
            assert frame.age[row] == np.ceil(np.rint(CYCLES * delays[row]) / CYCLES)
    for row, delay in enumerate(delays):
        cycles = round(CYCLES * delay)
        sent = np.repeat(commands[:, row], CYCLES, axis=0)
        expected = np.concatenate([np.zeros((cycles, 3)), sent])[: len(applied)]
        np.testing.assert_array_equal(np.array(applied)[:, row], expected)


@pytest.mark.parametrize("plant", ["kinematic", "planar", "mujoco"])
def test_robots_move_later_by_the_fraction_of_a_frame(plant: str) -> None:
    """The laws do not depend on time: at constant speed a robot is behind by speed times delay."""
    delays = [2, 2.25, 2.5, 2.9375, 3]
    changes = [
        {
            "radio": {"delay_frames": delay},
            "kinematic": {"alpha_low": 1.0, "alpha_high": 1.0},
            "sensors": {"gyro_noise_rad_s": 0, "gyro_bias_rad_s": 0},
        }
        for delay in delays
    ]
    route = *FAST, "reference.waypoints=[[0,0],[1,0]]", "reference.settle_s=0.2"
    simulated = variants(plant, changes, ["flc"], route)
    speed, command = 0.8, np.zeros((len(delays), 3))
    poses = []
    for frame in range(50):
        command[:, 0] = min(speed, 0.05 * (frame + 1))
        simulated.step(command.copy())
        poses.append(simulated.plant.pose()[:, 0].copy())
    x = np.array(poses)
    # At the end of frame 2 a command has acted since its first cycle after the dead time.
    moved = np.abs(x[2])
    assert (np.diff(moved[:4]) < 0).all()
    assert moved[3] > 2 * moved[4]
    actual_speed = (x[-1] - x[-11]) / (10 * FRAME_S)
    behind = (x[-1, 0] - x[-1]) / (actual_speed[0] * FRAME_S)
    np.testing.assert_allclose(behind, np.array(delays) - 2, atol=0.02)


def test_rows_do_not_depend_on_the_dead_times_of_others() -> None:
    """Rows with whole dead times have the same bits next to rows with fractions.

    `test_independent_rows.py` states the same for the other plants.
    """
    changes: list[dict[str, Any]] = [
        {"radio": {"delay_frames": 4, "jitter_frames": 2, "loss_probability": 0.1}},
        {"radio": {"delay_frames": 3.5, "jitter_frames": 0.5}},
        {"radio": {"delay_frames": 2, "kind": "wifi-broadcast"}},
    ]
    route = *FAST, "reference.waypoints=[[0,0],[0.15,0]]", "reference.settle_s=0.1"
    simulated = variants("planar", changes, ["comp-flc"], route)
    log = run_to_end(simulated)
    for row in range(3):
        assert_rows_equal(log, row, run_to_end(isolate_row(simulated, row)), 0)


@pytest.mark.parametrize("delay", [0.5, 3.25, 6.5])
def test_compensation_knows_the_fraction(delay: float) -> None:
    """Equations 7, 10 and 11 agree: the prediction is the pose one dead time later."""
    trajectory = run("kinematic", (*IDEAL, f"radio.delay_frames={delay}"))
    predicted, pose, command = (
        trajectory.channel(name)[:, COMPENSATED] for name in ("predicted", "pose", "command")
    )
    whole = int(delay)
    # From frame boundary k + whole to the end of the dead time, the older command acts.
    older = np.concatenate([np.zeros_like(command[:1]), command])[: len(command)]
    later = pose[whole:] + delay % 1 * FRAME_S * older[: len(pose) - whole]
    np.testing.assert_allclose(predicted[: len(later)], later, rtol=0, atol=1e-9)


def test_a_team_that_rounds_the_dead_time_is_worse() -> None:
    """The error of half a frame costs each compensator, on the plant of equation 7."""
    names = "comp-flc", "smith", "lqr"
    known = ("radio.delay_frames=6.5", "control.delay_error_frames=0")
    rounded = [(known[0], f"control.delay_error_frames={error}") for error in (-0.5, 0.5)]
    cases = [(*IDEAL, "reference.initial_rest_s=0.2", *case) for case in [known, *rounded]]
    log = run_to_end(batch(cases, names, (0,)))
    errors = np.abs(log.channel("pose") - log.channel("ref"))[..., 0].max(0).reshape(3, 3)
    assert (errors[0] < 0.5 * errors[1:]).all()


def test_adaptive_control_estimates_the_fraction() -> None:
    """From a nominal dead time that is half a frame too short or too long."""
    route = "reference.waypoints=[[-0.5,0],[0.5,0],[0.5,0.5]]", "reference.settle_s=0.2"
    exact = (*IDEAL[:5], "radio.delay_frames=5.5")
    cases = [(*exact, f"control.delay_error_frames={error}") for error in (-0.5, 0.5)]
    log = run_to_end(batch(cases, ("adaptive-comp-flc",), (0,), route))
    latency = log.channel("latency_hat")[-1, :, 0]
    np.testing.assert_allclose(latency, 5.5, atol=0.2)


def test_dead_times_are_whole_or_fractional() -> None:
    """In settings, in files and in the team's model."""
    fraction = om.load_scenario("rect", radio={"delay_frames": 5.5})
    assert fraction.settings.radio.delay_frames == 5.5
    whole = om.load_scenario("rect", radio={"delay_frames": 6.0})
    assert whole.settings == om.load_scenario("rect").settings
    assert "delay_frames = 6\n" in whole.to_toml() or "delay_frames = 6 " in whole.to_toml()
    simulated = simulation("planar", ("radio.kind=time-slots",), ("comp-flc",))
    assert simulated.team.controllers[0].model.delay_frames == pytest.approx(6.48)
