"""Metrics of rows, compared with closed forms and plain recomputation."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from benches.creep import contact_speed
from benches.logs import (
    alpha_windows,
    failure,
    fill_log,
    metrics_of,
    recovery_table,
    rows,
    saturation,
    tracking_errors,
)  # fmt: skip
from benches.plant import OUTWARD, TANGENTS
from numpy.typing import NDArray

import omni_mj as om
from omni_control.command_limiter import CommandLimiter
from omni_control.reference import MotionLimits

T = 1 / 60
RECT = om.load_scenario("rect").settings
# Frames 60 to 89, counted until 209.
PUSH = {"kind": "push", "start_s": 1.0, "duration_s": 0.5, "force_n": 10.0}
TILT = {"kind": "tilt", "start_s": 3.0, "angle_deg": 2.0}  # from frame 180 on


def of(frames: int, lengths: Any = None, **channels: Any) -> dict[str, NDArray]:
    """Return the metrics of rows of one controller."""
    n = max(np.shape(values)[1] for values in channels.values())
    return metrics_of(fill_log(rows(("a",), range(n)), frames, lengths, **channels))


def test_along_track_and_cross_track_errors_on_a_circle() -> None:
    """On a circle, a lag is an along-track error and an offset a cross-track error.

    A lag of 0.1 rad on a radius of 1 m gives the chord 2 sin(0.05), at an angle of 0.05 to the
    tangent. The first and last frame have one neighbor only and are left out.
    """
    angle = 0.02 * np.arange(200)
    late, outside = (np.stack([np.cos(a), np.sin(a)], axis=1) for a in (angle - 0.1, angle))
    ref, pose = np.zeros((200, 2, 3)), np.zeros((200, 2, 3))
    ref[..., :2] = outside[:, None]
    pose[:, 0, :2], pose[:, 1, :2] = late, 1.05 * outside
    log = fill_log(rows(("late", "outside")), 200, ref=ref, pose=pose)
    errors = [dict(tracking_errors(log, row)) for row in range(2)]
    chord = 2 * math.sin(0.05)
    for axis, expected in {
        "along_track": (chord * math.cos(0.05), 0),
        "cross_track": (chord * math.sin(0.05), 0.05),
    }.items():
        for row in range(2):
            np.testing.assert_allclose(errors[row][axis][1:-1], expected[row], atol=1e-9)


@pytest.mark.parametrize("frames", [1, 40, 250])
def test_metrics_of_a_row_do_not_depend_on_other_rows(frames: int) -> None:
    """The metrics are equal bit for bit."""
    rng = np.random.default_rng(frames)
    lengths = [frames, (frames + 1) // 2, 1]
    channels = {name: rng.normal(size=(frames, 3, 3)) for name in ("pose", "ref", "command")}
    together = of(frames, lengths, **channels)
    for i, length in enumerate(lengths):
        own_settings = {name: values[:length, i : i + 1] for name, values in channels.items()}
        single_row = of(length, **own_settings)
        for name, values in together.items():
            np.testing.assert_array_equal(values[i], single_row[name][0], err_msg=name)


def test_failing_improves_no_metric() -> None:
    """Errors, efforts and settling time are infinite, also for a row without frames."""
    log = fill_log(rows(("a",), (0, 1, 2)), 30, [30, 12, 0], pose=0.001, command=1.0)
    metrics = metrics_of(log, [failure(log, 1), failure(log, 2)])
    for name, values in metrics.items():
        # Of a log without motors
        unknown = name.startswith("peak_") or name.endswith("_fraction") or name == "mean_duty"
        assert np.isfinite(values[0]) or unknown, name
        assert np.isnan(values[1:]).all() if unknown else np.isposinf(values[1:]).all(), name
    no_frames = metrics_of(fill_log(rows(), 0))
    assert all(np.isnan(values).all() for values in no_frames.values())


def test_the_velocities_of_the_reference_have_no_excess_effort() -> None:
    """Sent at once or a dead time early, they have none; an added oscillation has its own effort.

    The oscillation of 0.1 m/s is perpendicular to the path, so that the squares add. The root of a
    difference of squares with errors of 1e-15 has an error of 1e-6.
    """
    start = 20
    speed = np.concatenate(
        [np.zeros(start), np.linspace(0, 1, 60), np.full(240, 1.0), np.linspace(1, 0, 80)]
    )
    velocity = speed[:, None] * (0.6, -0.8, 0.0)
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(velocity, axis=0)[:-1]]) * T
    early = np.concatenate([velocity[12:], np.zeros((12, 3))])
    hum = np.where(np.arange(len(speed)) % 2, 0.1, -0.1)[:, None] * (
        0.8,
        0.6,
        0.0,
    )  # across the path
    commands = np.stack([velocity, early, velocity + hum, 0.5 * velocity], axis=1)
    references = np.repeat(path[:, None], 4, axis=1)
    excess = of(len(speed), command=commands, ref=references)["excess_effort_m_s2"]
    own_settings = of(len(speed), command=hum[:, None])["effort_m_s2"][0]
    np.testing.assert_allclose(excess, [0, 0, own_settings, 0], atol=1e-6)
    assert own_settings == pytest.approx(
        0.2 / T, rel=0.01
    )  # but for the first frame, which comes from rest


def test_settling_counts_the_last_excursion_of_each_row_from_the_end_of_its_own_move() -> None:
    """Settling counts from the end of the reference's last motion.

    Rows: always near; far only while moving; far again later; exactly 1 cm at the end, which is not
    settled; ended early; a reference that only turns, up to frame 12; one that never moves.
    """
    frames = 50
    ref = np.zeros((frames, 7, 3))
    ref[:, :, 0] = 0.01 * np.minimum(np.arange(frames), 10)[:, None]
    ref[:, 5:] = 0.0
    ref[12:, 5, 2] = 1.0
    error = np.full((frames, 7), 0.001)
    error[:10, 1], error[31, 2], error[-1, 3], error[15:, 4] = 0.2, 0.02, 0.01, np.nan
    ref[15:, 4] = np.nan
    error[:15, 5:] = 0.5
    aside = ref + np.where(np.arange(3) == 1, error[..., None], 0.0)
    settled = of(frames, (~np.isnan(error)).sum(0), ref=ref, pose=aside)["settle_s"]
    np.testing.assert_allclose(settled, [0, 0, (32 - 10) * T, np.inf, 0, 3 * T, 15 * T])


def test_alpha_counts_only_where_the_mean_command_exceeds_a_tenth() -> None:
    """The mean over a window of 15 frames, whatever the commands in it are."""
    one_in_five = np.tile([1.0, 0.0, 0.0, 0.0, 0.0], 12)
    for command, counts in (
        (np.full(60, 0.1001), True),
        (np.full(60, -0.1001), True),
        (np.full(60, 0.0999), False),
        (0.501 * one_in_five, True),
        (0.499 * one_in_five, False),
        (np.tile([0.5, -0.45, 0.1], 20), False),
    ):
        position = np.concatenate([[0.0], 0.8 * np.cumsum(command) / 60])
        alpha = alpha_windows(position, np.append(command, 0.0))
        assert alpha == pytest.approx(0.8 if counts else np.nan, nan_ok=True)


def test_windows_of_alpha_are_ratios_of_displacements() -> None:
    """A robot with gain 0.8 and a lag of 0.1 s has alpha 0.8 in every window of driving."""
    command = np.where((np.arange(120) >= 20) & (np.arange(120) < 90), 0.5, 0.0)[:, None]
    late = np.concatenate([np.zeros((6, 1)), command[:-6]])
    position = 0.8 * np.cumsum(np.concatenate([[[0.0]], late[:-1]]), axis=0) / 60
    alpha = alpha_windows(position, command)
    assert np.nanmin(alpha) < 0.5
    assert alpha[20 + 6 : 90 - 14] == pytest.approx(0.8)


@pytest.mark.parametrize("speed", [0.0, 0.5, 2.0])
@pytest.mark.parametrize("friction", [0.4, 0.8])
def test_a_wheel_slides_that_slips_faster_than_it_can_creep(speed: float, friction: float) -> None:
    """The slope of Pacejka's cubic at zero slip is a third of that through the limit at x = 1.

    The traction of rubber that sticks is load times stiffness times slip over contact speed. So the
    limit is three times friction over stiffness, times that speed. A robot counts as sliding if any
    of its wheels slides.
    """
    own_settings = RECT.replace(carpet={"friction": friction})
    stiff = own_settings.replace(drivetrain={"creep_stiffness": 1000.0})
    pose = np.zeros((60, 1, 3))
    pose[:, 0, 0] = speed * T * np.arange(60)
    velocity = speed * np.stack([TANGENTS[:, 0], OUTWARD[:, 0]], axis=-1)
    limits = contact_speed(velocity) * 3 * friction / own_settings.drivetrain.creep_stiffness
    creep = limits.min()  # known to 2 %

    def sliding_fraction(settings: Any, slip: float) -> float:
        log = fill_log(
            rows(settings=settings), 60, pose=pose, slip=slip, duty_peak=0.5, current_limited=0.0
        )
        return float(metrics_of(log)["sliding_fraction"][0])

    assert sliding_fraction(own_settings, 0.98 * creep) == 0
    assert sliding_fraction(own_settings, creep + 0.05) == pytest.approx(
        59 / 60
    )  # the speed in the first frame is unknown
    assert sliding_fraction(stiff, creep + 0.03) == pytest.approx(59 / 60)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_commands_that_the_limits_change_count_as_limited(axis: int) -> None:
    """Random commands pass through the team's limits; only those that change are limited."""
    control = RECT.control
    rng = np.random.default_rng(axis)
    expected = rng.normal(0, 0.2, (60, 3))
    expected[:, axis] += rng.choice([0, 0, 30], 60)
    limits = MotionLimits(
        control.max_speed_m_s, control.max_acceleration_m_s2, control.max_turn_rate_rad_s,
        control.max_turn_acceleration_rad_s2,
    )  # fmt: skip
    pass_on, sent = CommandLimiter([limits], T), np.zeros((61, 3))
    for frame in range(60):
        sent[frame + 1] = pass_on(expected[frame, None], sent[frame, None])[0]
    changed = np.abs(sent[1:] - expected).max(1) > 1e-6
    log = fill_log(rows(settings=RECT), 60, command=sent[1:, None])
    np.testing.assert_array_equal(saturation.saturated_frames(log, 0)["command_limited"], changed)


