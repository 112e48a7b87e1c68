"""The robot's firmware: equations 2 and 3 backwards, the PID law by hand, the battery's limit, the gyro's heading."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from omni_control.kinematics import Kinematics
from omni_mj.firmware import Firmware
from omni_mj.robot import Motor
from omni_mj.settings import FirmwareSettings

KINEMATICS = Kinematics(np.radians([60.0, 135, 225, 300]), arm=0.08, radius=0.0285)
MOTOR = Motor(constant=0.036, resistance=0.942, gear=10 / 3)
UNLIMITED_V = 1e9
STILL = np.zeros(1)

finite = st.floats(-10, 10)


def firmware(
    kp: float = 0.0,
    ki: float = 0.0,
    kd: float = 0.0,
    feed_forward: float = 0.0,
    limit: float = UNLIMITED_V,
    heading: float = 0.0,
    timestep: float = 1 / 960,
) -> Firmware:
    """One robot's firmware with all gains off but those given."""
    gains = FirmwareSettings(kp=kp, ki=ki, kd=kd, feed_forward=feed_forward)
    return Firmware(gains, KINEMATICS, MOTOR, limit, np.array([heading]), timestep)


def rolling(command: NDArray, heading: float) -> NDArray:
    """Wheel speeds (4,) of rolling: the velocity v + w x p of each wheel's place along its tangent, in the world."""
    place = heading + np.radians([60.0, 135, 225, 300])
    radius_vector = 0.08 * np.stack([np.cos(place), np.sin(place)], axis=1)
    velocity = command[:2] + command[2] * np.stack([-radius_vector[:, 1], radius_vector[:, 0]], axis=1)
    return (velocity * np.stack([-np.sin(place), np.cos(place)], axis=1)).sum(1) / 0.0285


@settings(deadline=None, max_examples=50, derandomize=True)
@given(finite, finite, finite, st.floats(-20, 20))
def test_world_commands_become_wheel_speeds(vx: float, vy: float, w: float, heading: float) -> None:
    command = np.array([vx, vy, w])
    voltage = firmware(kp=1.0, heading=heading).voltages(command[None], STILL, np.zeros((1, 4)))
    # With k_p = 1 and wheels at rest, the voltage is the wanted speed. Rounding of angles up to 20 rad.
    np.testing.assert_allclose(voltage[0], rolling(command, heading), atol=1e-9)


def play(pid: Firmware, errors: list[float]) -> list[float]:
    """Voltages of wheel 1 when its speed lags the wanted one by `errors`."""
    command = np.array([[1.0, 0.5, 2.0]])
    wanted = rolling(command[0], 0.0)
    return [float(pid.voltages(command, STILL, (wanted - e)[None])[0, 0]) for e in errors]


# By hand, errors 2, 3, -1 at a timestep of 0.5 s: P = e; I = the sum of e dt with the newest; D = the change / dt,
# the error before the first step being 0.
@pytest.mark.parametrize(
    ("gains", "expected"),
    [
        ({"kp": 10.0}, [20.0, 30.0, -10.0]),
        ({"ki": 4.0}, [4.0, 10.0, 8.0]),
        ({"kd": 0.25}, [1.0, 0.5, -2.0]),
        ({"kp": 10.0, "ki": 4.0, "kd": 0.25}, [25.0, 40.5, -4.0]),
    ],
    ids=["P", "I", "D", "PID"],
)
def test_pid_law(gains: dict[str, float], expected: list[float]) -> None:
    # Rounding in wanted - (wanted - e).
    np.testing.assert_allclose(play(firmware(**gains, timestep=0.5), [2.0, 3.0, -1.0]), expected, atol=1e-9)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_feed_forward_is_the_back_emf_at_the_wanted_speed(share: float) -> None:
    command = np.array([[1.0, -0.4, 3.0]])
    voltage = firmware(feed_forward=share).voltages(command, STILL, np.zeros((1, 4)))
    # Speed constant of the motor, at the rotor, which turns 10/3 times as fast as the wheel; exact up to rounding.
    np.testing.assert_allclose(voltage[0], share * 0.036 * 10 / 3 * rolling(command[0], 0.0), rtol=1e-9)


