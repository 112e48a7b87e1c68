"""Creep, limit and drag of single wheels, against plain vectors and the backward Euler rule."""

import numpy as np
import pytest
from driving import with_settings
from hypothesis import given
from hypothesis import strategies as st
from laws import LAW
from omni_mj.onboard.laws import AT_REST_M_S
from omni_mj.onboard.traction import Traction

from omni_control.kinematics import Kinematics

KINEMATICS = Kinematics(np.radians([60, 135, 225, 300]), 0.083, 0.0285)
CENTRE, STEP = np.array([0.002, 0.0, 0.047]), 1 / 960
UP = np.array([0.0, 0.0, 1.0])
numbers = st.floats(0.0, 1.0)
speeds = st.tuples(st.floats(-4, 4), st.floats(-4, 4), st.floats(-20, 20)).map(np.array)


def traction(pile: float = 0.1, bearing: float = 0.03, friction: float = 0.8, inertia: float = 1.2e-5) -> Traction:
    settings = with_settings(
        carpet={"pile": pile, "friction": friction}, drive={"roller_friction": bearing, "creep_stiffness": 2.0}
    )
    return Traction([settings], KINEMATICS, CENTRE, np.full(4, 1 / inertia), STEP)


def travelled(made: Traction, heading: float, twist: np.ndarray, load: np.ndarray) -> Traction:
    quaternion = np.array([[np.cos(heading / 2), 0, 0, np.sin(heading / 2)]])
    made.travel(np.zeros((1, 3)), quaternion, np.array([[twist[0], twist[1], 0.3, 0, 0, twist[2]]]), load[None])
    made.press(load[None])
    return made


@LAW
@given(heading=st.floats(-7, 7), twist=speeds, pile=numbers, bearing=numbers, seed=st.integers(0, 1000))
def test_drag_is_the_sum_of_the_wheels_forces_and_their_moments(
    heading: float, twist: np.ndarray, pile: float, bearing: float, seed: int
) -> None:
    load = np.random.default_rng(seed).uniform(0, 20, 4)
    wrench = travelled(traction(pile, bearing), heading, twist, load).wrench[0]
    force, moment = np.zeros((2, 3))
    turn = np.array([[np.cos(heading), -np.sin(heading), 0], [np.sin(heading), np.cos(heading), 0], [0, 0, 1]])
    centre = turn @ CENTRE
    for azimuth, n in zip(KINEMATICS.azimuths, load, strict=True):
        axle = turn @ np.array([np.cos(azimuth), np.sin(azimuth), 0])
        contact = KINEMATICS.arm * axle
        velocity = np.array([*twist[:2], 0]) + np.cross(twist[2] * UP, contact)
        along = velocity @ axle
        pull = -pile * n * velocity / max(np.linalg.norm(velocity), AT_REST_M_S)
        pull -= min(bearing, 0.8) * n * along / max(abs(along), AT_REST_M_S) * axle
        force, moment = force + pull, moment + np.cross(contact - centre, pull)
    np.testing.assert_allclose(wrench, [*force, *moment], rtol=0, atol=1e-9)


@LAW
@given(twist=speeds, load=st.floats(0.1, 30), torque=st.floats(0.0, 0.1))
def test_a_rim_slips_as_backward_euler_says(twist: np.ndarray, load: float, torque: float) -> None:
    """One step of I w' = tau - c w with c = R^2 N C / |v|: w = h tau / (I + h c), and its steady state the law."""
    inertia, stiffness = 1.2e-5, 2.0
    made = travelled(traction(), 0.4, twist, np.full(4, load))
    tangents = 1j * np.exp(1j * KINEMATICS.azimuths)
    body = complex(twist[0], twist[1]) * np.exp(-0.4j)
    speed = np.abs(body + twist[2] * KINEMATICS.arm * tangents)
    # MuJoCo, of a hinge alone that stood: I a = tau + f and a + R f = 0 with R = (1 - d) / (d I).
    found = STEP * torque * (1 - made.impedance[0]) / inertia
    euler = STEP * torque / (inertia + STEP * KINEMATICS.radius**2 * load * stiffness / np.maximum(speed, 1e-12))
    np.testing.assert_allclose(found, euler, rtol=1e-9, atol=1e-12)


@given(friction=st.floats(0.05, 2.0), bearing=numbers)
@LAW
def test_the_limit_is_what_the_bearing_leaves_of_the_circle(friction: float, bearing: float) -> None:
    """Travelling along the axle of the first wheel; along its rim, the bearing takes nothing."""
    axle, load = np.exp(1j * KINEMATICS.azimuths[0]), np.full(4, 5.0)
    for direction, held in ((axle, min(bearing, friction)), (1j * axle, 0.0)):
        made = travelled(traction(0.0, bearing, friction), 0.0, np.array([direction.real, direction.imag, 0]), load)
        expected = np.sqrt(friction**2 - held**2) * 5.0 * KINEMATICS.radius
        assert made.limit[0, 0] == pytest.approx(expected, rel=1e-6, abs=1e-7)


def test_a_wheel_that_stands_does_not_creep_and_one_in_the_air_has_no_grip() -> None:
    standing = travelled(traction(), 0.0, np.zeros(3), np.full(4, 6.0))
    np.testing.assert_array_equal(standing.impedance, 1.0)
    np.testing.assert_array_equal(standing.wrench, 0.0)
    flying = travelled(traction(), 0.0, np.array([1.0, 0, 0]), np.zeros(4))
    assert flying.limit.max() < 1e-4
    np.testing.assert_array_equal(flying.wrench, 0.0)


def test_rows_are_computed_each_by_itself() -> None:
    """To the bit, however many there are."""
    rng = np.random.default_rng(0)
    settings = [with_settings(carpet={"pile": float(p)}) for p in rng.uniform(0, 0.3, 9)]
    position, quaternion, velocity = (rng.normal(size=(9, k)) for k in (3, 4, 6))
    load = rng.uniform(0, 9, (9, 4))

    def wrench(rows: slice) -> np.ndarray:
        made = Traction(settings[rows], KINEMATICS, CENTRE, np.full(4, 8e4), STEP)
        made.travel(position[rows], quaternion[rows], velocity[rows], load[rows])
        made.press(load[rows])
        return np.column_stack([made.wrench, made.limit, made.impedance])

    whole = wrench(slice(None))
    for row in range(9):
        np.testing.assert_array_equal(wrench(slice(row, row + 1)), whole[row : row + 1])
