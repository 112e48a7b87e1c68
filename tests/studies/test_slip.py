"""Test that fits recover known parameters and that robots slip as the closed form predicts."""

import numpy as np
import pytest
from benches.creep import CONTACT_RATIO, traction_per_load
from benches.studies import (
    PERIOD_S,
    PUBLISHED,
    Move,
    compute_creep_law,
    fits,
    moves,
    straight_move,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

import omni_mj as om
from omni_mj.config.resolve import resolve_settings
from omni_mj.config.settings import Settings

AT = np.arange(0.0, 2.4, PERIOD_S)
MOVES = (
    straight_move("forward", 1.0, rolls_out=False),
    straight_move("sideways", -1.25, rolls_out=False),
    straight_move("forward", 1.25, rolls_out=True),
    straight_move("sideways", -1.25, rolls_out=True),
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


class WheelEquations:
    """Traction of the wheels of a robot that travels along an axis, by Pacejka's cubic.

    Attributes:
        inertia: Mass or yaw inertia, kg or kg m^2.
        arm: Speed of the rims over the speed of the robot when it turns, 1 or m.
        drag: Rolling resistance and friction of the rollers' bearings, N or N m.
    """

    def __init__(self, robot: Settings, axis: int) -> None:
        """Prepare the equations of forward (0), sideways (1) or turning motion (2)."""
        wheels, body, azimuths = robot.wheels, robot.body, np.radians(robot.wheels.azimuths_deg)
        outward = np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1)
        self._matrix = np.column_stack(
            [-outward[:, 1], outward[:, 0], np.full(len(azimuths), wheels.arm_m)]
        )
        sums = np.array([np.ones(len(azimuths)), *wheels.arm_m * outward.T])
        weights = body.mass_kg * 9.81 * np.array([1.0, body.com_x_m, 0.0])
        self._load = sums.T @ np.linalg.solve(sums @ sums.T, weights)
        self._axis, self._stiffness = axis, robot.drivetrain.creep_stiffness
        self.inertia = body.yaw_inertia_kg_m2 if axis == 2 else body.mass_kg
        self.arm = wheels.arm_m if axis == 2 else 1.0
        axle = np.zeros(len(azimuths)) if axis == 2 else outward[:, axis]
        self._travel = np.stack([self._matrix[:, axis], axle], axis=1)  # at the speed 1
        ratio = (wheels.radius_m / wheels.roller_radius_m) ** (2 / 3)
        self._travel[:, 1] *= ratio / CONTACT_RATIO  # `traction_per_load` has the default ratio
        bearing = 0.0 if axis == 2 else robot.drivetrain.roller_friction
        self._friction = np.sqrt(robot.carpet.friction**2 - bearing**2)
        rolling = robot.carpet.rolling_resistance * self._load.sum() * self.arm
        self.drag = rolling + bearing * self._load @ np.abs(axle)

    def wrench(self, slip: NDArray) -> NDArray:
        """Return force and moment (3,) at a slip twist (3,), relative to the speed of travel."""
        traction = traction_per_load(
            self._matrix @ slip, self._travel, self._stiffness, self._friction
        )
        return np.asarray(self._matrix.T @ (self._load * traction))

    def slip(self, force: float) -> float:
        """Return the slip along the axis under a force along the axis."""
        expected = force * np.eye(3)[self._axis]
        return float(fsolve(lambda slip: self.wrench(slip) - expected, np.zeros(3))[self._axis])


@settings(max_examples=50)
@given(
    axis=st.sampled_from(range(3)),
    stiffness=st.floats(3, 12),
    bearing=st.floats(0, 0.15),
    rolling=st.floats(0.005, 0.05),
    com_x=st.floats(-0.01, 0.01),
    azimuths=st.sampled_from([(60, 135, 225, 300), (45, 135, 225, 315), (60, 180, 300)]),
)
def test_closed_form_solves_the_wheel_equations(
    axis: int,
    stiffness: float,
    bearing: float,
    rolling: float,
    com_x: float,
    azimuths: tuple[float, ...],
) -> None:
    """Compute forces from slip wheel by wheel. T0 is the slope of the slip at the drag."""
    robot = resolve_settings(
        {
            "carpet": {"rolling_resistance": rolling},
            "drivetrain": {"creep_stiffness": stiffness, "roller_friction": bearing},
            "body": {"com_x_m": com_x},
            "wheels": {"azimuths_deg": azimuths},
        }
    )
    closed, wheels = compute_creep_law(robot), WheelEquations(robot, axis)
    assert closed.drag[axis] == pytest.approx(wheels.drag)
    gain = 1 / (1 + wheels.slip(wheels.drag))
    step = 0.01 * wheels.drag
    slope = (wheels.slip(wheels.drag + step) - wheels.slip(wheels.drag - step)) / (2 * step)
    assert closed.gain[axis] == pytest.approx(gain, rel=1e-4)
    assert closed.coefficient[axis] == pytest.approx(
        gain**2 * wheels.inertia * slope / wheels.arm, rel=1e-3
    )


@pytest.mark.parametrize("name", PUBLISHED)
def test_measured_slip_and_drag_agree_with_the_closed_form(name: str) -> None:
    """The closed form neglects viscous friction and the spin-up of rollers.

    Robots that turned in sideways moves would have up to 15 % less T, and 4 % to 17 % less drag.
    """
    result = om.measure_slip([om.load_scenario("rect", robot=name, wheels=MODEL)], MOVES)
    (robot,) = result.robots.values()
    measured, closed = robot.measured, robot.closed_form
    for axis in moves.AXES:
        gain = closed[f"gain_{axis}"]
        assert gain - 0.018 < measured[f"gain_{axis}"] < gain, axis
    # The fit adds 1 ms to T |u|, which is 0.0016 s^2/m in turns. The rest is due to rims (2 %) and
    # wheel loops (3 %). Rubber softens, so T in moves is the secant over their accelerations.
    wheels = WheelEquations(result.outcomes[0].scenario.settings, 0)
    slips = [wheels.slip(wheels.drag + sign * 2.0 * wheels.inertia) for sign in (1, -1)]
    secant = closed["gain_forward"] ** 2 * (slips[0] - slips[1]) / 4.0
    assert secant < measured["time_forward"] + 0.001 < 1.06 * secant
    # Sideways, softening raises T by 9 to 15 %, and (K T0 a)^2 and soft
    # wheel loops lower it by as much.
    assert measured["time_sideways"] == pytest.approx(closed["time_sideways"], rel=0.03)
    assert measured["time_turning"] + 0.0016 == pytest.approx(closed["time_turning"], rel=0.03)
    assert measured["drag_forward"] == pytest.approx(closed["drag_forward"], rel=0.02)
    assert 1.0 < measured["drag_sideways"] / closed["drag_sideways"] < 1.035
    # Hubs, rims and rollers turn, too: their inertia is 5 to 8 % of that of robot and motors.
    assert 0.92 < measured["drag_turning"] / closed["drag_turning"] < 0.98
    assert [row["move"] for row in result.rows().to_pylist()] == [move.axis for move in MOVES]
    reported = result.summary()["slip"]["robots"][name]["quantities"]
    assert reported["drag_sideways"]["published"] is None
    time = reported["time_forward"]
    assert time["published"] == PUBLISHED[name]["time_forward"]
    assert time["deviation_percent"] == pytest.approx(
        100 * (time["measured"] / time["published"] - 1)
    )


def test_moves_are_the_published_ones() -> None:
    """Commands cover the track of 3 m, minus the distance of a roll-out."""
    published = moves.identification_moves()
    assert len(published) == 40
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
