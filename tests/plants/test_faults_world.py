"""What pushes, slopes, other carpets and hands do to robots, by laws of mechanics."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from benches.plant import (
    COM_HEIGHT_M,
    CONTACTS,
    FRAME_S,
    GRAVITY,
    ICE,
    MASS_KG,
    MAX_DRIFT,
    RADIUS_M,
    ROLLING_KG,
    SETTLE_FRAMES,
    STIFF,
    TANGENTS,
    TWO_ROLLERS,
    constant,
    drive,
    estimated_heading,
    noiseless,
    planar,
    ramp,
    rows,
    stand_still,
    two_rollers,
    wheel_loads,
    with_faults,
)
from benches.plant import mujoco as plant_of
from benches.steps import Tape

from omni_control.errors import OmniError
from omni_mj.config.settings import Settings
from omni_mj.plants.kinematic import KinematicPlant

# --- pushes ---


def test_a_push_gives_momentum_and_ends() -> None:
    """M v = F t less what ice holds, whatever heading and direction; then the speed stays."""
    force, frames, bearings = 20.0, 6, (0.0, 90.0, -125.0)
    pushes = [
        {"kind": "push", "duration_s": frames * FRAME_S, "force_n": force, "direction_deg": b}
        for b in bearings
    ]
    plant = plant_of(
        [with_faults(each, **ICE) for each in pushes] + [noiseless(**ICE)],
        [[0, 0, h] for h in (0, 0, 0.7, 0)],
    )
    stand_still(plant)
    stand_still(plant, frames)
    mass = MASS_KG + ROLLING_KG.mean()  # the same in all directions within 0.2 %
    direction = np.radians(bearings)
    towards = np.column_stack([np.cos(direction), np.sin(direction)])
    gained = plant.twist()[:3, :2] / (force * frames * FRAME_S / mass)
    # Ice takes up to 1.3 % of the force; rollers that come down take on the speed of the carpet, up
    # to as much.
    np.testing.assert_allclose(gained, towards, atol=0.03)
    after = np.linalg.norm(plant.twist()[:3, :2], axis=1)
    stand_still(plant, 3)
    # Ice, 0.1 m/s^2, and rollers brake it.
    assert (np.abs(np.linalg.norm(plant.twist()[:3, :2], axis=1) - after) < 0.02).all()
    assert np.abs(plant.pose()[3]).max() < MAX_DRIFT


# --- slopes ---


def test_on_ice_a_slope_accelerates_by_g_sin() -> None:
    """Between two slopes, so that Coulomb's friction, which is the same but for 1 % of it, falls out."""
    frames, angles = 9, np.radians([4.0, 8.0])
    chosen = [
        with_faults({"kind": "tilt", "angle_deg": np.degrees(a), "direction_deg": d}, **ICE)
        for d in (0, 90)
        for a in angles
    ]
    plant = plant_of(chosen)
    stand_still(plant)
    stand_still(plant, frames)
    speed = np.array([plant.twist()[:2, 0], plant.twist()[2:, 1]])
    gained = np.diff(speed, axis=1)[:, 0] / (frames * FRAME_S)
    # Rims and rollers turn along. 2 %: rollers that come down take on the speed of the carpet.
    np.testing.assert_allclose(
        gained, GRAVITY * np.diff(np.sin(angles)) * MASS_KG / (MASS_KG + ROLLING_KG), rtol=0.02
    )


def test_a_robot_that_stands_on_a_slope_weighs_on_its_wheels_as_statics_says() -> None:
    """Loads add up to m g cos; their moment is that of g sin at the height of the centre of mass, downhill."""
    angle, bearings = np.radians(5.0), np.radians([0.0, 90.0, 180.0])
    tilts = [{"kind": "tilt", "angle_deg": 5.0, "direction_deg": np.degrees(b)} for b in bearings]
    plant = plant_of(
        [with_faults(each, **TWO_ROLLERS) for each in tilts] + [noiseless(**TWO_ROLLERS)]
    )
    stand_still(plant, SETTLE_FRAMES + 40)
    load = wheel_loads(plant)
    np.testing.assert_allclose(load.sum(1)[:3], MASS_KG * GRAVITY * np.cos(angle), rtol=2e-3)
    moment = load @ CONTACTS / GRAVITY
    downhill = np.column_stack([np.cos(bearings), np.sin(bearings)])
    # 1 %: springs that still swing by as much of what the tilt shifts.
    shift = MASS_KG * COM_HEIGHT_M * np.sin(angle)
    np.testing.assert_allclose(
        moment[:3] - np.cos(angle) * moment[3], shift * downhill, atol=0.01 * shift
    )
    assert np.abs(plant.pose()[:, :2]).max() < 1e-3, "gears and wheel loops hold it"


def test_robots_of_a_world_stand_on_one_carpet() -> None:
    """What leans for one leans for the other; other worlds' do not."""
    tilt = {"kind": "tilt", "angle_deg": 5.0, "direction_deg": 90.0}
    start = [[0, 0, 0], [1, 0, 0]] * 2
    plant = plant_of([with_faults(tilt, **ICE)] * 2 + [noiseless(**ICE)] * 2, start, per_world=2)
    moved = stand_still(plant, 30)[-1] - start
    assert (moved[:2, 1] > 0.01).all()
    assert np.abs(moved[2:]).max() < MAX_DRIFT
    with pytest.raises(OmniError, match=r"all robots of a world stand on one carpet"):
        with_faults({**tilt, "robots": [1]})


