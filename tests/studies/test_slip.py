"""Test that fits recover known parameters and that robots slip as the closed form predicts."""

import numpy as np
import pytest
from benches.studies import (
    PERIOD_S,
    PUBLISHED,
    Move,
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
from omni_mj.config.resolve import resolve_settings

AT = np.arange(0.0, 2.4, PERIOD_S)
MOVES = (
    straight_move("forward", 1.0, rolls_out=False),
    straight_move("sideways", -1.25, rolls_out=False),
    straight_move("forward", 1.25, rolls_out=True),
    Move("turning", 8.0, 12.0, 0.5, rolls_out=True),
)
MODEL = {"model": "two-rollers"}


def wheels(t: NDArray | float, speed: float = 1.0) -> NDArray:
    """Return the wheel speed of a move, m/s: rest, ramp at 2 m/s^2, constant, ramp, rest."""
    return speed * np.interp(t, [0.1, 0.6, 1.6, 2.1], [0.0, 1.0, 1.0, 0.0])


def solve(slope: object) -> NDArray:
    """Solve v' = slope(t, v) by scipy, with steps that skip no corner of the input."""
    done = solve_ivp(slope, (0, AT[-1]), [0.0], "LSODA", AT, rtol=1e-9, atol=1e-10, max_step=0.01)
    return np.asarray(done.y[0])


@settings(max_examples=10)
@given(st.floats(0.6, 1.1), st.floats(0.0, 0.3), st.sampled_from([1.0, -1.0]))
def test_gain_and_slip_time_are_recovered(gain: float, time: float, sign: float) -> None:
    """Within 1e-4, because the fit holds T |u| for a quarter of a frame."""
    v = solve(
        lambda t, v: (gain * wheels(t, sign) - v) / (time * np.abs(wheels(t)) + fits.MIN_LAG_S)
    )
    fitted = fits.fit_gain_and_time(wheels(AT, sign), np.abs(wheels(AT)), v)
    assert fitted == pytest.approx((gain, time), abs=1e-4)


@settings(max_examples=10)
@given(st.floats(0.02, 0.12), st.floats(0.0, 1.5))
def test_fit_to_creep_has_its_closed_form(softness: float, slowing: float) -> None:
    """The solution of u = v + T0 v (v' + d) has K = 1 / (1 + T0 d) and T = K^2 T0.

    The fit has T |u| in place of T0 |v|. They differ by K T0 a in relative terms, with opposite
    signs in acceleration and braking. Its square remains, a quarter of it in K. The fit also adds
    1 ms to T |u|, which is 0.0016 s^2/m at the speeds of this move.
    """

    def slope(t: float, v: NDArray) -> NDArray:
        return (wheels(t) - v) / (softness * np.maximum(v, 1e-3)) - slowing * np.tanh(v / 1e-3)

    found_gain, found_time = fits.fit_gain_and_time(wheels(AT), wheels(AT), solve(slope))
    gain = 1 / (1 + softness * slowing)
    square = (gain * softness * 2.0) ** 2
    assert found_gain == pytest.approx(gain, rel=square / 4, abs=1e-4)
    assert found_time + 0.0016 == pytest.approx(
        gain**2 * softness * (1 + square / 2), rel=square / 2, abs=2e-4
    )


@pytest.mark.parametrize(("dry", "viscous"), [(0.8, 0.5), (1.6, 0.0), (3.0, 0.2)])
def test_deceleration_of_a_roll_out_is_recovered(dry: float, viscous: float) -> None:
    """Use the closed form of v' = -(c + b v). Too few samples give NaN."""
    rate = max(viscous, 1e-9)
    v = np.maximum((1.5 + dry / rate) * np.exp(-rate * AT) - dry / rate, 0.0)
    rolling = v[fits.SETTLING_SAMPLES :][v[fits.SETTLING_SAMPLES :] >= fits.AT_REST_M_S]
    mean = -np.diff(rolling).mean() / PERIOD_S
    assert fits.mean_deceleration(v, np.full(len(v), True), fits.AT_REST_M_S) == pytest.approx(mean)
    assert dry + viscous * rolling[-1] - 1e-5 < mean < dry + viscous * rolling[0] + 1e-5
    assert np.isnan(fits.mean_deceleration(v[:5], np.full(5, True), fits.AT_REST_M_S))


def test_closed_form_solves_the_wheel_equations() -> None:
    """Compute forces from slip wheel by wheel. Equal loads give T0 = W / (g C sum d^2)."""
    robot = resolve_settings()
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
        softness = closed.coefficient[axis] / closed.gain[axis] ** 2
        assert gap == pytest.approx(softness * v * force / mass, rel=1e-9)
        assert closed.gain[axis] == pytest.approx(1 / (1 + softness * closed.drag[axis] / mass))
    even = robot.replace(wheels={"azimuths_deg": [45, 135, 225, 315]})
    assert compute_creep_law(even).coefficient[0] / compute_creep_law(even).gain[
        0
    ] ** 2 == pytest.approx(4 / (9.81 * c * 2))


@pytest.mark.parametrize("name", PUBLISHED)
def test_measured_slip_and_drag_agree_with_the_closed_form(name: str) -> None:
    """Within 0.014 in K, -5 % - 0.002 s^2/m and +4 % in T, and 8 % in drag.

    The closed form neglects viscous bearing friction and the spin-up of rollers.
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
    reported = result.summary()["slip"]["robots"][name]["quantities"]["time_forward"]
    assert reported["published"] == PUBLISHED[name]["time_forward"]
    assert reported["deviation_percent"] == pytest.approx(
        100 * (reported["measured"] / reported["published"] - 1)
    )


def test_moves_are_the_published_ones() -> None:
    """Commands cover the track of 3 m, minus the distance of a roll-out."""
    published = moves.identification_moves()
    assert len(published) == 32
    for move in published:
        frames = move.frames
        distance = np.abs(move.command(frames)).sum() * PERIOD_S
        if move.axis in ("forward", "sideways"):
            roll_out = 0.5 * abs(move.speed) if move.rolls_out else 0.0
            # A command is reached at the end of its frame, which is half a frame early. A roll-out
            # starts up to a frame late.
            assert distance == pytest.approx(
                3.0 - roll_out, abs=1.1 * PERIOD_S * abs(move.speed)
            ), move
        assert move.is_coasting(frames).any() == move.rolls_out


def test_unknown_and_repeated_robots_are_rejected() -> None:
    with pytest.raises(om.OmniError, match="unknown robot 'tigers'"):
        om.measure_slip(["tigers"])
    with pytest.raises(om.OmniError, match="two scenarios are called 'tigers-v2016'"):
        om.measure_slip(["tigers-v2016"] * 2)


def test_robot_that_topples_is_reported_and_left_out() -> None:
    """A disturbance topples it, so that nothing is measured."""
    pushed = om.load_scenario("rect", wheels=MODEL, disturbance={"force_n": 1000.0})
    result = om.measure_slip([pushed], [straight_move("forward", 1.5, rolls_out=True)])
    (failure,) = result.failures
    assert failure.cause == "toppled over"
    assert (
        result.summary()["slip"]["robots"]["tigers-v2016"]["quantities"]["gain_forward"]["measured"]
        is None
    )
