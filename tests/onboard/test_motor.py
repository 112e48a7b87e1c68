"""The model's motor against the datasheet of the maxon EC 45 flat, 50 W, 24 V, and against the laws of a DC motor."""

import mujoco
import numpy as np
import pytest
from driving import constant, drive, rows
from hypothesis import given, settings
from hypothesis import strategies as st
from maxon import MAXON, ROBOTS, RPM, SHEET, sheet
from motor_bench import CLAMPED, FINE_STEP, Run, bench, run
from numpy.typing import NDArray
from omni_mj.onboard.motor import Motor
from omni_mj.onboard.motors import Motors
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.scenarios import models, scenario
from omni_mj.scenarios.settings import Settings
from omni_mj.worlds import build

# The catalogue's rows, in SI; those that settings have are in the sheet.
NOMINAL_V, NOMINAL_CURRENT, NOMINAL_TORQUE = 24.0, 2.52, 91.1e-3
NO_LOAD_RPM, NO_LOAD_CURRENT, NOMINAL_RPM = 6250.0, 0.238, 5170.0
TORQUE_CONSTANT, RESISTANCE, ROTOR_INERTIA = 0.036, 0.942, 135e-7
STALL_TORQUE, STALL_CURRENT = 0.918, 26.0
SPEED_CONSTANT_RPM_V = 265.0
TIME_CONSTANT = 9.79e-3
GEAR, COMMUTATION = MAXON.gear, MAXON.commutation
SHAFT_DRY, SHAFT_VISCOUS = MAXON.dry, MAXON.viscous
# A motor whose nominal row lies on the line of resistance and torque constant: no commutation, but for 1e-6 ohm s.
ON_THE_LINE = sheet(nominal_rpm=5736.0)


BENCH = bench()


def time_constant(result: Run) -> float:
    """From the slope of log(speed still missing), down to a tenth of it; constant friction does not change it."""
    missing = 1 - result.speed / result.speed[-1]
    rising = missing > 0.1
    return float(-result.timestep / np.polyfit(np.arange(rising.sum()), np.log(missing[rising]), 1)[0])


def wheel_inertia() -> float:
    """Hub with rim and rollers about the axle, kg m^2: the parallel axis theorem on the bodies of the model."""
    model = build.world(CLAMPED).model
    wheel, rim = (model.body(f"robot_1/{name}_1") for name in ("wheel", "rim"))
    total = float(wheel.inertia[0] + rim.inertia[0])
    for i in range(model.nbody):
        if model.body_parentid[i] == rim.id:
            # The roller's own axis is tangential: about the axle, one of its two equal, larger moments counts.
            total += float(model.body_inertia[i].max() + model.body_mass[i] * (model.body_pos[i] ** 2).sum())
    return total


def line_time_constant() -> float:
    """J / (K^2 / R + d): of a motor without commutation that turns a wheel, with the viscous friction d, s."""
    inertia = ROTOR_INERTIA + wheel_inertia() / GEAR**2
    return inertia / (TORQUE_CONSTANT**2 / RESISTANCE + SHAFT_VISCOUS)


def friction(speed: float) -> float:
    """The motor's own, at a speed of its shaft, rad/s: N m."""
    return SHAFT_DRY + SHAFT_VISCOUS * speed


def no_load_speed(voltage: float) -> float:
    """The shaft's, rad/s: V = (R + X w) I + K w with the current that overcomes the motor's friction."""

    def missing(speed: float) -> float:
        current = friction(speed) / TORQUE_CONSTANT
        return (RESISTANCE + COMMUTATION * speed) * current + TORQUE_CONSTANT * speed - voltage

    return float(brentq(missing, 0, voltage / TORQUE_CONSTANT))


@pytest.fixture(scope="module")
def spin_up() -> Run:
    return run(bench(FINE_STEP), 0.24, NOMINAL_V)


