"""What driving does to the turning of robots whose wheels give way: against the balance of moments, wheel by wheel."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from omni_control.estimation.compliance import HEIGHT_M, Compliance
from omni_control.kinematics import Kinematics

LEAGUE = Kinematics(np.radians([60, 135, 225, 300]), 0.083, 0.0285)
SQUARE = Kinematics(np.radians([45, 135, 225, 315]), 0.083, 0.0285)
number = st.floats(-1, 1)


def one(robot: Kinematics, v: complex, w: float, a: complex, e: complex, lag: float, creep: float) -> float:
    """Of one robot whose gyro nothing listens to."""
    rate, lags, creeps = (np.array([value]) for value in (w, lag, creep))
    velocity, acceleration, shortfall = (np.array([value], complex) for value in (v, a, e))
    return float(Compliance(robot, 1.0).turned(velocity, rate, acceleration, shortfall, lags, creeps)[0])


@given(st.tuples(*[number] * 7), st.floats(0.005, 0.05), st.floats(0.0, 0.1))
def test_it_is_the_turn_rate_at_which_the_wheels_have_no_moment(
    drawn: tuple[float, ...], lag: float, creep: float
) -> None:
    """Each wheel gives way by (tau + T |V| / n) f; loads n are those that the weight's lever over four feet leaves."""
    v, w, a, e = 2 * complex(*drawn[:2]), 5 * drawn[2], 2 * complex(*drawn[3:5]), complex(*drawn[5:])
    feet = 0.083 * np.exp(1j * LEAGUE.azimuths)

    def moment(lacking: float) -> float:
        balance = np.array([np.ones(4), feet.real, feet.imag])
        loads = np.linalg.lstsq(balance, [4, -4 * HEIGHT_M / 9.81 * a.real, -4 * HEIGHT_M / 9.81 * a.imag], rcond=None)
        total = 0.0
        for azimuth, load in zip(LEAGUE.azimuths, loads[0], strict=True):
            rim = complex(-math.sin(azimuth), math.cos(azimuth))
            gives = lag + creep * abs(v + w * 0.083 * rim) / max(load, 0.1)
            total += ((rim.conjugate() * e).real + 0.083 * lacking) / gives
        return total

    lacking = brentq(moment, -100, 100, xtol=1e-12)
    assert one(LEAGUE, v, w, a, e, lag, creep) == pytest.approx(-lacking, abs=1e-9)


@given(number, number, st.floats(0.0, 0.1))
def test_wheels_at_right_angles_turn_nothing_at_a_steady_pace(ahead: float, aside: float, creep: float) -> None:
    """All travel alike and bear alike."""
    assert one(SQUARE, complex(ahead, aside), 0.0, 0j, complex(aside, 1.0), 0.02, creep) == pytest.approx(0, abs=1e-12)


def test_a_robot_that_turns_while_it_speeds_up_turns_less() -> None:
    """The wheels that turning makes faster give way more: to first order by w e v / 2 v^2 where all is creep."""
    found = one(SQUARE, 1 + 0j, 0.5, 0j, 0.1 + 0j, 0.0, 0.05)
    assert found == pytest.approx(-0.5 * 0.1 / 2, rel=0.02)  # the next order: (l w / v)^2
