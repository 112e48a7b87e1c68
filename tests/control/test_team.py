"""Laws of a team's computer: it equals the loop written by hand, and rows are independent."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from benches.control import CONTROLLERS, Array, CommandLimiter, KalmanFilter, make_controller
from closed_loop import Plant, T, run_team, to_measured_pose
from team_setup import (
    MODES,
    TIGHT,
    TIMED,
    Follower,
    TruthFollower,
    make_noise,
    make_plant,
    make_reference,
    make_start_poses,
)

from omni_control import CommandHistory, Controller, Observation, OmniError, Team, TeamModel


def by_hand(controllers: Sequence[Controller], plant: Plant, noise: Array) -> Array:
    """Return commands (frames, n, 3) of a loop of queue, filter, controllers and limits."""
    model, n, sent = controllers[0].model, noise.shape[1], np.zeros((noise.shape[1], 3))
    kalman, limits = (
        KalmanFilter(plant.pose, T, model.vision_noise),
        CommandLimiter([model.limits] * n, T),
    )
    queue, commands = CommandHistory(n, 40), []
    for frame, error in enumerate(noise):
        measured = to_measured_pose(plant.pose + error)
        queue.append(sent)
        estimate = kalman.update(measured, queue.get_delayed(model.latency_frames) * T)
        wanted, first = [], 0
        for controller in controllers:
            rows = slice(first, first := first + len(controller.predicted_pose))
            known = (
                (plant.pose, plant.twist, plant.pose)
                if controller.knows_truth
                else (estimate, kalman.twist, measured)
            )
            observation = Observation(
                *(values[rows] for values in known), queue.select(rows), T, model.delay_frames
            )
            wanted.append(controller.command(frame, observation))
        sent = limits(np.concatenate(wanted), sent)
        commands.append(sent)
        plant.advance(sent)
    return np.array(commands)


def test_team_equals_a_loop_written_by_hand() -> None:
    """Every controller, side by side in one team, bit for bit."""
    model, start = TeamModel(T, 6, limits=TIGHT), make_start_poses(2 * len(CONTROLLERS))
    for kind in MODES:
        made = [
            [make_controller(name, model, make_reference(kind, 2), 2) for name in CONTROLLERS]
            for _ in range(2)
        ]
        expected = by_hand(made[0], make_plant(start), make_noise(len(start)))
        assert np.array_equal(
            run_team(Team(made[1], start), make_plant(start), make_noise(len(start)))["command"],
            expected,
        )
        assert np.hypot(*np.moveaxis(expected[..., :2], -1, 0)).max() == pytest.approx(0.25), (
            "the limits count"
        )


@pytest.mark.parametrize("kind", MODES)
def test_a_row_of_a_batch_equals_the_row_alone(kind: str) -> None:
    """All numbers of a robot, under any controller, equal those of the robot alone, bit by bit."""
    n, model = 4, TeamModel(T, 5)
    start, noise = make_start_poses(n), make_noise(n)
    for name in CONTROLLERS:

        def run(*rows: int, name: str = name) -> dict[str, Array]:
            team = Team(
                make_controller(name, model, make_reference(kind, len(rows)), len(rows)),
                start[list(rows)],
            )
            return run_team(team, make_plant(start, list(rows)), noise[:, rows])

        batch = run(0, 1, 2, 3)
        for rows in ((3,), (1, 2)):
            for what, values in run(*rows).items():
                np.testing.assert_array_equal(
                    batch[what][:, rows], values, err_msg=f"{name}: {what}"
                )


def test_controllers_observe_their_rows_and_the_limited_commands() -> None:
    """Compare a controller's observation with the team's, and predicted poses with equation 11."""
    tolds, start = (
        (TeamModel(T, 3), TeamModel(T, 0, limits=TIGHT), TeamModel(T, 5)),
        make_start_poses(6),
    )
    made = [
        Follower(tolds[0], TIMED, 2),
        TruthFollower(tolds[1], TIMED, 1),
        Follower(tolds[2], TIMED, 3),
    ]
    team, plant = Team(made, start), make_plant(start)
    commands, seen, true = [np.zeros((6, 3))] * 9, [], []
    for error in make_noise(6, 20):
        measured = to_measured_pose(plant.pose + error)
        seen.append(team.observe(measured, (plant.pose, plant.twist)))
        np.testing.assert_array_equal(seen[-1].measured_pose, measured)
        np.testing.assert_array_equal(seen[-1].pose, team.estimate)
        true.append((plant.pose, plant.twist))
        for model, rows in zip(tolds, (slice(0, 2), slice(2, 3), slice(3, 6)), strict=True):
            way = np.zeros((rows.stop - rows.start, 3))
            for i in range(1, model.delay_frames + 1):  # the commands of k - k_d to k - 1
                way += T * commands[-i][rows]
            # A sum of five commands of size 1, in two orders.
            np.testing.assert_allclose(
                seen[-1].predicted_pose[rows], team.estimate[rows] + way, rtol=0, atol=1e-15
            )
        commands.append(team.command())
        plant.advance(commands[-1])
    for controller, rows in zip(made, (slice(0, 2), slice(2, 3), slice(3, 6)), strict=True):
        for k, own in enumerate(controller.observations):
            delay, memory = controller.model.delay_frames, controller.memory_frames
            known = (
                (*true[k], true[k][0])
                if controller.knows_truth
                else (seen[k].pose, seen[k].twist, seen[k].measured_pose)
            )
            for got, expected in zip((own.pose, own.twist, own.measured_pose), known, strict=True):
                np.testing.assert_array_equal(got, expected[rows])
            past = np.array(commands)[9 + k - memory : 9 + k, rows]
            np.testing.assert_array_equal(own.sent_commands.get_latest(memory), past)
            np.testing.assert_array_equal(own.commands_in_flight, past[memory - delay :])


def test_returned_arrays_are_copies() -> None:
    team, other = (Team(Follower(TeamModel(T, 4), TIMED, 2), make_start_poses(2)) for _ in range(2))
    for measured in make_noise(2, 10):
        observation = other.observe(measured)
        for values in (
            observation.pose,
            observation.twist,
            observation.measured_pose,
            other.estimate,
            observation.filter_steps[0].frames_behind,
        ):
            with pytest.raises(ValueError, match="read-only"):
                values += 1.0
        command = other.command()
        np.testing.assert_array_equal(team.step(measured), command)
        command += 1.0


# --- what is recorded, and what is refused ---


class Talking(Follower):
    def command(self, frame: int, observation: Observation) -> Array:
        self.channels["number"] = np.full(len(observation.pose), float(frame))
        self.channels["pair"] = observation.pose[:, :2]
        return super().command(frame, observation)


def test_channels_of_several_controllers_are_merged() -> None:
    team = Team(
        [Follower(TeamModel(T, 2), TIMED, 1), Talking(TeamModel(T, 2), TIMED, 2)],
        make_start_poses(3),
    )
    assert team.channels == {}
    team.step(make_start_poses(3))
    team.step(make_start_poses(3))
    nan = np.nan
    assert list(team.channels) == ["number", "pair"]
    np.testing.assert_array_equal(team.channels["number"], [[nan], [1], [1]])
    np.testing.assert_array_equal(team.channels["pair"], [[nan, nan], *team.estimate[1:, :2]])


def test_invalid_input_is_rejected() -> None:
    model, poses = TeamModel(T, 2), make_start_poses(3)
    one, two = Follower(model, TIMED, 1), Follower(model, TIMED, 2)
    refused: list[tuple[str, Callable[[], object]]] = [
        ("one controller each", lambda: Team(one, poses)),
        ("one controller each", lambda: Team([one, two], poses, [[0], [0, 1]])),
        ("one controller each", lambda: Team([one, two], poses, [[0], [1, 7]])),
        ("one controller each", lambda: Team([], poses)),
        (r"finite poses \(n, 3\)", lambda: Team(one, np.zeros(3))),
        (r"finite poses \(n, 3\)", lambda: Team(one, [[np.nan, 0, 0]])),
        ("same length", lambda: Team([one, Follower(TeamModel(T / 2, 2), TIMED, 2)], poses)),
        (
            "knows the truth",
            lambda: Team(TruthFollower(model, TIMED, 1), poses[:1]).step(poses[:1]),
        ),
        (r"\(1, 3\), not of shape \(3, 3\)", lambda: Team(one, poses[:1]).step(poses)),
        ("observed before", lambda: Team(one, poses[:1]).command()),
        ("commands must be finite", lambda: Team(one, poses[:1]).command([[np.nan] * 3])),
    ]
    for says, do in refused:
        with pytest.raises(OmniError, match=says):
            do()
    once = Team(one, poses[:1])
    once.step(poses[:1])
    with pytest.raises(OmniError, match="observed before"):
        once.command()
