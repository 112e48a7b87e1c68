"""The model's motor against the datasheet of the maxon EC 45 flat, 50 W, 24 V, and against the laws of a DC motor."""

from dataclasses import dataclass

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from omni_mj.onboard.motors import Motors
from omni_mj.scenarios import models
from omni_mj.scenarios.settings import MotorSettings
from omni_mj.worlds import build

# The catalogue's rows, in SI.
NOMINAL_V = 24.0
STALL_TORQUE, STALL_CURRENT = 0.918, 26.0
NO_LOAD_RPM, NO_LOAD_CURRENT = 6250.0, 0.238
NOMINAL_TORQUE, NOMINAL_RPM, NOMINAL_CURRENT = 91.1e-3, 5170.0, 2.52
TORQUE_CONSTANT, RESISTANCE, ROTOR_INERTIA = 0.036, 0.942, 135e-7
SPEED_CONSTANT_RPM_V = 265.0
TIME_CONSTANT = 9.79e-3
GEAR = 60 / 18
COMMUTATION = 1.27e-3  # ohm s/rad: R(w) = R + X |w| fits the nominal point (FACTS of the design)

FINE_STEP = 1e-5  # a thousandth of the time constant: the integrator's error is then below 0.1 %
RPM = 60 / (2 * np.pi)


def bench(timestep: float | None = None, massless_wheels: bool = False, held: bool = False) -> mujoco.MjModel:
    """The robot clamped in the air, without gear and lint: a wheel's inertia and the motor's own friction remain."""
    spec = mujoco.MjSpec.from_file(str(models.model_path("ssl_robot")))
    spec.delete(spec.key("home"))
    spec.delete(spec.joint("robot"))
    spec.option.gravity = [0, 0, 0]
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    spec.option.timestep = timestep or build.CYCLE_S
    for i in range(1, 5):
        spec.joint(f"wheel_{i}").frictionloss = build.world().motor_friction
        if held:
            spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=f"wheel_{i}")
    if massless_wheels:
        for joint in spec.joints:
            joint.damping = [0, 0, 0]  # of the rollers' bearings: explicit integration needs some inertia beside it
        for body in spec.bodies:
            if body.name.startswith(("wheel", "roller")):
                body.mass, body.inertia = 1e-9, [1e-12] * 3
    return spec.compile()


BENCH = bench()


@dataclass
class Run:
    """Motor 1 over time: the state before each step and the torque that acted in it, on the motor's shaft."""

    timestep: float
    speed: NDArray
    torque: NDArray  # from the engine
    voltage: NDArray  # at the terminals
    told: NDArray  # current that Motors reports

    @property
    def current(self) -> NDArray:
        return self.torque / TORQUE_CONSTANT


def run(
    model: mujoco.MjModel,
    seconds: float,
    voltage: float,
    start_speed: float = 0.0,
    load: float = 0.0,
    settings: MotorSettings | None = None,
) -> Run:
    """Drive motor 1 at a voltage, from a speed of its shaft, against a load torque on its shaft."""
    data = mujoco.MjData(model)
    motors = Motors(build.world().motor, 4, [settings or MotorSettings()], 1 / 60)
    wheel = model.joint("wheel_1").dofadr[0]
    wheels = [model.joint(f"wheel_{i}").dofadr[0] for i in (1, 2, 3, 4)]
    data.qvel[wheel] = start_speed / GEAR
    data.qfrc_applied[wheel] = -load * GEAR
    terminals = np.array([[voltage, 0.0, 0.0, 0.0]])
    speed, torque, told = [], [], []
    for _ in range(round(seconds / model.opt.timestep)):
        speed.append(data.qvel[wheel] * GEAR)
        data.ctrl[:], current = motors.drive(terminals, data.qvel[None, wheels])
        mujoco.mj_step(model, data)
        torque.append(data.actuator_force[0])
        told.append(current[0, 0])
    return Run(model.opt.timestep, np.array(speed), np.array(torque), np.full(len(speed), voltage), np.array(told))