def poses_with_errors(frames: int, *spans: tuple[int, int, float]) -> NDArray:
    """Return poses (frames, 1, 3) at given distances from zero in some spans of frames."""
    pose = np.zeros((frames, 1, 3))
    for start, stop, distance in spans:
        pose[start:stop, 0, :2] = 0.6 * distance, 0.8 * distance
    return pose


@pytest.mark.parametrize(
    ("spans", "excursion", "recovered"),
    [
        ([], 0.0, 0.0),
        ([(0, 60, 0.5)], 0.0, 0.0),  # before it
        ([(60, 300, 0.0199)], 0.0199, 0.0),
        ([(70, 75, 0.3)], 0.3, 15 * T),
        ([(70, 75, 0.3), (100, 131, 0.0201)], 0.3, 71 * T),
        ([(209, 210, 0.1)], 0.1, np.inf),  # in the last frame that counts
        ([(210, 300, 0.5)], 0.0, 0.0),
        ([(0, 300, 0.1)], 0.1, np.inf),
    ],
)
def test_excursion_and_recovery_count_until_two_seconds_after_the_fault(
    spans: list[tuple[int, int, float]], excursion: float, recovered: float
) -> None:
    own_settings = RECT.replace(fault=(PUSH,))
    metrics = metrics_of(
        fill_log(rows(settings=own_settings), 300, pose=poses_with_errors(300, *spans))
    )
    assert metrics["fault_1_excursion_m"] == pytest.approx([excursion], abs=1e-12)
    assert metrics["fault_1_recovery_s"] == pytest.approx([recovered])


