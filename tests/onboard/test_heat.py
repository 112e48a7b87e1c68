"""Heat in the motors: two nodes against an ODE solver, closed forms and the datasheet."""

import numpy as np
import pytest
from driving import FRAME_S
from hypothesis import given, settings
from hypothesis import strategies as st
from maxon import MAXON, ROBOTS, SHEET, sheet
from numpy.typing import NDArray
from omni_mj.onboard.motors import Motors
from scipy.integrate import solve_ivp

from omni_mj.scenarios import robots, scenario
from omni_mj.scenarios.motor_settings import MotorSettings

COPPER_PER_K = 0.00393
# maxon's catalogue: thermal resistances in K/W, time constants in s, the winding's highest temperature in deg C.
WINDING_HOUSING, HOUSING_AMBIENT = 8.28, 1.57
WINDING_TIME, MOTOR_TIME = 28.8, 78.3
WINDING_J_K, HOUSING_J_K = 3.48, 49.9  # heat capacities: time constant over resistance, to three digits
HIGHEST_C = 125.0
NOMINAL_CURRENT, NOMINAL_SPEED = 2.52, 5170 * np.pi / 30 * 18 / 60  # A, and rad/s of the wheel


def hold(motors: Motors, current: float, periods: int, speed: float = 0.0) -> tuple[NDArray, NDArray]:
    """Temperatures (periods + 1, 4) of the first robot's windings and housings, at one current and wheel speed."""
    load, turning = np.full((2, 1, *motors.winding.shape), [[[[current]]], [[[speed]]]])
    winding, housing = [motors.winding[0]], [motors.housing[0]]
    for _ in range(periods):
        motors.warm(load, turning)
        winding.append(motors.winding[0])
        housing.append(motors.housing[0])
    return np.array(winding), np.array(housing)


def steady(
    current: float, ambient: float, outer: float, resistance: float = 0.942, inward: float = WINDING_HOUSING
) -> tuple[float, float]:
    """Winding and housing in equilibrium with `outer` W into the housing: i^2 R(T_w) flows through both resistances.

    Linear in T_w, solved for it. `inward` is the resistance between the two, K/W.
    """
    cold, housing = current**2 * resistance, ambient + HOUSING_AMBIENT * outer
    through = inward + HOUSING_AMBIENT
    rise = cold * (1 + COPPER_PER_K * (housing - 25)) * through / (1 - cold * COPPER_PER_K * through)
    return housing + rise, housing + HOUSING_AMBIENT * rise / through


def test_five_minutes_of_duty_cycle_against_an_ode_solver() -> None:
    rng = np.random.default_rng(3)
    segment, n = 300, 2  # 5 s, 5 min, two robots
    # Rest, nominal current, about twice that, of either sign, and a ripple within each frame.
    levels = rng.choice(
        [0.0, 1.0, -2.5, 2.5, 4.0, -5.0, 5.0], p=[0.3, 0.2, 0.15, 0.15, 0.1, 0.05, 0.05], size=(60, n, 4)
    )
    speeds = rng.uniform(-150, 150, (60, n, 4))  # of the wheels: up to the motor's nominal, either way
    ripple = 1 + 0.3 * np.sin(2 * np.pi * np.arange(4) / 4)[:, None, None]  # in fewer steps than a frame has
    chosen = [sheet(winding_c=60.0, housing_c=40.0, ambient_c=20.0), sheet(ambient_c=35.0)]
    motors = Motors(chosen, 4, FRAME_S)
    ambient = np.array([[20.0], [35.0]])

    def rates(time: float, state: NDArray, squared: NDArray, outer: NDArray) -> NDArray:
        winding, housing = state.reshape(2, n, 4)
        heat = squared * 0.942 * (1 + COPPER_PER_K * (winding - 25))
        inward = (winding - housing) / WINDING_HOUSING
        outward = (housing - ambient) / HOUSING_AMBIENT
        warming = (heat - inward) / WINDING_J_K, (inward + outer - outward) / HOUSING_J_K
        return np.concatenate([each.ravel() for each in warming])

    state = np.concatenate([motors.winding.ravel(), motors.housing.ravel()])
    hottest = 0.0
    for level, speed in zip(levels, speeds, strict=True):
        currents, turning = ripple * level, ripple * speed  # together: the product's mean is not that of the means
        for _ in range(segment):
            motors.warm(currents, turning)
        heat = (currents**2).mean(0), MAXON.outer_loss(currents, turning).mean(0)
        state = solve_ivp(rates, (0, segment * FRAME_S), state, args=heat, rtol=1e-8, atol=1e-8).y[:, -1]
        winding, housing = state.reshape(2, n, 4)
        # The bound asked of the model, 0.1 K: resistance is held for a frame, in which a winding warms by up to 0.2 K.
        np.testing.assert_allclose(motors.winding, winding, rtol=0, atol=0.1)
        np.testing.assert_allclose(motors.housing, housing, rtol=0, atol=0.1)
        hottest = max(hottest, winding.max())
    assert hottest > 100  # or nothing was tested


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.floats(0, 3.5), st.floats(-200, 200), st.floats(-20, 60), st.floats(0, 100))
def test_steady_state_is_the_closed_form(current: float, speed: float, ambient: float, start: float) -> None:
    chosen = sheet(winding_c=start, housing_c=start, ambient_c=ambient)
    # Periods far beyond the time constants: each is a step of a fixed-point iteration on the winding's resistance,
    # whose factor i^2 R_25 c (R_th1 + R_th2) is 0.45 at most.
    winding, housing = hold(Motors([chosen], 4, 3600.0), current, 60, speed)
    expected = steady(current, ambient, float(MAXON.outer_loss(current, speed)))
    np.testing.assert_allclose(winding[-1], expected[0], atol=1e-6)
    np.testing.assert_allclose(housing[-1], expected[1], atol=1e-6)