def test_settings_and_model_hold_the_datasheets_numbers() -> None:
    world, motor = build.world(Settings(motor=SHEET)), Motor.of(sheet())
    actuators = world.robots[0].motors
    assert (motor.constant, motor.resistance, motor.gear) == (TORQUE_CONSTANT, RESISTANCE, 60 / 18)
    assert motor.inertia == ROTOR_INERTIA
    np.testing.assert_array_equal(world.model.actuator_armature[actuators], ROTOR_INERTIA)
    np.testing.assert_allclose(world.model.actuator_gear[actuators, 0], GEAR, rtol=1e-12)
    assert motor.commutation == pytest.approx(COMMUTATION, rel=1e-12)
    assert (motor.dry, motor.viscous) == pytest.approx((SHAFT_DRY, SHAFT_VISCOUS), rel=1e-12)
    assert (motor.wheel_dry, motor.wheel_viscous) == pytest.approx((SHAFT_DRY * GEAR, SHAFT_VISCOUS * GEAR**2))
    assert motor.dry + motor.viscous * NO_LOAD_RPM / RPM == pytest.approx(TORQUE_CONSTANT * NO_LOAD_CURRENT, rel=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_plant_drives_each_robots_own_motor(name: str) -> None:
    """What the engine reckons with, in a plant that has driven a cold robot for a frame, is the sheet's."""
    cold = scenario.scenario("rect", robot=name).settings
    plant, own = MujocoPlant(rows([cold], robot=name), np.zeros((1, 3))), ROBOTS[name]
    drive(plant, constant([0.5, 0.0, 0.0], 1, 1))
    model = plant._batch.get_model(0)
    np.testing.assert_allclose(model.actuator_gainprm[:, :2], [[own.resistance, own.constant]] * 4, rtol=1e-12)
    np.testing.assert_allclose(model.actuator_gear[:, 0], own.gear, rtol=1e-12)


def test_stall() -> None:
    data = mujoco.MjData(BENCH)
    wheels = [BENCH.joint(f"wheel_{i}").dofadr[0] for i in (1, 2, 3, 4)]
    for sign in (1, -1):
        data.ctrl[:] = sign * NOMINAL_V
        mujoco.mj_forward(BENCH, data)  # at rest, as a held shaft is
        # 2 % and 3 %: K V / R is 0.1 % below the catalogue's torque, V / R 2 % below its current, rounded to 26 A.
        np.testing.assert_allclose(data.actuator_force, sign * STALL_TORQUE, rtol=0.02)
        np.testing.assert_allclose(data.actuator_force / TORQUE_CONSTANT, sign * STALL_CURRENT, rtol=0.03)
        np.testing.assert_allclose(data.qfrc_actuator[wheels], sign * STALL_TORQUE * GEAR, rtol=0.02)


def test_the_robots_file_by_itself_has_its_motor_and_its_full_battery() -> None:
    model, settings = mujoco.MjModel.from_xml_path(str(models.robot_path())), Settings()
    data = mujoco.MjData(model)
    data.ctrl[:] = 100.0
    mujoco.mj_forward(model, data)
    own = ROBOTS["tigers-v2016"]
    full = 4.2 * settings.battery.cells
    np.testing.assert_allclose(data.actuator_force, own.constant * full / own.resistance)


def test_torque_constant_agrees_with_the_speed_constant() -> None:
    # One physical constant, printed twice; three digits each.
    assert Motor.of(sheet()).constant == pytest.approx(RPM / SPEED_CONSTANT_RPM_V, rel=2e-3)


@pytest.mark.parametrize("voltage", [6.0, 12.0, -12.0, 24.0])
def test_no_load_speed_is_that_of_the_back_emf_less_friction_and_commutation(voltage: float) -> None:
    result = run(bench(), 0.4, voltage)
    # 0.1 %: MuJoCo's friction is a soft constraint.
    assert result.speed[-1] == pytest.approx(np.sign(voltage) * no_load_speed(abs(voltage)), rel=1e-3)


def test_no_load_point_of_the_datasheet(spin_up: Run) -> None:
    # 2 %: samples of the motor. Without the commutation drop the speed would be 1 % above.
    assert spin_up.speed[-1] * RPM == pytest.approx(NO_LOAD_RPM, rel=0.02)
    assert spin_up.current[-1] == pytest.approx(NO_LOAD_CURRENT, rel=0.02)


def test_nominal_current_at_nominal_voltage_and_speed() -> None:
    turning = np.full((1, 4), NOMINAL_RPM / RPM / GEAR)
    voltage, current = Motors([sheet()], 4, 1 / 60).drive(np.full((1, 4), NOMINAL_V), turning)
    # What commutation is derived from: exact.
    np.testing.assert_allclose(current, NOMINAL_CURRENT, rtol=1e-9)
    np.testing.assert_array_equal(voltage, NOMINAL_V)


def test_nominal_point_of_the_datasheet() -> None:
    # The sheet's nominal torque is that of the air gap (36 mN m/A * 2.52 A is 90.7 mN m): its friction is in it.
    load = NOMINAL_TORQUE - friction(NOMINAL_RPM / RPM)
    result = run(bench(), 0.4, NOMINAL_V, start_speed=NOMINAL_RPM / RPM, load=load)
    assert result.speed[-1] == pytest.approx(result.speed[-100], rel=1e-4)  # steady
    assert result.speed[-1] * RPM == pytest.approx(NOMINAL_RPM, rel=0.02)
    # 3 %: 0.5 % for torque over torque constant, which is 2.53 A. With friction on top it would be 2.74 A.
    assert result.current[-1] == pytest.approx(NOMINAL_CURRENT, rel=0.03)
    assert result.current[-1] == pytest.approx(NOMINAL_TORQUE / TORQUE_CONSTANT, rel=1e-3)


def test_stall_point_of_the_datasheet() -> None:
    # Held: torque and current. The catalogue's 26 A is 25.5 A rounded up: 918 mN m / 36 mN m/A, while 24 V / 0.942 ohm
    # is 25.48 A. So 2 % of the 25.5 A that the sheet's own torque needs, and 2.1 % of the two digits printed.
    held = run(bench(held=True), 0.5, NOMINAL_V)
    assert abs(held.speed[-1]) < 1e-3 * NO_LOAD_RPM / RPM
    assert held.torque[-1] == pytest.approx(STALL_TORQUE, rel=0.02)
    assert held.current[-1] == pytest.approx(STALL_TORQUE / TORQUE_CONSTANT, rel=0.02)
    assert held.current[-1] == pytest.approx(STALL_CURRENT, rel=0.021)


@pytest.mark.parametrize(("share", "direction"), [(0.98, 1), (1.02, -1)])
def test_a_load_of_the_stall_torque_within_2_percent_stops_the_motor(share: float, direction: int) -> None:
    # The load at the shaft, friction (0.9 %) included: less is lifted, more turns the motor back.
    result = run(bench(), 0.2, NOMINAL_V, load=share * STALL_TORQUE)
    assert direction * result.speed[-1] > 0
    assert direction * (result.speed[-1] - result.speed[-100]) >= 0


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.floats(-25, 25), st.floats(-700, 700), st.floats(0.3, 1.79))
def test_the_engine_drives_the_current_that_is_reported(voltage: float, speed: float, resistance: float) -> None:
    result = run(BENCH, 1 / 960, voltage, start_speed=speed, settings=sheet(resistance_ohm=resistance))
    # Kirchhoff on the current that makes the engine's torque, commutation's drop included; exact up to rounding.
    current = result.current[0]
    back_emf = TORQUE_CONSTANT * speed
    # The nominal row leaves commutation what the resistance does not take.
    nominal = NOMINAL_RPM / RPM
    drop = NOMINAL_V - TORQUE_CONSTANT * nominal - resistance * NOMINAL_CURRENT
    commutation = drop / (nominal * NOMINAL_CURRENT)
    assert current * (resistance + commutation * abs(speed)) + back_emf == pytest.approx(voltage, abs=1e-6)
    assert result.told[0] == pytest.approx(current, abs=1e-6)
    # Commutation costs, it never drives: the current keeps its sign and shrinks.
    line = (voltage - back_emf) / resistance
    assert abs(current) <= abs(line) + 1e-6
    assert current * line >= 0


