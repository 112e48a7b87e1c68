"""How driving turns robots, by the wheels' geometry: wheels do not all give way alike under what they pull.

A wheel k gives way along its rim by what it pulls over a stiffness c_k: by the lag of its loop, and by creep, which is
in proportion to its travel and, of the same pull, to the inverse of its load (Pacejka, Tire and Vehicle Dynamics, on
the brush model). In units that do not matter here

    1 / c_k = tau + T |V_k| / n_k,    V_k = v + w l d_k,    n_k = load over the mean of all

with lag tau and creep T of driving forward (`motion`), and the rim's direction d_k. A robot whose velocity lacks e of
the one commanded, and whose turn rate lacks e_w, is turned by the moment l sum c_k (d_k . e + l e_w). So e turns it as
a command would of

    share sum c_k (d_k . e) / (l sum c_k)

where share is what a loop on the gyro leaves. It is not zero: rims need not add up to nothing; those that turning makes
travel faster give way more; and acceleration takes load from the wheels on the side towards which it goes.
"""

from typing import NamedTuple

import numpy as np

from omni_control.estimation.motion import Plane
from omni_control.kinematics import Array, Kinematics, Number
from omni_control.traction import GRAVITY, loads

HEIGHT_M = 0.047  # of the centre of mass: TIGERs Mannheim's robots have 45 and 49 mm
LEAST_LOAD = 0.1  # of the mean, that every wheel is taken to bear


class GivesArrays(NamedTuple):
    """Of `Compliance`; of robots whose wheels do not give way, of no wheel."""

    rims: Plane  # (W,)
    standing: Array  # (W,)
    shifting: Plane  # (W,)
    arm: float
    share: float


class Compliance:
    """Wheels that give way.

    Args:
        geometry: of the wheels.
        share: of what they do to a turn rate, that a loop on the gyro leaves.

    Attributes:
        arrays: of them.
    """

    def __init__(self, geometry: Kinematics, share: float) -> None:
        rims: Plane = geometry.matrix[:, 0] + 1j * geometry.matrix[:, 1]
        standing, shifting = loads(geometry, HEIGHT_M)
        shifted: Plane = len(rims) / GRAVITY * shifting[:, :2] @ np.array([1, -1j])
        self.arrays = GivesArrays(rims, len(rims) * standing, shifted, geometry.arm, share / geometry.arm)

    def turned(
        self, velocity: Plane, rate: Array, acceleration: Plane, shortfall: Plane, lag: Array, creep: Array
    ) -> Array:
        """Turn rates (..., n) that act on robots like commands, rad/s.

        Args:
            velocity: of robots (..., n), m/s, here and below ahead and aside as real and imaginary parts.
            rate: at which they turn, (..., n) or (n,) rad/s.
            acceleration: (..., n) or (n,) m/s^2.
            shortfall: of the velocity from the one commanded, (..., n) m/s.
            lag: of the wheel loops forward, (n,) s.
            creep: forward, as the slip of wheels over their travel and their robot's acceleration, (n,) s^2/m.
        """
        own, turning = self.arrays, self.arrays.arm * rate
        load = loaded(acceleration[..., None], own.standing, own.shifting)
        stiff = stiffness(velocity[..., None], turning[..., None], own.rims, load, lag[:, None], creep[:, None])
        pull = stiff * (shortfall.conj()[..., None] * own.rims).real
        turned: Array = own.share * np.add.reduce(pull, axis=-1) / np.add.reduce(stiff, axis=-1)
        return turned


# Laws for single numbers and arrays alike, by which loops over robots reckon too (`by_robot`).


def loaded(acceleration: Number, standing: Number, shifting: Number) -> Number:
    """Load of a wheel over the mean, n."""
    return np.maximum(standing + (acceleration * shifting).real, LEAST_LOAD)


def stiffness(velocity: Number, turning: Number, rim: Number, load: Number, lag: Number, creep: Number) -> Number:
    """Of a wheel along its rim, c; `turning` is the speed that it has by the turn rate."""
    return 1 / (lag + creep * np.abs(velocity + turning * rim) / load)
