"""What heat in the motors does to a robot, and what its firmware does about it."""

import numpy as np
import pytest
from driving import FRAME_S, constant, drive, quiet
from driving import mujoco as plant_of
from maxon import OWN, SHEET
from numpy.typing import NDArray
from omni_mj.onboard.firmware import Firmware
from omni_mj.onboard.motors import Motors
from scipy.integrate import solve_ivp

from omni_control.kinematics import Kinematics
from omni_mj.link.radio import Received

COPPER_PER_K, WINDING_HOUSING, HOUSING_AMBIENT = 0.00393, 8.28, 1.57  # copper; maxon's catalogue, K/W
HIGHEST_C = 125.0  # same, of a winding


def test_heat_reaches_the_engines_motors() -> None:
    # Robots whose windings and magnets are cold and hot, against the same command from rest: for one frame, in which
    # the wheels hardly turn, the torque and so the way is that of the voltage, K / R.
    hot = quiet(motor={"winding_c": 125.0, "housing_c": 95.0})
    plant = plant_of([quiet(), hot])
    drive(plant, constant([0.3, 0.0, 0.0], 1, 2))
    cold_peak, hot_peak = plant.telemetry().current_peak
    assert hot_peak == pytest.approx(cold_peak / 1.393, rel=1e-3)  # the first step, wheels at rest
    speed = plant.telemetry().wheel_speed
    assert (np.abs(speed[1]) < 0.97 * np.abs(speed[0])).all()
    drive(plant, constant([0.3, 0.0, 0.0], 59, 2))
    # And for good: a proportional loop with hot motors droops more.
    x = plant.pose()[:, 0]
    assert 0.5 * x[0] < x[1] < x[0] - 1e-3


def test_the_plants_windings_follow_the_currents_that_it_reports() -> None:
    spin_up, frames = 30, 150
    # Small heat capacities, that two seconds warm by tens of kelvins; stiff gears, that take amperes for a steady turn,
    # in which the current at the end of a frame, the one reported, is that of the whole frame: encoders of more than
    # the robot's 2048 counts, of which one is half an ampere.
    light, hardy, fine = {"winding_j_k": 1.0, "housing_j_k": 10.0}, {"cut_off_v": 0.0}, {"encoder_counts": 8192}
    plant = plant_of(
        [quiet(motor=light, battery=hardy, sensors=fine, drive={"gear_friction_nm": f}) for f in (0.2, 0.4)]
    )
    currents, outer, temperatures = [], [], []
    for command in constant([0.0, 0.0, 12.0], frames, 2):
        drive(plant, command[None])
        telemetry = plant.telemetry()
        currents.append(telemetry.current.copy())
        outer.append(OWN.outer_loss(telemetry.current, telemetry.wheel_speed))
        temperatures.append(np.concatenate([telemetry.winding.ravel(), telemetry.housing.ravel()]))
    start = temperatures[spin_up - 1]

    def rates(time: float, state: NDArray) -> NDArray:
        winding, housing = state.reshape(2, 2, 4)
        frame = spin_up + min(int(time / FRAME_S), frames - spin_up - 1)
        heat = currents[frame] ** 2 * OWN.resistance * (1 + COPPER_PER_K * (winding - 25))
        inward, outward = (winding - housing) / WINDING_HOUSING, (housing - 25) / HOUSING_AMBIENT
        return np.concatenate([(heat - inward).ravel() / 1.0, (inward + outer[frame] - outward).ravel() / 10.0])

    ends = (np.arange(frames - spin_up) + 1) * FRAME_S
    solution = solve_ivp(rates, (0, ends[-1]), start, t_eval=ends, max_step=FRAME_S, rtol=1e-6).y.T
    rise = np.array(temperatures[spin_up:]) - start
    assert rise[:, 12:].max() > 0.02
    assert rise[:, :4].max() > 5
    assert rise[:, 4:8].max() > 20
    # 2 % of each robot's largest rise: rollers and encoder counts modulate the current within a frame.
    for robot in (slice(0, 4), slice(4, 8), slice(8, 12), slice(12, 16)):
        expected = (solution - start)[:, robot]
        np.testing.assert_allclose(rise[:, robot], expected, rtol=0, atol=0.02 * expected.max())


def push(derate: bool, speeds: NDArray, error: float, battery_v: NDArray, minutes: float) -> NDArray:
    """Hottest winding (frames, n) of robots whose wheels the carpet holds `error` rad/s below what they are told."""
    n = len(speeds)
    kinematics = Kinematics(np.radians([60.0, 135, 225, 300]), arm=0.08, radius=0.0285)
    loops = {"derate": derate, "turn_gain": 0.0, "nominal_voltage_v": 22.2}
    chosen = [quiet(motor=SHEET, firmware=loops)] * n
    firmware = Firmware(chosen, kinematics, np.zeros(n), FRAME_S, FRAME_S)
    motors = Motors([each.motor for each in chosen], 4, FRAME_S)
    commands = np.stack([0 * speeds, 0 * speeds, (speeds + error) * 0.0285 / 0.08], axis=1)
    turning = np.tile(speeds[:, None], 4)
    angle, hottest = 0 * turning, []
    for _ in range(round(minutes * 60 / FRAME_S)):
        angle = angle + turning * FRAME_S
        firmware.receive(Received.at_once(commands), motors.winding)
        duty = firmware.duties(np.zeros(n), angle)
        motors.warm(motors.drive(duty * battery_v[:, None], turning)[1][None], turning[None])
        hottest.append(motors.winding.max(1))
    return np.array(hottest)


def test_derating_keeps_the_winding_below_its_limit() -> None:
    """Against a wall and at 1.7 m/s, with an empty, a nominal and a full battery."""
    speeds, battery_v = np.repeat([0.0, 60.0], 3), np.tile([20.4, 22.2, 25.2], 2)
    # Twenty rad/s behind, a k_p of 0.3 drives 6 V into less than an ohm: the winding passes its limit within seconds.
    assert (push(False, speeds, 20.0, battery_v, 0.5)[-1] > HIGHEST_C).all()
    limited = push(True, speeds, 20.0, battery_v, 1.0).max(0)
    assert (limited < HIGHEST_C).all()
    # It limits no more than it must: the motor is used up to within the band where derating begins.
    assert (limited > HIGHEST_C - 10).all()
