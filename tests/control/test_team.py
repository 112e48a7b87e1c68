"""Laws of a team's computer: it is the loop written by hand, each row by itself, whatever becomes of the others."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from closed_loop import BodyFrame, Plant, T, reported, vision
from ways import KINDS, TIMED, along

from omni_control import CommandsInFlight, Controller, ControllerError, MotionLimits, OmniError, Seen, Team, Told
from omni_control.controllers import make
from omni_control.estimation.kalman import KalmanFilter
from omni_control.kinematics import Array
from omni_control.limits import CommandLimits
from omni_control.registry import CONTROLLERS

FRAMES = 40
TIGHT = MotionLimits(0.5, 1.5, 1.0, 5.0)
SAID = ("estimate", "predicted", "alpha_hat", "latency_hat")


class Straight(Controller):
    """Drives as the reference does, and notes what it saw."""

    gain: float = 2.0

    def __init__(self, *known: Any) -> None:
        super().__init__(*known)
        self.saw: list[Seen] = []

    def command(self, frame: int, seen: Seen) -> Array:
        self.saw.append(seen)
        self.predicted = seen.arriving
        target, speed = self.reference.at(frame, seen.pose)
        return speed + self.gain * (target - seen.arriving)


class Knowing(Straight):
    """The same with the truth."""

    knows_truth = True


def noise_of(n: int, frames: int = FRAMES) -> Array:
    return vision(np.random.default_rng(0), frames, n, gaps=0.02)


def plant_of(start: Array, rows: Any = slice(None)) -> Plant:
    """Some of robots of which each answers in a way of its own."""
    rng, n = np.random.default_rng(1), len(start)
    latency, alpha = rng.integers(6, 16, (n, 1)) / 2 + np.zeros(3), rng.uniform(0.7, 1.1, (n, 3))
    return BodyFrame(start[rows], latency[rows], alpha[rows], 0.02)


def play(team: Team, plant: Plant, noise: Array) -> dict[str, Array]:
    """Drive, and record what a team commands and says, (frames, n, 3) each."""
    said: dict[str, list[Array]] = {name: [] for name in ("command", *SAID)}
    for error in noise:
        command = team.step(reported(plant.pose + error), (plant.pose, plant.twist))
        for name, values in said.items():
            values.append(np.array(command if name == "command" else getattr(team, name)))
        plant.advance(command)
    return {name: np.array(values) for name, values in said.items()}


def starts(n: int) -> Array:
    return np.random.default_rng(2).uniform(-0.1, 0.1, (n, 3))


def by_hand(controllers: Sequence[Controller], plant: Plant, noise: Array) -> Array:
    """Commands (frames, n, 3): queue, filter, controllers with n robots in all, limits, each as it stands."""
    told, n, sent = controllers[0].told, noise.shape[1], np.zeros((noise.shape[1], 3))
    kalman, limits = KalmanFilter(plant.pose, T, told.vision_noise), CommandLimits([told.limits] * n, T)
    queue, commands = CommandsInFlight(n, 40), []
    for frame, error in enumerate(noise):
        measured = reported(plant.pose + error)
        queue.push(sent)
        estimate = kalman.update(measured, queue.felt(told.latency_frames) * T)
        wanted, first = [], 0
        for controller in controllers:
            rows = slice(first, first := first + len(controller.predicted))
            known = (
                (plant.pose, plant.twist, plant.pose) if controller.knows_truth else (estimate, kalman.twist, measured)
            )
            seen = Seen(*(values[rows] for values in known), queue.of(rows), T, told.delay_frames)
            wanted.append(controller.command(frame, seen))
        sent = limits(np.concatenate(wanted), sent)
        commands.append(sent)
        plant.advance(sent)
    return np.array(commands)


def test_it_is_the_loop_written_by_hand() -> None:
    """Every controller, side by side in one team, bit for bit."""
    told, start = Told(T, 6, limits=TIGHT), starts(2 * len(CONTROLLERS))
    for kind in KINDS:
        made = [[make(name, told, along(kind, 2), 2) for name in CONTROLLERS] for _ in range(2)]
        expected = by_hand(made[0], plant_of(start), noise_of(len(start)))
        assert np.array_equal(play(Team(made[1], start), plant_of(start), noise_of(len(start)))["command"], expected)
        assert np.hypot(*np.moveaxis(expected[..., :2], -1, 0)).max() == pytest.approx(0.5), "the limits count"


def test_rows_of_which_something_else_is_told_are_what_they_are_in_a_team_of_their_own() -> None:
    """Dead time, lag, noise and limits of each controller's own, rows in any order: all that is said, bit for bit."""
    tolds = [
        Told(T, 0, 0.0, limits=TIGHT),
        Told(T, 4, position_noise_m=0.01, error_range_m=0.2),
        Told(T, 9, 0.05, heading_noise_rad=0.001, drag_m_s=0.0, limits=MotionLimits(1.0, 2.0, 3.0, 9.0)),
    ]
    names = [*CONTROLLERS] * 2
    n = 2 * len(names)
    shuffled = np.random.default_rng(3).permutation(n)
    rows = [shuffled[[2 * i, 2 * i + 1]] for i in range(len(names))]
    start, noise = starts(n), noise_of(n)

    def made(i: int) -> Controller:
        return make(names[i], tolds[i % 3], along(KINDS[i % 2], 2), 2)

    together = play(Team([made(i) for i in range(len(names))], start, rows), plant_of(start), noise)
    for i, part in enumerate(rows):
        alone = play(Team(made(i), start[part]), plant_of(start, part), noise[:, part])
        for name, values in alone.items():
            np.testing.assert_array_equal(together[name][:, part], values, err_msg=f"{names[i]}: {name}")


