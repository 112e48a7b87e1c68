"""The slip study finds on simulated robots what the law of creep says of them, whatever vision's noise."""

import numpy as np
import pytest

import omni_mj as om
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.studies.slip import SlipResult
from omni_mj.studies.slip.moves import Move, identification, straight

MOVES = (
    straight("forward", 1.0, rolls_out=False),
    straight("sideways", -1.25, rolls_out=False),
    straight("forward", 1.25, rolls_out=True),
    Move("turning", 8.0, 12.0, 0.5, rolls_out=True),
)
MODEL = {"model": "two-rollers"}


def driven(moves: tuple[Move, ...] = MOVES, **sections: dict[str, object]) -> SlipResult:
    wheels = MODEL | sections.pop("wheels", {})
    result = om.slip([om.scenario("rect", wheels=wheels, **sections)], moves, check=False)
    assert result.failures == []
    return result


@pytest.fixture(scope="module")
def default() -> SlipResult:
    """The default robot, seen with noise."""
    return driven()


def test_the_default_robot_slips_as_the_law_says(default: SlipResult) -> None:
    """What the law leaves out (see there): up to 0.01 of K, and 5 % of T; 8 % in turning, where T |u| is small."""
    (robot,) = default.robots.values()
    for axis, share in (("forward", 0.05), ("sideways", 0.05), ("turning", 0.08)):
        assert robot.law[f"gain_{axis}"] - 0.01 < robot.measured[f"gain_{axis}"] < robot.law[f"gain_{axis}"], axis
        assert robot.measured[f"time_{axis}"] == pytest.approx(robot.law[f"time_{axis}"], rel=share), axis


def test_noise_of_vision_and_the_faster_wheels_change_nothing(default: SlipResult) -> None:
    """Acceleration is integrated, and vision only corrects: 1.3 mm of noise are 1 mm/s, 0.1 % of the speed."""
    (noisy,) = default.robots.values()
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


def test_drag_of_a_roll_out_is_that_of_pile_bearings_and_gears(default: SlipResult) -> None:
    """From the robot's numbers: drag through the contacts and of gears, over the mass and the rotors' inertia.

    8 %: viscous bearings and the spinning up of rollers, 0.1 to 0.2 N of 3.3.
    """
    (robot,) = default.robots.values()
    settings = default.outcomes[0].scenario.settings
    motor, wheels = settings.motor, settings.wheels
    turned = np.abs(np.sin(np.radians(wheels.azimuths_deg)))  # how fast each wheel turns for 1 m/s forward
    weight, radius = 9.81 * settings.body.mass_kg, wheels.radius_m
    axles = np.abs(np.cos(np.radians(wheels.azimuths_deg)))
    bearings = settings.drive.roller_friction * weight * np.array([0.293, 0.207, 0.207, 0.293]) @ axles
    drag = settings.carpet.pile * weight + bearings + settings.drive.gear_friction_nm / radius * turned.sum()
    rotors = motor.rotor_inertia_kg_m2 * motor.gear**2 / radius**2 * (turned**2).sum()
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


def test_results_have_a_row_a_move_and_stand_beside_what_was_published(default: SlipResult) -> None:
    rows = default.rows().to_pylist()
    assert [row["move"] for row in rows] == [move.kind for move in MOVES]
    assert rows[0]["gain"] is not None
    summary = default.summary()
    found = summary["slip"]["robots"]["tigers-v2016"]["quantities"]["time_forward"]
    assert found["published"] == 0.06
    assert found["deviation_percent"] == pytest.approx(100 * (found["measured"] / 0.06 - 1))
    assert "T forward" in default.table()
    assert summary["complete"]


def test_robots_that_are_not_there_or_named_twice_are_refused() -> None:
    with pytest.raises(om.OmniError, match="unknown robot 'tigers'"):
        om.slip(["tigers"])
    with pytest.raises(om.OmniError, match="'tigers-v2016' is named twice"):
        om.slip(["tigers-v2016"] * 2)


def test_a_robot_that_falls_is_left_out_and_told() -> None:
    """Its centre of mass is so high that it topples; the figures are those of nothing."""
    body = {"centre_height_m": 0.15, "tilt_inertia_kg_m2": 0.02}
    tall = om.scenario("rect", wheels=MODEL, body=body, carpet={"friction": 2.0})
    result = om.slip([tall], [straight("forward", 1.5, rolls_out=False, acceleration=9.0)], check=False)
    (failure,) = result.failures
    assert failure.cause == "toppled over"
    (robot,) = result.robots.values()
    assert np.isnan(robot.measured["gain_forward"])
    assert result.summary()["slip"]["robots"]["tigers-v2016"]["quantities"]["gain_forward"]["measured"] is None
