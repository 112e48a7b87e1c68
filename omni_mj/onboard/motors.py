"""A motor per wheel: current from voltage and speed, heat from current, resistance and torque from temperature."""

from collections.abc import Sequence

import numpy as np
from scipy.linalg import expm

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import MotorSettings, column
from omni_mj.worlds.wheels import Motor

REFERENCE_C = 25.0  # at which the datasheet gives resistance and torque constant


class Motors:
    """Motors of n robots, each with two thermal nodes: winding and housing.

    The winding takes up its copper's i^2 R and passes it to the housing, which passes it to the air (thermal
    resistances and time constants of the datasheet). Copper's resistance rises with the winding's temperature; the
    magnets, which turn in the housing, weaken with the housing's.

    Args:
        motor: constants at 25 deg C, from the model.
        wheels: number of wheels of a robot.
        settings: one per robot.
        period: time between calls of `warm`, s.
        strength: of each motor's magnets beside the datasheet's, a factor of the torque constant; what broadcasts to
            (n, wheels).

    Attributes:
        winding, housing: temperatures, deg C, (n, wheels).
        resistance: terminal resistance now, ohm, (n, wheels).
        constant: torque constant now, N m/A, (n, wheels).
    """

    def __init__(
        self,
        motor: Motor,
        wheels: int,
        settings: Sequence[MotorSettings],
        period: float,
        strength: Array | float = 1.0,
    ) -> None:
        self._motor = motor
        shape = (len(settings), wheels)
        self._cold_constant = np.broadcast_to(motor.constant * strength, shape)
        self._ambient = column(settings, "ambient_c")
        self._copper, self._magnet = column(settings, "copper_per_k"), column(settings, "magnet_per_k")
        self._commutation = column(settings, "commutation_ohm_s") * motor.gear
        self.winding = np.broadcast_to(column(settings, "winding_c"), shape).copy()
        self.housing = np.broadcast_to(column(settings, "housing_c"), shape).copy()
        conduction = {s: _conduction(s, period) for s in set(settings)}
        self._conduction = np.stack([conduction[s] for s in settings], axis=-1)[..., None]
        self._update()

    def drive(self, voltage: Array, wheel_speed: Array) -> tuple[Array, Array]:
        """Find what a voltage does at a speed.

        The datasheet's nominal point lies below the line from no-load speed to stall: commutation costs voltage that
        grows with current and speed, R(w) = R + X |w|. The dcmotor actuator knows a constant R, so it is given the
        voltage that drives the same current through that.

        Args:
            voltage: at the terminals, V, (n, wheels).
            wheel_speed: rad/s, (n, wheels).

        Returns:
            The dcmotor's voltage (n, wheels) and the current (n, wheels) in A.
        """
        back_emf = self._speed_constant * wheel_speed
        current = (voltage - back_emf) / (self.resistance + self._commutation * np.abs(wheel_speed))
        drop = current * self.resistance
        return back_emf + drop, current

    def warm(self, currents: Array) -> None:
        """Let the copper losses of a period's currents (steps, n, wheels) in A change temperatures and constants."""
        square = (currents**2).mean(0)
        winding, _ = self._conduct(square * self.resistance)
        # The resistance rises during the period: its mean makes the step exact to second order.
        mean = (self.resistance + self._resistance_at(winding)) / 2
        self.winding, self.housing = self._conduct(square * mean)
        self._update()

    def _conduct(self, heat: Array) -> tuple[Array, Array]:
        """Temperatures of windings and housings after a period of `heat` (n, wheels) in W."""
        (a, b), (c, d), (e, f) = np.moveaxis(self._conduction, 0, 1)
        winding, housing = self.winding - self._ambient, self.housing - self._ambient
        return (
            self._ambient + (a * winding + c * housing + e * heat),
            self._ambient + (b * winding + d * housing + f * heat),
        )

    def _resistance_at(self, winding: Array) -> Array:
        return self._motor.resistance * (1 + self._copper * (winding - REFERENCE_C))

    def _update(self) -> None:
        self.resistance = self._resistance_at(self.winding)
        self.constant = self._cold_constant * (1 + self._magnet * (self.housing - REFERENCE_C))
        self._speed_constant = self.constant * self._motor.gear


def _conduction(s: MotorSettings, period: float) -> Array:
    """Exact solution of the two nodes over one period (s) with constant heat into the winding.

    Returns:
        (2, 3): temperatures over ambient of winding and housing, from those before and from the heat in W.
    """
    inner, outer = 1 / s.winding_housing_k_w, 1 / s.housing_ambient_k_w
    rates = np.zeros((3, 3))
    rates[0] = np.array([-inner, inner, 1.0]) / s.winding_j_k
    rates[1] = np.array([inner, -inner - outer, 0.0]) / s.housing_j_k
    solution: Array = expm(rates * period)
    return solution[:2]
