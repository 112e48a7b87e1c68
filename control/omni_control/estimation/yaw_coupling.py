"""How driving turns robots, by the wheels' geometry: wheels do not all give way alike under what they pull.

A wheel k gives way along its rim by what it pulls over a stiffness c_k: by the lag of its loop, and by creep,
which is in proportion to its travel and, of the same pull, to the inverse of its load (Pacejka, Tire and
Vehicle Dynamics, on the brush model). In units that cancel

    1 / c_k = tau + T |V_k| / n_k,    V_k = v + w l d_k,    n_k = load over the mean of all

with lag tau and creep T of driving forward, and the rim's direction d_k. A robot whose velocity lacks e of the
one commanded, and whose turn rate lacks e_w, is turned by the moment l sum c_k (d_k . e + l e_w). So e turns it
as a command would of

    share sum c_k (d_k . e) / (l sum c_k)

where share is what a loop on the gyro leaves. It is not zero: rims need not add up to nothing; those that
turning makes travel faster give way more; and acceleration takes load from the wheels towards which it goes.
"""

import numpy as np

from omni_control.kinematics import Array, Kinematics
from omni_control.traction import GRAVITY, load_distribution

CENTER_HEIGHT_M = 0.047  # of the centre of mass: TIGERs Mannheim's robots have 45 and 49 mm
MIN_LOAD = 0.1  # of the mean, that every wheel bears


class WheelCompliance:
    """Wheels that give way.

    Args:
        geometry: of the wheels.
        share: of what they do to a turn rate, left by a loop on the gyro.
    """

    def __init__(self, geometry: Kinematics, share: float) -> None:
        self._rims = geometry.matrix[:, :2].T  # (2, wheels)
        standing, shifting = load_distribution(geometry, CENTER_HEIGHT_M)
        count = len(geometry.azimuths)
        self._standing, self._shifting = count * standing, count / GRAVITY * shifting[:, :2].T
        self._arm, self._share = geometry.arm, share / geometry.arm

    def compute_turn_rate(
        self, velocity: Array, acceleration: Array, shortfall: Array, lag: Array, creep: Array
    ) -> Array:
        """Return the turn rates (..., n) that act on robots like commands, rad/s.

        Args:
            velocity: of robots in their axes, (..., n, 3).
            acceleration: same, m/s^2.
            shortfall: of the velocity from the one commanded, same.
            lag: of the wheel loops forward, (..., n) s.
            creep: forward, (..., n) s^2/m.
        """
        # Sums instead of matrix products, which BLAS may round differently in a larger batch.
        shifted = (
            acceleration[..., :1] * self._shifting[0] + acceleration[..., 1:2] * self._shifting[1]
        )
        load = np.maximum(self._standing + shifted, MIN_LOAD)
        turning = self._arm * velocity[..., 2:]
        along = velocity[..., :1] + turning * self._rims[0]
        across = velocity[..., 1:2] + turning * self._rims[1]
        stiffness = 1 / (lag[..., None] + creep[..., None] * np.hypot(along, across) / load)
        pull = stiffness * (
            shortfall[..., :1] * self._rims[0] + shortfall[..., 1:2] * self._rims[1]
        )
        turn_rate: Array = self._share * pull.sum(-1) / stiffness.sum(-1)
        return turn_rate
