"""What no robot can be, by laws that are reckoned here another way: drawn wheels, polygons, moments of bodies."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from omni_control.errors import OmniError
from omni_control.kinematics import Kinematics
from omni_mj.scenarios import robot_checks
from omni_mj.scenarios.settings import BodySettings, CarpetSettings, MotorSettings, Settings, WheelSettings

FOUR = (60.0, 135.0, 225.0, 300.0)
angles = st.lists(st.floats(0, 360), min_size=3, max_size=8)
quick = hypothesis_settings(deadline=None, max_examples=60, derandomize=True)


def refusal(**sections: dict[str, object]) -> str:
    with pytest.raises(OmniError) as error:
        Settings(**sections)
    return str(error.value)


@pytest.mark.parametrize(
    ("sections", "says"),
    [
        ({"wheels": {"rollers": 8, "roller_radius_m": 0.002}}, "wheels.rollers = 8 of wheels.roller_radius_m = 0.002 "
         "do not close a wheel of wheels.radius_m = 0.0285: their ends do not meet; it takes 9 at least"),
        ({"wheels": {"roller_radius_m": 0.015}}, "wheels.roller_radius_m = 0.015 leaves no room for an axle"),
        ({"wheels": {"rollers": 30, "model": "two-rollers"}}, "wheels.rollers = 30 is too many for wheels.model = "),
        ({"wheels": {"arm_m": 0.04}}, "wheels.azimuths_deg: the wheels at 60 and 135 deg overlap with wheels.arm_m"),
        ({"wheels": {"azimuths_deg": [0, 180, 360]}}, "wheels.azimuths_deg: the wheels at 0 and 0 deg overlap"),
        ({"wheels": {"azimuths_deg": [90, 270, 270]}}, "wheels.azimuths_deg: the wheels at 270 and 270 deg overlap"),
        ({"wheels": {"azimuths_deg": [-60, 0, 60]}}, "body.centre_x_m = 0 is 41.5 mm outside the polygon of "),
        ({"body": {"centre_x_m": -0.06}}, "body.centre_x_m = -0.06 is 1.31 mm outside the polygon"),
        ({"body": {"yaw_inertia_kg_m2": 0.03}}, "body.yaw_inertia_kg_m2 = 0.03 and body.tilt_inertia_kg_m2"),
        ({"body": {"tilt_inertia_kg_m2": 0.1}}, "body.tilt_inertia_kg_m2 = 0.1 is more than body.mass_kg = 2.65"),
        ({"motor": {"resistance_ohm": -0.4}}, "motor.resistance_ohm must be a number from 0.0001 to 1000 ohm"),
        ({"motor": {"resistance_ohm": 4.0}}, "motor.nominal_rpm with motor.nominal_current_a takes"),
        ({"battery": {"cut_off_v": 17.0}}, "battery.cut_off_v = 17 is not below the 16.8 V of battery.cells = 4"),
        ({"firmware": {"rate_hz": 200}}, "firmware.rate_hz must divide the 960 Hz of the physics (960, 480, 320"),
        ({"firmware": {"rate_hz": 1000}}, "firmware.rate_hz must be a whole number from 60 to 960 Hz, not 1000"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_in_a_line(sections: dict[str, dict[str, object]], says: str) -> None:
    whole = dict(Settings())
    given = {name: {**dict(whole[name]), **fields} for name, fields in sections.items()}
    text = refusal(**given)
    assert any(line.startswith(says) for line in text.splitlines()), text


def test_all_that_is_wrong_is_said_at_once() -> None:
    text = refusal(body={"centre_x_m": 0.09, "yaw_inertia_kg_m2": 0.03}, battery={"cut_off_v": 30})
    assert len(text.splitlines()) == 4  # of which the yaw inertia is twice too much: for the tilt's, and for the mass


@quick
@given(st.floats(0.02, 0.05), st.floats(0.08, 0.4), st.integers(8, 40))
def test_rollers_close_a_wheel_where_their_barrels_meet(radius: float, share: float, count: int) -> None:
    """Drawn: a roller's profile is the wheel's circle; halfway to the next one it must be outside the rollers' axes.

    Axes are chords whose middles are at R - r.
    """
    half = math.pi / count
    profile, axis = np.array([math.sin(half), math.cos(half)]) * radius, radius * (1 - share)
    closes = profile[1] > axis
    given = WheelSettings.model_construct(
        model="rollers", azimuths_deg=FOUR, arm_m=1.0, radius_m=radius, rollers=count, roller_radius_m=share * radius
    )
    assert bool(list(robot_checks.wheels(given))) != closes


@quick
@given(st.floats(0.02, 0.05), st.floats(0.1, 0.45), st.floats(0, 0.6))
def test_a_roller_reaches_as_deep_as_its_lowest_point(radius: float, share: float, angle: float) -> None:
    """By 100000 points of the ellipse; between two of them it may be 1e-9 of its size lower."""
    roller = share * radius
    t = np.linspace(0, math.tau, 100_001)
    along, down = math.sqrt(radius * roller) * np.sin(t), radius - roller + roller * np.cos(t)
    lowest = (down * math.cos(angle) + along * math.sin(angle)).max()
    assert robot_checks.depth(radius, roller, angle) == pytest.approx(lowest, rel=1e-8)


@quick
@given(angles, st.floats(0.05, 0.12))
def test_wheels_overlap_where_their_discs_do(azimuths: list[float], arm: float) -> None:
    """Seen from above, their inner sides are segments; they overlap where two of these cross."""
    radius, roller = 0.0285, 0.006
    middles = [(arm - roller) * np.exp(1j * math.radians(a)) for a in azimuths]
    sides = [(m - 1j * radius * m / abs(m), m + 1j * radius * m / abs(m)) for m in middles]

    def side(a: complex, b: complex, p: complex) -> float:
        return float(((b - a).conjugate() * (p - a)).imag)

    pairs = [(s, t) for i, s in enumerate(sides) for t in sides[:i]]
    products = [(side(*s, t[0]) * side(*s, t[1]), side(*t, s[0]) * side(*t, s[1])) for s, t in pairs]
    if any(abs(p) < 1e-12 for pair in products for p in pair):
        return  # they touch, or nearly lie on each other: rounding decides
    crossing = any(p < 0 and q < 0 for p, q in products)
    given = WheelSettings.model_construct(
        model="rollers", azimuths_deg=tuple(azimuths), arm_m=arm, radius_m=radius, rollers=16, roller_radius_m=roller
    )
    assert bool(list(robot_checks.wheels(given))) == crossing


@quick
@given(angles, st.floats(-0.09, 0.09))
def test_a_robot_stands_where_wheels_can_bear_it(azimuths: list[float], x: float) -> None:
    """By linear programming: loads that are not negative, with the weight's sum and moments."""
    from scipy.optimize import linprog

    arm, around = 0.08, np.radians(azimuths)
    inside = robot_checks.support(azimuths, arm, x)
    if abs(inside) < 1e-6 or np.diff(np.sort(around)).min() < 1e-3:
        return
    balance = np.stack([np.ones(len(around)), arm * np.cos(around), arm * np.sin(around)])
    stands = linprog(np.zeros(len(around)), A_eq=balance, b_eq=[1.0, x, 0.0]).status == 0
    assert (inside > 0) == stands


