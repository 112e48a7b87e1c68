"""The robot's firmware: equations 2 and 3 backwards, the PID law by hand, duties, encoder counts, gyro and vision."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maxon import sheet
from numpy.typing import NDArray
from omni_mj.onboard.firmware import Firmware

from omni_control.kinematics import Kinematics
from omni_mj.link.radio import Received
from omni_mj.scenarios.settings import FirmwareSettings, SensorSettings, Settings

KINEMATICS = Kinematics(np.radians([60.0, 135, 225, 300]), arm=0.08, radius=0.0285)
# Beyond what settings allow, and so not checked by them.
UNLIMITED_V = 1e9
FINE_COUNTS = 10**12  # an encoder whose steps vanish beside rounding
FRAME_S = 1 / 60
STILL = np.zeros(1)
COLD = np.full((1, 4), 25.0)

finite = st.floats(-10, 10)


class Robot:
    """One robot's firmware for motors of 24 V, all gains off but those given, and wheels that turn as told."""

    def __init__(
        self,
        limit: float = UNLIMITED_V,
        heading: float = 0.0,
        timestep: float = 1 / 960,
        counts: int = FINE_COUNTS,
        limit_c: float = 125.0,
        **gains: float,
    ) -> None:
        off = {"kp": 0.0, "ki": 0.0, "kd": 0.0, "feed_forward": 0.0, "turn_gain": 0.0, "heading_gain": 0.0}
        self.settings = Settings(
            firmware=FirmwareSettings.model_construct(**off | {"bias_gain": 0.0, "nominal_voltage_v": limit} | gains),
            sensors=SensorSettings.model_construct(encoder_counts=counts),
            motor=sheet(limit_c=limit_c),
        )
        self.firmware = Firmware([self.settings], KINEMATICS, np.array([heading]), timestep, FRAME_S)
        self.angle = np.zeros(4)
        self.limit, self.timestep = limit, timestep
        self.firmware.duties(STILL, self.angle[None])  # at rest, where the encoders begin to count

    def obey(self, command: NDArray, winding: NDArray = COLD) -> None:
        self.firmware.receive(Received.at_once(np.asarray(command, float)[None]), winding)

    def voltages(self, speed: NDArray | float = 0.0, gyro: float = 0.0) -> NDArray:
        """Volts (4,) of a nominal battery after one step in which the wheels turned at `speed`."""
        self.angle = self.angle + speed * self.timestep
        return self.firmware.duties(np.array([gyro]), self.angle[None])[0] * self.limit


def rolling(command: NDArray, heading: float) -> NDArray:
    """Wheel speeds (4,) of rolling: the velocity v + w x p of each wheel's place along its tangent, in the world."""
    place = heading + np.radians([60.0, 135, 225, 300])
    radius_vector = 0.08 * np.stack([np.cos(place), np.sin(place)], axis=1)
    velocity = command[:2] + command[2] * np.stack([-radius_vector[:, 1], radius_vector[:, 0]], axis=1)
    return (velocity * np.stack([-np.sin(place), np.cos(place)], axis=1)).sum(1) / 0.0285


@settings(deadline=None, max_examples=50, derandomize=True)
@given(finite, finite, finite, st.floats(-20, 20))
def test_world_commands_become_wheel_speeds(vx: float, vy: float, w: float, heading: float) -> None:
    robot = Robot(kp=1.0, heading=heading)
    robot.obey(np.array([vx, vy, w]))
    # With k_p = 1 and wheels at rest, the voltage is the wanted speed. Rounding of angles up to 20 rad, and of volts
    # as shares of a battery without limit.
    np.testing.assert_allclose(robot.voltages(), rolling(np.array([vx, vy, w]), heading), atol=1e-9)


@settings(deadline=None, max_examples=50, derandomize=True)
@given(finite, finite, finite, st.floats(-30, 30), st.floats(0, 10))
def test_turn_rate_loop_adds_its_gain_times_what_the_gyro_misses(
    vx: float, vy: float, w: float, gyro: float, gain: float
) -> None:
    robot = Robot(kp=1.0, turn_gain=gain)
    robot.obey(np.array([vx, vy, w]))
    voltage = robot.voltages(gyro=gyro)
    # The heading that the step's turn has led to is the one whose wheels are told.
    expected = rolling(np.array([vx, vy, w + gain * (w - gyro)]), gyro / 960)
    np.testing.assert_allclose(voltage, expected, atol=1e-9 * (1 + gain))  # rounding grows with the sums


