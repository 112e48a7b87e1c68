"""The slip study finds on simulated robots what the law of creep says of them, whatever vision's noise."""

import compiled
import numpy as np
import pytest

import omni_mj as om
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.studies.slip import SlipResult
from omni_mj.studies.slip.figures import Robot
from omni_mj.studies.slip.law import AXES
from omni_mj.studies.slip.moves import Move, identification, straight
from omni_mj.studies.slip.published import PUBLISHED

MOVES = (
    straight("forward", 1.0, rolls_out=False),
    straight("sideways", -1.25, rolls_out=False),
    straight("forward", 1.25, rolls_out=True),
    Move("turning", 8.0, 12.0, 0.5, rolls_out=True),
)
MODEL = {"model": "two-rollers"}
# A robot that stays as it is while those that come with the package learn from measurements.
FIXED = {
    "body": {"mass_kg": 2.65, "centre_x_m": 0.0, "centre_height_m": 0.045, "yaw_inertia_kg_m2": 0.0139},
    "drive": {"gear_friction_nm": 0.003, "roller_friction": 0.03, "roller_damping_nm_s": 2e-6, "creep_stiffness": 2.3},
    "carpet": {"pile": 0.1, "friction": 0.8},
}


def driven(moves: tuple[Move, ...] = MOVES, **sections: dict[str, object]) -> SlipResult:
    compiled.once("mujoco")
    sections = {"wheels": MODEL, "physics": compiled.NUMBA} | sections
    result = om.slip([om.scenario("rect", **FIXED, **sections)], moves, check=False)
    assert result.failures == []
    return result


@pytest.fixture(scope="module")
def fixed() -> SlipResult:
    """Seen with noise."""
    return driven()


def check_law(robot: Robot) -> None:
    """What the law leaves out (see there): up to 0.014 of K; of T up to 5 % and 0.002 s^2/m less, up to 4 % more."""
    for axis in AXES:
        gain, time = (robot.law[f"{what}_{axis}"] for what in ("gain", "time"))
        assert gain - 0.014 < robot.measured[f"gain_{axis}"] < gain, axis
        assert 0.95 * time - 0.002 < robot.measured[f"time_{axis}"] < 1.04 * time, axis


def test_a_robot_slips_as_the_law_says(fixed: SlipResult) -> None:
    (robot,) = fixed.robots.values()
    check_law(robot)


@pytest.mark.parametrize("name", PUBLISHED)
def test_robots_of_the_package_slip_as_the_law_says(name: str) -> None:
    """And roll out so, within 8 %: bearings' viscous part and the spinning up of rollers."""
    compiled.once("mujoco")
    chosen = om.scenario("rect", robot=name, wheels=MODEL, physics=compiled.NUMBA)
    (robot,) = om.slip([chosen], MOVES, check=False).robots.values()
    check_law(robot)
    for axis in ("forward", "turning"):
        assert robot.measured[f"drag_{axis}"] == pytest.approx(robot.law[f"drag_{axis}"], rel=0.08), axis


def test_noise_of_vision_and_the_faster_wheels_change_nothing(fixed: SlipResult) -> None:
    """Acceleration is integrated, and vision only corrects: 1.3 mm of noise are 1 mm/s, 0.1 % of the speed."""
    (noisy,) = fixed.robots.values()
    quiet = {"position_noise_m": 0.0, "heading_noise_rad": 0.0, "miss_probability": 0.0}
    (exact,) = driven(vision=quiet, wheels={"model": "rollers"}).robots.values()
    for name, value in exact.measured.items():
        share = 0.02 if name.startswith("time") else 0.01
        assert noisy.measured[name] == pytest.approx(value, rel=share, nan_ok=True), name


def test_without_creep_wheels_do_not_slip() -> None:
    """But for the rollers' effective radius, 0.2 %, and friction that acts within 3.5 ms, over a metre per second."""
    (robot,) = driven(MOVES[:2], wheels={"model": "rollers", "creep": "off"}).robots.values()
    for axis in ("forward", "sideways"):
        assert robot.law[f"gain_{axis}"] == 1
        assert robot.measured[f"gain_{axis}"] == pytest.approx(1, abs=0.004)
        assert robot.measured[f"time_{axis}"] == pytest.approx(0, abs=0.003)


