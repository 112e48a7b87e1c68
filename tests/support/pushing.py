"""Wheels that push on a carpet, as tests of their limits draw them, and what they can do at best, wheel by wheel."""

import cmath
import math

import numpy as np
from hypothesis import strategies as st
from scipy.optimize import linprog

from omni_control import Kinematics, MotionLimits, WheelLimits
from omni_control.kinematics import Array

G, RADIUS = 9.81, 0.0285
AZIMUTHS = (60.0, 135.0, 225.0, 300.0)
# Wheels at most 15 deg from these azimuths: they stand around the centre. On the worst carpet drag takes 2/3 of it.
wheels = st.builds(
    lambda shift, arm, *rest: WheelLimits(Kinematics(np.radians(np.add(AZIMUTHS, shift)), arm, RADIUS), *rest),
    st.tuples(*[st.floats(-15, 15)] * 4),
    st.floats(0.06, 0.1),
    st.floats(0.3, 1.2),
    st.floats(0.05, 0.1),
    st.floats(0, 0.05),
    st.floats(0, 0.05),
    st.floats(0, 0.05),
    st.floats(0.5, 5),
)
vectors = st.tuples(*[st.floats(-1, 1).filter(lambda x: abs(x) > 1e-3)] * 2, st.floats(-20, 20))
limits = st.builds(
    MotionLimits,
    st.floats(0.3, 4),
    st.floats(0.3, 8),
    st.floats(1, 10),
    st.floats(3, 100),
    st.none() | st.floats(0.3, 8),
    st.none() | st.floats(5, 200),
)
TIGERS = WheelLimits(Kinematics(np.radians(AZIMUTHS), 0.083, RADIUS), 0.45, 0.0695, 0.045, 0.045, 0.09)  # v2016


def statics(robot: WheelLimits) -> tuple[Array, Array]:
    """Loads at rest (wheels,) and what accelerations [ax, ay] add to them (wheels, 2), per mass: four springs."""
    spoke = np.exp(1j * robot.kinematics.azimuths)
    balance = np.array([np.ones(4), robot.kinematics.arm * spoke.real, robot.kinematics.arm * spoke.imag])
    moments = np.array([[G, 0, 0], [0, -robot.centre_height, 0], [0, 0, -robot.centre_height]])
    loads = balance.T @ np.linalg.solve(balance @ balance.T, moments)
    return loads[:, 0], loads[:, 1:]


def drag(robot: WheelLimits, travel: Array) -> Array:
    """Force [x, y] and moment per mass on a body that travels at a twist, wheel by wheel."""
    force, moment = 0j, 0.0
    for azimuth, load in zip(robot.kinematics.azimuths, statics(robot)[0], strict=True):
        axle = cmath.exp(1j * azimuth)
        lever = robot.kinematics.arm * axle
        v = complex(*travel[:2]) + 1j * travel[2] * lever
        across = (v * axle.conjugate()).real
        push = -load * (robot.pile * v / abs(v) + robot.roller_friction * np.sign(across) * axle)
        force, moment = force + push, moment + (lever.conjugate() * push).imag
    return np.array([force.real, force.imag, moment])


def most(robot: WheelLimits, asked: Array, travel: Array) -> float:
    """How many times accelerations [ax, ay, b] can be had at best: forces of the rims, by a linear program."""
    standing, shifting = statics(robot)
    spoke = np.exp(1j * robot.kinematics.azimuths)
    grip = math.sqrt(robot.friction**2 - robot.roller_friction**2)
    q = asked * [1, 1, robot.gyration**2]
    gives = np.array([(1j * spoke).real, (1j * spoke).imag, np.full(4, robot.kinematics.arm)])
    shifts = -grip * (shifting @ q[:2])[:, None]
    found = linprog(
        [0, 0, 0, 0, -1],
        np.vstack([np.hstack([sign * np.eye(4), shifts]) for sign in (1, -1)]),
        np.tile(grip * standing, 2),
        np.hstack([gives, -q[:, None]]),
        -drag(robot, travel),
        bounds=(None, None),
    )
    return float(found.x[-1])