def play(robot: Robot, errors: list[float]) -> list[float]:
    """Voltages of wheel 1 when its speed lags the wanted one by `errors`."""
    command = np.array([1.0, 0.5, 2.0])
    robot.obey(command)
    wanted = rolling(command, 0.0)
    return [float(robot.voltages(wanted - e)[0]) for e in errors]


# By hand, errors 2, 3, -1 at a timestep of 0.5 s: P = e; I = the sum of e dt with the newest; D = the change / dt,
# the error before the first step being 0.
def test_pid_law() -> None:
    for gains, expected in (
        ({"kp": 10.0}, [20.0, 30.0, -10.0]),
        ({"ki": 4.0}, [4.0, 10.0, 8.0]),
        ({"kd": 0.25}, [1.0, 0.5, -2.0]),
        ({"kp": 10.0, "ki": 4.0, "kd": 0.25}, [25.0, 40.5, -4.0]),
    ):
        # Rounding in wanted - (wanted - e), and the fine encoder's last count of 4e-12 rad/s.
        np.testing.assert_allclose(play(Robot(**gains, timestep=0.5), [2.0, 3.0, -1.0]), expected, atol=1e-9)


def test_feed_forward_is_the_back_emf_at_the_wanted_speed() -> None:
    command = np.array([1.0, -0.4, 3.0])
    for share in (0.0, 0.5, 1.0):
        robot = Robot(feed_forward=share)
        robot.obey(command)
        # Speed constant of the motor, at the rotor, which turns 10/3 times as fast as the wheel; exact up to rounding.
        np.testing.assert_allclose(robot.voltages(), share * 0.036 * 10 / 3 * rolling(command, 0.0), rtol=1e-9)


@settings(deadline=None, max_examples=30, derandomize=True)
@given(
    st.lists(st.tuples(finite, finite, finite), min_size=1, max_size=10),
    st.floats(1, 60),
    st.floats(0, 100),
    st.floats(0, 1000),
)
def test_duty_never_exceeds_one(
    commands: list[tuple[float, float, float]], nominal: float, kp: float, ki: float
) -> None:
    robot = Robot(kp=kp, ki=ki, kd=0.01, feed_forward=1.0, limit=nominal)
    for command in commands:
        robot.obey(np.array(command))
        assert np.abs(robot.firmware.duties(STILL, np.zeros((1, 4)))).max() <= 1.0


@settings(deadline=None, max_examples=30, derandomize=True)
@given(st.floats(1, 60), st.floats(-3, 3))
def test_duty_is_the_share_of_the_nominal_battery(nominal: float, error: float) -> None:
    robot = Robot(kp=nominal, limit=nominal)
    robot.obey(np.array([0.0, 0.0, error * 0.0285 / 0.08]))
    # k_p e / V of the nominal battery, whatever the real one gives; clipped at the whole of it. Exact up to rounding.
    duty = robot.firmware.duties(STILL, np.zeros((1, 4)))[0]
    np.testing.assert_allclose(duty, np.clip(error, -1, 1), atol=1e-9)


def test_the_limit_is_reached_and_left_alone_below() -> None:
    # 1e-6: the fine encoder's last count.
    for sign in (1, -1):
        voltages = play(Robot(kp=1.0, limit=5.0), [sign * 4.9, sign * 5.1, sign * 100.0])
        assert voltages == pytest.approx([sign * 4.9, sign * 5.0, sign * 5.0])


def test_integral_does_not_wind_up() -> None:
    for sign, saturated_steps in itertools.product((1, -1), (1, 10, 300)):
        # k_i dt = 1 V per unit of error and step: the integral reaches 4 V, one more step of 4 would exceed the 5 V.
        robot = Robot(ki=2.0, timestep=0.5, limit=5.0)
        assert play(robot, [sign * 4.0]) == pytest.approx([sign * 4.0])
        assert play(robot, [sign * 4.0] * saturated_steps) == pytest.approx([sign * 5.0] * saturated_steps)
        # However long that lasted: without error the integral's 4 V remain, and an opposite error counts at once.
        assert play(robot, [0.0, sign * -1.0]) == pytest.approx([sign * 4.0, sign * 3.0])