# --- friction ---


def test_a_wheel_that_slides_pulls_by_the_friction_of_the_moment() -> None:
    """Momentum over what the wheels bear, along the rims, before, while and after."""
    usual, other, first, frames = 0.25, 0.5, 4, 7
    fault = {
        "kind": "friction",
        "start_s": first * FRAME_S,
        "duration_s": frames * FRAME_S,
        "friction": other,
    }
    free: dict[str, Any] = {
        "drivetrain": {"roller_friction": 0.0, "roller_damping_nm_s": 0.0},
        "firmware": STIFF,
    }
    tape = Tape(
        plant_of(
            [with_faults(fault, carpet={"friction": usual, "rolling_resistance": 0.0}, **free)]
        )
    )
    tape.drive(constant([3.6, 0.0, 0.0], 18, 1))
    # From some steps after a change on, when the load has swung.
    for start, stop, friction in ((20, 60, usual), (80, 170, other), (190, 280, usual)):
        slips, load = tape.steps["slips"][start:stop], tape.steps["load"][start:stop]
        assert (np.abs(slips) * RADIUS_M > 0.1).all(), "every wheel slides"
        velocity = tape.steps["velocity"][:, 0, 0]
        gained = (MASS_KG + ROLLING_KG[0]) * (velocity[stop - 1] - velocity[start - 1])
        pull = ((-np.sign(slips) * load) @ TANGENTS[:, 0]).sum() / 960
        assert gained / pull == pytest.approx(friction, rel=0.03), (
            start
        )  # 2 % as in test_sliding.py, and short


def test_a_patch_that_comes_is_one_that_was_there_and_covers_it_until_it_goes() -> None:
    """To the bit; where the robot is not on it, it is none."""
    there = {"friction": 0.8, "patches": [[0, 0, 5.0, 0.3]]}
    comes = {
        "kind": "friction-patch",
        "start_s": 0.0,
        "x_m": 0.0,
        "y_m": 0.0,
        "radius_m": 5.0,
        "friction": 0.3,
    }
    own = [
        with_faults(comes, carpet={"friction": 0.8}),
        noiseless(carpet=there),
        with_faults({**comes, "x_m": 9.0, "radius_m": 1.0}, carpet=there),
        with_faults({**comes, "duration_s": 10 * FRAME_S}, carpet={"friction": 0.8}),
        noiseless(carpet={"friction": 0.8}),
    ]
    plant = plant_of(own)
    poses = drive(plant, constant([2.0, 0, 0], 20, 5))
    np.testing.assert_array_equal(poses[:, 0], poses[:, 1])
    np.testing.assert_array_equal(poses[:, 2], poses[:, 1])
    np.testing.assert_array_equal(poses[:11, 3], poses[:11, 1])


# --- hands ---


@pytest.mark.parametrize(
    "make", [two_rollers, planar, lambda own: KinematicPlant(rows(own), np.zeros((len(own), 3)))]
)
def test_a_hand_puts_a_robot_elsewhere_at_rest(make: Callable[[list[Settings]], Any]) -> None:
    """As far as it says, of whatever heading, in one frame; whoever is told to stand stays there."""
    hand = {"kind": "kidnap", "x_m": 0.7, "y_m": -0.4, "heading_deg": 150.0}
    plant = make([with_faults({"kind": "vision-loss"}, hand), with_faults()])
    drive(plant, ramp([[1.0, 0.5, 0.5]] * 2, 3.0, SETTLE_FRAMES))
    before = plant.pose()
    poses = stand_still(plant, 1)
    moved = poses[-1] - before
    # Less what the robot would have gone on in the frame, at most: 1.1 m/s.
    np.testing.assert_allclose(moved[0], [0.7, -0.4, np.radians(150)], atol=0.02)
    put = stand_still(plant, 20)[-1]
    np.testing.assert_allclose(put[0, :2], poses[-1][0, :2], atol=2e-3)
    # Vision's heading contradicts its own by so much that it takes its gyro for one that drifts,
    # and turns a little.
    assert put[0, 2] == pytest.approx(poses[-1][0, 2], abs=0.02)


def test_no_sensor_of_a_robot_sees_a_hand() -> None:
    """Neither the gyro, nor an encoder, nor what holds its wheels."""
    hand = {"kind": "kidnap", "x_m": 0.3, "heading_deg": 90.0}
    for make in (two_rollers, planar):
        plant = make([with_faults(hand, firmware={"heading_gain": 0.0, "gyro_bias_gain": 0.0})])
        stand_still(plant, SETTLE_FRAMES + 5)
        assert plant.pose()[0, 2] == pytest.approx(np.pi / 2, abs=1e-3)
        assert estimated_heading(plant)[0] == pytest.approx(0, abs=1e-3)
        assert np.abs(plant.telemetry().wheel_angle).max() < 0.05
