"""Faults of the world, by laws of mechanics: pushes, slopes, friction, displacement."""

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
    WHEELED_PLANTS,
    PlantOf,
    constant,
    drive,
    estimated_heading,
    noiseless,
    on_all_wheels,
    planar,
    ramp,
    rows,
    stand_still,
    two_rollers,
    wheel_loads,
    with_faults,
)
from benches.plant import mujoco as plant_of
from benches.step_recorder import StepRecorder

from omni_control.errors import OmniError
from omni_mj.plants.kinematic_plant import KinematicPlant

# --- pushes ---


def test_a_push_adds_momentum() -> None:
    """M v = F t minus friction, for any heading and direction; the speed is then constant."""
    force, frames, bearings = 20.0, 6, (0.0, 90.0, -125.0)
    pushes = [
        {"kind": "push", "duration_s": frames * FRAME_S, "force_n": force, "direction_deg": b}
        for b in bearings
    ]
    plant = plant_of(
        [with_faults(fault, **ICE) for fault in pushes] + [noiseless(**ICE)],
        [[0, 0, h] for h in (0, 0, 0.7, 0)],
    )
    stand_still(plant)
    stand_still(plant, frames)
    mass = MASS_KG + ROLLING_KG.mean()  # the same in all directions within 0.2 %
    direction = np.radians(bearings)
    unit_vectors = np.column_stack([np.cos(direction), np.sin(direction)])
    velocity = plant.twist()[:3, :2] / (force * frames * FRAME_S / mass)
    # Friction of ice takes up to 1.3 % of the force, and rollers that come down about as much.
    np.testing.assert_allclose(velocity, unit_vectors, atol=0.03)
    speed = np.linalg.norm(plant.twist()[:3, :2], axis=1)
    stand_still(plant, 3)
    # Friction of ice, 0.1 m/s^2, and rollers brake it.
    assert (np.abs(np.linalg.norm(plant.twist()[:3, :2], axis=1) - speed) < 0.02).all()
    assert np.abs(plant.pose()[3]).max() < MAX_DRIFT


# --- slopes ---


def test_on_ice_a_slope_accelerates_by_g_sin() -> None:
    """The difference between two slopes, from which Coulomb's friction cancels within 1 %."""
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
    acceleration = np.diff(speed, axis=1)[:, 0] / (frames * FRAME_S)
    # Rims and rollers turn along. 2 %: rollers that come down take on the speed of the carpet.
    np.testing.assert_allclose(
        acceleration,
        GRAVITY * np.diff(np.sin(angles)) * MASS_KG / (MASS_KG + ROLLING_KG),
        rtol=0.02,
    )


@WHEELED_PLANTS
def test_normal_forces_on_a_slope_are_those_of_statics(
    plant_of: PlantOf,
) -> None:
    """Their sum is m g cos, their moment that of m g sin at the center of mass, downhill."""
    angle, bearings = np.radians(5.0), np.radians([0.0, 90.0, 180.0])
    tilts = [{"kind": "tilt", "angle_deg": 5.0, "direction_deg": np.degrees(b)} for b in bearings]
    blocked = on_all_wheels("motor-blocked")
    plant = plant_of([with_faults(tilt, *blocked) for tilt in tilts] + [noiseless()])
    stand_still(plant, SETTLE_FRAMES + 40)
    load = wheel_loads(plant)
    # MuJoCo's springs still oscillate, by 1 % of the shift. The loads of planar are statics.
    rtol, share = (1e-9, 1e-3) if plant_of is planar else (2e-3, 0.01)
    np.testing.assert_allclose(load.sum(1)[:3], MASS_KG * GRAVITY * np.cos(angle), rtol=rtol)
    moment = load @ CONTACTS / GRAVITY
    downhill = np.column_stack([np.cos(bearings), np.sin(bearings)])
    shift = MASS_KG * COM_HEIGHT_M * np.sin(angle)
    np.testing.assert_allclose(
        moment[:3] - np.cos(angle) * moment[3], shift * downhill, atol=share * shift
    )
    assert np.abs(plant.pose()[:, :2]).max() < 1e-3, "blocked motors hold the robot"


def test_a_tilt_acts_on_all_robots_of_a_world() -> None:
    """Other worlds are not tilted."""
    tilt = {"kind": "tilt", "angle_deg": 5.0, "direction_deg": 90.0}
    start = [[0, 0, 0], [1, 0, 0]] * 2
    plant = plant_of([with_faults(tilt, **ICE)] * 2 + [noiseless(**ICE)] * 2, start, per_world=2)
    displacement = stand_still(plant, 30)[-1] - start
    assert (displacement[:2, 1] > 0.01).all()
    assert np.abs(displacement[2:]).max() < MAX_DRIFT
    with pytest.raises(OmniError, match=r"all robots of a world stand on one carpet"):
        with_faults({**tilt, "robots": [1]})