def test_while_saturated_only_errors_that_point_back_are_integrated() -> None:
    for error, remembered in ((-1.0, -3.0), (1.0, 0.0)):  # that points back, that pushes further
        robot = Robot(ki=2.0, feed_forward=1.0, timestep=0.5, limit=5.0)
        fast = np.array([0.0, 0.0, 50.0])  # its back-EMF, 0.12 V s/rad * 140 rad/s, is beyond the limit
        robot.obey(fast)
        for _ in range(3):
            np.testing.assert_allclose(robot.voltages(rolling(fast, 0.0) - error), 5.0, rtol=1e-12)
        # Then at rest and without error, what shows is the integral: k_i times three steps of 0.5 s, or nothing.
        robot.obey(np.zeros(3))
        np.testing.assert_allclose(robot.voltages(), remembered, atol=1e-9)


def test_robots_of_any_number_of_wheels() -> None:
    """The laws are those of each wheel; here three, and five."""
    for wheels in (3, 5):
        place = np.arange(wheels) * 2 * np.pi / wheels
        chosen = Robot(kp=1.0).settings
        firmware = Firmware([chosen] * 2, Kinematics(place, 0.1, 0.03), np.zeros(2), 1 / 960, FRAME_S)
        firmware.receive(Received.at_once(np.array([[1.0, 0, 0], [0, 0, 3.0]])), np.full((2, wheels), 25.0))
        voltage = firmware.duties(np.zeros(2), np.zeros((2, wheels))) * UNLIMITED_V
        np.testing.assert_allclose(voltage, [-np.sin(place) / 0.03, np.full(wheels, 3.0 * 0.1 / 0.03)], atol=1e-9)


def test_wheels_and_robots_have_their_own_integrals() -> None:
    gains = FirmwareSettings.model_construct(
        kp=0.0, ki=1.0, kd=0.0, feed_forward=0.0, turn_gain=0.0, heading_gain=0.0, nominal_voltage_v=UNLIMITED_V
    )
    chosen = Settings(firmware=gains, sensors=SensorSettings.model_construct(encoder_counts=FINE_COUNTS))
    pid = Firmware([chosen, chosen], KINEMATICS, np.zeros(2), 0.5, FRAME_S)
    pid.receive(Received.at_once(np.zeros((2, 3))), np.full((2, 4), 25.0))
    pid.duties(np.zeros(2), np.zeros((2, 4)))
    errors = np.arange(8.0).reshape(2, 4)
    for step in (1, 2, 3):
        voltage = pid.duties(np.zeros(2), -errors * 0.5 * step) * UNLIMITED_V
        np.testing.assert_allclose(voltage, 0.5 * step * errors, atol=1e-9)


def test_the_back_emf_is_that_of_each_robots_own_motor() -> None:
    """Fed forward, and where derating ends: by the datasheet's constant and gear of the row."""
    one, other = Robot(feed_forward=1.0).settings, Robot(feed_forward=1.0).settings
    other = other.replace(motor={"gear": 3.0, "nominal_rpm": 5000.0})
    both = Firmware([one, other], KINEMATICS, np.zeros(2), 1 / 960, FRAME_S)
    both.receive(Received.at_once(np.tile([0.0, 0.0, 1.0], (2, 1))), np.full((2, 4), 25.0))
    voltage = both.duties(np.zeros(2), np.zeros((2, 4))) * UNLIMITED_V
    expected = 0.036 * np.array([[10 / 3], [3.0]]) * 0.08 / 0.0285
    np.testing.assert_allclose(voltage, np.tile(expected, 4), rtol=1e-9)


def test_robots_obey_their_own_gains() -> None:
    chosen = [Robot(**gains).settings for gains in ({"kp": 1.0}, {"kp": 2.0}, {"feed_forward": 1.0}, {"ki": 960.0})]
    together = Firmware(chosen, KINEMATICS, np.zeros(4), 1 / 960, FRAME_S)
    together.receive(Received.at_once(np.tile([0.0, 0.0, 1.0], (4, 1))), np.full((4, 4), 25.0))
    voltage = together.duties(np.zeros(4), np.zeros((4, 4))) * UNLIMITED_V
    # P, twice P, back-EMF, and an integral that one step fills: of the same wanted speed, l w / r.
    expected = np.array([1.0, 2.0, 0.12, 1.0]) * 0.08 / 0.0285
    np.testing.assert_allclose(voltage, np.tile(expected[:, None], 4), rtol=1e-9)


