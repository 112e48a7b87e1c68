"""Resistance and torque constant of each motor, by voltages and currents; and motors that are not as the others.

At the terminals V = (R + X |w|) i + k G w, with the wheel's speed w and the gear G, by least squares of each motor's
lines. Both may change over the log, in proportion to time: windings warm up. Commutation X / R is the file's. Where
voltages are of other times than speeds, by d, that adds d k G w', which is fitted as well: left out, it would count as
resistance, and what that then lacks in steady driving as constant.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_mj.robot.motors import Motor
from omni_mj.scenarios.settings import Settings
from omni_mj.studies.identify.errors import MEMORY_S, regress
from omni_mj.studies.identify.logs import Log

DIFFERENT, SURE = 0.05, 3.0  # share of the constant, and standard errors, by which motors of a kind do not differ


@dataclass(frozen=True)
class Winding:
    """Of one motor, with standard errors.

    Attributes:
        resistance: in the middle of the log, ohm.
        constant: torque per current, N m/A; change: of it over the log.
    """

    resistance: float
    resistance_error: float
    constant: float
    constant_error: float
    change: float
    change_error: float


def windings(logs: Sequence[Log], settings: Settings) -> list[Winding]:
    """Those of all motors, of logs with wheels, currents and voltages."""
    motor, whole = Motor.of(settings.motor), [_lines(log) for log in logs]
    lags = [max(1, round(MEMORY_S / log.period)) for log in logs]
    found = []
    for wheel in range(min(speed.shape[1] for speed, _, _ in whole)):
        rows, volts = list[Array](), list[Array]()
        for log, (speeds, currents, voltages) in zip(logs, whole, strict=True):
            speed, current = speeds[:, wheel], currents[:, wheel]
            opposed = 1 + motor.commutation * motor.gear / motor.resistance * np.abs(speed)
            own = np.stack([opposed * current, motor.gear * speed], -1)
            warmer = own * np.linspace(-0.5, 0.5, len(own))[:, None]
            faster = np.gradient(speed, log.time[1:])[:, None]
            rows.append(np.concatenate([own, warmer, faster], -1)[:, None])
            volts.append(voltages[:, wheel, None])
        value, error = regress(rows, volts, lags)
        numbers = value[0], error[0], value[1], error[1], value[3], error[3]
        found.append(Winding(*map(float, numbers)))
    return found


def odd(found: Sequence[Winding]) -> Iterator[str]:
    """Motors whose constant is not that of the others, or changes, a line each."""
    for wheel, one in enumerate(found, 1):
        others = float(np.median([each.constant for each in found if each is not one] or [one.constant]))
        if abs(one.constant - others) > DIFFERENT * others + SURE * one.constant_error:
            yield f"motor {wheel}: its torque constant is {one.constant:.3g} N m/A, that of the others {others:.3g}"
        if abs(one.change) > DIFFERENT * others + SURE * one.change_error:
            yield f"motor {wheel}: its torque constant changes over the log by {one.change:+.2g} N m/A"


def _lines(log: Log) -> tuple[Array, Array, Array]:
    """Speeds of wheels (F - 1, W), currents and voltages at the same times."""
    assert log.motors is not None
    assert log.motors.current is not None
    assert log.motors.voltage is not None
    assert log.wheels is not None
    speed = log.wheels[:-1]  # mean since the line before
    if not log.motors.means:
        speed = (speed + log.wheels[1:]) / 2  # at the line between two means
    return speed, log.motors.current[1:], log.motors.voltage[1:]
