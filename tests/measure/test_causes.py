"""Why robots stray: what counts as sliding, as held back, and how shares come of it."""

import compiled
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as tried
from hypothesis import strategies as st
from logs import failure, filled, rows

import omni_mj as om
from omni_mj.measure import causes, metrics, summary
from omni_mj.scenarios import scenario
from omni_mj.scenarios.settings import PERIOD_S, Settings

FRAMES = 60
FOUND = scenario.load("rect").settings


def driving(speed: float, slip: float, settings: Settings = FOUND, **channels: object) -> dict[str, np.ndarray]:
    """What is found of a robot that drives ahead at `speed`, all its wheels slipping by `slip`, m/s."""
    pose = np.zeros((FRAMES, 1, 3))
    pose[:, 0, 0] = speed * PERIOD_S * np.arange(FRAMES)
    given_ = {"duty_peak": 0.5, "current_limited": 0.0} | channels
    log = filled(rows(settings=settings), FRAMES, pose=pose, slip=slip, **given_)  # type: ignore[arg-type]
    return causes.of_row(log, 0)


@pytest.mark.parametrize("speed", [0.0, 0.5, 2.0])
@pytest.mark.parametrize("friction", [0.4, 0.8])
def test_a_wheel_slides_that_slips_faster_than_it_can_creep(speed: float, friction: float) -> None:
    """Creep's force is load times stiffness times slip over speed, and friction times load at Coulomb's limit.

    So a wheel whose centre drives at that speed slips by speed times friction over stiffness there, and does not slide.
    """
    settings = FOUND.replace(carpet={"friction": friction})
    creep = speed * friction / settings.drive.creep_stiffness
    assert not driving(speed, creep, settings)["sliding"].any()
    slides = driving(speed, creep + 0.05, settings)["sliding"]
    assert slides[1:].all()
    assert not slides[0]  # in which nobody knows how fast it drives


def test_wheels_that_do_not_creep_slide_when_they_slip() -> None:
    stiff = FOUND.replace(wheels={"creep": "off"})
    assert driving(2.0, 0.03, stiff)["sliding"][1:].all()
    assert not driving(2.0, 0.03)["sliding"].any()


def test_motors_at_full_voltage_and_drivers_that_limit_are_counted_by_frames() -> None:
    """Of 60 frames 15 at full duty, 6 in which one motor's current is held back for a part of the frame."""
    duty = np.where(np.arange(FRAMES) < 15, 1.0, 0.2)[:, None, None]
    limited = np.zeros((FRAMES, 1, 4))
    limited[30:36, 0, 2] = 0.1
    log = filled(rows(), FRAMES, slip=0.0, duty_peak=duty, current_limited=limited)
    measured = metrics.row_metrics(log)
    found = {name: measured[name][0] for name in causes.NAMES}
    assert found == pytest.approx(
        {"sliding_share": 0, "full_voltage_share": 0.25, "current_limited_share": 0.1, "held_back_share": 0,
         "duty_mean": (15 * 1.0 + 45 * 0.2) / 60}
    )  # fmt: skip


@tried(deadline=None, derandomize=True, max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(0, 2))
def test_what_the_limits_change_is_what_is_held_back(seed: int, axis: int) -> None:
    """Commands that ask at random for more or less pass through the team's limits; those that come out changed are held
    back, and those that come out as they were are not, but for the few that ask for a limit itself."""
    from omni_control.limits import CommandLimits
    from omni_mj.scenarios.references import motion_limits

    control = FOUND.control
    wanted = np.random.default_rng(seed).normal(0, 0.2, (FRAMES, 3))
    wanted[:, axis] += np.random.default_rng(seed + 1).choice([0, 0, 30], FRAMES)
    limits, sent = CommandLimits([motion_limits(control)], PERIOD_S), np.zeros((FRAMES + 1, 3))
    for frame in range(FRAMES):
        sent[frame + 1] = limits(wanted[frame, None], sent[frame, None])[0]
    changed = np.abs(sent[1:] - wanted).max(1) > 1e-6
    met = causes.at_limits(sent[1:], sent[0], control)
    np.testing.assert_array_equal(np.any([frames for _, frames in met.values()], axis=0), changed)


def test_a_plant_without_wheels_has_commands_only_and_a_row_that_failed_has_nothing() -> None:
    log = filled(rows(["a", "b"]), FRAMES, [FRAMES, 20])
    assert set(causes.of_row(log, 0)) == {causes.HELD_BACK}
    measured = metrics.row_metrics(log, [failure(log, 1)])
    assert np.isnan(measured["sliding_share"]).all()
    np.testing.assert_array_equal(measured["held_back_share"], [0.0, np.nan])


def test_a_seed_that_failed_is_left_out() -> None:
    """Of three seeds: shares 0.5 and 0.25, and one that failed."""
    command = np.zeros((FRAMES, 3, 3))
    command[:30, 0, 0] = command[:15, 1, 0] = FOUND.control.max_speed_m_s
    log = filled(rows(["a"], [0, 1, 2], FOUND), FRAMES, command=command)
    found = summary.results(log, failures := [failure(log, 2)], metrics.row_metrics(log, failures))["a"]["why"]
    share = found["held_back_share"]
    # The frame in which it stops is at the limit of acceleration.
    assert share["seeds"] == pytest.approx([31 / 60, 16 / 60, None])
    assert share["median"] == pytest.approx(23.5 / 60)
    assert found["sliding_share"]["median"] is None


def test_the_terminal_tells_of_causes_that_matter_beside_the_errors() -> None:
    """On friction 0.15 wheels slide; on the paper's rectangle as it is nothing does, and nothing is said."""
    way = {"waypoints": [[0, 0], [0.4, 0]], "max_acceleration_m_s2": 2.5}
    compiled.once("planar")
    slippery = om.scenario("rect", plant="planar", reference=way, carpet={"friction": 0.15}, physics=compiled.NUMBA)
    result = om.run(slippery, ["comp-flc"], seeds=[0])
    told = causes.table(result.summary())
    assert told
    assert told.headings[:3] == ["controller", "plane, cm", "wheels slide, %"]
    share = result.summary()["scenarios"]["rect"]["results"]["comp-flc"]["why"]["sliding_share"]["median"]
    assert float(told.rows[0][2]) == pytest.approx(100 * share, abs=0.05)
    assert share > 0.2
    calm = om.run(om.scenario("rect", plant="kinematic", reference={"waypoints": [[0, 0], [0.2, 0]]}), ["comp-flc"])
    assert causes.table(calm.summary()) is None
