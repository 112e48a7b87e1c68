"""Motors and their drivers: current from voltage and speed, current limit, heat and its effects.

The voltage of a DC motor is V = (R + X |w|) I + K w, with the current I, the wheel speed w, the
resistance R, and the back-EMF constant K at the wheel. The commutation of a brushless motor adds
the resistance X |w| (derived in `omni_mj.config.motor_settings`). A driver is an ideal chopper. If
the current, driving or braking, would exceed its limit, the driver sets the voltage at which the
current is at the limit. Without battery voltage, drivers let the motors coast.

K is the constant in the robot, `motor.torque_factor` times the datasheet's. Torque and back-EMF
have one K, because K I w is the electrical power that becomes mechanical power, driving or braking.

A gear rubs under load: the friction of a hub grows by (1 - eta) |K I|, with the efficiency eta of
the gear. A motor that drives passes eta K I to the wheel, one that brakes (2 - eta) K I.

Heat flows through two nodes, as in the thermal rows of maxon's datasheets. The winding receives
the copper losses R I^2 and passes heat to the housing. The housing receives the commutation losses
X |w| I^2 and the losses (dry friction + viscous friction |w|) |w| of the motor's own friction, and
passes heat to the air. Gears are outside the motors, and do not heat them. The resistance of copper
rises with the winding's temperature. The magnets have the housing's temperature, and weaken as it
rises.
"""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from omni_mj.config import PERIOD_S
from omni_mj.config.motor_settings import MotorSettings
from omni_mj.config.settings import Settings, gather
from omni_mj.robot.array_ops import Array, any_true, clip, namespace

# Temperature at which datasheets state resistance and torque constant, deg C
REFERENCE_C = 25.0


class MotorParameters(NamedTuple):
    """Motors of n robots, (n,) unless another shape is given.

    Speeds and torques are those at the wheel, behind the gear, unless noted.
    """

    gear_ratio: Array  # motor speed over wheel speed, 1
    cold_resistance: Array  # R at 25 deg C, ohm
    cold_torque_constant: Array  # at 25 deg C, at the motor's shaft, (W, n) N m/A
    commutation: Array  # X: resistance per wheel speed, ohm s/rad
    current_limit: Array  # largest current of the driver, A
    dry_friction: Array  # dry friction torque of the motor, N m
    viscous_friction: Array  # friction torque per wheel speed, N m s/rad
    load_friction: Array  # friction torque of the gear per torque of the motor, 1
    copper_coefficient: Array  # relative change of the resistance, 1/K
    magnet_coefficient: Array  # relative change of the torque constant, 1/K
    ambient: Array  # temperature of the air, deg C
    thermal_step: Array  # matrices of `solve_thermal_nodes`, (2, 4, n) 1 and K/W


class MotorState(NamedTuple):
    """Temperatures of motors, and the constants that follow from them, (W, n)."""

    winding: Array  # temperature of the winding, deg C
    housing: Array  # temperature of the housing, deg C
    resistance: Array  # R, ohm
    # K: back-EMF per wheel speed, V s/rad, which equals the torque at the wheel per current, N m/A
    back_emf_constant: Array


def make_motor_parameters(settings: Sequence[Settings], magnet_factor: Array) -> MotorParameters:
    """Return the parameters of n robots.

    Args:
        settings: One per robot.
        magnet_factor: Ratio of each motor's torque constant to that of the settings, (W, n).
    """
    sheets = [s.motor for s in settings]
    gear_ratio = gather(sheets, "gear_ratio")
    return MotorParameters(
        gear_ratio=gear_ratio,
        cold_resistance=gather(sheets, "resistance_ohm"),
        cold_torque_constant=gather(sheets, "effective_constant_nm_a") * magnet_factor,
        commutation=gather(sheets, "commutation_ohm_s") * gear_ratio,
        current_limit=gather(settings, "firmware.current_limit_a"),
        dry_friction=gather(sheets, "wheel_dry_friction_nm"),
        viscous_friction=gather(sheets, "wheel_viscous_friction_nm_s"),
        load_friction=1 - gather(settings, "drivetrain.efficiency"),
        copper_coefficient=gather(sheets, "winding_resistance_per_k"),
        magnet_coefficient=gather(sheets, "torque_constant_per_k"),
        ambient=gather(sheets, "ambient_c"),
        thermal_step=np.stack([solve_thermal_nodes(sheet) for sheet in sheets], axis=-1),
    )


def make_motor_state(p: MotorParameters, winding: Array, housing: Array) -> MotorState:
    """Return motors whose R and K are those at given temperatures, on which they depend linearly.

    Args:
        p: Parameters.
        winding: Temperatures of the windings, (W, n) deg C.
        housing: Temperatures of the housings, (W, n) deg C.
    """
    resistance = p.cold_resistance * (1 + p.copper_coefficient * (winding - REFERENCE_C))
    torque_constant = p.cold_torque_constant * (1 + p.magnet_coefficient * (housing - REFERENCE_C))
    return MotorState(winding, housing, resistance, torque_constant * p.gear_ratio)


