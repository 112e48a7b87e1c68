"""Fits of the slip study recover what a solver was told; robots slip as the law of creep says, whatever the noise."""

import numpy as np
import pytest
from benches.studies import (
    PERIOD_S,
    PUBLISHED,
    Move,
    Settings,
    compute_creep_law,
    compute_normal_forces,
    fits,
    moves,
    straight_move,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import omni_mj as om

AT = np.arange(0.0, 2.4, PERIOD_S)
MOVES = (
    straight_move("forward", 1.0, rolls_out=False),
    straight_move("sideways", -1.25, rolls_out=False),
    straight_move("forward", 1.25, rolls_out=True),
    Move("turning", 8.0, 12.0, 0.5, rolls_out=True),
)
MODEL = {"model": "two-rollers"}


def wheels(t: NDArray | float, speed: float = 1.0) -> NDArray:
    """Speed of the wheels, m/s: rest, ramp at 2 m/s^2, constant, ramp, rest."""
    return speed * np.interp(t, [0.1, 0.6, 1.6, 2.1], [0.0, 1.0, 1.0, 0.0])


def solved(slope: object) -> NDArray:
    """What scipy makes of v' = slope(t, v); its steps never jump over a corner."""
    done = solve_ivp(slope, (0, AT[-1]), [0.0], "LSODA", AT, rtol=1e-9, atol=1e-10, max_step=0.01)
    return np.asarray(done.y[0])


@settings(max_examples=10)
@given(st.floats(0.6, 1.1), st.floats(0.0, 0.3), st.sampled_from([1.0, -1.0]))
def test_gain_and_time_of_the_law_are_recovered(gain: float, time: float, sign: float) -> None:
    """Solved by LSODA. 1e-4: the fit holds T |u| for a quarter of a frame."""
    v = solved(
        lambda t, v: (gain * wheels(t, sign) - v) / (time * np.abs(wheels(t)) + fits.MIN_LAG_S)
    )
    found = fits.fit_gain_and_time(wheels(AT, sign), np.abs(wheels(AT)), v)
    assert found == pytest.approx((gain, time), abs=1e-4)


@settings(max_examples=10)
@given(st.floats(0.02, 0.12), st.floats(0.0, 1.5))
def test_what_is_fitted_to_the_law_of_creep_is_its_closed_form(
    softness: float, slowing: float
) -> None:
    """u = v + T0 v (v' + d), solved for v, shows as K = 1 / (1 + T0 d) and T = K^2 T0.

    The fit has T |u| where the law has T0 |v|, which differ by the share K T0 a, in opposite senses
    in speeding up and braking: its square remains, a quarter of it in K. And it has 1 ms beside T
    |u|, 0.0016 s^2/m at this move's speeds.
    """

    def slope(t: float, v: NDArray) -> NDArray:
        return (wheels(t) - v) / (softness * np.maximum(v, 1e-3)) - slowing * np.tanh(v / 1e-3)

    found_gain, found_time = fits.fit_gain_and_time(wheels(AT), wheels(AT), solved(slope))
    gain = 1 / (1 + softness * slowing)
    square = (gain * softness * 2.0) ** 2
    assert found_gain == pytest.approx(gain, rel=square / 4, abs=1e-4)
    assert found_time + 0.0016 == pytest.approx(
        gain**2 * softness * (1 + square / 2), rel=square / 2, abs=2e-4
    )


@pytest.mark.parametrize(("dry", "viscous"), [(0.8, 0.5), (1.6, 0.0), (3.0, 0.2)])
def test_drag_of_a_roll_out_is_recovered(dry: float, viscous: float) -> None:
    """v' = -(c + b v) has a closed form; the mean over what rolls is that of its ends. Three samples tell nothing."""
    rate = max(viscous, 1e-9)
    v = np.maximum((1.5 + dry / rate) * np.exp(-rate * AT) - dry / rate, 0.0)
    rolling = v[fits.SETTLING_SAMPLES :][v[fits.SETTLING_SAMPLES :] >= fits.AT_REST_M_S]
    mean = -np.diff(rolling).mean() / PERIOD_S
    assert fits.mean_deceleration(v, np.full(len(v), True)) == pytest.approx(mean)
    assert dry + viscous * rolling[-1] - 1e-5 < mean < dry + viscous * rolling[0] + 1e-5
    assert np.isnan(fits.mean_deceleration(v[:5], np.full(5, True)))


def test_the_closed_form_of_a_robot_is_the_solution_of_its_wheels() -> None:
    """Here slips are given, and forces follow wheel by wheel; `compute_creep_law` inverts. Equal loads give W/(g C sum d^2)."""
    robot = Settings()
    closed, load = compute_creep_law(robot), compute_normal_forces(robot)
    azimuth, c, mass = (
        np.radians(robot.wheels.azimuths_deg),
        robot.drivetrain.creep_stiffness,
        robot.body.mass_kg,
    )
    assert load.sum() == pytest.approx(mass * 9.81)
    for axis, direction in enumerate((-np.sin(azimuth), np.cos(azimuth))):
        gap, v = 0.07, 1.2
        force = (load * c * (gap * direction) / v * direction).sum()
        softness = closed.time[axis] / closed.gain[axis] ** 2
        assert gap == pytest.approx(softness * v * force / mass, rel=1e-9)
        assert closed.gain[axis] == pytest.approx(1 / (1 + softness * closed.drag[axis] / mass))
    even = robot.replace(wheels={"azimuths_deg": [45, 135, 225, 315]})
    assert compute_creep_law(even).time[0] / compute_creep_law(even).gain[0] ** 2 == pytest.approx(
        4 / (9.81 * c * 2)
    )


@pytest.mark.parametrize("name", PUBLISHED)
def test_robots_slip_and_roll_out_as_the_law_says(name: str) -> None:
    """It leaves out up to 0.014 of K; of T up to 5 % and 0.002 s^2/m less, up to 4 % more; of drag 8 %.

    Drag by bearings' viscous part and the spinning up of rollers. The summary has the same numbers,
    a row for a move.
    """
    result = om.measure_slip([om.load_scenario("rect", robot=name, wheels=MODEL)], MOVES)
    (robot,) = result.robots.values()
    for axis in moves.AXES:
        gain, time = (robot.closed_form[f"{what}_{axis}"] for what in ("gain", "time"))
        assert gain - 0.014 < robot.measured[f"gain_{axis}"] < gain, axis
        assert 0.95 * time - 0.002 < robot.measured[f"time_{axis}"] < 1.04 * time, axis
    for axis in ("forward", "turning"):
        assert robot.measured[f"drag_{axis}"] == pytest.approx(
            robot.closed_form[f"drag_{axis}"], rel=0.08
        ), axis
    assert [row["move"] for row in result.rows().to_pylist()] == [move.axis for move in MOVES]
    told = result.summary()["slip"]["robots"][name]["quantities"]["time_forward"]
    assert told["published"] == PUBLISHED[name]["time_forward"]
    assert told["deviation_percent"] == pytest.approx(
        100 * (told["measured"] / told["published"] - 1)
    )


def test_the_moves_are_those_that_were_published() -> None:
    """Ends 3 m apart: the way of the commands is that, less what is left to roll."""
    every = moves.identification_moves()
    assert len(every) == 32
    for move in every:
        frames = move.frames
        way = np.abs(move.command(frames)).sum() * PERIOD_S
        if move.axis in ("forward", "sideways"):
            left = 0.5 * abs(move.speed) if move.rolls_out else 0.0
            # What is commanded in a frame is reached at its end: half a frame too soon, and up to
            # one to let go.
            assert way == pytest.approx(3.0 - left, abs=1.1 * PERIOD_S * abs(move.speed)), move
        assert move.is_coasting(frames).any() == move.rolls_out


def test_robots_that_are_not_there_or_named_twice_are_refused() -> None:
    with pytest.raises(om.OmniError, match="unknown robot 'tigers'"):
        om.measure_slip(["tigers"])
    with pytest.raises(om.OmniError, match="two scenarios are called 'tigers-v2016'"):
        om.measure_slip(["tigers-v2016"] * 2)


def test_a_robot_that_falls_is_left_out_and_told() -> None:
    """It is pushed over; there are no figures of it."""
    pushed = om.load_scenario("rect", wheels=MODEL, disturbance={"force_n": 1000.0})
    result = om.measure_slip([pushed], [straight_move("forward", 1.5, rolls_out=True)])
    (failure,) = result.failures
    assert failure.cause == "toppled over"
    assert (
        result.summary()["slip"]["robots"]["tigers-v2016"]["quantities"]["gain_forward"]["measured"]
        is None
    )
