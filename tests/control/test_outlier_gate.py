"""Outlier gate: it passes what a robot can do unchanged, rejects the rest, and always recovers."""

import numpy as np
from benches.control import (
    OUTLIERS_TO_ACCEPT,
    REPEATS_TO_ACCEPT,
    Array,
    OutlierGate,
    make_controller,
    wrap_angle,
)
from closed_loop import NOISE, LaggedPlant, T, make_vision_noise, run_team, to_measured_pose
from hypothesis import given, settings
from hypothesis import strategies as st
from team_setup import make_reference, make_start_poses

from omni_control import MotionLimits, Team, TeamModel

LIMITS = MotionLimits(3.7, 4.7, 26.0, 50.8)
NOW = np.zeros(1)  # age of a measurement that is captured as it arrives, s
REST = np.zeros((1, 3))  # commanded displacement
seeds = st.integers(0, 2**32 - 1)


def make_gate(n: int) -> OutlierGate:
    return OutlierGate(np.tile(NOISE, (n, 1)), [LIMITS] * n, T)


def simulate_collisions(
    rng: np.random.Generator, frames: int, n: int, missed: float
) -> tuple[Array, Array]:
    """Return measurements (frames, n, 3) and ages (frames, n) of robots with random velocities.

    From frame to frame, they may go from rest to full speed.
    """
    velocity = rng.uniform(-1, 1, (frames, n, 3)) * [3.7 / np.sqrt(2), 3.7 / np.sqrt(2), 20.0]
    pose = rng.uniform(-3, 3, (n, 3)) + np.cumsum(velocity * T, axis=0)
    age = rng.uniform(0, 1, (frames, n))
    measured = pose - age[..., None] * T * velocity + NOISE * rng.standard_normal(pose.shape)
    measured[..., 2] = wrap_angle(measured[..., 2])
    measured[rng.random((frames, n)) < missed] = np.nan
    return measured, age * T


@given(seeds, st.floats(0, 0.5))
def test_possible_motions_pass_unchanged(seed: int, missed: float) -> None:
    """To the bit, whatever collides with the robot, however late or rare measurements are."""
    poses, ages = simulate_collisions(np.random.default_rng(seed), 60, 5, missed)
    gate = make_gate(5)
    for pose, age in zip(poses, ages, strict=True):
        np.testing.assert_array_equal(gate.reject_outliers(pose, age, 0 * pose), pose)


@given(seeds, st.floats(0.18, 10.0), st.floats(-np.pi, np.pi))
def test_another_robot_is_rejected(seed: int, distance: float, direction: float) -> None:
    """It stands next to a robot at rest and is measured sometimes, never twice in a row."""
    rng = np.random.default_rng(seed)
    offset = np.array([[distance * np.cos(direction), distance * np.sin(direction), 1.0]])
    gate, is_wrong = make_gate(1), True
    for _ in range(100):
        is_wrong = not is_wrong and rng.random() < 0.5
        pose = NOISE * rng.standard_normal((1, 3))
        accepted = gate.reject_outliers(pose + is_wrong * offset, NOW, REST)
        np.testing.assert_array_equal(accepted, np.nan if is_wrong else pose)


@given(seeds, st.floats(-np.pi, np.pi), st.floats(-20, 20))
def test_reversed_headings_are_corrected(seed: int, heading: float, rate: float) -> None:
    """In all frames but the first, up to nine in a row, for turning robots, to rounding."""
    rng, gate, in_a_row = np.random.default_rng(seed), make_gate(1), 0
    for k in range(100):
        true = np.array([[0, 0, wrap_angle(heading + rate * T * k)]])
        true += NOISE * rng.standard_normal((1, 3))
        is_reversed = k > 0 and in_a_row < OUTLIERS_TO_ACCEPT - 1 and rng.random() < 0.5
        in_a_row = in_a_row + 1 if is_reversed else 0
        measured = true.copy()
        measured[:, 2] = wrap_angle(true[:, 2] + np.pi * is_reversed)
        accepted = gate.reject_outliers(measured, NOW, REST)
        np.testing.assert_array_equal(accepted[:, :2], true[:, :2])
        assert abs(wrap_angle(accepted[0, 2] - true[0, 2])) < 1e-14


@given(
    seeds,
    st.floats(0, 1),
    st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-np.pi, np.pi)),
)
def test_the_gate_recovers_within_ten_measurements(
    seed: int, missed: float, pose: tuple[float, float, float]
) -> None:
    """After any measurements, true ones pass unchanged from the tenth on."""
    rng, gate = np.random.default_rng(seed), make_gate(3)
    for _ in range(rng.integers(0, 60)):
        measured = rng.uniform(-4, 4, (3, 3))
        measured[rng.random(3) < missed] = np.nan
        gate.reject_outliers(measured, rng.uniform(0, 0.2, 3), 0 * measured)
    for k in range(3 * OUTLIERS_TO_ACCEPT):
        measured = to_measured_pose(np.array(pose) + NOISE * rng.standard_normal((3, 3)))
        accepted = gate.reject_outliers(measured, np.zeros(3), 0 * measured)
        if k >= OUTLIERS_TO_ACCEPT - 1:
            np.testing.assert_array_equal(accepted[:, :2], measured[:, :2])
        if k >= 2 * OUTLIERS_TO_ACCEPT - 2:  # headings are checked once the position is accepted
            np.testing.assert_array_equal(accepted, measured)