@cache
def solve_thermal_nodes(s: MotorSettings) -> Array:
    """Solve C dT/dt = -G T + Q for winding and housing over a frame, by its two modes.

    T are the temperatures over ambient, C the heat capacities, G the matrix of thermal conductances
    and Q the heat flows into the nodes. With the eigenvalues r and eigenvectors U of the symmetric
    matrix C^-1/2 G C^-1/2 and the duration h of a frame,

        T(h) = C^-1/2 U exp(-r h) U' C^1/2 T(0) + C^-1/2 U (1 - exp(-r h)) / r U' C^-1/2 Q.

    Args:
        s: Motor with its thermal resistances and heat capacities.

    Returns:
        Matrix (2, 4) that maps T(0), K, and Q, W, to T(h), K.
    """
    winding_w_k = 1 / s.winding_housing_resistance_k_w
    housing_w_k = 1 / s.housing_ambient_resistance_k_w
    conductances = np.array(
        [[winding_w_k, -winding_w_k], [-winding_w_k, winding_w_k + housing_w_k]]
    )
    root = np.sqrt([s.winding_heat_capacity_j_k, s.housing_heat_capacity_j_k])
    rates, modes = np.linalg.eigh(conductances / np.outer(root, root))
    remaining = modes * np.exp(-rates * PERIOD_S) @ modes.T * (root / root[:, None])
    received = modes * (-np.expm1(-rates * PERIOD_S) / rates) @ modes.T / np.outer(root, root)
    return np.hstack([remaining, received])


def drive_motors(
    p: MotorParameters, s: MotorState, voltage: Array, wheel_speed: Array, is_powered: Array
) -> tuple[Array, Array, Array]:
    """Compute I = (V - K w) / (R + X |w|), and lower the voltage where the driver limits I.

    A driver without power switches its transistors off, and the motor carries no current.

    Args:
        p: Parameters.
        s: State.
        voltage: Voltages that the drivers apply, (W, n) V.
        wheel_speed: Speeds of the wheels, (W, n) rad/s.
        is_powered: Whether the battery supplies the drivers, (n,).

    Returns:
        Voltages at the motor terminals, (W, n) V, currents, (W, n) A, and whether the driver
        limited the current, (W, n).
    """
    xp = namespace(voltage)
    back_emf = s.back_emf_constant * wheel_speed
    resistance = compute_resistance(p, s, wheel_speed)
    voltage = xp.where(is_powered, voltage, back_emf)
    current = (voltage - back_emf) / resistance
    is_limited = abs(current) > p.current_limit
    if any_true(is_limited):
        limit = xp.copysign(p.current_limit, current)
        voltage = xp.where(is_limited, back_emf + limit * resistance, voltage)
        current = xp.where(is_limited, limit, current)
    return voltage, current, is_limited


def compute_resistance(p: MotorParameters, s: MotorState, wheel_speed: Array) -> Array:
    """Return the resistances R + X |w| at speeds of the wheels (W, n) in rad/s, (W, n) ohm."""
    return s.resistance + p.commutation * abs(wheel_speed)


def compute_load_friction(p: MotorParameters, s: MotorState, current: Array) -> Array:
    """Return the friction torque of hubs by the load of the gear, (W, n) N m.

    Args:
        p: Parameters.
        s: State.
        current: Motor currents, (W, n) A.
    """
    return p.load_friction * abs(s.back_emf_constant * current)


def override_duty(
    p: MotorParameters,
    s: MotorState,
    duty: Array,
    current_setpoint: Array,
    wheel_speed: Array,
    battery_voltage: Array,
) -> Array:
    """Return duty cycles that drive given currents, within the voltage of the battery.

    The duty cycle is V over the battery's voltage, limited to [-1, 1], with
    V = K w + (R + X |w|) I.

    Args:
        p: Parameters.
        s: State.
        duty: Duty cycles that the firmware commands, (W, n).
        current_setpoint: Currents to drive, (W, n) A; NaN where the firmware drives.
        wheel_speed: Speeds of the wheels, (W, n) rad/s.
        battery_voltage: Voltage at the terminals of the battery, (n,) V.
    """
    xp = namespace(duty)
    resistance = compute_resistance(p, s, wheel_speed)
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
    # Averaged as a product, because speed and current are correlated within a frame
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
    # The resistance rises during the frame. With its mean, the step has second-order accuracy.
    mean_resistance = (s.resistance + predicted.resistance) / 2
    winding = compute_temperature(0, mean_resistance)
    return make_motor_state(p, winding, compute_temperature(1, mean_resistance))
