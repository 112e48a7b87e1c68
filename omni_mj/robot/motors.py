"""Motors and their drivers: current from voltage and speed, current limit, heat and its effects.

Voltage of a DC motor: V = (R + X |w|) I + K w, where the commutation of a brushless motor adds
the resistance X |w| (derived in `omni_mj.config.motor_settings`). A driver is an ideal chopper. If
a current would exceed its limit, driving or braking, it lowers the voltage to the one that drives
the limit.

Heat flows through two nodes, as in the thermal rows of maxon's data sheets. The winding receives
the copper losses R I^2 and passes heat to the housing. The housing receives the losses in the
stator's iron and the bearings, X |w| I^2 and (dry + viscous |w|) |w|, and passes heat to the air.
The resistance of copper rises with the winding's temperature. The magnets, which turn in the
housing, weaken with the housing's temperature.
"""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from omni_mj.config.motor_settings import MotorSettings
from omni_mj.config.settings import PERIOD_S, Settings, gather
from omni_mj.robot.array_ops import Array, any_true, clip, namespace

REFERENCE_C = 25.0  # at which the data sheet states resistance and torque constant


class MotorParameters(NamedTuple):
    """Motors of n robots, at the wheel; (n,) unless another shape is given."""

    gear_ratio: Array
    cold_resistance: Array  # at 25 deg C, ohm
    cold_torque_constant: Array  # at 25 deg C, at the motor's shaft, (W, n) N m/A
    commutation: Array  # resistance per wheel speed, ohm s/rad
    current_limit: Array  # A
    dry_friction: Array  # N m
    viscous_friction: Array  # N m s/rad
    copper_coefficient: Array  # relative change of the resistance, 1/K
    magnet_coefficient: Array  # relative change of the torque constant, 1/K
    ambient: Array  # temperature of the air, deg C
    thermal_step: Array  # temperatures after a frame, (2, 4, n); see `solve_thermal_nodes`


class MotorState(NamedTuple):
    """Temperatures, and the constants that follow from them, (W, n)."""

    winding: Array  # temperature, deg C
    housing: Array  # temperature, deg C
    resistance: Array  # ohm
    back_emf_constant: Array  # V s/rad of the wheel, which equals torque per current there, N m/A


def make_motor_parameters(settings: Sequence[Settings], magnet_factor: Array) -> MotorParameters:
    """Return the parameters of n robots.

    Args:
        settings: One per robot.
        magnet_factor: Torque constant of each motor over the data sheet's, (W, n).
    """
    sheets = [s.motor for s in settings]
    gear_ratio = gather(sheets, "gear_ratio")
    return MotorParameters(
        gear_ratio=gear_ratio,
        cold_resistance=gather(sheets, "resistance_ohm"),
        cold_torque_constant=gather(sheets, "torque_constant_nm_a") * magnet_factor,
        commutation=gather(sheets, "commutation_ohm_s") * gear_ratio,
        current_limit=gather(settings, "firmware.current_limit_a"),
        dry_friction=gather(sheets, "wheel_dry_friction_nm"),
        viscous_friction=gather(sheets, "wheel_viscous_friction_nm_s"),
        copper_coefficient=gather(sheets, "winding_resistance_per_k"),
        magnet_coefficient=gather(sheets, "torque_constant_per_k"),
        ambient=gather(sheets, "ambient_c"),
        thermal_step=np.stack([solve_thermal_nodes(sheet) for sheet in sheets], axis=-1),
    )


def make_motor_state(p: MotorParameters, winding: Array, housing: Array) -> MotorState:
    """Return motors at temperatures (W, n) in deg C: R and K change linearly with them."""
    resistance = p.cold_resistance * (1 + p.copper_coefficient * (winding - REFERENCE_C))
    torque_constant = p.cold_torque_constant * (1 + p.magnet_coefficient * (housing - REFERENCE_C))
    return MotorState(winding, housing, resistance, torque_constant * p.gear_ratio)


