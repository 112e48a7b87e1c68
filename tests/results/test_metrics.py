"""What is measured of rows, against closed forms and plain recomputation."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from benches.logs import (
    alpha_windows,
    failure,
    filled,
    measured,
    recovery_table,
    rows,
    saturation,
    tracking_errors,
)  # fmt: skip
from numpy.typing import NDArray

import omni_mj as om
from omni_control.command_limiter import CommandLimiter
from omni_control.reference import MotionLimits

T = 1 / 60
RECT = om.load_scenario("rect").settings
PUSH = {
    "kind": "push",
    "start_s": 1.0,
    "duration_s": 0.5,
    "force_n": 10.0,
}  # frames 60 to 89, looked at until 209
TILT = {"kind": "tilt", "start_s": 3.0, "angle_deg": 2.0}  # from frame 180 on


def of(frames: int, lengths: Any = None, **channels: Any) -> dict[str, NDArray]:
    """What is measured of rows of one controller."""
    n = max(np.shape(values)[1] for values in channels.values())
    return measured(filled(rows(("a",), range(n)), frames, lengths, **channels))


def test_on_a_circle_who_is_late_is_behind_and_who_is_outside_is_aside() -> None:
    """Late by a 1/10 rad on a radius of 1 m: the chord 2 sin(0.05), seen from the tangent at an angle of 0.05. Outside
    by 5 cm: all of it across. The last frame knows the frame before it only, and is half a step off: left out."""
    angle = 0.02 * np.arange(200)
    late, outside = (np.stack([np.cos(a), np.sin(a)], axis=1) for a in (angle - 0.1, angle))
    ref, pose = np.zeros((200, 2, 3)), np.zeros((200, 2, 3))
    ref[..., :2] = outside[:, None]
    pose[:, 0, :2], pose[:, 1, :2] = late, 1.05 * outside
    found = tracking_errors(filled(rows(("late", "outside")), 200, ref=ref, pose=pose))
    chord = 2 * math.sin(0.05)
    for axis, wanted in {
        "along_track": (chord * math.cos(0.05), 0),
        "cross_track": (chord * math.sin(0.05), 0.05),
    }.items():
        np.testing.assert_allclose(
            found[axis][1:-1], np.broadcast_to(wanted, (198, 2)), atol=1e-9, err_msg=axis
        )


@pytest.mark.parametrize("frames", [1, 40, 250])
def test_a_row_has_the_numbers_of_its_own_frames_whatever_is_beside_it(frames: int) -> None:
    """The same bits as alone."""
    rng = np.random.default_rng(frames)
    lengths = [frames, (frames + 1) // 2, 1]
    channels = {name: rng.normal(size=(frames, 3, 3)) for name in ("pose", "ref", "command")}
    together = of(frames, lengths, **channels)
    for i, length in enumerate(lengths):
        own = {name: values[:length, i : i + 1] for name, values in channels.items()}
        alone = of(length, **own)
        for name, values in together.items():
            np.testing.assert_array_equal(values[i], alone[name][0], err_msg=name)


def test_failing_improves_no_number() -> None:
    """Errors, efforts and settling without bound, nothing else; and a row that never began is the same."""
    log = filled(rows(("a",), (0, 1, 2)), 30, [30, 12, 0], pose=0.001, command=1.0)
    found = measured(log, [failure(log, 1), failure(log, 2)])
    for name, values in found.items():
        # Of a log without motors
        unknown = name.startswith("peak_") or name.endswith("_fraction") or name == "duty_mean"
        assert np.isfinite(values[0]) or unknown, name
        assert np.isnan(values[1:]).all() if unknown else np.isposinf(values[1:]).all(), name
    nothing = measured(filled(rows(), 0))
    assert all(np.isnan(values).all() for values in nothing.values())


def test_who_sends_the_references_own_velocities_has_no_excess_effort() -> None:
    """Now, or a dead time before they are due; who adds a hum of 0.1 m/s in every other frame has the hum's own effort,
    which is 0.2 m/s from frame to frame, where the reference has no acceleration that could go with it or against it.

    The root of a difference of squares, each good to 1e-15, is good to 1e-6.
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
    own = of(len(speed), command=hum[:, None])["effort_m_s2"][0]
    np.testing.assert_allclose(excess, [0, 0, own, 0], atol=1e-6)
    assert own == pytest.approx(0.2 / T, rel=0.01)  # but for the first frame, which comes from rest