def test_drag_of_a_roll_out_is_that_of_pile_bearings_gears_and_motors(fixed: SlipResult) -> None:
    """By hand: 2.60 N of pile, 0.46 N of bearings and 0.33 of gears and 0.29 to 0.30 of motors slow 2.65 + 0.46 kg.

    Motors: (1.9 to 2.1 mN m each behind 3.33:1 at the wheels' mean speed of 20 rad/s). 8 % as above.
    """
    (robot,) = fixed.robots.values()
    settings = fixed.outcomes[0].scenario.settings
    motor, wheels = settings.motor, settings.wheels
    across, along = (np.abs(each(np.radians(wheels.azimuths_deg))) for each in (np.sin, np.cos))
    weight = 9.81 * settings.body.mass_kg
    bearings = settings.drive.roller_friction * weight * np.array([0.293, 0.207, 0.207, 0.293]) @ along
    speed = 0.6 * across / wheels.radius_m * motor.gear  # of the motors at 0.6 m/s
    motors = motor.gear * (motor.dry_friction_nm + motor.viscous_friction_nm_s * speed)
    hubs = (settings.drive.gear_friction_nm + motors) @ across / wheels.radius_m
    drag = settings.carpet.pile * weight + bearings + hubs
    rotors = motor.rotor_inertia_kg_m2 * motor.gear**2 / wheels.radius_m**2 * (across**2).sum()
    deceleration = robot.fitted["deceleration"][2]
    assert deceleration == pytest.approx(drag / (settings.body.mass_kg + rotors), rel=0.08)
    assert robot.measured["drag_forward"] == pytest.approx(2.65 * deceleration)


def test_the_moves_are_those_that_were_published() -> None:
    """Ends 3 m apart: the way of the commands is that, less what is left to roll."""
    moves = identification()
    assert len(moves) == 40
    for move in moves:
        frames = move.frames
        way = np.abs(move.commands(frames)).sum() * PERIOD_S
        if move.kind in ("forward", "sideways"):
            left = 0.5 * abs(move.speed) if move.rolls_out else 0.0
            # What is commanded in a frame is reached at its end: half a frame too soon, and up to one to let go.
            assert way == pytest.approx(3.0 - left, abs=1.1 * PERIOD_S * abs(move.speed)), move
        assert not (move.free(frames) & (move.accelerating(frames) | move.holding(frames))).any()
        assert move.free(frames).any() == move.rolls_out
        assert move.accelerating(frames).sum() == pytest.approx(abs(move.speed) / move.acceleration / PERIOD_S, abs=2)


def test_results_have_a_row_a_move_and_stand_beside_what_was_published(fixed: SlipResult) -> None:
    rows = fixed.rows().to_pylist()
    assert [row["move"] for row in rows] == [move.kind for move in MOVES]
    assert rows[0]["gain"] is not None
    summary = fixed.summary()
    found = summary["slip"]["robots"]["tigers-v2016"]["quantities"]["time_forward"]
    assert found["published"] == 0.06
    assert found["deviation_percent"] == pytest.approx(100 * (found["measured"] / 0.06 - 1))
    assert "T forward" in fixed.table()
    assert summary["complete"]


def test_robots_that_are_not_there_or_named_twice_are_refused() -> None:
    with pytest.raises(om.OmniError, match="unknown robot 'tigers'"):
        om.slip(["tigers"])
    with pytest.raises(om.OmniError, match="'tigers-v2016' is named twice"):
        om.slip(["tigers-v2016"] * 2)


def test_a_robot_that_falls_is_left_out_and_told() -> None:
    """It is pushed over; there are no figures of it, and no open loop that would need them."""
    compiled.once("mujoco")
    pushed = om.scenario("rect", wheels=MODEL, physics=compiled.NUMBA, disturbance={"force_n": 1000.0})
    result = om.slip([pushed], [straight("forward", 1.5, rolls_out=True)])
    (failure,) = result.failures
    assert failure.cause == "toppled over"
    (robot,) = result.robots.values()
    assert np.isnan(robot.measured["gain_forward"])
    assert result.summary()["slip"]["robots"]["tigers-v2016"]["quantities"]["gain_forward"]["measured"] is None
