"""Laws of dead time: which commands are in flight, and the displacement that they still cause."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omni_control.delay import CommandsInFlight, compensation
from omni_control.kinematics import Array

LAW = settings(deadline=None, max_examples=100, derandomize=True)

T = 1 / 60


def sent_before(frame: int, commands: Array, length: int) -> CommandsInFlight:
    """The queue as it is in `frame`, after the commands (frames, n, 3) of the frames before it were sent."""
    queue = CommandsInFlight(commands.shape[1], length)
    for command in commands[:frame]:
        queue.push(command)
    return queue


def test_the_diagram_of_two_frames_dead_time() -> None:
    """With k_d = 2, x(k) has felt u0, sent in k - 3, and u1 and u2, sent in k - 2 and k - 1, are in flight."""
    commands = np.array([[[0.5, 0, 0]], [[1.0, 2.0, 3.0]], [[-4.0, 5.0, 6.0]]])
    queue = sent_before(3, commands, length=3)
    assert queue.last(2).tolist() == [[[1, 2, 3]], [[-4, 5, 6]]]
    assert queue.last(1, skip=2).tolist() == [[[0.5, 0, 0]]]
    # Halves, quarters and small integers are exact in binary.
    alpha = np.array([[0.5, 0.25, 1.0]])
    assert compensation(queue.last(2), alpha, 0.5).tolist() == [[-0.75, 0.875, 4.5]]


def test_frame_by_frame_table_of_three_frames_dead_time() -> None:
    """What is in flight in each frame, and how far it still goes, written out by hand for commands 1, 2, 3, ... m/s."""
    table = {
        0: ([0, 0, 0], 0),
        1: ([0, 0, 1], 1),
        2: ([0, 1, 2], 3),
        3: ([1, 2, 3], 6),
        4: ([2, 3, 4], 9),
        5: ([3, 4, 5], 12),
    }
    commands = np.arange(1.0, 7.0)[:, None, None] * [1.0, 0.0, -1.0]
    for frame, (speeds, distance) in table.items():
        flying = sent_before(frame, commands, length=3).last(3)
        assert flying[:, 0, 0].tolist() == speeds
        assert compensation(flying, np.ones((1, 3)), 1.0).tolist() == [[distance, 0, -distance]]


@LAW
@given(st.integers(0, 12), st.integers(0, 20), st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_the_compensated_pose_is_where_the_plant_will_be(delay: int, spare: int, n: int, seed: int) -> None:
    """Equation 7, x(k+1) = x(k) + alpha T u(k - k_d), reaches in k + k_d what equation 10 predicts in frame k."""
    rng = np.random.default_rng(seed)
    frames = 40
    alpha, commands = rng.uniform(0.5, 1.1, (n, 3)), rng.uniform(-3, 3, (frames, n, 3))
    poses = [rng.uniform(-4, 4, (n, 3))]
    for k in range(frames):
        felt = commands[k - delay] if k >= delay else np.zeros((n, 3))
        poses.append(poses[-1] + alpha * T * felt)
    queue = CommandsInFlight(n, delay + spare)
    for k in range(frames - delay):
        if k:
            queue.push(commands[k - 1])
        predicted = poses[k] + compensation(queue.last(delay), alpha, T)
        # Twelve additions to a pose of size 4 in one order and in another.
        np.testing.assert_allclose(predicted, poses[k + delay], rtol=0, atol=2e-14)


@pytest.mark.parametrize("length", [0, 5])
def test_without_dead_time_nothing_is_in_flight(length: int) -> None:
    """With k_d = 0 the prediction is the pose itself, whatever was sent."""
    queue = sent_before(4, np.full((4, 2, 3), 7.0), length)
    assert queue.last(0).shape == (0, 2, 3)
    assert compensation(queue.last(0), np.ones((2, 3)), T).tolist() == [[0, 0, 0]] * 2


def test_a_command_is_copied_when_it_is_sent() -> None:
    """The caller may reuse its array: what is in flight cannot be called back."""
    queue, command = CommandsInFlight(1, 2), np.ones((1, 3))
    queue.push(command)
    command[:] = 9
    queue.push(command)
    assert queue.last(2)[:, 0].tolist() == [[1, 1, 1], [9, 9, 9]]


def test_a_row_of_a_batch_is_what_it_is_alone() -> None:
    """The sum over the frames is taken in the same order for one robot as for many, for any dead time."""
    commands = np.random.default_rng(0).normal(size=(30, 33, 3))
    alpha = np.random.default_rng(1).uniform(0.5, 1.1, (33, 3))
    for delay in range(31):
        batch = compensation(commands[:delay], alpha, T)
        for i in (0, 7, 32):
            assert np.array_equal(compensation(commands[:delay, i : i + 1], alpha[i : i + 1], T)[0], batch[i])
