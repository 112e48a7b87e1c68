"""Controllers that fail: they stop their own robots, say why, and cost the others nothing."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from benches.control import Array, make_controller
from closed_loop import T, run_team
from team_setup import TIMED, Follower, TruthFollower, make_noise, make_plant, make_start_poses

from omni_control import ControllerError, Observation, OmniError, Team, TeamModel


class Failing(Follower):
    """A controller that fails in frame 5 in the way that `how` names."""

    how: str = ""

    def command(self, frame: int, observation: Observation) -> Array:
        command = super().command(frame, observation).copy()
        if frame == 5:
            if self.how == "raise":
                raise KeyError("no way")
            if self.how == "shape":
                return command[:, :2]
            if self.how == "record":
                self.alpha_hat = np.ones(2)
            if self.how == "channel":
                self.channels = {"odd": np.ones(7)}
            if self.how == "text":
                self.channels = {"odd": np.array(["a", "b", "c"])}
        if frame in (5, 8) and self.how == "nan":
            command[1, frame % 3] = np.nan
        if self.how == "inf":
            command[:] = np.inf
        return command


FAILURES: dict[str, tuple[int, list[int], str]] = {  # frame, rows, message
    "raise": (
        5,
        [2, 3, 4],
        r"Failing failed in frame 5 \(test_team_failures.py, line \d+\): KeyError: 'no way'",
    ),
    "shape": (
        5,
        [2, 3, 4],
        r"in frame 5: commands must be numbers \(3, 3\), got float64 of shape \(3, 2\)",
    ),
    "record": (5, [2, 3, 4], r"in frame 5: alpha_hat must have the shape .* got \(2,\)"),
    "channel": (5, [2, 3, 4], r"in frame 5: channel 'odd' must have the shape .* got \(7,\)"),
    "text": (5, [2, 3, 4], "could not convert string to float"),
    "nan": (5, [3], "commands that are not finite in frame 5"),
    "inf": (0, [2, 3, 4], "commands that are not finite in frame 0"),
}


def team_with(how: str, on_failure: Callable[..., None] | None = None) -> Team:
    model = TeamModel(T, 2)
    made = [
        Follower(model, TIMED, 2),
        make_controller(Failing, model, TIMED, 3, {"how": how}),
        TruthFollower(model, TIMED, 1),
    ]
    return Team(made, make_start_poses(6), on_failure=on_failure)


def test_failed_rows_are_sent_zero_and_the_others_go_on() -> None:
    """The handler is called once, with the reason; the other rows do not change by a bit."""
    quiet = run_team(team_with(""), make_plant(make_start_poses(6)), make_noise(6, 12))
    for how, (frame, rows, message) in FAILURES.items():
        model: list[tuple[int, list[int]]] = []

        def handle(
            failed: Array, reason: ControllerError, model: list[Any] = model, message: str = message
        ) -> None:
            assert not model, "once"
            model.append(failed.tolist())
            with pytest.raises(ControllerError, match=message):
                raise reason

        team = team_with(how, handle)
        reported = run_team(team, make_plant(make_start_poses(6)), make_noise(6, 12))
        assert (model, np.flatnonzero(team.inactive).tolist()) == ([rows], rows), how
        healthy_rows = [row for row in range(6) if row not in rows]
        for name, values in reported.items():
            np.testing.assert_array_equal(
                values[:, healthy_rows], quiet[name][:, healthy_rows], err_msg=how
            )
            np.testing.assert_array_equal(values[:frame], quiet[name][:frame], err_msg=how)
        assert (reported["command"][frame:, rows] == 0).all()
        assert np.isnan(reported["predicted_pose"][frame:, rows]).all()
        with pytest.raises(ControllerError, match=message):
            run_team(team_with(how), make_plant(make_start_poses(6)), make_noise(6, 12))


def test_a_stopped_robot_is_ignored() -> None:
    """Its vision and truth are ignored from then on; infinite poses of others are rejected."""
    team = Team(
        [Follower(TeamModel(T, 2), TIMED, 2), TruthFollower(TeamModel(T, 2), TIMED, 2)],
        make_start_poses(4),
    )
    team.step(make_start_poses(4), (make_start_poses(4), np.zeros((4, 3))))
    team.stop([1, 3])
    broken = make_start_poses(4)
    broken[[1, 3]] = np.nan
    for _ in range(3):
        command = team.step(broken, (broken, broken))
        assert np.isfinite(command).all()
        assert (command[[1, 3]] == 0).all()
        assert np.isnan(team.predicted_pose).any(1).tolist() == [False, True, False, True]
    with pytest.raises(OmniError, match="measured_poses must be finite"):
        team.observe(np.full((4, 3), np.inf), (broken, broken))
