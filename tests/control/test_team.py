"""Laws of a team's computer: it equals the loop written by hand, and rows are independent."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from benches.control import (
    CONTROLLERS,
    Array,
    CommandLimiter,
    FilterStep,
    KalmanFilter,
    make_controller,
)
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


def run_loop_by_hand(controllers: Sequence[Controller], plant: Plant, noise: Array) -> Array:
    """Return commands (frames, n, 3) of a loop of queue, filter, controllers and limits."""
    models = [c.model for c in controllers for _ in c.predicted_pose]
    n, sent, latency = len(models), np.zeros_like(plant.pose), [m.latency_frames for m in models]
    kalman = KalmanFilter(plant.pose, T, models[0].vision_noise)
    limits = CommandLimiter([model.limits for model in models], T)
    queue, commands = CommandHistory(n, 40), []
    for frame, error in enumerate(noise):
        measured = to_measured_pose(plant.pose + error)
        queue.append(sent)
        displacement = queue.get_delayed(np.array(latency)[:, None]) * T
        estimate = kalman.update(measured, displacement, FilterStep.to_present(n))
        controller_commands, start = [], 0
        for controller in controllers:
            rows = slice(start, start := start + len(controller.predicted_pose))
            known_state = (
                (plant.pose, plant.twist, plant.pose)
                if controller.knows_truth
                else (estimate, kalman.twist, measured)
            )
            observation = Observation(
                *(values[rows] for values in known_state),
                queue.select(rows),
                T,
                controller.model.delay_frames,
            )
            controller_commands.append(controller.command(frame, observation))
        sent = limits(np.concatenate(controller_commands), sent)
        commands.append(sent)
        plant.advance(sent)
    return np.array(commands)


def test_team_equals_a_loop_written_by_hand() -> None:
    """Every controller with a dead time of its own, side by side, bit for bit."""
    start = make_start_poses(2 * len(CONTROLLERS) + 2)
    for kind in MODES:
        controllers = [
            [
                make_controller(
                    name, TeamModel(T, 3 + i % 4, limits=TIGHT), make_reference(kind, 2), 2
                )
                for i, name in enumerate((*CONTROLLERS, Follower))
            ]
            for _ in range(2)
        ]
        expected = run_loop_by_hand(controllers[0], make_plant(start), make_noise(len(start)))
        assert np.array_equal(
            run_team(Team(controllers[1], start), make_plant(start), make_noise(len(start)))[
                "command"
            ],
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
            for name_of_value, values in run(*rows).items():
                np.testing.assert_array_equal(
                    batch[name_of_value][:, rows], values, err_msg=f"{name}: {name_of_value}"
                )


def test_returned_arrays_are_copies() -> None:
    team, second_team = (
        Team(Follower(TeamModel(T, 4), TIMED, 2), make_start_poses(2)) for _ in range(2)
    )
    for measured in make_noise(2, 10):
        observation = second_team.observe(measured)
        for values in (
            observation.pose,
            observation.twist,
            observation.measured_pose,
            second_team.estimate,
            observation.filter_steps[0].frames_behind,
        ):
            with pytest.raises(ValueError, match="read-only"):
                values += 1.0
        command = second_team.command()
        np.testing.assert_array_equal(team.step(measured), command)
        command += 1.0


# --- channels and invalid input ---


class RecordingFollower(Follower):
    def command(self, frame: int, observation: Observation) -> Array:
        self.channels["number"] = np.full(len(observation.pose), float(frame))
        self.channels["pair"] = observation.pose[:, :2]
        return super().command(frame, observation)


def test_channels_of_several_controllers_are_merged() -> None:
    team = Team(
        [Follower(TeamModel(T, 2), TIMED, 1), RecordingFollower(TeamModel(T, 2), TIMED, 2)],
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
    single, double = Follower(model, TIMED, 1), Follower(model, TIMED, 2)
    invalid_calls: list[tuple[str, Callable[[], object]]] = [
        ("one controller each", lambda: Team(single, poses)),
        ("one controller each", lambda: Team([single, double], poses, [[0], [0, 1]])),
        ("one controller each", lambda: Team([single, double], poses, [[0], [1, 7]])),
        ("one controller each", lambda: Team([], poses)),
        (r"finite numbers of shape \(n, 3\)", lambda: Team(single, np.zeros(3))),
        (r"finite numbers of shape \(n, 3\)", lambda: Team(single, [[np.nan, 0, 0]])),
        ("same length", lambda: Team([single, Follower(TeamModel(T / 2, 2), TIMED, 2)], poses)),
        (
            "knows the truth",
            lambda: Team(TruthFollower(model, TIMED, 1), poses[:1]).step(poses[:1]),
        ),
        (r"of shape \(1, 3\), got", lambda: Team(single, poses[:1]).step(poses)),
        ("observed before", lambda: Team(single, poses[:1]).command()),
        ("commands must be finite", lambda: Team(single, poses[:1]).command([[np.nan] * 3])),
    ]
    for message, call in invalid_calls:
        with pytest.raises(OmniError, match=message):
            call()
    stepped_team = Team(single, poses[:1])
    stepped_team.step(poses[:1])
    with pytest.raises(OmniError, match="observed before"):
        stepped_team.command()
