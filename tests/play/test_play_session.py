"""Laws of a session that is played: what changes while robots drive, and what stays."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import omni_mj as om
from omni_mj.play.play_session import PlaySession, Snapshot
from omni_mj.simulation.log import Log

SHORT = {"waypoints": [[0, 0, 0], [0.5, 0.3, 0.5]], "settle_s": 0.2}
CONTROLLERS = ("flc", "adaptive-comp-flc")
N_FRAMES = 25
STILL = """
import omni_mj as om


class Mine(om.Controller):
    def command(self, frame, observation):
        return 0 * observation.pose
"""


def scenario(plant: str = "planar", **sections: Any) -> om.Scenario:
    return om.load_scenario("rect", plant=plant, reference=SHORT, **sections)


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
    log = om.run(scenario(plant), CONTROLLERS).outcomes[0].log
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
    "motor.winding_c": 90.0,
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


def press_push(played: PlaySession) -> None:
    played.push()


@pytest.mark.parametrize("plant", ["mujoco", "planar"])
@pytest.mark.parametrize(
    ("press", "fault"),
    [
        (press_push, {"kind": "push", "force_n": 40.0, "duration_s": 0.2}),
        (lambda played: played.set_radio_lost(True), {"kind": "radio-loss"}),
        (lambda played: played.set_camera_lost(True), {"kind": "vision-loss"}),
    ],
)
def test_a_button_gives_a_run_with_that_fault(
    plant: str, press: Callable[[PlaySession], None], fault: dict[str, Any]
) -> None:
    """Bit for bit: robots without faults so far get what processors and encoders need for them."""
    played = session(plant)
    play(played, 20)
    heading = played.simulation.plant.pose()[0, 2]
    if fault["kind"] == "push":  # to the left of each robot: play one of them
        played = PlaySession(scenario(plant), CONTROLLERS[:1])
        play(played, 20)
        fault = fault | {"direction_deg": float(np.degrees(heading + np.pi / 2))}
    press(played)
    disturbed = scenario(plant, fault=[{"start_s": 20 / 60} | fault])
    log = simulate(disturbed.replace(controllers=played.scenario.controllers), 20 + N_FRAMES)
    assert_same_frames(play(played), log, first=20)