def test_settling_counts_the_last_excursion_of_each_row_from_the_end_of_its_own_move() -> None:
    """Rows: always near; far only while moving; far again later; exactly 1 cm at the end, which is not below; ended
    before the others; with a reference that only turns, up to frame 12; with one that never moves."""
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


def test_windows_of_alpha_are_ratios_of_displacements() -> None:
    """A robot that covers 0.8 of its command, 0.1 s late, shows 0.8 in every window in which it drives throughout."""
    command = np.where((np.arange(120) >= 20) & (np.arange(120) < 90), 0.5, 0.0)[:, None]
    late = np.concatenate([np.zeros((6, 1)), command[:-6]])
    position = 0.8 * np.cumsum(np.concatenate([[[0.0]], late[:-1]]), axis=0) / 60
    alpha = alpha_windows(position, command)
    assert np.nanmin(alpha) < 0.5
    assert alpha[20 + 6 : 90 - 14] == pytest.approx(0.8)


@pytest.mark.parametrize("speed", [0.0, 0.5, 2.0])
@pytest.mark.parametrize("friction", [0.4, 0.8])
def test_a_wheel_slides_that_slips_faster_than_it_can_creep(speed: float, friction: float) -> None:
    """Creep's force is load times stiffness times slip over speed, and friction times load at Coulomb's limit.

    So a wheel whose centre drives at that speed slips by speed times friction over stiffness there,
    and does not slide.
    """
    own = RECT.replace(carpet={"friction": friction})
    stiff = own.replace(drivetrain={"creep_stiffness": 1000.0})
    pose = np.zeros((60, 1, 3))
    pose[:, 0, 0] = speed * T * np.arange(60)
    creep = speed * friction / own.drivetrain.creep_stiffness

    def share(settings: Any, slip: float) -> float:
        log = filled(
            rows(settings=settings), 60, pose=pose, slip=slip, duty_peak=0.5, current_limited=0.0
        )
        return float(measured(log)["sliding_fraction"][0])

    assert share(own, creep) == 0
    assert share(own, creep + 0.05) == pytest.approx(
        59 / 60
    )  # in the first frame nobody knows how fast it drives
    assert share(stiff, creep + 0.03) == pytest.approx(59 / 60)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_what_the_limits_change_is_what_is_held_back(axis: int) -> None:
    """Commands that ask at random for more or less pass through the team's limits; those that come out changed are held
    back, and those that come out as they were are not."""
    control = RECT.control
    rng = np.random.default_rng(axis)
    wanted = rng.normal(0, 0.2, (60, 3))
    wanted[:, axis] += rng.choice([0, 0, 30], 60)
    limits = MotionLimits(
        control.max_speed_m_s, control.max_acceleration_m_s2, control.max_turn_rate_rad_s,
        control.max_turn_acceleration_rad_s2,
    )  # fmt: skip
    pass_on, sent = CommandLimiter([limits], T), np.zeros((61, 3))
    for frame in range(60):
        sent[frame + 1] = pass_on(wanted[frame, None], sent[frame, None])[0]
    changed = np.abs(sent[1:] - wanted).max(1) > 1e-6
    log = filled(rows(settings=RECT), 60, command=sent[1:, None])
    np.testing.assert_array_equal(saturation.saturated_frames(log, 0)["command_limited"], changed)