def test_mechanical_time_constant_of_the_bare_motor() -> None:
    # A small step, for the sheet's figure is R J / K^2 of the line at standstill: at 1 V commutation adds at most 2 %
    # to R, at 24 V it almost doubles it at full speed.
    result = run(bench(FINE_STEP, massless_wheels=True), 0.12, 1.0)
    # 5 %: the catalogue's 9.79 ms and its own R J / K^2 = 9.81 ms differ by 0.3 %, samples of the motor by more;
    # viscous friction takes 0.7 %.
    assert time_constant(result) == pytest.approx(TIME_CONSTANT, rel=0.05)


def test_the_wheel_adds_its_inertia_to_the_rotors() -> None:
    result = run(bench(FINE_STEP), 0.12, NOMINAL_V, settings=ON_THE_LINE)
    # Integration error at the fine step and the fit's start-up, both below 0.5 %.
    assert time_constant(result) == pytest.approx(line_time_constant(), rel=5e-3)


def test_spin_up_follows_the_differential_equation(spin_up: Run) -> None:
    inertia = ROTOR_INERTIA + wheel_inertia() / GEAR**2

    def acceleration(time: float, speed: NDArray) -> NDArray:
        current = (NOMINAL_V - TORQUE_CONSTANT * speed) / (RESISTANCE + COMMUTATION * speed)
        return (TORQUE_CONSTANT * current - friction(speed[0])) / inertia

    time = np.arange(len(spin_up.speed)) * FINE_STEP
    solution = solve_ivp(acceleration, (0, time[-1]), [0.0], t_eval=time, rtol=1e-8, atol=1e-8)
    # 0.2 % of the final speed: Euler's error h / (2 e tau) is 0.02 %, the soft friction's 0.1 %.
    np.testing.assert_allclose(spin_up.speed, solution.y[0], atol=2e-3 * solution.y[0, -1])


