"""Turning that driving causes: wheels do not all yield alike under traction.

A wheel k yields along its rim by its traction over a stiffness c_k. Two effects add up: the lag of
its speed loop, and creep, which is in proportion to the speed of the wheel and inversely to its
load (Pacejka, Tire and Vehicle Dynamics, brush model). In units that cancel

    1 / c_k = tau + T |V_k| / n_k,    V_k = v + w l d_k,    n_k = load over the mean load

with lag tau and creep T of driving forward, and the rim's direction d_k. A velocity deficit e and a
turn rate deficit e_w cause a moment l sum c_k (d_k . e + l e_w). So e turns the robot like a
commanded turn rate of

    r sum c_k (d_k . e) / (l sum c_k)

where r is the fraction that a gyro loop leaves. The sum is not zero, for three reasons: rim
directions need not add up to zero; wheels that turning makes faster yield more; and acceleration
unloads the wheels on the side towards which it points.
"""

import numpy as np

from omni_control.kinematics import Array, Kinematics
from omni_control.traction import GRAVITY, compute_load_distribution

COM_HEIGHT_M = 0.047  # of the center of mass: TIGERs Mannheim's robots have 45 and 49 mm
MIN_LOAD = 0.1  # load of every wheel over the mean load


class WheelCompliance:
    """Turn rate that compliant wheels cause.

    Args:
        geometry: Geometry of the wheels.
        gyro_residual: Fraction of a turn rate disturbance that a gyro loop leaves.
    """

    def __init__(self, geometry: Kinematics, gyro_residual: float) -> None:
        self._rim_directions = geometry.matrix[:, :2].T  # (2, wheels)
        static, dynamic = compute_load_distribution(geometry, COM_HEIGHT_M)
        n_wheels = len(geometry.azimuths)
        self._static_load = n_wheels * static
        self._load_transfer = n_wheels / GRAVITY * dynamic[:, :2].T
        self._arm, self._lever = geometry.arm, gyro_residual / geometry.arm

    def compute_turn_rate(
        self, velocity: Array, acceleration: Array, deficit: Array, lag: Array, creep: Array
    ) -> Array:
        """Return the turn rates (..., n) that act on robots like commands, rad/s.

        Args:
            velocity: Body velocities (..., n, 3).
            acceleration: Body accelerations (..., n, 3).
            deficit: Commanded minus actual body velocities (..., n, 3).
            lag: Lag of the wheel loops forward, (..., n) s.
            creep: Creep forward, (..., n) s^2/m.
        """
        # Sums instead of matrix products, which BLAS may round differently in a larger batch.
        rim_x, rim_y = self._rim_directions
        transfer_x, transfer_y = self._load_transfer
        transfer = acceleration[..., :1] * transfer_x + acceleration[..., 1:2] * transfer_y
        load = np.maximum(self._static_load + transfer, MIN_LOAD)
        rim_spin = self._arm * velocity[..., 2:]
        wheel_speed = np.hypot(
            velocity[..., :1] + rim_spin * rim_x, velocity[..., 1:2] + rim_spin * rim_y
        )
        stiffness = 1 / (lag[..., None] + creep[..., None] * wheel_speed / load)
        traction = stiffness * (deficit[..., :1] * rim_x + deficit[..., 1:2] * rim_y)
        turn_rate: Array = self._lever * traction.sum(-1) / stiffness.sum(-1)
        return turn_rate
