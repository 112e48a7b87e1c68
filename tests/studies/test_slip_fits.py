"""The fits of the slip study recover what an independent solver was told, and find the law's closed form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from omni_mj.scenarios.settings import PERIOD_S, Settings
from omni_mj.scenarios.told import loads
from omni_mj.studies.slip import fits
from omni_mj.studies.slip.law import expected

REACHED, LET_GO, STOPPED, END = 0.6, 1.6, 2.1, 2.4  # s, of a move to 1 m/s at 2 m/s^2
AT = np.arange(0.0, END, PERIOD_S)


def wheels(t: NDArray | float, speed: float = 1.0) -> NDArray:
    """Speed of the wheels, m/s: rest, ramp, constant, ramp, rest."""
    return speed * np.interp(t, [0.1, REACHED, LET_GO, STOPPED], [0.0, 1.0, 1.0, 0.0])


def solved(slope: object) -> NDArray:
    """What scipy makes of v' = slope(t, v); its steps never jump over a corner."""
    done = solve_ivp(slope, (0, AT[-1]), [0.0], "LSODA", AT, rtol=1e-9, atol=1e-10, max_step=0.01)
    return np.asarray(done.y[0])


@settings(deadline=None, max_examples=20, derandomize=True)
@given(st.floats(0.6, 1.1), st.floats(0.0, 0.3), st.sampled_from([1.0, -1.0]))
def test_gain_and_time_of_the_law_are_recovered(gain: float, time: float, sign: float) -> None:
    """Solved by LSODA. 1e-4: the fit holds T |u| for a quarter of a frame."""
    v = solved(lambda t, v: (gain * wheels(t, sign) - v) / (time * np.abs(wheels(t)) + fits.FLOOR_S))
    found = fits.fit_law(wheels(AT, sign), np.abs(wheels(AT)), v, PERIOD_S)
    assert found.gain == pytest.approx(gain, abs=1e-4)
    assert found.time == pytest.approx(time, abs=1e-4)


@settings(deadline=None, max_examples=20, derandomize=True)
@given(st.floats(0.02, 0.12), st.floats(0.0, 1.5))
def test_what_is_fitted_to_the_law_of_creep_is_its_closed_form(softness: float, slowing: float) -> None:
    """u = v + T0 v (v' + d), solved for v, shows as K = 1 / (1 + T0 d) and T = K^2 T0.

    The fit has T |u| where the law has T0 |v|, which differ by the share K T0 a, in opposite senses in speeding up and
    braking: its square remains, a quarter of it in K. And it has 1 ms beside T |u|, 0.0016 s^2/m at this move's speeds.
    """

    def slope(t: float, v: NDArray) -> NDArray:
        moving = np.maximum(v, 1e-3)
        return (wheels(t) - v) / (softness * moving) - slowing * np.tanh(v / 1e-3)

    found = fits.fit_law(wheels(AT), wheels(AT), solved(slope), PERIOD_S)
    gain = 1 / (1 + softness * slowing)
    square = (gain * softness * 2.0) ** 2
    assert found.gain == pytest.approx(gain, rel=square / 4, abs=1e-4)
    assert found.time + 0.0016 == pytest.approx(gain**2 * softness * (1 + square / 2), rel=square / 2, abs=2e-4)


@settings(deadline=None, max_examples=30, derandomize=True)
@given(st.floats(0.5, 3.0), st.floats(0.0, 0.8))
def test_drag_of_a_roll_out_is_recovered(dry: float, viscous: float) -> None:
    """v' = -(c + b v) has a closed form; differences over a frame are those of its middle up to (b T)^2 / 24, 1e-5."""
    start, rate = 1.5, max(viscous, 1e-9)
    v = np.maximum((start + dry / rate) * np.exp(-rate * AT) - dry / rate, 0.0)
    mean, (at_rest, per_speed) = fits.fit_drag(v, np.full(len(v), True), PERIOD_S)
    rolling = v[fits.SETTLING :]
    rolling = rolling[rolling >= fits.AT_REST]
    assert at_rest == pytest.approx(dry, rel=1e-4)
    assert per_speed == pytest.approx(viscous, abs=1e-4)
    assert mean == pytest.approx((rolling[0] - rolling[-1]) / (PERIOD_S * (len(rolling) - 1)))


def test_what_does_not_roll_out_long_enough_tells_nothing() -> None:
    mean, line = fits.fit_drag(np.array([0.3, 0.2, 0.1, 0.06, 0.0]), np.full(5, True), PERIOD_S)
    assert np.isnan(mean)
    assert np.isnan(line).all()


def test_efficiency_is_recovered() -> None:
    """Of a body whose motors give 2.5 times the force that it shows; sums over whole frames are exact."""
    mass, drag, holding = 2.0, 3.0, np.arange(60) >= 30
    v = np.minimum(2.0 * PERIOD_S * np.arange(60), 1.0)
    force = 2.5 * np.where(holding, drag, mass * 2.0 + drag)
    held, growing = fits.efficiency(v, force, holding, ~holding, drag, mass, PERIOD_S)
    assert held == pytest.approx(0.4)
    assert growing == pytest.approx(0.4)


def test_the_closed_form_of_a_robot_is_the_solution_of_its_wheels() -> None:
    """Here slips are given, and forces follow wheel by wheel; `expected` inverts. Equal loads give W/(g C sum d^2)."""
    robot = Settings()
    law, load = expected(robot), loads(robot)
    azimuth, c, mass = np.radians(robot.wheels.azimuths_deg), robot.drive.creep_stiffness, robot.body.mass_kg
    assert load.sum() == pytest.approx(mass * 9.81)
    assert load @ np.cos(azimuth) == pytest.approx(0, abs=1e-9)  # the centre of mass is in the middle
    for axis, direction in enumerate((-np.sin(azimuth), np.cos(azimuth))):
        gap, v, force = 0.07, 1.2, 0.0
        for n, d in zip(load, direction, strict=True):
            force += n * c * (gap * d) / v * d
        softness = law.time[axis] / law.gain[axis] ** 2
        assert gap == pytest.approx(softness * v * force / mass, rel=1e-9)
        assert law.gain[axis] == pytest.approx(1 / (1 + softness * law.drag[axis] / mass))
    even = robot.replace(wheels={"azimuths_deg": [45, 135, 225, 315]})
    assert expected(even).time[0] / expected(even).gain[0] ** 2 == pytest.approx(4 / (9.81 * c * 2))