def test_after_a_frozen_image_a_robot_may_be_as_far_as_it_can_have_driven() -> None:
    """The frozen image is accepted. Afterwards it counts with its true age."""
    gate, frozen = make_gate(1), np.array([[0.1, 0.2, 0.3]])
    for _ in range(20):
        np.testing.assert_array_equal(gate.reject_outliers(frozen, NOW, REST), frozen)
    measured = frozen + np.array([1.5, 0.0, 0.0])  # 4.5 m/s
    np.testing.assert_array_equal(gate.reject_outliers(measured, NOW, REST), measured)


@given(st.floats(0.0, 3.5), st.floats(-np.pi, np.pi))
def test_a_moving_robot_does_not_stop_dead(speed: float, direction: float) -> None:
    """Repeats are rejected if measurements differed by more than 1 cm/s, otherwise accepted.

    When the measurements change again, they are accepted, after any number of repeats.
    """
    step = speed * T * np.array([[np.cos(direction), np.sin(direction), 0.0]])
    for repeats in (4, REPEATS_TO_ACCEPT + 4):
        gate = make_gate(1)
        for k in range(3):
            gate.reject_outliers(k * step + 0.1, NOW, REST)
        x = np.array(
            [gate.reject_outliers(2 * step + 0.1, NOW, REST)[0, 0] for _ in range(repeats)]
        )
        rejected = REPEATS_TO_ACCEPT - 1 if speed > 0.01 else 0
        if abs(speed - 0.01) > 1e-6:
            np.testing.assert_array_equal(np.isnan(x), np.arange(repeats) < rejected)
        measured = (3 + repeats) * step + 0.1
        np.testing.assert_array_equal(gate.reject_outliers(measured, NOW, REST), measured)


def test_an_image_that_repeats_under_commands_is_frozen() -> None:
    """It begins at rest, before commands of 1 m/s for 10 s. One equal coordinate means nothing."""
    gate, command = make_gate(2), T * np.tile([1.0, 0.0, 0.0], (2, 1))
    image = np.array([[0.1, 0.2, 0.3], [0.1, 0.2, 0.3]])
    for k in range(660):
        image[1, 1:] += 0.001
        accepted = gate.reject_outliers(image, np.zeros(2), command * (k >= 60))
        is_frozen = np.isnan(accepted[:, 0]).tolist()
        assert is_frozen == [k >= 63, False]  # after the third 1.7 cm


@given(st.floats(0.0, 0.1))
def test_distance_counts_the_time_between_captures(age: float) -> None:
    """A robot at 7 m/s is measured `age` late and then without delay, in turns."""
    gate = make_gate(1)
    for k in range(20):
        late = np.array([age * (k % 2 == 0)])
        measured = np.array([[7.0 * (k * T - late[0]), 0.0, 0.0]])
        np.testing.assert_array_equal(gate.reject_outliers(measured, late, REST), measured)


def report(gate: OutlierGate, direction: int, turn: float, shift: float = 0.0) -> list[bool]:
    """Return whether headings are believed, of a robot that turns at once in frame 30.

    It then moves along (1) its commands of 1 m/s or against them (-1).
    """
    believed, command = [], np.array([[T, 0.0, 0.0]])
    for k in range(200):
        is_turned = k >= 30
        position = T * (k if not is_turned else 30 + direction * (k - 30)) + shift * is_turned
        measured = np.array([[position, 0.0, turn * is_turned]])
        accepted = gate.reject_outliers(measured, NOW, command)
        believed.append(bool(abs(wrap_angle(accepted - measured)[0, 2]) < 1e-9))
    return believed[30:]


def test_a_reversed_heading_is_noticed_next_to_a_robot_without_measurements() -> None:
    gate = make_gate(2)
    for k in range(200):
        measured = np.array([[k * T, 0.0, np.pi * (k >= 30)], [np.nan] * 3])
        gate.reject_outliers(measured, np.zeros(2), np.array([[T, 0.0, 0.0]] * 2))
    assert gate.is_reversed.tolist() == [True, False]


def test_a_reversed_heading_is_believed_if_motion_contradicts_its_correction() -> None:
    """A carried robot is believed after ten images, a reversed pattern never."""
    gate = make_gate(1)
    assert not any(report(gate, 1, np.pi))
    assert gate.is_reversed[0]
    against = make_gate(1)
    assert report(against, -1, np.pi).index(True) in range(9, 15)
    assert not against.is_reversed[0]
    for turn, shift in ((2.5, 0.0), (np.pi, 0.1)):
        carried = report(make_gate(1), 1, turn, shift)
        assert carried == [False] * 9 + [True] * 161


@settings(max_examples=12)
@given(seeds, st.floats(0.05, 0.3))
def test_a_team_with_wrong_measurements_drives_as_with_missing_ones(
    seed: int, probability: float
) -> None:
    """Another robot, 1.5 m away, is measured in up to three of ten frames."""
    rng, n, frames = np.random.default_rng(seed), 2, 100
    noise = make_vision_noise(rng, frames, n)
    is_wrong = (rng.random((frames, n)) < probability) & (np.arange(frames) > 0)[:, None]
    wrong, missing = noise.copy(), noise.copy()
    wrong[is_wrong] += [1.5, 0.3, np.pi]
    missing[is_wrong] = np.nan
    start = make_start_poses(n)

    def run(errors: Array) -> dict[str, Array]:
        reference = make_reference("iterated", n)
        team = Team(make_controller("comp-flc", TeamModel(T, 4), reference, n), start)
        return run_team(team, LaggedPlant(start, 4, alpha=0.9), errors)

    expected = run(missing)
    for name, values in run(wrong).items():
        np.testing.assert_array_equal(values, expected[name], err_msg=name)