def test_the_physics_step_is_short_for_the_motor() -> None:
    result = run(bench(), 0.12, NOMINAL_V, settings=ON_THE_LINE)
    exact = line_time_constant()
    # Explicit Euler multiplies the missing speed by 1 - h / tau in each step: a time constant 4.7 % too short.
    euler = -result.timestep / np.log(1 - result.timestep / exact)
    assert time_constant(result) == pytest.approx(euler, rel=5e-3)  # the fit over few steps
    assert euler == pytest.approx(exact, rel=0.05)


def test_terminal_voltage_is_resistive_drop_plus_back_emf(spin_up: Run) -> None:
    # At every instant, not only at the two ends of the line; exact arithmetic up to rounding.
    resistance = RESISTANCE + COMMUTATION * spin_up.speed
    np.testing.assert_allclose(
        resistance * spin_up.current + TORQUE_CONSTANT * spin_up.speed, spin_up.voltage, rtol=1e-7
    )


def test_energy_balance(spin_up: Run) -> None:
    until = round(0.03 / FINE_STEP)
    speed, current = spin_up.speed[:until], spin_up.current[:until]
    electrical = (spin_up.voltage[:until] * current).sum() * FINE_STEP
    heat = ((RESISTANCE + COMMUTATION * speed) * current**2).sum() * FINE_STEP
    lost = ((SHAFT_DRY + SHAFT_VISCOUS * speed) * speed).sum() * FINE_STEP
    kinetic = 0.5 * (ROTOR_INERTIA + wheel_inertia() / GEAR**2) * spin_up.speed[until] ** 2
    # Both large, so that neither can hide the other's error. The sums err by about half a step of 3000; 0.2 % leaves
    # room for that and for the soft friction.
    assert min(heat, kinetic) > 0.3 * electrical
    assert heat + lost + kinetic == pytest.approx(electrical, rel=2e-3)


@pytest.mark.parametrize(("share", "sign"), [(1.3, -1), (0.5, 1)], ids=["faster: brakes", "slower: drives"])
def test_current_changes_sign_at_the_speed_of_equal_back_emf(share: float, sign: int) -> None:
    result = run(bench(), 0.01, NOMINAL_V, start_speed=share * NOMINAL_V / TORQUE_CONSTANT)
    assert np.sign(result.current[0]) == sign
