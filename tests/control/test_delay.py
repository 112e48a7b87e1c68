"""Laws of dead time: which commands are in flight, and the displacement that they still cause."""

import numpy as np
import pytest
from benches.control import Array, CommandHistory, OmniError, predict_displacement
from hypothesis import given
from hypothesis import strategies as st

from omni_control import Observation

T = 1 / 60


def make_history(frame: int, commands: Array, length: int) -> CommandHistory:
    """Return the history in `frame`, after the commands (frames, n, 3) before it were sent."""
    history = CommandHistory(commands.shape[1], length)
    for command in commands[:frame]:
        history.append(command)
    return history


@given(st.integers(0, 12), st.integers(0, 20), st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_the_compensated_pose_is_where_the_plant_will_be(
    delay: int, spare: int, n: int, seed: int
) -> None:
    """Equation 7, x(k+1) = x(k) + alpha T u(k - k_d), reaches the prediction of equation 10."""
    rng = np.random.default_rng(seed)
    frames = 40
    alpha, commands = rng.uniform(0.5, 1.1, (n, 3)), rng.uniform(-3, 3, (frames, n, 3))
    poses = [rng.uniform(-4, 4, (n, 3))]
    for k in range(frames):
        acting_command = commands[k - delay] if k >= delay else np.zeros((n, 3))
        poses.append(poses[-1] + alpha * T * acting_command)
    history = CommandHistory(n, delay + spare)
    for k in range(frames - delay):
        if k:
            history.append(commands[k - 1])
        predicted = poses[k] + predict_displacement(history.get_latest(delay), alpha, T)
        # Twelve additions to a pose of size 4 in one order and in another.
        np.testing.assert_allclose(predicted, poses[k + delay], rtol=0, atol=2e-14)


# --- latencies that need not be whole, nor the same for all robots and axes ---


@given(st.lists(st.integers(0, 96), min_size=6, max_size=6), st.integers(0, 2**32 - 1))
def test_delayed_commands_agree_with_a_fine_clock(eighths: list[int], seed: int) -> None:
    """In each eighth of a frame a robot applies the command sent one latency before."""
    ticks = np.array(eighths).reshape(2, 3)
    commands = np.random.default_rng(seed).uniform(-3, 3, (15, 2, 3))
    commands_by_eighth = np.repeat(
        commands, 8, axis=0
    )  # the command sent in frame k stands from its first eighth on
    history = make_history(15, commands, length=14)
    # The frame just past are the eighths from now - 8 on; the last command is sent at its start
    now = 8 * 15
    for robot in range(2):
        for axis in range(3):
            start = now - 8 - ticks[robot, axis]
            expected = commands_by_eighth[start : start + 8, robot, axis].mean()
            # A mean of eight numbers of size 3.
            assert history.get_delayed(ticks / 8)[robot, axis] == pytest.approx(expected, abs=1e-14)
            pending_sum = commands_by_eighth[start + 8 :, robot, axis].sum() / 8
            pending_displacement = (
                history.get_pending_fractions(ticks / 8) * history.get_latest(14)
            ).sum(0)[robot, axis]
            assert pending_displacement == pytest.approx(pending_sum, abs=1e-13)


def test_requests_beyond_the_history_are_rejected() -> None:
    history = CommandHistory(2, 5)
    assert history.get_latest(3, skip=2).shape == (3, 2, 3)
    with pytest.raises(OmniError, match="6 commands requested, but only 5 are stored"):
        history.get_latest(4, skip=2)


def test_views_are_read_only_and_do_not_change() -> None:
    """Views of past frames do not change with new commands; selections hold their robots' own."""
    commands = np.random.default_rng(0).normal(size=(40, 5, 3))
    history, views, selections = CommandHistory(5, 4), [], []
    for command in commands:
        history.append(command)
        views.append(history.get_latest(3, skip=1))
        selections.append(history.select([3, 1], 3))
    for frame in range(4, 40):
        np.testing.assert_array_equal(views[frame], commands[frame - 3 : frame])
        np.testing.assert_array_equal(
            selections[frame].get_latest(3), commands[frame - 2 : frame + 1, [3, 1]]
        )
    selection = selections[-1]
    assert selection.length == 3
    np.testing.assert_array_equal(selection.get_delayed(1.5), history.get_delayed(1.5)[[3, 1]])
    for view in (views[-1], selection.get_latest(1), history.select(slice(2)).get_latest(4)):
        with pytest.raises(ValueError, match="read-only"):
            view += 1.0
    with pytest.raises(OmniError, match="only 4 are stored"):
        history.select(slice(None), 5)


def test_the_oldest_command_still_acts_for_the_fraction_of_a_dead_time() -> None:
    """With 1.25 frames a quarter of the command of two frames ago is in flight."""
    history = make_history(
        3, np.array([1.0, 2.0, 4.0])[:, None, None] * np.ones((1, 1, 3)), length=3
    )
    zero = np.zeros((1, 3))
    for delay in (1.25, np.array([1.25])):
        observation = Observation(zero, zero, zero, history, 0.5, delay)
        assert observation.commands_in_flight[:, 0, 0].tolist() == [0.5, 4]
        assert observation.predicted_pose.tolist() == [3 * [2.25]]
    np.testing.assert_allclose(history.get_delayed(1.25), 1.75)  # 2 - (2 - 1) / 4 acted last


def test_different_dead_times_are_compensated_per_robot() -> None:
    """Robots with dead times of 0, 2 and 3 frames: commands that have acted are zero."""
    history = make_history(
        3, np.array([1.0, 2.0, 4.0])[:, None, None] * np.ones((1, 3, 3)), length=4
    )
    observation = Observation(
        np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), history, 0.5, np.array([0, 2, 3])
    )
    assert observation.commands_in_flight[..., 0].tolist() == [[0, 0, 1], [0, 2, 2], [0, 4, 4]]
    assert observation.predicted_pose[:, 1].tolist() == [0, 3, 3.5]