@pytest.mark.parametrize("kind", KINDS)
def test_a_row_of_a_batch_is_what_it_is_alone(kind: str) -> None:
    """Each robot's every number, under every controller, is bit for bit its own: of one alone, and of some."""
    n, told = 4, Told(T, 5)
    start, noise = starts(n), noise_of(n)
    for name in CONTROLLERS:

        def run(*rows: int, name: str = name) -> dict[str, Array]:
            team = Team(make(name, told, along(kind, len(rows)), len(rows)), start[list(rows)])
            return play(team, plant_of(start, list(rows)), noise[:, rows])

        batch = run(0, 1, 2, 3)
        for rows in ((3,), (1, 2)):
            for what, values in run(*rows).items():
                np.testing.assert_array_equal(batch[what][:, rows], values, err_msg=f"{name}: {what}")


def test_a_controller_sees_its_own_rows_and_what_was_sent_after_the_limits() -> None:
    """What one sees, and the whole team's view; the pose to which commands in flight lead is equation 11's sum."""
    tolds, start = (Told(T, 3), Told(T, 0, limits=TIGHT), Told(T, 5)), starts(6)
    made = [Straight(tolds[0], TIMED, 2), Knowing(tolds[1], TIMED, 1), Straight(tolds[2], TIMED, 3)]
    team, plant = Team(made, start), plant_of(start)
    commands, seen, true = [np.zeros((6, 3))] * 9, [], []
    for error in noise_of(6, 20):
        measured = reported(plant.pose + error)
        seen.append(team.observe(measured, (plant.pose, plant.twist)))
        np.testing.assert_array_equal(seen[-1].measured, measured)
        np.testing.assert_array_equal(seen[-1].pose, team.estimate)
        true.append((plant.pose, plant.twist))
        for told, rows in zip(tolds, (slice(0, 2), slice(2, 3), slice(3, 6)), strict=True):
            way = np.zeros((rows.stop - rows.start, 3))
            for i in range(1, told.delay_frames + 1):  # the commands of k - k_d to k - 1
                way += T * commands[-i][rows]
            # A sum of five commands of size 1, in two orders.
            np.testing.assert_allclose(seen[-1].arriving[rows], team.estimate[rows] + way, rtol=0, atol=1e-15)
        commands.append(team.command())
        plant.advance(commands[-1])
    for controller, rows in zip(made, (slice(0, 2), slice(2, 3), slice(3, 6)), strict=True):
        for k, own in enumerate(controller.saw):
            delay, memory = controller.told.delay_frames, controller.memory_frames
            known = (
                (*true[k], true[k][0]) if controller.knows_truth else (seen[k].pose, seen[k].twist, seen[k].measured)
            )
            for got, expected in zip((own.pose, own.twist, own.measured), known, strict=True):
                np.testing.assert_array_equal(got, expected[rows])
            past = np.array(commands)[9 + k - memory : 9 + k, rows]
            np.testing.assert_array_equal(own.sent.last(memory), past)
            np.testing.assert_array_equal(own.in_flight, past[memory - delay :])


