"""Laws of the kinematics: rigid-body motion at the wheels, rotation between frames, angles."""

import math

import numpy as np
from benches.control import Kinematics, body_to_world, world_to_body, wrap_angle
from hypothesis import example, given
from hypothesis import strategies as st

EPS = float(np.finfo(float).eps)

ARM, RADIUS = 0.08, 0.027
twists = st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-30, 30))
angles = st.floats(-1e4, 1e4)
# Wheels at most 20 deg from the nominal azimuths: any such four have a well-conditioned matrix.
robots = st.builds(
    lambda shift, arm, radius: Kinematics(
        np.radians(np.add([60.0, 135.0, 225.0, 300.0], shift)), arm, radius
    ),
    st.tuples(*[st.floats(-20, 20)] * 4),
    st.floats(0.05, 0.12),
    st.floats(0.02, 0.04),
)


@given(robots, twists)
def test_a_wheel_rolls_at_the_velocity_of_its_contact_point(
    robot: Kinematics, twist: tuple[float, ...]
) -> None:
    """Rigid body in the complex plane: point p moves at v + i w p, the wheel along i p / |p|."""
    spoke = np.exp(1j * robot.azimuths)
    point_velocity = complex(twist[0], twist[1]) + 1j * twist[2] * robot.arm * spoke
    rim = (point_velocity * np.conj(1j * spoke)).real
    # Speeds reach (5 sqrt 2 + 30 * 0.12) / 0.02 = 530 rad/s, of which a few roundings are about
    # 1e-12.
    np.testing.assert_allclose(robot.wheel_speeds(twist), rim / robot.radius, rtol=0, atol=2e-12)


@given(robots, st.tuples(*[st.floats(-300, 300)] * 4))
def test_slipping_wheels_give_the_least_squares_twist(
    robot: Kinematics, speeds: tuple[float, ...]
) -> None:
    """Four wheels over-determine three unknowns; an independent solver finds the same best fit."""
    spoke = np.exp(1j * robot.azimuths)
    rolling = np.stack([-spoke.imag, spoke.real, np.full(4, robot.arm)], axis=1)
    best = np.linalg.lstsq(rolling, np.array(speeds) * robot.radius, rcond=None)[0]
    # Twists reach 300 * 0.04 / 0.05 = 240 rad/s and the matrix has a condition number of about 30.
    np.testing.assert_allclose(robot.body_twist(speeds), best, rtol=0, atol=1e-11)


@given(twists, angles)
def test_the_world_frame_is_a_rotation_of_the_body_frame(
    twist: tuple[float, ...], heading: float
) -> None:
    """Rotation by phi is multiplication by exp(i phi); the turn rate is the same in both frames."""
    velocity = complex(twist[0], twist[1])
    turned, back = velocity * np.exp(1j * heading), velocity * np.exp(-1j * heading)
    # Two products and a sum of numbers of size 5.
    np.testing.assert_allclose(
        body_to_world(twist, heading), [turned.real, turned.imag, twist[2]], rtol=0, atol=4e-15
    )
    np.testing.assert_allclose(
        world_to_body(twist, heading), [back.real, back.imag, twist[2]], rtol=0, atol=4e-15
    )


@given(angles)
@example(np.pi)
@example(-np.pi)
@example(3 * np.pi)
@example(-3 * np.pi)
@example(0.0)
def test_wrapping_removes_whole_turns_only(angle: float) -> None:
    """Wrapped and original angles differ by a multiple of a turn, by the IEEE remainder."""
    wrapped = float(wrap_angle(angle))
    # The number of turns times 2 pi is rounded to the spacing of floats near the angle.
    slack = 2 * EPS * (abs(angle) + np.pi)
    assert abs(math.remainder(wrapped - angle, 2 * np.pi)) <= slack
    assert abs(wrapped) <= np.pi + slack


def test_wrapped_angles_never_leave_the_half_open_interval() -> None:
    """(-pi, pi] holds strictly, also for angles one rounding away from an odd multiple of pi."""
    odd = np.arange(-2001, 2002, 2) * np.pi
    angle = np.concatenate([odd, np.nextafter(odd, np.inf), np.nextafter(odd, -np.inf)])
    wrapped = wrap_angle(angle)
    assert wrapped.max() <= np.pi
    assert wrapped.min() > -np.pi