def strayed(frames: int, *spans: tuple[int, int, float]) -> NDArray:
    """Poses (frames, 1, 3) at a distance of 3 : 4 : 5 from a reference that stays at zero, in some spans of frames."""
    pose = np.zeros((frames, 1, 3))
    for first, stop, distance in spans:
        pose[first:stop, 0, :2] = 0.6 * distance, 0.8 * distance
    return pose


@pytest.mark.parametrize(
    ("spans", "excursion", "recovered"),
    [
        ([], 0.0, 0.0),
        ([(0, 60, 0.5)], 0.0, 0.0),  # before it
        ([(60, 300, 0.0199)], 0.0199, 0.0),
        ([(70, 75, 0.3)], 0.3, 15 * T),
        ([(70, 75, 0.3), (100, 131, 0.0201)], 0.3, 71 * T),
        ([(209, 210, 0.1)], 0.1, np.inf),  # in the last frame that is looked at
        ([(210, 300, 0.5)], 0.0, 0.0),
        ([(0, 300, 0.1)], 0.1, np.inf),
    ],
)
def test_excursion_and_recovery_are_those_until_two_seconds_after(
    spans: list[tuple[int, int, float]], excursion: float, recovered: float
) -> None:
    own = RECT.replace(fault=(PUSH,))
    found = measured(filled(rows(settings=own), 300, pose=strayed(300, *spans)))
    assert found["fault_1_excursion_m"] == pytest.approx([excursion], abs=1e-12)
    assert found["fault_1_recovery_s"] == pytest.approx([recovered])


def test_recovery_is_known_of_rows_that_meet_a_fault() -> None:
    """Not of one that failed, has no fault, or ended before; a fault that goes on is looked at until the end."""
    push, both, none = (RECT.replace(fault=faults) for faults in ((PUSH,), (PUSH, TILT), ()))
    own = [push, push, none, push, both]
    table = [replace(row, settings=s) for row, s in zip(rows(("a",), range(5)), own, strict=True)]
    pose = np.repeat(strayed(300), 5, axis=1)
    pose[200:290, 4, 0] = 0.1
    log = filled(table, 300, [300, 100, 300, 40, 300], pose=pose)
    found = measured(log, [failure(log, 1)])
    np.testing.assert_array_equal(found["fault_1_excursion_m"], [0.0, np.inf, np.nan, np.nan, 0.1])
    np.testing.assert_array_equal(
        found["fault_1_recovery_s"], [0.0, np.inf, np.nan, np.nan, np.inf]
    )
    assert found["fault_2_recovery_s"][4] == pytest.approx(110 * T)


def test_a_run_tells_how_its_controllers_recover() -> None:
    """What the table says is what the summary holds, which is what the rows have; nothing where no fault is."""
    route = {"waypoints": [[0, 0], [0.5, 0]]}
    happens = [
        {"kind": "vision-loss", "start_s": 0.5, "duration_s": 0.5},
        {"kind": "alpha", "start_s": 2, "alpha": 0.8},
    ]
    scenario = om.load_scenario("rect", plant="kinematic", reference=route, fault=happens)
    result = om.run(scenario, ["flc", "comp-flc"], seeds=[0, 1, 2])
    found = result.summary()["scenarios"]["rect"]["results"]
    drawn = recovery_table(result.summary())
    assert drawn is not None
    assert [row[1] for row in drawn.rows] == ["flc", "comp-flc"] * 2
    assert drawn.rows[0][2] == f"{100 * found['flc']['recovery'][0]['excursion_m']['median']:.2f}"
    assert (
        result.rows()["fault_2_excursion_m"].to_pylist()[3:]
        == found["comp-flc"]["recovery"][1]["excursion_m"]["per_seed"]
    )
    calm = om.run(om.load_scenario("rect", plant="kinematic", reference=route), ["flc"], seeds=[0])
    assert recovery_table(calm.summary()) is None