def test_a_controller_that_writes_into_what_it_was_handed_changes_nobody_else() -> None:
    """Arrays are its own or cannot be written to, and nor can the reference that it shares."""

    class Vandal(Straight):
        def command(self, frame: int, seen: Seen) -> Array:
            command = super().command(frame, seen).copy()
            for values in (seen.pose, seen.twist, seen.measured):
                values += 1.0
            for shared in (seen.in_flight, seen.sent.last(2), self.reference.at(frame, seen.pose)[0], TIMED.poses):
                with pytest.raises(ValueError, match="read-only"):
                    shared += 1.0
            with pytest.raises(OmniError, match="only be read"):
                seen.sent.push(command)
            return command

    start, noise = starts(4), noise_of(4, 20)
    said = []
    for kind in (Straight, Vandal):
        team = Team([kind(Told(T, 4), TIMED, 2), Straight(Told(T, 4), TIMED, 2)], start)
        said.append(play(team, plant_of(start), noise))
    for name in said[0]:
        np.testing.assert_array_equal(said[0][name], said[1][name], err_msg=name)


def test_who_writes_into_what_a_team_returns_changes_nothing() -> None:
    team, other = (Team(Straight(Told(T, 4), TIMED, 2), starts(2)) for _ in range(2))
    for measured in noise_of(2, 10):
        seen = other.observe(measured)
        for values in (seen.pose, seen.twist, seen.measured, other.estimate):
            values += 1.0
        command = other.command()
        np.testing.assert_array_equal(team.step(measured), command)
        command += 1.0


# --- controllers that fail ---


class Failing(Straight):
    """Fails in frame 5 as its text says."""

    how: str = ""

    def command(self, frame: int, seen: Seen) -> Array:
        command = super().command(frame, seen).copy()
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


FAILURES: dict[str, tuple[int, list[int], str]] = {  # the frame, the rows, what is said
    "raise": (5, [2, 3, 4], r"Failing failed in frame 5 \(test_team.py, line \d+\): KeyError: 'no way'"),
    "shape": (5, [2, 3, 4], r"commands of shape \(3, 2\) in frame 5; \(3, 3\) finite"),
    "record": (5, [2, 3, 4], r"alpha_hat of shape \(2,\) in frame 5"),
    "channel": (5, [2, 3, 4], r"channel 'odd' of shape \(7,\) in frame 5"),
    "text": (5, [2, 3, 4], "channel 'odd' that is not of numbers"),
    "nan": (5, [3], "commands that are not finite in frame 5"),
    "inf": (0, [2, 3, 4], "commands that are not finite in frame 0"),
}


def team_with(how: str, on_failure: Callable[..., None] | None = None) -> Team:
    told = Told(T, 2)
    made = [Straight(told, TIMED, 2), make(Failing, told, TIMED, 3, {"how": how}), Knowing(told, TIMED, 1)]
    return Team(made, starts(6), on_failure=on_failure)


def test_rows_that_fail_are_sent_zero_and_the_others_go_on() -> None:
    """Told once, with the reason; they say nothing more, and no bit of the others changes."""
    quiet = play(team_with(""), plant_of(starts(6)), noise_of(6, 12))
    for how, (frame, rows, says) in FAILURES.items():
        told: list[tuple[int, list[int]]] = []

        def handle(failed: Array, reason: ControllerError, told: list[Any] = told, says: str = says) -> None:
            assert not told, "once"
            told.append(failed.tolist())
            with pytest.raises(ControllerError, match=says):
                raise reason

        team = team_with(how, handle)
        said = play(team, plant_of(starts(6)), noise_of(6, 12))
        assert (told, np.flatnonzero(team.failed).tolist()) == ([rows], rows), how
        others = [row for row in range(6) if row not in rows]
        for name, values in said.items():
            np.testing.assert_array_equal(values[:, others], quiet[name][:, others], err_msg=how)
            np.testing.assert_array_equal(values[:frame], quiet[name][:frame], err_msg=how)
        assert (said["command"][frame:, rows] == 0).all()
        assert np.isnan(said["predicted"][frame:, rows]).all()
        with pytest.raises(ControllerError, match=says):
            play(team_with(how), plant_of(starts(6)), noise_of(6, 12))