def test_rows_that_reach_a_fault_have_a_recovery() -> None:
    """Rows: recovered; failed; without faults; ended before the fault; with a lasting fault."""
    push_rows, push_and_tilt, none = (
        RECT.replace(fault=faults) for faults in ((PUSH,), (PUSH, TILT), ())
    )
    own_settings = [push_rows, push_rows, none, push_rows, push_and_tilt]
    table_rows = [
        replace(row, settings=s)
        for row, s in zip(rows(("a",), range(5)), own_settings, strict=True)
    ]
    pose = np.repeat(poses_with_errors(300), 5, axis=1)
    pose[200:290, 4, 0] = 0.1
    log = fill_log(table_rows, 300, [300, 100, 300, 40, 300], pose=pose)
    metrics = metrics_of(log, [failure(log, 1)])
    np.testing.assert_array_equal(
        metrics["fault_1_excursion_m"], [0.0, np.inf, np.nan, np.nan, 0.1]
    )
    np.testing.assert_array_equal(
        metrics["fault_1_recovery_s"], [0.0, np.inf, np.nan, np.nan, np.inf]
    )
    assert metrics["fault_2_recovery_s"][4] == pytest.approx(110 * T)


def test_table_and_summary_report_recovery() -> None:
    """Table, summary and rows agree. Without faults there is no table."""
    route = {"waypoints": [[0, 0], [0.5, 0]]}
    happens = [
        {"kind": "vision-loss", "start_s": 0.5, "duration_s": 0.5},
        {"kind": "alpha", "start_s": 2, "alpha": 0.8},
    ]
    scenario = om.load_scenario("rect", plant="kinematic", reference=route, fault=happens)
    result = om.run(scenario, ["flc", "comp-flc"], seeds=[0, 1, 2])
    metrics = result.summary()["scenarios"]["rect"]["results"]
    drawn = recovery_table(result.summary())
    assert drawn is not None
    assert [row[1] for row in drawn.rows] == ["flc", "comp-flc"] * 2
    assert drawn.rows[0][2] == f"{100 * metrics['flc']['recovery'][0]['excursion_m']['median']:.2f}"
    assert (
        result.rows()["fault_2_excursion_m"].to_pylist()[3:]
        == metrics["comp-flc"]["recovery"][1]["excursion_m"]["per_seed"]
    )
    calm = om.run(om.load_scenario("rect", plant="kinematic", reference=route), ["flc"], seeds=[0])
    assert recovery_table(calm.summary()) is None