@cache
def solve_thermal_nodes(s: MotorSettings) -> Array:
    """Solve C dT/dt = -G T + Q for winding and housing over a frame, by its two modes.

    Scaling with the roots of the heat capacities C makes the matrix symmetric.

    Args:
        s: Motor with its thermal resistances and heat capacities.

    Returns:
        Matrix (2, 4) that maps temperatures of winding and housing over ambient before, K, and the
        heat into winding and housing, W, to these temperatures after the frame, K.
    """
    winding_w_k = 1 / s.winding_housing_k_w
    housing_w_k = 1 / s.housing_ambient_k_w
    conductances = np.array(
        [[winding_w_k, -winding_w_k], [-winding_w_k, winding_w_k + housing_w_k]]
    )
    root = np.sqrt([s.winding_j_k, s.housing_j_k])
    rates, modes = np.linalg.eigh(conductances / np.outer(root, root))
    remaining = modes * np.exp(-rates * PERIOD_S) @ modes.T * (root / root[:, None])
    received = modes * (-np.expm1(-rates * PERIOD_S) / rates) @ modes.T / np.outer(root, root)
    return np.hstack([remaining, received])


def drive_motors(
    p: MotorParameters, s: MotorState, voltage: Array, wheel_speed: Array
) -> tuple[Array, Array, Array]:
    """Compute I = (V - K w) / (R + X |w|), and lower the voltage where the driver limits I.

    Args:
        p: Parameters.
        s: State.
        voltage: Voltages that the drivers apply, (W, n) V.
        wheel_speed: Speeds of the wheels, (W, n) rad/s.

    Returns:
        Voltages at the terminals, V, currents, A, and whether the driver limited the current.
    """
    xp = namespace(voltage)
    back_emf = s.back_emf_constant * wheel_speed
    resistance = s.resistance + p.commutation * abs(wheel_speed)
    current = (voltage - back_emf) / resistance
    is_limited = abs(current) > p.current_limit
    if any_true(is_limited):
        limit = xp.copysign(p.current_limit, current)
        voltage = xp.where(is_limited, back_emf + limit * resistance, voltage)
        current = xp.where(is_limited, limit, current)
    return voltage, current, is_limited


def override_duty(
    p: MotorParameters,
    s: MotorState,
    duty: Array,
    current_setpoint: Array,
    wheel_speed: Array,
    battery_voltage: Array,
) -> Array:
    """Return duties that drive set currents, V = K w + (R + X |w|) I, as far as the battery can.

    Args:
        p: Parameters.
        s: State.
        duty: Duties of the firmware, (W, n).
        current_setpoint: Currents, (W, n) A; NaN where the firmware drives.
        wheel_speed: Speeds of the wheels, (W, n) rad/s.
        battery_voltage: Voltage at the terminals of the battery, (n,) V.
    """
    xp = namespace(duty)
    resistance = s.resistance + p.commutation * abs(wheel_speed)
    voltage = s.back_emf_constant * wheel_speed + current_setpoint * resistance
    is_powered = battery_voltage > 0
    setpoint_duty = clip(voltage / xp.where(is_powered, battery_voltage, 1.0), -1.0, 1.0)
    return xp.where(xp.isnan(current_setpoint), duty, xp.where(is_powered, setpoint_duty, 0.0))


def update_temperatures(
    p: MotorParameters, s: MotorState, currents: Array, wheel_speeds: Array
) -> MotorState:
    """Advance the temperatures of winding and housing by the losses of a frame.

    Args:
        p: Parameters.
        s: State.
        currents: Currents in the cycles of the frame, (cycles, W, n) A.
        wheel_speeds: Speeds of the wheels, (cycles, W, n) rad/s.
    """
    squares = currents * currents
    abs_speeds = abs(wheel_speeds)
    # If speed and current swing together, the mean of the product is not the product of the means.
    housing_losses = abs_speeds * (
        p.commutation * squares + p.dry_friction + p.viscous_friction * abs_speeds
    )
    housing_heat = housing_losses.sum(0) / len(currents)
    mean_square = squares.sum(0) / len(currents)

    def compute_temperature(node: int, resistance: Array) -> Array:
        step = p.thermal_step[node]
        winding_rise = s.winding - p.ambient
        housing_rise = s.housing - p.ambient
        return p.ambient + (
            step[0] * winding_rise
            + step[1] * housing_rise
            + step[2] * (mean_square * resistance)
            + step[3] * housing_heat
        )

    predicted = make_motor_state(p, compute_temperature(0, s.resistance), s.housing)
    # The resistance rises during the frame: with its mean the step is exact to second order.
    mean_resistance = (s.resistance + predicted.resistance) / 2
    winding = compute_temperature(0, mean_resistance)
    return make_motor_state(p, winding, compute_temperature(1, mean_resistance))