def test_a_robot_that_was_stopped_is_left_alone() -> None:
    """Whatever vision and truth say of it from then on; an infinite pose of another is refused."""
    team = Team([Straight(Told(T, 2), TIMED, 2), Knowing(Told(T, 2), TIMED, 2)], starts(4))
    team.step(starts(4), (starts(4), np.zeros((4, 3))))
    team.stop([1, 3])
    broken = starts(4)
    broken[[1, 3]] = np.nan
    for _ in range(3):
        command = team.step(broken, (broken, broken))
        assert np.isfinite(command).all()
        assert (command[[1, 3]] == 0).all()
        assert np.isnan(team.predicted).any(1).tolist() == [False, True, False, True]
    with pytest.raises(OmniError, match="what vision reports must be finite"):
        team.observe(np.full((4, 3), np.inf), (broken, broken))


# --- what is recorded, and what is refused ---


class Talking(Straight):
    def command(self, frame: int, seen: Seen) -> Array:
        self.channels["number"] = np.full(len(seen.pose), float(frame))
        self.channels["pair"] = seen.pose[:, :2]
        return super().command(frame, seen)


def test_channels_of_a_controllers_own_are_put_together() -> None:
    team = Team([Straight(Told(T, 2), TIMED, 1), Talking(Told(T, 2), TIMED, 2)], starts(3))
    assert team.channels == {}
    team.step(starts(3))
    team.step(starts(3))
    nan = np.nan
    assert list(team.channels) == ["number", "pair"]
    np.testing.assert_array_equal(team.channels["number"], [[nan], [1], [1]])
    np.testing.assert_array_equal(team.channels["pair"], [[nan, nan], *team.estimate[1:, :2]])


def test_what_somebody_else_sent_counts() -> None:
    """It is in flight, and the limits start from it."""
    team = Team(Straight(Told(T, 1, limits=TIGHT), TIMED, 1), np.zeros((1, 3)))
    team.observe(np.zeros((1, 3)))
    team.sent([[0.3, 0.0, 0.0]])
    seen = team.observe(np.zeros((1, 3)))
    assert seen.in_flight.tolist() == [[[0.3, 0.0, 0.0]]]
    np.testing.assert_allclose(team.limited([[9.0, 0.0, 0.0]]), [[0.3 + 1.5 * T, 0.0, 0.0]], rtol=1e-15)


def test_nonsense_is_refused() -> None:
    told, poses = Told(T, 2), starts(3)
    one, two = Straight(told, TIMED, 1), Straight(told, TIMED, 2)
    refused: list[tuple[str, Callable[[], object]]] = [
        ("one controller each", lambda: Team(one, poses)),
        ("one controller each", lambda: Team([one, two], poses, [[0], [0, 1]])),
        ("one controller each", lambda: Team([one, two], poses, [[0], [1, 7]])),
        ("one controller each", lambda: Team([], poses)),
        (r"finite poses \(n, 3\)", lambda: Team(one, np.zeros(3))),
        (r"finite poses \(n, 3\)", lambda: Team(one, [[np.nan, 0, 0]])),
        ("same length", lambda: Team([one, Straight(Told(T / 2, 2), TIMED, 2)], poses)),
        ("knows the truth", lambda: Team(Knowing(told, TIMED, 1), poses[:1]).step(poses[:1])),
        (r"\(1, 3\), not of shape \(3, 3\)", lambda: Team(one, poses[:1]).step(poses)),
        ("observed before", lambda: Team(one, poses[:1]).command()),
        ("commands must be finite", lambda: Team(one, poses[:1]).sent([[np.nan] * 3])),
    ]
    for says, do in refused:
        with pytest.raises(OmniError, match=says):
            do()
    once = Team(one, poses[:1])
    once.step(poses[:1])
    with pytest.raises(OmniError, match="observed before"):
        once.command()
