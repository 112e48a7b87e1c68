"""Battery: open-circuit voltage over charge, sag under load, and undervoltage protection.

In a frame the battery is a Thevenin source: an open-circuit voltage in series with an internal
resistance. Charge and protection change from frame to frame, the terminal voltage from cycle to
cycle.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omni_mj.config.settings import PERIOD_S, Settings, gather
from omni_mj.robot.array_ops import Array, clip, namespace, sum_wheels

# Open-circuit voltage of a LiPo cell in V over its state of charge: 4.2 V full, 3.7 V (nominal) at
# half charge, and steep below a tenth
CELL_CHARGE = np.array([0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 1.0])
CELL_VOLTAGE_V = np.array([3.0, 3.4, 3.55, 3.63, 3.66, 3.70, 3.83, 4.05, 4.2])
# Time constant with which the protection averages the voltage, s. Without the average every hard
# start would trip it.
PROTECTION_TIME_S = 1.0


class BatteryParameters(NamedTuple):
    """Parameters of n batteries, (n,)."""

    n_cells: Array  # number of cells in series
    capacity: Array  # charge of a full battery, A s
    resistance: Array  # internal resistance, ohm
    cut_off_voltage: Array  # average voltage at which the protection switches off, V


class BatterySource(NamedTuple):
    """Thevenin equivalent of n batteries in a frame, (n,).

    With a battery that is off, both are zero and the motors are shorted.
    """

    open_circuit_voltage: Array  # voltage without load, V
    resistance: Array  # internal resistance, ohm
    # Infinite if the battery is off, otherwise 0, V. Added to the voltage that duty cycles are
    # relative to, it makes them 0.
    infinite_if_off: Array
    voltage_factor: Array  # fraction of the voltage that the contacts pass, 1


class BatteryState(NamedTuple):
    """State of n batteries, (n,)."""

    charge: Array  # state of charge, from 0 (empty) to 1 (full)
    average_voltage: Array  # filtered voltage that the protection compares with its limit, V
    is_on: Array  # whether the protection passes power
    voltage: Array  # terminal voltage, V


def make_battery(settings: Sequence[Settings]) -> tuple[BatteryParameters, BatteryState]:
    """Return parameters and initial state of the batteries of n robots."""
    n_cells, capacity, resistance, cut_off, charge = (
        gather(settings, f"battery.{name}")
        for name in ("series_cells", "capacity_ah", "resistance_ohm", "cut_off_v", "charge")
    )
    p = BatteryParameters(n_cells, capacity * 3600, resistance, cut_off)
    voltage = n_cells * np.interp(charge, CELL_CHARGE, CELL_VOLTAGE_V)
    return p, BatteryState(charge, voltage, np.ones(len(settings), bool), voltage)


def compute_open_circuit_voltage(p: BatteryParameters, s: BatteryState) -> Array:
    """Return the voltage without load (n,) in V; 0 if the battery is off."""
    xp = namespace(s.charge)
    cell_voltage = xp.interp(s.charge, CELL_CHARGE, CELL_VOLTAGE_V)
    return xp.where(s.is_on, p.n_cells * cell_voltage, 0.0)


def make_source(p: BatteryParameters, s: BatteryState, voltage_factor: Array) -> BatterySource:
    """Return the Thevenin equivalent for a frame.

    Args:
        p: Parameters.
        s: State.
        voltage_factor: Fraction of the voltage that the contacts pass, (n,).
    """
    infinite_if_off = namespace(voltage_factor).where(s.is_on, 0.0, np.inf)
    open_circuit_voltage = compute_open_circuit_voltage(p, s)
    return BatterySource(
        open_circuit_voltage, s.is_on * p.resistance, infinite_if_off, voltage_factor
    )


def apply_motor_load(
    s: BatteryState, source: BatterySource, voltage: Array, current: Array
) -> tuple[BatteryState, Array]:
    """Compute the terminal voltage under the motors' currents, U = f (U0 - R I).

    U0 is the open-circuit voltage, R the internal resistance, I the battery current, and f the
    voltage factor. Drivers pass power without loss, so I is the sum of duty cycle times motor
    current, and braking motors charge the battery. A driver dissipates the power that a motor
    generates beyond the battery's voltage, or with a battery that is off.

    Args:
        s: State.
        source: Thevenin equivalent in this frame.
        voltage: Motor voltages, (W, n) V.
        current: Motor currents, (W, n) A.

    Returns:
        The state with the new terminal voltage, and the battery currents, (n,) A.
    """
    duty = clip(voltage / (s.voltage + source.infinite_if_off), -1.0, 1.0)
    battery_current = sum_wheels(duty * current)
    loaded_voltage = source.open_circuit_voltage - source.resistance * battery_current
    return s._replace(voltage=source.voltage_factor * loaded_voltage), battery_current


def discharge_battery(
    p: BatteryParameters, s: BatteryState, battery_current: Array
) -> BatteryState:
    """Subtract the charge that flows in a frame, and update the protection.

    Args:
        p: Parameters.
        s: State.
        battery_current: Mean battery current in the frame, (n,) A.
    """
    charge = clip(s.charge - battery_current * PERIOD_S / p.capacity, 0.0, 1.0)
    s = s._replace(charge=charge)
    sag = s.is_on * p.resistance * battery_current
    loaded_voltage = compute_open_circuit_voltage(p, s) - sag
    smoothing = PERIOD_S / PROTECTION_TIME_S
    average = s.average_voltage + (loaded_voltage - s.average_voltage) * smoothing
    return s._replace(average_voltage=average, is_on=s.is_on & (average > p.cut_off_voltage))
