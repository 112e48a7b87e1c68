"""What controllers know in advance and observe in each frame. They cannot change it for others."""

from contextlib import suppress
from copy import deepcopy

import numpy as np
import pytest
from benches.short_simulations import FAST, PLANTS, Grid, Simulation, scenario

from omni_control import Controller, Observation, TeamModel
from omni_control.kinematics import Array
from omni_control.reference import Reference

FRAME_S = 1 / 60
SHORT = ("reference.waypoints=[[0, 0, 0], [0.2, 0.1, 0.3]]", "reference.settle_s=0.1")


class Witness(Controller):
    """Stores what it observes."""

    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        super().__init__(model, reference, n)
        self.witnessed: list[tuple[Array, ...]] = []

    def command(self, frame: int, observation: Observation) -> Array:
        self.witnessed.append(
            deepcopy(
                (
                    observation.pose,
                    observation.twist,
                    observation.measured_pose,
                    observation.sent_commands.get_latest(1)[0],
                )
            )
        )
        return self.reference.at(frame, observation.pose)[1]


class TrueWitness(Witness):
    knows_truth = True


class Vandal(Witness):
    def command(self, frame: int, observation: Observation) -> Array:
        command = super().command(frame, observation)
        for observed in (
            observation.pose,
            observation.twist,
            observation.measured_pose,
            observation.sent_commands.get_latest(1),
            self.reference.at(frame, observation.pose)[0],
        ):
            with suppress(ValueError):  # read-only
                observed += 1.0
        return command


def simulated(plant: str, *kinds: type[Controller], overrides: tuple[str, ...] = ()) -> Simulation:
    """Return a short run of controller classes with two seeds."""
    if plant == "mujoco":
        overrides = (*FAST, *overrides)
    simulation = Simulation(
        scenario.load_with_overrides("rect", [*SHORT, *overrides], {"plant": plant, "seeds": 2}),
        kinds,
    )
    simulation.run()
    return simulation


@pytest.mark.parametrize("plant", PLANTS)
def test_controllers_see_vision_unless_they_know_the_truth(plant: str) -> None:
    """Each controller observes its own rows and the commands of the previous frame."""
    simulation = simulated(plant, Witness, TrueWitness)
    channel = Grid(simulation.log).channel
    for i, controller in enumerate(simulation.team.controllers):
        pose, twist, measured, sent = (
            np.array(column) for column in zip(*controller.witnessed, strict=True)
        )
        np.testing.assert_array_equal(sent[1:], channel("command")[:-1, i])
        assert (sent[0] == 0).all()
        true = channel("pose")[:, i]
        if controller.knows_truth:
            np.testing.assert_array_equal(pose, true)
            np.testing.assert_array_equal(measured, true)
            # The way is the integral of the twist, that of the plant's frame just past or of its
            # instant: within the way of one frame, and 2 % for slip and rollers that shake.
            displacement = twist[1:].sum(0) * FRAME_S
            np.testing.assert_allclose(displacement, true[-1] - true[0], rtol=0.02, atol=0.003)
        else:
            np.testing.assert_array_equal(measured, channel("vision")[:, i])
            # Vision's noise is 1.3 mm and 10 mrad; what is filtered is near the truth, not equal to
            # it.
            assert (pose[1:, :, :2] != true[1:, :, :2]).all()
            assert np.abs(pose - true)[..., :2].max() < 0.03


def test_a_controller_cannot_change_what_others_see() -> None:
    """Writing to the arrays of an observation changes copies only."""
    quiet, loud = (simulated("kinematic", kind, TrueWitness) for kind in (Witness, Vandal))
    for name in ("pose", "vision", "command", "applied"):
        values, other_values = (Grid(s.log).channel(name) for s in (quiet, loud))
        np.testing.assert_array_equal(values, other_values, err_msg=name)


@pytest.mark.parametrize(("error", "assumed"), [(0, 6), (3, 9), (-2, 4), (-7, 0)])
def test_controllers_know_the_assumed_dead_time_and_noise(error: int, assumed: int) -> None:
    """The dead time has an error and is at least zero; the real dead time does not change."""
    overrides = (f"control.delay_error_frames={error}", "vision.position_noise_m=0.002")
    simulation = simulated("kinematic", Witness, overrides=overrides)
    model = simulation.team.controllers[0].model
    assert (model.delay_frames, model.period) == (assumed, FRAME_S)
    assert (model.position_noise_m, model.heading_noise_rad) == (0.002, 0.01)
    command, applied = (Grid(simulation.log).channel(name) for name in ("command", "applied"))
    np.testing.assert_array_equal(applied[6:], command[:-6])


@pytest.mark.parametrize(("plant", "lag_s"), [("mujoco", 0.05), ("kinematic", 0.0)])
def test_controllers_know_the_lag_of_plants_with_wheels(plant: str, lag_s: float) -> None:
    model = (
        Simulation(
            scenario.load_with_overrides("rect", ["control.assumed_lag_s=0.05"], {"plant": plant})
        )
        .team.controllers[0]
        .model
    )
    assert model.lag_s == pytest.approx(
        lag_s, abs=1e-8
    )  # next to none: a zero would mean that it is unknown
    assert model.latency_frames == pytest.approx(6 + lag_s / FRAME_S)
