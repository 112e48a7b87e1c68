"""Laws of a session that is played: what changes while robots drive, and what stays."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import omni_mj as om
from omni_mj.config import faults
from omni_mj.play.play_session import PlaySession, Snapshot
from omni_mj.simulation.log import Log

SHORT = {"waypoints": [[0, 0, 0], [0.5, 0.3, 0.5]], "settle_s": 0.2}
REST = SHORT | {"initial_rest_s": 0.2}
NOISELESS = {
    "vision": {"position_noise_m": 0.0, "heading_noise_rad": 0.0},
    "sensors": {"gyro_noise_rad_s": 0.0, "gyro_bias_rad_s": 0.0},
}
CONTROLLERS = ("flc", "adaptive-comp-flc")
N_FRAMES = 20
STILL = """
import omni_mj as om


class Mine(om.Controller):
    def command(self, frame, observation):
        return 0 * observation.pose
"""


def scenario(plant: str = "planar", **sections: Any) -> om.Scenario:
    return om.load_scenario("rect", plant=plant, **({"reference": SHORT} | sections))


def session(plant: str = "planar", **sections: Any) -> PlaySession:
    return PlaySession(scenario(plant, **sections), CONTROLLERS)


def play(played: PlaySession, n_frames: int = N_FRAMES) -> list[Snapshot]:
    return [played.advance() for _ in range(n_frames)]


def simulate(played_scenario: om.Scenario, n_frames: int) -> Log:
    simulation = om.Simulation(played_scenario)
    for _ in range(n_frames):
        simulation.step()
    return simulation.log


def assert_same_frames(snapshots: list[Snapshot], log: Log, first: int = 0) -> None:
    channels = {"pose": "pose", "reference": "ref", "command": "command", "predicted": "predicted"}
    for name, channel in channels.items():
        values = np.array([getattr(snapshot, name) for snapshot in snapshots])
        np.testing.assert_array_equal(values, log.channel(channel)[first : first + len(values)])


@pytest.mark.parametrize("plant", ["mujoco", "planar", "kinematic"])
def test_frames_without_changes_are_those_of_a_run(plant: str) -> None:
    """Bit for bit, also after a disturbed start and a restart."""
    if plant == "kinematic":
        log = om.run(scenario(plant), CONTROLLERS).outcomes[0].log
    else:  # the same in less time
        log = simulate(scenario(plant).replace(controllers=CONTROLLERS), N_FRAMES)
    played = session(plant)
    assert_same_frames(play(played), log)
    played.carry_away()
    play(played, 5)
    played.restart()
    assert_same_frames(play(played), log)


WHEELED_CHANGES = {
    "radio.delay_frames": 12,
    "radio.loss_probability": 0.3,
    "carpet.friction": 0.2,
    "drivetrain.creep_stiffness": 3.0,
    "drivetrain.gear_friction_nm": 0.01,
    "drivetrain.roller_damping_nm_s": 1e-5,
    "battery.charge": 0.1,
    "firmware.ki": 2.0,
    "vision.delay_s": 0.02,
    "disturbance.force_n": 5.0,
    "control.heading_gain": 6.0,
}
KINEMATIC_CHANGES = {"kinematic.alpha_high": 0.8, "disturbance.velocity_m_s": 0.2}


@pytest.mark.parametrize(
    ("plant", "changes"),
    [("mujoco", WHEELED_CHANGES), ("planar", WHEELED_CHANGES), ("kinematic", KINEMATIC_CHANGES)],
)
def test_changes_at_the_start_give_a_run_with_those_settings(
    plant: str, changes: dict[str, float]
) -> None:
    played = session(plant)
    for name, value in changes.items():
        settings = played.scenario.settings
        assert played.change(name, value), "the robots drive on"
        assert played.scenario.settings != settings
    assert_same_frames(play(played), simulate(played.scenario, N_FRAMES))


FAULTS = [
    {"kind": "encoder-dropout", "start_s": 0.1, "wheel": 1, "probability": 0.3},
    {"kind": "payload", "start_s": 0.1, "mass_kg": 0.5},
    {"kind": "tilt", "start_s": 0.1, "angle_deg": 5.0},
    {"kind": "motor-blocked", "start_s": 0.2, "duration_s": 0.1, "wheel": 2},
    {"kind": "radio-burst-loss", "start_s": 0.0, "mean_burst_frames": 3, "burst_fraction": 0.4},
    {"kind": "vision-freeze", "start_s": 0.2, "duration_s": 0.1},
]


@pytest.mark.parametrize("plant", ["mujoco", "planar"])
def test_a_change_to_the_present_value_changes_nothing(plant: str) -> None:
    """Whatever is under way: packets, faults, noise, and loads of the robots."""
    played, untouched = session(plant, fault=FAULTS), session(plant, fault=FAULTS)
    for frame in range(25):
        if frame % 4 == 2:
            assert played.change("carpet.friction", untouched.scenario.settings.carpet.friction)
        for value, same in zip(
            vars(played.advance()).values(), vars(untouched.advance()).values(), strict=True
        ):
            np.testing.assert_array_equal(value, same)


PUSH = {"kind": "push", "force_n": 40.0, "duration_s": 0.2, "direction_deg": 90.0}


@pytest.mark.parametrize(
    ("plant", "press", "fault"),
    [
        ("mujoco", lambda played: played.push(), PUSH),
        ("planar", lambda played: played.push(), PUSH),
        (
            "kinematic",
            lambda played: played.set_lost(faults.RadioLoss, True),
            {"kind": "radio-loss"},
        ),
        (
            "kinematic",
            lambda played: played.set_lost(faults.VisionLoss, True),
            {"kind": "vision-loss"},
        ),
    ],
)
def test_a_button_gives_a_run_with_that_fault(
    plant: str, press: Callable[[PlaySession], None], fault: dict[str, Any]
) -> None:
    """Bit for bit: robots without faults so far get what processors and encoders need for them."""
    start_frame = 10  # the robots rest, so that their left is 90 degrees from the x axis
    calm = NOISELESS | {"reference": REST}
    played = session(plant, **calm)
    play(played, start_frame)
    press(played)
    disturbed = scenario(plant, fault=[{"start_s": start_frame / 60} | fault], **calm)
    log = simulate(disturbed.replace(controllers=CONTROLLERS), start_frame + N_FRAMES)
    assert_same_frames(play(played), log, first=start_frame)


def test_errors_grow_with_the_dead_time_of_driving_robots() -> None:
    """The robots do not jump, and the compensation that knows the dead time stays better."""
    circle = scenario("kinematic", reference={"shape": "circle", "laps": 3})
    played = PlaySession(circle, ("flc", "comp-flc"))
    play(played, 60)
    before = np.mean([snapshot.error_m for snapshot in play(played, 60)], axis=0)
    last = played.snapshot
    assert played.change("radio.delay_frames", 30)
    assert np.abs(played.advance().pose - last.pose)[:, :2].max() < 0.05
    play(played, 40)
    after = np.mean([snapshot.error_m for snapshot in play(played, 60)], axis=0)
    assert (after > 2 * before).all()
    assert after[1] < after[0]


def test_a_state_is_a_scenario(tmp_path: Path) -> None:
    """The state in a file, read again, is run as the session plays it after a restart."""
    played = session()
    play(played, 10)
    played.change("radio.delay_frames", 9)
    assert not played.change("body.mass_kg", 2.5), "the mass takes a restart"
    played.change("carpet.friction", 0.3)
    path = tmp_path / "state.toml"
    path.write_text(played.scenario.to_toml())
    state = om.load_scenario(path)
    assert state == played.scenario
    played.restart()
    assert_same_frames(play(played), simulate(state, N_FRAMES))


def test_robots_drive_to_a_target_and_at_a_velocity() -> None:
    """Also if the controllers change on their way."""
    played = session("kinematic")
    play(played, 5)
    played.set_target(-0.3, 0.2)
    play(played, 20)
    assert played.change("control.heading_gain", 4.0)
    snapshot = play(played, 130)[-1]
    assert not snapshot.has_ended
    np.testing.assert_allclose(snapshot.pose[:, :2], [[-0.3, 0.2]] * 2, atol=0.03)
    np.testing.assert_array_equal(
        snapshot.error_m, np.hypot(*(snapshot.pose.T[:2].T - [-0.3, 0.2]).T)
    )
    played.set_velocity(0.5, 0.0, 0.0)
    first, last = play(played, 60)[-1], play(played, 30)[-1]
    assert (np.abs((last.pose - first.pose)[:, 0] / 0.5 - 0.5) < 0.15).all()
    assert np.isnan(last.error_m).all()


def test_robots_rest_at_the_end_and_can_still_be_disturbed() -> None:
    played = session(reference={"waypoints": [[0, 0], [0.1, 0]], "settle_s": 0.0})
    n_frames = played.simulation.references[0].frames
    snapshot = play(played, n_frames)[-1]
    assert not snapshot.has_ended
    snapshot = play(played, 30)[-1]
    assert snapshot.has_ended
    pose = snapshot.pose
    played.push()
    assert (np.abs(play(played, 10)[-1].pose - pose)[:, :2].max(1) > 0.02).all()


def test_alpha_is_that_of_the_plant() -> None:
    """The plant kinematic has the alpha that its fault sets, forward and sideways."""
    fault = [{"kind": "alpha", "start_s": 0.0, "alpha": 0.8}]
    played = session("kinematic", fault=fault, disturbance={"velocity_m_s": 0.0})
    played.set_velocity(0.6, 0.4, 0.0)
    play(played, 60)
    np.testing.assert_allclose(played.compute_alpha(), 0.8, rtol=1e-9)
    played.set_velocity(0.0, 0.0, 0.0)
    play(played, 60)
    assert np.isnan(played.compute_alpha()).all()


def test_a_robot_that_is_carried_has_no_alpha() -> None:
    played = session()
    played.set_velocity(0.6, 0.4, 0.0)
    play(played, 60)
    assert np.isfinite(played.compute_alpha()).all()
    played.carry_away()
    for _ in range(20):
        played.advance()
        assert np.isnan(played.compute_alpha()).all()


def test_debris_lies_ahead_and_takes_traction() -> None:
    played = PlaySession(scenario(), ("comp-flc",))
    play(played, 30)
    played.spill_debris()
    first_debris = played.list_faults(faults.FrictionPatch)
    [patch] = first_debris
    x, y, radius = patch.x_m, patch.y_m, patch.radius_m
    assert radius > np.hypot(*(played.simulation.references[0].poses[60, :2] - [x, y]))
    with_debris = play(played, 35)[-1].pose
    without = simulate(played.scenario, 65).channel("pose")[-1]
    assert np.hypot(*(with_debris - without)[0, :2]) > 0.05
    played.spill_debris()
    assert (len(first_debris), len(played.list_faults(faults.FrictionPatch))) == (1, 2)
    played.restart()
    assert not played.list_faults(faults.FrictionPatch)


def test_a_lost_radio_is_found_again() -> None:
    played = session("kinematic")
    play(played, 30)
    played.set_lost(faults.RadioLoss, True)
    assert (play(played, 40)[-1].error_m > 0.1).all()
    played.set_lost(faults.RadioLoss, False)
    assert (play(played, 120)[-1].error_m < 0.1).all()


def test_a_file_with_an_error_lets_its_robot_stand_until_it_is_correct(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(STILL)
    saved_ns = file.stat().st_mtime_ns
    played = PlaySession(scenario(), ("flc", f"{file}:Mine"))

    def save(text: str) -> None:
        file.write_text(text)
        played.reload_controller(played.scenario.controllers[1])

    play(played, 5)
    save(STILL.replace("0 * observation", "0 ** ("))
    pose = played.snapshot.pose
    (failure,) = play(played, 20)[-1].failures
    assert "mine.py cannot be run: SyntaxError" in failure
    assert played.snapshot.time_s > 20 / 60, "the other robot drives on"
    np.testing.assert_allclose(played.snapshot.pose[1], pose[1], atol=1e-3)
    assert played.change("radio.delay_frames", 9), "sliders still work"
    played.restart()
    snapshot = play(played, 40)[-1]
    assert "mine.py cannot be run" in snapshot.failures[0], "also after a restart"
    np.testing.assert_allclose(snapshot.pose[1], 0, atol=1e-3)
    assert np.hypot(*snapshot.pose[0, :2]) > 0.02
    file.write_text(STILL)
    os.utime(file, ns=(saved_ns, saved_ns))
    played.reload_controller(played.scenario.controllers[1])
    assert not played.advance().failures, "also if the old file is restored with its time"
    save(STILL.replace("0 * observation.pose", "0 / []"))
    (failure,) = play(played, 2)[-1].failures
    assert "mine.py, line 7" in failure
    save(STILL.replace("0 * observation", "0 ** ("))
    (failure,) = play(played, 2)[-1].failures
    assert "mine.py cannot be run: SyntaxError" in failure, "the latest error"
    save("import sys\n" + STILL.replace("0 * observation.pose", "sys.exit()"))
    (failure,) = play(played, 2)[-1].failures
    assert "mine.py, line 8): SystemExit" in failure
    save(STILL.replace("    def", "    kp: float = 1.0\n    def"))
    assert not played.advance().failures
    assert played.change("controller.Mine.kp", 2.0)
    save(STILL.replace("    def", "    gain: float = 1.0\n    def"))
    assert not played.advance().failures, "parameters are those of the file again"
    assert not played.scenario.settings.controller


def test_robots_that_all_failed_have_not_reached_the_end(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(STILL.replace("0 * observation.pose", "0 / []"))
    snapshot = play(PlaySession(scenario("kinematic"), (f"{file}:Mine",)), 3)[-1]
    assert snapshot.failures
    assert not snapshot.has_ended


def test_a_setting_that_changes_the_reference_takes_a_restart() -> None:
    """The friction of rollers limits references that assume a friction."""
    played = session(reference={"assumed_friction": 0.8})
    frames = played.simulation.references[0].frames
    assert not played.change("drivetrain.roller_friction", 0.3)
    assert played.simulation.references[0].frames != frames


def test_each_start_is_recorded(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    played = PlaySession(scenario(), ("flc",), record=tmp_path / "play.rrd")
    play(played, 5)
    played.push()
    play(played, 5)
    played.restart()
    play(played, 5)
    played.close()
    assert sorted(file.name for file in tmp_path.iterdir()) == ["play-2.rrd", "play.rrd"]
    assert b"push" in (tmp_path / "play.rrd").read_bytes()


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda played: played.change("radio.delay_frames", 601), "600"),
        (lambda played: played.change("radio.delay_frames", 200), "less than the 1.* frames"),
        (lambda played: played.change("radio.delay_frames", float("nan")), "finite number"),
        (lambda played: played.change("radio.delay", 3), "did you mean 'radio.delay_frames'"),
        (lambda played: played.change("controller.flc.gain", 3), "has no parameter 'gain'"),
        (lambda played: played.change("controller.mpc.gain", 3), "no such controller"),
        (lambda played: played.restart(controllers=["flc"] * 4), "at most 3 controllers, got 4"),
        (lambda played: played.push(), "the plant kinematic has no push"),
    ],
)
def test_a_bad_value_changes_nothing(act: Callable[[PlaySession], None], message: str) -> None:
    played, untouched = session("kinematic"), session("kinematic")
    play(played, 5)
    play(untouched, 5)
    with pytest.raises(om.OmniError, match=message):
        act(played)
    assert played.scenario == untouched.scenario
    np.testing.assert_array_equal(play(played, 5)[-1].pose, play(untouched, 5)[-1].pose)


def test_controllers_drop_out_with_their_parameters(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(STILL.replace("    def", "    gain: float = 1.0\n\n    def"))
    played = PlaySession(scenario("kinematic"), ("flc", f"{file}:Mine"))
    assert played.change("controller.Mine.gain", 2.0)
    assert played.scenario.settings.controller == {"Mine": {"gain": 2.0}}
    played.restart(controllers=["flc"])
    assert played.labels == ("flc",)
    assert not played.scenario.settings.controller


def test_a_longer_dead_time_does_not_confuse_the_gyro_of_a_turning_robot() -> None:
    """Headings by vision are now older than the firmware remembered until then."""
    spin = {"waypoints": [[0, 0, 0], [0, 0, 6]], "max_turn_rate_rad_s": 6.0}
    played = PlaySession(scenario(reference=spin, **NOISELESS), ("flc",))
    play(played, 40)
    assert abs(played.snapshot.command[0, 2]) > 2
    assert played.change("radio.delay_frames", 20)
    for _ in range(35):
        played.advance()
        plant = played.simulation.plant
        assert plant.electronics.firmware.heading == pytest.approx(plant.pose()[:, 2], abs=0.015)
