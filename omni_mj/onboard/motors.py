"""A motor per wheel and its driver: current from voltage and speed, held to a limit; heat; what heat changes."""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array
from omni_mj.onboard import arrays, laws
from omni_mj.onboard.arrays import HeatArrays, MotorArrays
from omni_mj.onboard.motor import Motor
from omni_mj.scenarios.motor_settings import MotorSettings
from omni_mj.scenarios.settings import column


class Motors:
    """Motors of n robots, each with a driver that limits its current and two thermal nodes: winding and housing.

    The winding takes up its copper's i^2 R and passes it to the housing. The housing takes up what is lost in the
    stator's iron and the bearings, commutation's X |w| i^2 and friction's (dry + viscous |w|) |w|, and passes all of it
    to the air (thermal resistances and time constants of the datasheet). Copper's resistance rises with the winding's
    temperature; the magnets, which turn in the housing, weaken with the housing's.

    Args:
        settings: one per robot.
        wheels: number of wheels of a robot.
        period: time between calls of `warm`, s.
        limit: highest current that a driver lets through, either way, A; what broadcasts to (n, wheels).
        strength: of each motor's magnets beside the datasheet's, a factor of the torque constant; the same.

    Attributes:
        winding, housing: temperatures, deg C, (n, wheels).
        resistance: terminal resistance now, ohm, (n, wheels).
        constant: torque constant now, N m/A, (n, wheels).
        block: numbers of now (see `arrays.motors`).
        limited: share of the steps of the period just past in which the driver held the current back, (n, wheels).
    """

    def __init__(
        self,
        settings: Sequence[MotorSettings],
        wheels: int,
        period: float,
        limit: Array | float = np.inf,
        strength: Array | float = 1.0,
    ) -> None:
        shape, motors = (len(settings), wheels), [Motor.of(s) for s in settings]
        self._cold_resistance, self._gear = column(motors, "resistance"), column(motors, "gear")
        self._new_constant = arrays.filled(column(motors, "constant") * strength, shape)
        self._cold_constant = self._new_constant
        self.block = np.zeros((arrays.MOTORS, wheels, len(settings)))
        self._speed_constant, self.resistance, commutation, self._limit, self._held_back = (
            each.T for each in arrays.motors(self.block)
        )
        self._commutation = column(motors, "commutation") * self._gear  # per speed of the wheel
        commutation[:] = self._commutation
        self._dry, self._viscous = column(motors, "wheel_dry"), column(motors, "wheel_viscous")
        self._losses = [arrays.plain(each) for each in (self._commutation, self._dry, self._viscous)]
        self._limit[:] = limit
        self._ambient = column(settings, "ambient_c")
        self._copper, self._magnet = column(settings, "copper_per_k"), column(settings, "magnet_per_k")
        self.winding = arrays.filled(column(settings, "winding_c"), shape)
        self.housing = arrays.filled(column(settings, "housing_c"), shape)
        self.limited = arrays.filled(0.0, shape)
        conduction = {s: _conduction(s, period) for s in set(settings)}
        self._conduction = np.stack([conduction[s] for s in settings], axis=-1)[..., None]
        self._update()

    def weaken(self, share: Array) -> None:
        """From now on have a share (n, wheels) of the magnets' field at the start."""
        self._cold_constant = arrays.filled(self._new_constant * share, share.shape)
        self._update()

    def drive(self, voltage: Array, wheel_speed: Array) -> tuple[Array, Array]:
        """Find what a voltage does at a speed.

        The driver is an ideal chopper: where a current would be beyond its limit, driving or braking, it gives the
        terminals the voltage at which it is not, whatever battery and temperature are.

        Args:
            voltage: wanted at the terminals, V, (n, wheels).
            wheel_speed: rad/s, (n, wheels).

        Returns:
            Voltage at the terminals, and current in A, both (n, wheels).
        """
        motor = self._speed_constant, self.resistance, self._losses[0]
        current, back_emf, turning = laws.current(voltage, wheel_speed, *motor)
        over = np.abs(current) > self._limit
        if np.count_nonzero(over):
            volts, amperes = laws.held_back(current, self._limit, back_emf, turning)
            voltage, current = np.where(over, volts, voltage), np.where(over, amperes, current)
            self._held_back += over
        return voltage, current

    def torque(self, current: Array) -> Array:
        """Torques at the wheels, N m, of currents (n, wheels) in A: constants of torque and speed are one."""
        return np.asarray(self._speed_constant * current)

    def told(self, current: Array, wheel_speed: Array) -> Array:
        """Voltages for MuJoCo's dcmotor, which knows a constant R in place of R + X |w|, to drive these currents.

        Args:
            current: A, (n, wheels).
            wheel_speed: rad/s, (n, wheels).
        """
        return np.asarray(self._speed_constant * wheel_speed + current * self.resistance)

    def arrays(self) -> MotorArrays:
        """The parts of `block`."""
        return arrays.motors(self.block)

    def heat_arrays(self) -> HeatArrays:
        """What a compiled loop reads and writes in place of `warm`."""
        return HeatArrays(
            winding=self.winding.T,
            housing=self.housing.T,
            constant=self.constant.T,
            limited=self.limited.T,
            cold_resistance=self._cold_resistance[:, 0],
            cold_constant=self._cold_constant.T,
            ambient=self._ambient[:, 0],
            copper=self._copper[:, 0],
            magnet=self._magnet[:, 0],
            gear=self._gear[:, 0],
            dry=self._dry[:, 0],
            viscous=self._viscous[:, 0],
            conduction=self._conduction[..., 0],
        )

    def hold(self, duty: Array, current: Array, speed: Array, supply: Array) -> None:
        """Overwrite the `duty` (n, W) of motors that are held at a current, as far as the supply drives it.

        Args:
            duty: written.
            current: (n, W) A, not a number where the duty stays.
            speed: of the wheels, (n, W) rad/s.
            supply: the battery's voltage, (n, 1) V.
        """
        wanted = self.voltage(current, speed)
        held = np.divide(wanted, supply, out=np.zeros_like(wanted), where=supply > 0)
        np.copyto(duty, np.clip(held, -1.0, 1.0), where=~np.isnan(current))

    def voltage(self, current: Array, wheel_speed: Array) -> Array:
        """The voltage at the terminals, V, that drives a current (n, wheels) in A: the inverse of `drive`."""
        volts: Array = laws.voltage(current, wheel_speed, self._speed_constant, self.resistance, self._commutation)
        return volts

    def warm(self, currents: Array, wheel_speeds: Array) -> None:
        """Let the losses of a period change temperatures and constants.

        Args:
            currents: of the period's steps (steps, n, wheels), A.
            wheel_speeds: the same, rad/s.
        """
        square, outer = np.zeros((2, *self.winding.shape[::-1])).swapaxes(1, 2)
        # Where speed and current swing together, the mean of the product is not the product of the means.
        for current, speed in zip(currents, wheel_speeds, strict=True):
            squared = current * current
            square += squared
            outer += laws.in_the_housing(squared, np.abs(speed), *self._losses)
        square, outer = square / len(currents), outer / len(currents)
        winding, _ = self._conduct(square * self.resistance, outer)
        # The resistance rises during the period: its mean makes the step exact to second order.
        mean = (self.resistance + self._resistance_at(winding)) / 2
        self.winding, self.housing = self._conduct(square * mean, outer)
        self.limited = self._held_back / len(currents)
        self._held_back[:] = 0.0
        self._update()

    def _conduct(self, inner: Array, outer: Array) -> tuple[Array, Array]:
        """Temperatures of windings and housings after a period of heat (n, wheels) in W into each."""
        now = self.winding - self._ambient, self.housing - self._ambient, inner, outer
        winding, housing = (self._ambient + laws.conducted(solution, *now) for solution in self._conduction)
        return winding, housing

    def _resistance_at(self, winding: Array) -> Array:
        return laws.at_temperature(self._cold_resistance, self._copper, winding)

    def _update(self) -> None:
        self.resistance[:] = self._resistance_at(self.winding)
        self.constant = laws.at_temperature(self._cold_constant, self._magnet, self.housing)
        self._speed_constant[:] = self.constant * self._gear


def _conduction(s: MotorSettings, period: float) -> Array:
    """Exact solution of the two nodes over one period (s) with constant heat into each, by their two modes.

    Returns:
        (2, 4): temperatures over ambient of winding and housing, from those before and from the heats in W.
    """
    inner, outer = 1 / s.winding_housing_k_w, 1 / s.housing_ambient_k_w
    root = np.sqrt([s.winding_j_k, s.housing_j_k])
    rates, modes = np.linalg.eigh(np.array([[inner, -inner], [-inner, inner + outer]]) / np.outer(root, root))
    kept = modes * np.exp(-rates * period) @ modes.T * (root / root[:, None])
    taken = modes * (-np.expm1(-rates * period) / rates) @ modes.T / np.outer(root, root)
    return np.hstack([kept, taken])