def test_the_sheets_continuous_current_settles_at_its_highest_temperature() -> None:
    """2.52 A at 5170 rpm, "nominal", is what a motor bears for ever at 25 deg C: its winding then has 125 deg C."""
    winding, _ = hold(Motors([sheet()], 4, 60.0), NOMINAL_CURRENT, 60, NOMINAL_SPEED)
    # 5 K: the sheet's digits, and whatever maxon's own model of the losses is. By hand 121 deg C.
    assert winding[-1] == pytest.approx(HIGHEST_C, abs=5)
    assert winding[-1] == pytest.approx(winding[-2], abs=1e-6)
    assert winding.max() < HIGHEST_C
    # Each loss matters: copper alone leaves it 23 K below, friction warms the housing by 6 K and commutation by 8 K,
    # in which the copper resists more. And a tenth more current is too much.
    copper, _ = hold(Motors([sheet()], 4, 60.0), NOMINAL_CURRENT, 60)
    assert copper.max() < HIGHEST_C - 20
    more, _ = hold(Motors([sheet()], 4, 60.0), 1.1 * NOMINAL_CURRENT, 60, NOMINAL_SPEED)
    assert more.max() > HIGHEST_C


def settled(name: str, share: float) -> tuple[float, float]:
    """Winding of a robot's motor, deg C, at a share of its nominal current and at nominal speed; and by closed form."""
    motor, own = scenario.scenario("rect", robot=name).settings.motor, ROBOTS[name]
    current, speed = share * own.nominal_current, own.nominal_speed / own.gear
    winding, _ = hold(Motors([motor], 4, 60.0), current, 60, speed)
    inward = robots.sections(name)["motor"].get("winding_housing_k_w", WINDING_HOUSING)
    outer = float(own.outer_loss(current, speed))
    return float(winding[-1, 0]), steady(current, 25.0, outer, own.resistance, inward)[0]


@pytest.mark.parametrize("name", ROBOTS)
def test_each_robots_motor_settles_where_its_losses_say(name: str) -> None:
    for share in (0.5, 1.0):
        assert np.subtract(*settled(name, share)) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("name", ROBOTS)
def test_each_robots_motor_bears_its_nominal_current(name: str) -> None:
    # The default robot's as the 24 V winding does, of which it is a rewinding with the same losses. No sheet was found
    # of the others': their windings are assumed to be cooled well enough for it.
    assert settled(name, 1.0)[0] == pytest.approx(HIGHEST_C, abs=5)


@settings(deadline=None, max_examples=60, derandomize=True)
@given(st.floats(-25, 25), st.floats(-200, 200), st.floats(-20, 60), st.floats(0, 1))
def test_electrical_power_is_that_of_the_shaft_and_of_all_heats(
    voltage: float, speed: float, temperature: float, dry_share: float
) -> None:
    """First law at any instant: V I = (K I - friction) w + what the two nodes take up, from their temperatures."""
    chosen = sheet(winding_c=temperature, housing_c=temperature, ambient_c=temperature, dry_share=dry_share)
    tiny = chosen.replace(winding_j_k=1e4, housing_j_k=1e5)  # that hardly warm: all heat stays, resistance too
    motors = Motors([tiny], 4, 1e-3)
    terminals, current = motors.drive(np.full((1, 4), voltage), np.full((1, 4), speed))
    constant, rotor = motors.constant, speed * MAXON.gear
    own = np.sign(rotor) * (dry_share + (1 - dry_share) * abs(rotor) / (6250 * np.pi / 30)) * 0.036 * 0.238
    shaft = (constant * current - own) * rotor
    motors.warm(current[None], np.full((1, 1, 4), speed))
    heat = (1e4 * (motors.winding - temperature) + 1e5 * (motors.housing - temperature)) / 1e-3
    # Rounding: a kilowatt for a millisecond is 1e-4 K of up to 60 deg C, which have 14 digits.
    np.testing.assert_allclose(terminals * current, shaft + heat, atol=1e-2)


def time_constant(temperature: NDArray, period: float) -> float:
    """From the slope of the logarithm of what is left over ambient, in the first half of the fall."""
    left = np.log((temperature - 25.0) / (temperature[0] - 25.0))
    use = left > np.log(0.5)
    return float(-period / np.polyfit(np.arange(use.sum()), left[use], 1)[0])