@settings(deadline=None, max_examples=50, derandomize=True)
@given(
    st.lists(st.tuples(finite, finite, finite), min_size=1, max_size=10),
    st.floats(0, 25.2),
    st.floats(0, 100),
    st.floats(0, 1000),
)
def test_voltage_never_exceeds_the_battery(
    commands: list[tuple[float, float, float]], limit: float, kp: float, ki: float
) -> None:
    pid = firmware(kp=kp, ki=ki, kd=0.01, feed_forward=1.0, limit=limit)
    for command in commands:
        assert np.abs(pid.voltages(np.array([command]), STILL, np.zeros((1, 4)))).max() <= limit


@pytest.mark.parametrize("sign", [1, -1])
def test_the_limit_is_reached_and_left_alone_below(sign: int) -> None:
    assert play(firmware(kp=1.0, limit=5.0), [sign * 4.9, sign * 5.1, sign * 100.0]) == pytest.approx(
        [sign * 4.9, sign * 5.0, sign * 5.0]
    )


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("saturated_steps", [1, 10, 1000])
def test_integral_does_not_wind_up(sign: int, saturated_steps: int) -> None:
    # k_i dt = 1 V per unit of error and step: the integral reaches 4 V, one more step of 4 would exceed the limit of 5.
    pid = firmware(ki=2.0, timestep=0.5, limit=5.0)
    assert play(pid, [sign * 4.0]) == pytest.approx([sign * 4.0])
    assert play(pid, [sign * 4.0] * saturated_steps) == pytest.approx([sign * 5.0] * saturated_steps)
    # However long that lasted: without error the integral's 4 V remain, and an opposite error counts at once.
    assert play(pid, [0.0, sign * -1.0]) == pytest.approx([sign * 4.0, sign * 3.0])


@pytest.mark.parametrize(("error", "remembered"), [(-1.0, -3.0), (1.0, 0.0)], ids=["points back", "pushes further"])
def test_while_saturated_only_errors_that_point_back_are_integrated(error: float, remembered: float) -> None:
    pid = firmware(ki=2.0, feed_forward=1.0, timestep=0.5, limit=5.0)
    fast = np.array([[0.0, 0.0, 50.0]])  # its back-EMF, 0.12 V s/rad * 140 rad/s, is beyond the limit
    for _ in range(3):
        assert (pid.voltages(fast, STILL, rolling(fast[0], 0.0)[None] - error) == 5.0).all()
    # Then at rest and without error, what shows is the integral: k_i times three steps of 0.5 s, or nothing.
    rest = pid.voltages(np.zeros((1, 3)), STILL, np.zeros((1, 4)))
    np.testing.assert_allclose(rest, remembered, atol=1e-9)


def test_wheels_and_robots_have_their_own_integrals() -> None:
    gains = FirmwareSettings(kp=0.0, ki=1.0, kd=0.0, feed_forward=0.0)
    pid = Firmware(gains, KINEMATICS, MOTOR, UNLIMITED_V, np.zeros(2), 0.5)
    errors = np.arange(8.0).reshape(2, 4)
    for step in (1, 2, 3):
        voltage = pid.voltages(np.zeros((2, 3)), np.zeros(2), -errors)
        np.testing.assert_allclose(voltage, 0.5 * step * errors)


@settings(deadline=None, max_examples=30, derandomize=True)
@given(st.floats(-20, 20), st.lists(st.floats(-30, 30), min_size=1, max_size=30))
def test_heading_is_the_gyros_integral(start: float, rates: list[float]) -> None:
    pid = firmware(kp=1.0, heading=start, timestep=1 / 960)
    command = np.array([[1.0, 2.0, 0.5]])
    for rate in rates:
        voltage = pid.voltages(command, np.array([rate]), np.zeros((1, 4)))
    heading = start + sum(rates) / 960
    assert pid.heading[0] == pytest.approx(heading, abs=1e-9)
    # The command's direction is fixed in the world while the robot turns under it.
    np.testing.assert_allclose(voltage[0], rolling(command[0], heading), atol=1e-9)