@quick
@given(angles)
def test_three_wheels_that_do_not_overlap_move_a_robot_along_all_axes(azimuths: list[float]) -> None:
    """Their axles meet in the middle, so that no three of them are parallel: what speeds turn them is of rank 3."""
    try:
        placed = WheelSettings(azimuths_deg=tuple(azimuths), arm_m=0.09)
    except OmniError:
        return
    matrix = Kinematics(np.radians(placed.azimuths_deg), 1.0, 1.0).matrix
    assert np.linalg.svd(matrix, compute_uv=False).min() > 0.1


@quick
@given(
    st.lists(st.tuples(*[st.floats(-0.06, 0.06)] * 2, st.floats(0, 0.12), st.floats(0.01, 1)), min_size=4, max_size=9)
)
def test_no_body_is_refused_for_its_inertia(masses: list[tuple[float, float, float, float]]) -> None:
    """Points within the robot, and their mirror images so that any horizontal axis is like any other: all pass."""
    at = np.array([p for x, y, z, _ in masses for p in ((x, y, z), (-y, x, z), (-x, -y, z), (y, -x, z))])
    m = np.repeat([each[3] for each in masses], 4)
    centre = m @ at / m.sum()
    r = at - centre
    yaw, tilt = m @ (r[:, 0] ** 2 + r[:, 1] ** 2), m @ (r[:, 0] ** 2 + r[:, 2] ** 2)
    whole = Settings.model_construct(
        body=BodySettings.model_construct(
            mass_kg=m.sum(), centre_x_m=0.0, centre_height_m=0.05, yaw_inertia_kg_m2=yaw, tilt_inertia_kg_m2=tilt
        ),
        wheels=WheelSettings(), battery=Settings().battery, motor=MotorSettings(), carpet=CarpetSettings(),
    )  # fmt: skip
    assert list(robot_checks.robot(whole)) == []
