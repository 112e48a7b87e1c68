"""The creep law of a wheel, written independently of omni_mj."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benches.plant import RADIUS_M, ROLLER_RADIUS_M

# Length of the default robot's contacts along the rim over that along the axle (Hertz)
CONTACT_RATIO = (RADIUS_M / ROLLER_RADIUS_M) ** (2 / 3)


def contact_speed(velocity: ArrayLike) -> NDArray:
    """Return the speed at which rubber passes through the contacts, m/s.

    Args:
        velocity: Velocities of the wheels' centers along rim and axle, (..., 2) m/s.
    """
    rim, axle = np.moveaxis(np.asarray(velocity, float), -1, 0)
    return np.asarray(np.hypot(rim, CONTACT_RATIO * axle))


def traction_per_load(
    slip: ArrayLike, velocity: ArrayLike, stiffness: float, friction: float
) -> NDArray:
    """Return Pacejka's cubic for a brush under parabolic pressure, mu (1 - (1 - x)^3).

    Args:
        slip: Speeds of the rims relative to the carpet, m/s.
        velocity: As for `contact_speed`.
        stiffness: Creep stiffness C.
        friction: Coefficient of friction mu along the rim.
    """
    slip, speed = np.asarray(slip, float), np.maximum(contact_speed(velocity), 1e-9)
    stuck = np.maximum(1 - np.abs(slip) * stiffness / (3 * friction * speed), 0.0)
    return np.asarray(np.sign(slip) * friction * (1 - stuck**3))


def slip_of_traction(
    traction: ArrayLike, velocity: ArrayLike, stiffness: float, friction: float
) -> NDArray:
    """Return the inverse of `traction_per_load` for tractions over load below the friction."""
    traction = np.asarray(traction, float)
    fraction = 1 - np.cbrt(1 - np.abs(traction) / friction)
    limit = 3 * friction / stiffness * contact_speed(velocity)
    return np.asarray(np.sign(traction) * fraction * limit)