def time_constant(result: Run) -> float:
    """From the slope of log(speed still missing), down to a tenth of it; constant friction does not change it."""
    missing = 1 - result.speed / result.speed[-1]
    rising = missing > 0.1
    return float(-result.timestep / np.polyfit(np.arange(rising.sum()), np.log(missing[rising]), 1)[0])


def wheel_inertia() -> float:
    """Wheel with its rollers about the axle, kg m^2: the parallel axis theorem on the bodies of the model."""
    model = build.world().model
    wheel = model.body("robot_1/wheel_1")
    total = float(wheel.inertia[0])
    for i in range(model.nbody):
        if model.body_parentid[i] == wheel.id:
            # The roller's own axis is tangential: about the axle, one of its two equal, larger moments counts.
            total += float(model.body_inertia[i].max() + model.body_mass[i] * (model.body_pos[i] ** 2).sum())
    return total


def no_load_speed(voltage: float) -> float:
    """V = (R + X w) I_0 + K w with the current I_0 of the dry friction, solved for the shaft's speed w, rad/s."""
    return (voltage - RESISTANCE * NO_LOAD_CURRENT) / (TORQUE_CONSTANT + COMMUTATION * NO_LOAD_CURRENT)


@pytest.fixture(scope="module")
def spin_up() -> Run:
    return run(bench(FINE_STEP), 0.24, NOMINAL_V)


def test_python_reads_the_datasheets_numbers_from_the_model() -> None:
    motor = build.world().motor
    assert (motor.constant, motor.resistance) == (TORQUE_CONSTANT, RESISTANCE)
    assert motor.gear == pytest.approx(GEAR, rel=1e-8)  # nine digits in the file


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


def test_a_full_battery_is_the_most_a_motor_gets() -> None:
    model = bench()
    data = mujoco.MjData(model)
    data.ctrl[:] = 100.0
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.actuator_force, TORQUE_CONSTANT * 25.2 / RESISTANCE)  # 6 cells of 4.2 V


def test_torque_constant_agrees_with_the_speed_constant() -> None:
    # One physical constant, printed twice; three digits each.
    assert build.world().motor.constant == pytest.approx(RPM / SPEED_CONSTANT_RPM_V, rel=2e-3)


@pytest.mark.parametrize("voltage", [6.0, 12.0, -12.0, 24.0])
def test_no_load_speed_is_that_of_the_back_emf_less_friction_and_commutation(voltage: float) -> None:
    result = run(bench(), 0.4, voltage)
    # 0.1 %: MuJoCo's friction is a soft constraint.
    assert result.speed[-1] == pytest.approx(np.sign(voltage) * no_load_speed(abs(voltage)), rel=1e-3)


def test_no_load_point_of_the_datasheet(spin_up: Run) -> None:
    # 2 %: samples of the motor. Without the commutation drop the speed would be 1 % above.
    assert spin_up.speed[-1] * RPM == pytest.approx(NO_LOAD_RPM, rel=0.02)
    assert spin_up.current[-1] == pytest.approx(NO_LOAD_CURRENT, rel=0.02)


def test_nominal_point_of_the_datasheet() -> None:
    result = run(bench(), 0.4, NOMINAL_V, start_speed=NOMINAL_RPM / RPM, load=NOMINAL_TORQUE)
    assert result.speed[-1] == pytest.approx(result.speed[-100], rel=1e-4)  # steady
    assert result.speed[-1] * RPM == pytest.approx(NOMINAL_RPM, rel=0.02)
    # 12 %: the sheet's rows disagree. Torque over torque constant is 2.53 A for the load alone, 2.77 A with friction.
    assert result.current[-1] == pytest.approx(NOMINAL_CURRENT, rel=0.12)
    assert result.current[-1] == pytest.approx(NOMINAL_TORQUE / TORQUE_CONSTANT + NO_LOAD_CURRENT, rel=1e-3)


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
@given(st.floats(-25, 25), st.floats(-700, 700), st.floats(0, 5e-3))
def test_the_engine_drives_the_current_that_is_reported(voltage: float, speed: float, commutation: float) -> None:
    chosen = MotorSettings(commutation_ohm_s=commutation)
    result = run(BENCH, 1 / 960, voltage, start_speed=speed, settings=chosen)
    # Kirchhoff on the current that makes the engine's torque, commutation's drop included; exact up to rounding, but
    # for speeds whose back-EMF with its drop is beyond the range of the actuator's voltage.
    if abs(TORQUE_CONSTANT * speed) > 25:
        return
    current = result.current[0]
    back_emf = TORQUE_CONSTANT * speed
    assert current * (RESISTANCE + commutation * abs(speed)) + back_emf == pytest.approx(voltage, abs=1e-6)
    assert result.told[0] == pytest.approx(current, abs=1e-6)
    # Commutation costs, it never drives: the current keeps its sign and shrinks.
    line = (voltage - back_emf) / RESISTANCE
    assert abs(current) <= abs(line) + 1e-6
    assert current * line >= 0