# --- friction ---


def test_traction_of_sliding_wheels_follows_the_friction_of_the_moment() -> None:
    """Momentum over normal forces along the rims, before, during and after the fault."""
    nominal, changed, start_frame, frames = 0.25, 0.5, 4, 7
    fault = {
        "kind": "friction",
        "start_s": start_frame * FRAME_S,
        "duration_s": frames * FRAME_S,
        "friction": changed,
    }
    free: dict[str, Any] = {
        "drivetrain": {"roller_friction": 0.0, "roller_damping_nm_s": 0.0},
        "firmware": STIFF,
    }
    tape = StepRecorder(
        plant_of(
            [with_faults(fault, carpet={"friction": nominal, "rolling_resistance": 0.0}, **free)]
        )
    )
    tape.drive(constant([3.6, 0.0, 0.0], 18, 1))
    # Some steps after a change, when the normal forces have settled
    for start, stop, friction in ((20, 60, nominal), (80, 170, changed), (190, 280, nominal)):
        slips, load = tape.steps["slips"][start:stop], tape.steps["load"][start:stop]
        assert (np.abs(slips) * RADIUS_M > 0.1).all(), "every wheel slides"
        velocity = tape.steps["velocity"][:, 0, 0]
        momentum = (MASS_KG + ROLLING_KG[0]) * (velocity[stop - 1] - velocity[start - 1])
        impulse = ((-np.sign(slips) * load) @ TANGENTS[:, 0]).sum() / 960
        # 2 % as in test_sliding.py, and few steps
        assert momentum / impulse == pytest.approx(friction, rel=0.03), start


def test_a_patch_of_a_fault_acts_like_one_of_the_scenario_while_it_lasts() -> None:
    """Bit for bit. It overrides other patches, and does not act on robots next to it."""
    patched = {"friction": 0.8, "patches": [[0, 0, 5.0, 0.3]]}
    fault = {
        "kind": "friction-patch",
        "start_s": 0.0,
        "x_m": 0.0,
        "y_m": 0.0,
        "radius_m": 5.0,
        "friction": 0.3,
    }
    settings = [
        with_faults(fault, carpet={"friction": 0.8}),
        noiseless(carpet=patched),
        with_faults({**fault, "x_m": 9.0, "radius_m": 1.0}, carpet=patched),
        with_faults({**fault, "duration_s": 10 * FRAME_S}, carpet={"friction": 0.8}),
        noiseless(carpet={"friction": 0.8}),
    ]
    plant = plant_of(settings)
    poses = drive(plant, constant([2.0, 0, 0], 20, 5))
    np.testing.assert_array_equal(poses[:, 0], poses[:, 1])
    np.testing.assert_array_equal(poses[:, 2], poses[:, 1])
    np.testing.assert_array_equal(poses[:11, 3], poses[:11, 1])


# --- displacement ---


@pytest.mark.parametrize(
    "make", [two_rollers, planar, lambda s: KinematicPlant(rows(s), np.zeros((len(s), 3)))]
)
def test_a_kidnapped_robot_is_displaced_and_at_rest(make: PlantOf) -> None:
    """By the set distance, for any heading, in one frame; with zero commands it stays there."""
    kidnap = {"kind": "kidnap", "x_m": 0.7, "y_m": -0.4, "heading_deg": 150.0}
    plant = make([with_faults({"kind": "vision-loss"}, kidnap), with_faults()])
    drive(plant, ramp([[1.0, 0.5, 0.5]] * 2, 3.0, SETTLE_FRAMES))
    start = plant.pose()
    poses = stand_still(plant, 1)
    displacement = poses[-1] - start
    # Less the motion of the robot in the frame, at most 1.1 m/s
    np.testing.assert_allclose(displacement[0], [0.7, -0.4, np.radians(150)], atol=0.02)
    final = stand_still(plant, 20)[-1]
    np.testing.assert_allclose(final[0, :2], poses[-1][0, :2], atol=2e-3)
    # Vision's heading differs so much from the robot's estimate that this estimates a bias of its
    # gyro, and turns a little.
    assert final[0, 2] == pytest.approx(poses[-1][0, 2], abs=0.02)


def test_no_sensor_of_a_robot_measures_a_kidnap() -> None:
    """Neither the gyro nor an encoder."""
    kidnap = {"kind": "kidnap", "x_m": 0.3, "heading_deg": 90.0}
    for make in (two_rollers, planar):
        plant = make([with_faults(kidnap, firmware={"heading_gain": 0.0, "gyro_bias_gain": 0.0})])
        stand_still(plant, SETTLE_FRAMES + 5)
        assert plant.pose()[0, 2] == pytest.approx(np.pi / 2, abs=1e-3)
        assert estimated_heading(plant)[0] == pytest.approx(0, abs=1e-3)
        assert np.abs(plant.telemetry().wheel_angle).max() < 0.05
