"""Losses between motor and carpet: weak motors, gears under load, and no battery."""

import mujoco
import numpy as np
import pytest
from benches.plant import (
    LOSSLESS,
    RADIUS_M,
    TANGENTS,
    WHEELED_PLANTS,
    PlantOf,
    constant,
    drive,
    noiseless,
    with_settings,
)
from numpy.typing import NDArray

import omni_mj as om
from omni_mj.mjcf.robot_builder import build_robot_spec

ROLL_OUT_DRAG_N = 2.7  # of the robot ssl-a-team, forward
STANDING = constant((0, 0, 0), 10, 2)
IDEAL = noiseless(
    wheels={"model": "two-rollers"},
    carpet={"rolling_resistance": 0.0},
    drivetrain=LOSSLESS | {"creep_stiffness": 1000.0},
    motor={"dry_friction_fraction": 0.0, "no_load_current_a": 0.0, "torque_factor": 1.0},
)


@WHEELED_PLANTS
@pytest.mark.parametrize(
    ("lossy", "driving", "braking"),
    [
        ({"motor": {"torque_factor": 0.7}}, 0.7, 0.7),
        ({"drivetrain": {"efficiency": 0.7}}, 0.7, 1.3),
    ],
    ids=["motor", "gear"],
)
def test_a_weak_motor_passes_less_in_both_directions_and_a_gear_rubs_in_both(
    lossy: dict[str, dict[str, float]], driving: float, braking: float, plant_of: PlantOf
) -> None:
    """Ratio of the accelerations by the same currents to those without losses.

    2 % and 4 %: rollers are spun up, and carpet is compressed, in proportion to the speed, which is
    higher without losses.
    """
    plant = plant_of([IDEAL, IDEAL.replace(**lossy)])
    currents = np.sign(TANGENTS[:, 0]) * np.ones((2, 1))
    plant.set_motor_currents(currents)
    drive(plant, STANDING)
    lossless_speed, lossy_speed = plant.twist()[:, 0]
    assert lossless_speed > 0.3
    assert lossy_speed / lossless_speed == pytest.approx(driving, rel=0.02)
    plant.set_motor_currents(-0.5 * currents)
    drive(plant, STANDING[:5])
    lossless_change, lossy_change = plant.twist()[:, 0] - [lossless_speed, lossy_speed]
    assert lossy_change / lossless_change == pytest.approx(braking, rel=0.04)


@WHEELED_PLANTS
def test_acceleration_triangles_of_ssl_a_team_are_not_exceeded(plant_of: PlantOf) -> None:
    """Currents for m a and friction, tuned at 1 m/s^2, fall short at 0.75 and 2 m/s^2.

    Published for a real robot: 14, 3 and 22 % short (SSL-A-Team/controls at d1a83b2,
    analysis/ros_scripts/accel_tuning/README.md: +a, 0 and -a for 0.5 s each; mean of the slopes of
    the speed in the first and last part). Motors with one constant for driving and braking are
    within 2 % of the command, because drag cancels in the mean. Losses that brake exceed it by
    11 % at 2 m/s^2.
    """
    published = np.array([-0.14, -0.03, -0.22])
    commanded, part = np.array([0.75, 1.0, 2.0]), 30
    robot = om.load_scenario("rect", robot="ssl-a-team").settings
    constant_at_rim = robot.motor.torque_constant_nm_a / robot.wheels.radius_m
    force_shares = np.linalg.pinv(robot.wheels.kinematics.matrix.T)[:, 0]

    def measure_errors(efficiency: float) -> NDArray:
        plant = plant_of([robot.replace(physics={"backend": "numpy"})] * 3)
        speeds = [np.zeros(3)]
        for acceleration in np.repeat([1.0, 0.0, -1.0], part)[:, None] * commanded:
            friction = ROLL_OUT_DRAG_N * np.sign(speeds[-1].round(4))
            force = (robot.body.mass_kg * acceleration + friction) / efficiency
            plant.set_motor_currents(force[:, None] * force_shares / constant_at_rim)
            drive(plant, constant((0, 0, 0), 1, 3))
            speeds.append(plant.twist()[:, 0])
        times = np.arange(part + 1) / 60
        up, down = (
            np.polyfit(times, ramp, 1)[0] for ramp in (speeds[: part + 1], speeds[2 * part :])
        )
        return np.asarray((up - down) / 2 / commanded - 1)

    tuned = 1 + measure_errors(1.0)[1]
    tuned *= 1 + measure_errors(tuned)[1]
    errors = measure_errors(tuned)
    assert abs(errors[1]) < 0.01, "tuned as the real robot"
    assert (published < errors).all()
    assert (errors < 0.02).all()


@pytest.mark.parametrize("plant", ["mujoco", "planar"])
def test_a_robot_coasts_when_its_battery_switches_off(plant: str) -> None:
    """Its deceleration is that of a robot whose motors carry no current, not that of brakes."""
    scenario = om.load_scenario(
        "sprint",
        plant=plant,
        physics={"backend": "numpy"},
        reference={"waypoints": [[0, 0], [3, 0]]},
        wheels={"model": "two-rollers"},
        battery={"resistance_ohm": 0.5, "cut_off_v": 14.2},
    )
    frames = om.run(scenario, ["comp-flc"], seeds=1).frames()
    voltage = frames["battery_voltage_v"].to_numpy()
    speed = np.hypot(*(np.gradient(frames[axis].to_numpy(), 1 / 60) for axis in ("x_m", "y_m")))
    off = np.flatnonzero(voltage <= 0)
    assert speed[off[0]] > 1.5
    coasting = speed[off[3] : off[3] + 30]
    currents = [frames[f"current_{i}_a"].to_numpy()[off[3:]] for i in range(1, 5)]
    np.testing.assert_allclose(currents, 0.0, atol=1e-9)
    # Roll-out drag, 4.4 N, over the mass with rotors; shorted motors brake with 6 m/s^2.
    assert 1.3 < (coasting[0] - coasting[-1]) * 60 / 29 < 2.2


def test_hubs_grow_with_the_wheel() -> None:
    """Discs of constant thickness: mass grows with the square, inertia with its square."""
    hubs = []
    for factor in (1.0, 1.2):
        settings = with_settings(wheels={"radius_m": RADIUS_M * factor, "rollers": 20})
        model = build_robot_spec(settings.mechanics).spec.compile()
        hub = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "wheel_1")
        hubs.append([model.body_mass[hub], model.body_inertia[hub].max()])
    np.testing.assert_allclose(np.divide(hubs[1], hubs[0]), [1.2**2, 1.2**4])