# --- encoders ---


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.lists(st.floats(-200, 200), min_size=1, max_size=60), st.integers(10, 10_000))
def test_rates_come_from_whole_counts_and_lose_none(speeds: list[float], counts: int) -> None:
    robot = Robot(kp=1.0, counts=counts)
    robot.obey(np.zeros(3))
    rates = np.array([-robot.voltages(speed)[0] for speed in speeds])
    # At the wheel, the geared encoder's counts are 2 pi / (counts * gear) apart; a rate is a whole number of them per
    # step, and off by less than one.
    count = 2 * np.pi / (counts * 10 / 3) * 960
    np.testing.assert_allclose(rates / count, np.rint(rates / count), atol=1e-6)  # rounding of 1e9 V
    assert (np.abs(rates - speeds) < count * (1 + 1e-9)).all()
    # What one step leaves over the next one counts: together they are the angle, to one count.
    assert abs(rates.sum() - np.sum(speeds)) < count * (1 + 1e-9)


@settings(deadline=None, max_examples=30, derandomize=True)
@given(st.floats(-100, 100))
def test_an_encoder_starts_where_the_wheel_stands(angle: float) -> None:
    chosen = Robot(kp=1.0, counts=8192).settings
    firmware = Firmware([chosen], KINEMATICS, np.zeros(1), 1 / 960, FRAME_S)
    firmware.receive(Received.at_once(np.zeros((1, 3))), COLD)
    # A wheel at rest has no speed, wherever it stands.
    for _ in range(3):
        np.testing.assert_array_equal(firmware.duties(STILL, np.full((1, 4), angle)), 0.0)


@settings(deadline=None, max_examples=30, derandomize=True)
@given(st.floats(-20, 20), st.lists(st.floats(-30, 30), min_size=1, max_size=30))
def test_without_vision_heading_is_the_gyros_integral(start: float, rates: list[float]) -> None:
    robot = Robot(kp=1.0, heading=start)
    command = np.array([1.0, 2.0, 0.5])
    robot.obey(command)
    for rate in rates:
        voltage = robot.voltages(gyro=rate)
    heading = start + sum(rates) / 960
    assert robot.firmware.estimate.heading[0] == pytest.approx(heading, abs=1e-9)
    # The command's direction is fixed in the world while the robot turns under it.
    np.testing.assert_allclose(voltage, rolling(command, heading), atol=1e-9)


# --- derating ---


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.floats(-200, 200), st.floats(-100, 100), st.floats(20, 160))
def test_derating_limits_the_current_of_a_motor_near_its_limit(speed: float, error: float, winding: float) -> None:
    robot = Robot(kp=1.0, feed_forward=1.0, derate=True)
    wanted = speed + error
    robot.obey(np.array([0.0, 0.0, wanted * 0.0285 / 0.08]), np.array([[winding, 25.0, 25.0, 25.0]]))
    robot.voltages(speed)
    voltage = robot.voltages(speed)
    current = (voltage - 0.12 * speed) / 0.942  # of the datasheet's motor on a nominal battery
    asked = (0.12 * wanted + error - 0.12 * speed) / 0.942
    # Twice the nominal 2.52 A from 10 K below the limit, falling to none at 125 deg C; never more than asked.
    allowed = np.inf if winding <= 115 else 5.04 * max(0.0, (125 - winding) / 10)
    assert current[0] == pytest.approx(np.clip(asked, -allowed, allowed), abs=1e-5)  # 1e9 V, encoder's last count
    np.testing.assert_allclose(current[1:], asked, atol=1e-5)  # the others' windings are cold


def test_derating_ends_when_the_winding_has_cooled() -> None:
    robot = Robot(kp=1.0, derate=True)
    robot.obey(np.array([0.0, 0.0, 10.0]), np.full((1, 4), 130.0))
    np.testing.assert_allclose(robot.voltages(), 0.0, atol=1e-9)
    robot.obey(np.array([0.0, 0.0, 10.0]), COLD)
    np.testing.assert_allclose(robot.voltages(), 10 * 0.08 / 0.0285, rtol=1e-9)


def test_without_derating_temperatures_change_nothing() -> None:
    robot = Robot(kp=1.0)
    robot.obey(np.array([0.0, 0.0, 10.0]), np.full((1, 4), 500.0))
    np.testing.assert_allclose(robot.voltages(), 10 * 0.08 / 0.0285, rtol=1e-9)