def test_time_constants_are_the_datasheets() -> None:
    # Winding: into a housing that never warms. Motor: winding and housing apart, the housing into the air.
    # 0.5 %: the settings give the heat capacities with three digits.
    # Unchecked: beyond what is allowed.
    alone = MotorSettings.model_construct(**SHEET, winding_c=100.0, housing_j_k=1e9)
    winding, _ = hold(Motors([alone], 4, 0.1), 0.0, 1000)
    assert time_constant(winding[:, 0], 0.1) == pytest.approx(WINDING_TIME, rel=5e-3)
    apart = MotorSettings.model_construct(**SHEET, housing_c=100.0, winding_housing_k_w=1e9)
    _, housing = hold(Motors([apart], 4, 0.1), 0.0, 2000)
    assert time_constant(housing[:, 0], 0.1) == pytest.approx(MOTOR_TIME, rel=5e-3)


@settings(deadline=None, max_examples=30, derandomize=True)
@given(st.floats(-20, 200), st.floats(-20, 200), st.floats(-20, 60), st.floats(1e-3, 100))
def test_without_current_a_motor_takes_on_the_temperature_of_the_air(
    winding: float, housing: float, ambient: float, period: float
) -> None:
    motors = Motors([sheet(winding_c=winding, housing_c=housing, ambient_c=ambient)], 4, period)
    warmest, coldest = max(winding, housing, ambient), min(winding, housing, ambient)
    for _ in range(20):
        hold(motors, 0.0, 1)
        # Second law: without work no node leaves the range, and the range only shrinks. Rounding.
        for node in (motors.winding, motors.housing):
            assert coldest - 1e-9 <= node.min()
            assert node.max() <= warmest + 1e-9
        warmest = max(motors.winding.max(), motors.housing.max(), ambient)
        coldest = min(motors.winding.min(), motors.housing.min(), ambient)
    # The slower of the two eigenvalues, 1 / 97 s, sets how fast; and the far end is the air.
    cooled = Motors([sheet(winding_c=winding, housing_c=housing, ambient_c=ambient)], 4, 3600.0)
    hold(cooled, 0.0, 1)
    np.testing.assert_allclose([cooled.winding, cooled.housing], ambient, atol=1e-6)


def test_heat_is_conserved() -> None:
    motors, period = Motors([sheet()], 4, FRAME_S), FRAME_S
    winding, housing = hold(motors, 4.0, 60 * 60, 100.0)
    resistance = 0.942 * (1 + COPPER_PER_K * (winding - 25))
    produced = ((16.0 * resistance[:-1]).sum(0) + len(winding[1:]) * MAXON.outer_loss(4.0, 100.0)) * period
    left = np.trapezoid(housing - 25, dx=period, axis=0) / HOUSING_AMBIENT
    stored = WINDING_J_K * (winding[-1] - 25) + HOUSING_J_K * (housing[-1] - 25)
    assert (stored > 0.1 * produced).all()
    assert (left > 0.1 * produced).all()
    # First law. 1e-4: the trapezoidal sum.
    np.testing.assert_allclose(stored + left, produced, rtol=1e-4)


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.floats(-20, 200), st.floats(-20, 200))
def test_resistance_follows_the_winding_and_torque_constant_the_housing(winding: float, housing: float) -> None:
    motors = Motors([sheet(winding_c=winding, housing_c=housing)], 4, FRAME_S)
    np.testing.assert_allclose(motors.resistance, 0.942 * (1 + 0.00393 * (winding - 25)))  # copper
    np.testing.assert_allclose(motors.constant, 0.036 * (1 - 0.001 * (housing - 25)))  # NdFeB
    hold(motors, 5.0, 10)
    np.testing.assert_allclose(motors.resistance, 0.942 * (1 + 0.00393 * (motors.winding - 25)))
    np.testing.assert_allclose(motors.constant, 0.036 * (1 - 0.001 * (motors.housing - 25)))


def test_a_hot_motor_stalls_weaker_and_runs_faster() -> None:
    voltage, still = np.full((1, 4), 12.0), np.zeros((1, 4))
    cold = Motors([sheet()], 4, FRAME_S)
    hot = Motors([sheet(winding_c=125.0, housing_c=95.0)], 4, FRAME_S)
    torque = [motors.constant * motors.drive(voltage, still)[1] for motors in (cold, hot)]
    # By the two laws: R up by 39.3 %, K down by 7 %.
    np.testing.assert_allclose(torque[1] / torque[0], 0.93 / 1.393)
    # Without load, the speed of equal back-EMF: weak magnets let a motor run faster.
    speed = 12.0 / (0.93 * 0.036 * 60 / 18)
    np.testing.assert_allclose(hot.drive(voltage, np.full((1, 4), speed))[1], 0.0, atol=1e-9)
    assert (cold.drive(voltage, np.full((1, 4), speed))[1] < -0.1).all()
