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

import numpy as np

from omni_control.estimation.motion import Plane
from omni_control.kinematics import Array, Kinematics
from omni_control.traction import GRAVITY, loads

HEIGHT_M = 0.047  # of the centre of mass: TIGERs Mannheim's robots have 45 and 49 mm
LEAST_LOAD = 0.1  # of the mean, that every wheel is taken to bear


class Compliance:
    """Wheels that give way.

    Args:
        geometry: of the wheels.
        share: of what they do to a turn rate, that a loop on the gyro leaves.
    """

    def __init__(self, geometry: Kinematics, share: float) -> None:
        self._rims: Plane = geometry.matrix[:, 0] + 1j * geometry.matrix[:, 1]
        self._arm, self._share = geometry.arm, share / geometry.arm
        standing, shifting = loads(geometry, HEIGHT_M)
        self._standing = len(standing) * standing
        self._shifting = len(standing) / GRAVITY * (shifting[:, 0] - 1j * shifting[:, 1])

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
        travel = np.abs(velocity[..., None] + (self._arm * rate)[..., None] * self._rims)
        load = np.maximum(self._standing + (acceleration[..., None] * self._shifting).real, LEAST_LOAD)
        stiffness = 1 / (lag[:, None] + creep[:, None] * travel / load)
        pull = stiffness * (shortfall.conj()[..., None] * self._rims).real
        turned: Array = self._share * np.add.reduce(pull, axis=-1) / np.add.reduce(stiffness, axis=-1)
        return turned