def test_mechanical_time_constant_of_the_bare_motor() -> None:
    # A small step, for the sheet's figure is R J / K^2 of the line at standstill: at 1 V commutation adds at most 2 %
    # to R, at 24 V it almost doubles it at full speed.
    result = run(bench(FINE_STEP, massless_wheels=True), 0.12, 1.0)
    # 5 %: the catalogue's 9.79 ms and its own R J / K^2 = 9.81 ms differ by 0.3 %, samples of the motor by more.
    assert time_constant(result) == pytest.approx(TIME_CONSTANT, rel=0.05)


def test_the_wheel_adds_its_inertia_to_the_rotors() -> None:
    result = run(bench(FINE_STEP), 0.12, NOMINAL_V, settings=MotorSettings(commutation_ohm_s=0.0))
    inertia = ROTOR_INERTIA + wheel_inertia() / GEAR**2
    # Integration error at the fine step and the fit's start-up, both below 0.5 %.
    assert time_constant(result) == pytest.approx(RESISTANCE * inertia / TORQUE_CONSTANT**2, rel=5e-3)


def test_spin_up_follows_the_differential_equation(spin_up: Run) -> None:
    inertia = ROTOR_INERTIA + wheel_inertia() / GEAR**2

    def acceleration(time: float, speed: NDArray) -> NDArray:
        current = (NOMINAL_V - TORQUE_CONSTANT * speed) / (RESISTANCE + COMMUTATION * speed)
        return TORQUE_CONSTANT * (current - NO_LOAD_CURRENT) / inertia

    time = np.arange(len(spin_up.speed)) * FINE_STEP
    solution = solve_ivp(acceleration, (0, time[-1]), [0.0], t_eval=time, rtol=1e-8, atol=1e-8)
    # 0.2 % of the final speed: Euler's error h / (2 e tau) is 0.02 %, the soft friction's 0.1 %.
    np.testing.assert_allclose(spin_up.speed, solution.y[0], atol=2e-3 * solution.y[0, -1])


def test_the_physics_step_is_short_for_the_motor() -> None:
    result = run(bench(), 0.12, NOMINAL_V, settings=MotorSettings(commutation_ohm_s=0.0))
    inertia = ROTOR_INERTIA + wheel_inertia() / GEAR**2
    exact = RESISTANCE * inertia / TORQUE_CONSTANT**2
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
    friction = TORQUE_CONSTANT * NO_LOAD_CURRENT * speed.sum() * FINE_STEP
    kinetic = 0.5 * (ROTOR_INERTIA + wheel_inertia() / GEAR**2) * spin_up.speed[until] ** 2
    # Both large, so that neither can hide the other's error. The sums err by about half a step of 3000; 0.2 % leaves
    # room for that and for the soft friction.
    assert min(heat, kinetic) > 0.3 * electrical
    assert heat + friction + kinetic == pytest.approx(electrical, rel=2e-3)


@pytest.mark.parametrize(("share", "sign"), [(1.3, -1), (0.5, 1)], ids=["faster: brakes", "slower: drives"])
def test_current_changes_sign_at_the_speed_of_equal_back_emf(share: float, sign: int) -> None:
    result = run(bench(), 0.01, NOMINAL_V, start_speed=share * NOMINAL_V / TORQUE_CONSTANT)
    assert np.sign(result.current[0]) == sign
