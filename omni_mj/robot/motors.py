"""Motors and their drivers: current from voltage and speed, limited by the driver; heat, and its effects.

Voltage: V = (R + X |w|) I + K w, with the resistance X |w| of commutation. A driver is an ideal chopper. If a current
would exceed its limit, driving or braking, it lowers the voltage to the one that drives the limit.

Heat flows through two nodes. The winding receives the copper's losses R I^2 and passes heat to the housing. The housing
receives what is lost in the stator's iron and the bearings, X |w| I^2 and (dry + viscous |w|) |w|, and passes heat to
the air. Copper's resistance rises with the winding's temperature. The magnets, which turn in the housing, weaken with
the housing's.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from omni_mj.config.motor_settings import MotorSettings
from omni_mj.config.settings import PERIOD_S, Settings, gather
from omni_mj.robot.array_namespace import Array, any_true, clip, namespace

REFERENCE_C = 25.0  # at which the data sheet states resistance and torque constant


@dataclass(frozen=True)
class Motor:
    """A motor at 25 deg C by its data sheet, at its own shaft; the wheel turns `gear` times slower.

    Attributes:
        constant: Torque per current, which equals voltage per speed, N m/A = V s/rad.
        resistance: Of the terminals, ohm.
        commutation: What commutation adds to the resistance per speed, ohm s/rad.
        dry: Friction that is the same at every speed (bearings), N m.
        viscous: Friction per speed (iron, windage), N m s/rad.
        inertia: Of the rotor, kg m^2.
        gear: Turns of the motor in one of the wheel.
    """

    constant: float
    resistance: float
    commutation: float
    dry: float
    viscous: float
    inertia: float
    gear: float

    @classmethod
    def of(cls, sheet: MotorSettings) -> Self:
        """Return the motor of a data sheet; `MotorSettings` derives the constants from its rows."""
        return cls(
            constant=sheet.constant_nm_a,
            resistance=sheet.resistance_ohm,
            commutation=sheet.commutation_ohm_s,
            dry=sheet.dry_friction_nm,
            viscous=sheet.viscous_friction_nm_s,
            inertia=sheet.rotor_inertia_kg_m2,
            gear=sheet.gear,
        )

    @property
    def speed_constant(self) -> float:
        """Back-EMF per speed of the wheel, V s/rad."""
        return self.constant * self.gear

    @property
    def wheel_dry(self) -> float:
        """Dry friction at the wheel, N m."""
        return self.dry * self.gear

    @property
    def wheel_viscous(self) -> float:
        """Friction per speed at the wheel, N m s/rad."""
        return self.viscous * self.gear**2


class MotorParameters(NamedTuple):
    """Motors of n robots, at the wheel; (n,) unless another shape is given."""

    gear: Array
    cold_resistance: Array  # at 25 deg C, ohm
    cold_constant: Array  # torque constant at 25 deg C, (W, n) N m/A
    commutation: Array  # resistance per speed, ohm s/rad
    current_limit: Array  # A
    dry: Array  # friction, N m
    viscous: Array  # friction per speed, N m s/rad
    copper: Array  # change of the resistance, 1/K
    magnet: Array  # change of the torque constant, 1/K
    ambient: Array  # deg C
    # Temperatures of winding and housing over ambient after a frame, (2, 4, n); see `conduction`
    conduction: Array


class MotorState(NamedTuple):
    """Temperatures and what follows from them, (W, n)."""

    winding: Array  # deg C
    housing: Array  # deg C
    resistance: Array  # ohm
    back_emf: Array  # torque per current at the wheel, which equals back-EMF per speed, V s/rad


def motor_parameters(settings: Sequence[Settings], strength: Array) -> MotorParameters:
    """Return the parameters of n robots.

    Args:
        settings: One per robot.
        strength: Of the magnets over the data sheet's, a factor, (W, n).
    """
    sheets, motors = [s.motor for s in settings], [Motor.of(s.motor) for s in settings]
    solutions = {sheet: conduction(sheet, PERIOD_S) for sheet in set(sheets)}
    return MotorParameters(
        gear=gather(motors, "gear"),
        cold_resistance=gather(motors, "resistance"),
        cold_constant=gather(motors, "constant") * strength,
        commutation=gather(motors, "commutation") * gather(motors, "gear"),
        current_limit=gather(settings, "firmware.current_limit_a"),
        dry=gather(motors, "wheel_dry"),
        viscous=gather(motors, "wheel_viscous"),
        copper=gather(sheets, "copper_per_k"),
        magnet=gather(sheets, "magnet_per_k"),
        ambient=gather(sheets, "ambient_c"),
        conduction=np.stack([solutions[sheet] for sheet in sheets], axis=-1),
    )


def motors_at(p: MotorParameters, winding: Array, housing: Array) -> MotorState:
    """Return motors at temperatures (W, n) in deg C."""
    resistance = p.cold_resistance * (1 + p.copper * (winding - REFERENCE_C))
    constant = p.cold_constant * (1 + p.magnet * (housing - REFERENCE_C))
    return MotorState(winding, housing, resistance, constant * p.gear)


def conduction(s: MotorSettings, period: float) -> Array:
    """Solve the two thermal nodes over a period (s) with constant heat into each, by their two modes.

    Returns:
        Factors (2, 4): temperatures of winding and housing over ambient, for each of those before,
            K, and the heats
        into winding and housing, W.
    """
    inner, outer = 1 / s.winding_housing_k_w, 1 / s.housing_ambient_k_w
    root = np.sqrt([s.winding_j_k, s.housing_j_k])
    rates, modes = np.linalg.eigh(
        np.array([[inner, -inner], [-inner, inner + outer]]) / np.outer(root, root)
    )
    remaining = modes * np.exp(-rates * period) @ modes.T * (root / root[:, None])
    received = modes * (-np.expm1(-rates * period) / rates) @ modes.T / np.outer(root, root)
    return np.hstack([remaining, received])


def drive_motors(
    p: MotorParameters, s: MotorState, voltage: Array, speed: Array
) -> tuple[Array, Array, Array]:
    """Apply voltages (W, n) in V to motors whose wheels turn at speeds (W, n) in rad/s.

    Returns:
        Voltages at the terminals, V, currents, A, and whether the driver limited the current.
    """
    xp = namespace(voltage)
    back_emf = s.back_emf * speed
    resistance = s.resistance + p.commutation * abs(speed)
    current = (voltage - back_emf) / resistance
    is_limited = abs(current) > p.current_limit
    if any_true(is_limited):
        limit = xp.copysign(p.current_limit, current)
        voltage = xp.where(is_limited, back_emf + limit * resistance, voltage)
        current = xp.where(is_limited, limit, current)
    return voltage, current, is_limited


def hold_current(
    p: MotorParameters, s: MotorState, duty: Array, held: Array, speed: Array, supply: Array
) -> Array:
    """Return duties that drive a current, as far as the battery's voltage does.

    Args:
        p: Parameters.
        s: State.
        duty: That of the firmware, (W, n).
        held: Currents, (W, n) A; NaN where the firmware drives.
        speed: Of the wheels, (W, n) rad/s.
        supply: Voltage of the battery, (n,) V.
    """
    xp = namespace(duty)
    voltage = s.back_emf * speed + held * (s.resistance + p.commutation * abs(speed))
    powered = supply > 0
    share = xp.where(powered, clip(voltage / xp.where(powered, supply, 1.0), -1.0, 1.0), 0.0)
    return xp.where(xp.isnan(held), duty, share)


def warm_motors(p: MotorParameters, s: MotorState, currents: Array, speeds: Array) -> MotorState:
    """Let a frame's losses change temperatures.

    Args:
        p: Parameters.
        s: State.
        currents: In the cycles of the frame, (cycles, W, n) A.
        speeds: Of the wheels, (cycles, W, n) rad/s.
    """
    squares, sizes = currents * currents, abs(speeds)
    # If speed and current swing together, the mean of the product is not the product of the means.
    outer = (sizes * (p.commutation * squares + p.dry + p.viscous * sizes)).sum(0) / len(currents)
    square = squares.sum(0) / len(currents)

    def conduct(node: int, resistance: Array) -> Array:
        c = p.conduction[node]
        inside, outside = s.winding - p.ambient, s.housing - p.ambient
        return p.ambient + (
            c[0] * inside + c[1] * outside + c[2] * (square * resistance) + c[3] * outer
        )

    after = motors_at(p, conduct(0, s.resistance), s.housing)
    # The resistance rises during the frame: with its mean the step is exact to second order.
    mean = (s.resistance + after.resistance) / 2
    return motors_at(p, conduct(0, mean), conduct(1, mean))
