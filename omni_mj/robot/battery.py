"""Battery: open-circuit voltage over charge, sag under load, and undervoltage protection.

The battery is a Thevenin source: an open-circuit voltage in series with an internal resistance. The
terminal voltage changes in every cycle; charge and protection change once per frame.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omni_mj.config import PERIOD_S
from omni_mj.config.settings import Settings, gather
from omni_mj.robot.array_ops import Array, clip, namespace, sum_wheels

# Open-circuit voltage of a LiPo cell in V over its state of charge: 4.2 V full, 3.7 V (nominal) at
# half charge, and steep below a tenth
CELL_CHARGE = np.array([0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 1.0])
CELL_VOLTAGE_V = np.array([3.0, 3.4, 3.55, 3.63, 3.66, 3.70, 3.83, 4.05, 4.2])
# Time constant of the protection's low-pass filter, s. Without the filter, the sag at every hard
# start would trip it.
PROTECTION_TIME_S = 1.0


class BatteryParameters(NamedTuple):
    """Parameters of n batteries, (n,)."""

    n_cells: Array  # number of cells in series
    capacity: Array  # charge of a full battery, A s
    resistance: Array  # internal resistance, ohm
    cut_off_voltage: Array  # filtered voltage below which the protection switches off, V


class BatterySource(NamedTuple):
    """Thevenin equivalent of n batteries in a frame, (n,).

    If the protection has switched a battery off, its voltage and resistance are zero. Drivers
    without power let the motors coast.
    """

    open_circuit_voltage: Array  # voltage without load, V
    resistance: Array  # internal resistance, ohm
    voltage_factor: Array  # fraction of the voltage that the contacts pass, 1


class BatteryState(NamedTuple):
    """State of n batteries, (n,)."""

    charge: Array  # state of charge, from 0 (empty) to 1 (full)
    filtered_voltage: Array  # voltage that the protection compares with its limit, V
    is_on: Array  # whether the protection has not switched off
    voltage: Array  # terminal voltage, V


def make_battery(settings: Sequence[Settings]) -> tuple[BatteryParameters, BatteryState]:
    """Return parameters and initial state of the batteries of n robots."""
    n_cells, capacity, resistance, cut_off, charge = (
        gather(settings, f"battery.{name}")
        for name in ("series_cells", "capacity_ah", "resistance_ohm", "cut_off_v", "charge")
    )
    p = BatteryParameters(n_cells, capacity * 3600, resistance, cut_off)
    voltage = _compute_open_circuit_voltage(p, charge)
    return p, BatteryState(charge, voltage, np.ones(len(settings), bool), voltage)


def make_battery_source(
    p: BatteryParameters, s: BatteryState, voltage_factor: Array
) -> BatterySource:
    """Return the Thevenin equivalent for a frame.

    Args:
        p: Parameters.
        s: State.
        voltage_factor: Fraction of the voltage that the contacts pass, (n,).
    """
    open_circuit_voltage = _compute_open_circuit_voltage(p, s.charge)
    return BatterySource(s.is_on * open_circuit_voltage, s.is_on * p.resistance, voltage_factor)


def apply_motor_load(
    s: BatteryState, source: BatterySource, voltage: Array, current: Array
) -> tuple[BatteryState, Array]:
    """Compute the terminal voltage under the motors' currents, U = f (U0 - R I).

    U0 is the open-circuit voltage, R the internal resistance, I the battery current, and f the
    voltage factor. Drivers pass power without loss, so I is the sum of duty cycle times motor
    current, and braking motors charge the battery. If a motor's voltage exceeds the battery's, the
    driver dissipates the surplus.

    Args:
        s: State.
        source: Thevenin equivalent in this frame.
        voltage: Motor voltages, (W, n) V.
        current: Motor currents, (W, n) A.

    Returns:
        The state with the new terminal voltage, and the battery currents, (n,) A.
    """
    # Without voltage, motors carry no current for any duty cycle.
    battery_voltage = namespace(voltage).where(s.voltage > 0, s.voltage, 1.0)
    duty = clip(voltage / battery_voltage, -1.0, 1.0)
    battery_current = s.is_on * sum_wheels(duty * current)
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
    sag = p.resistance * battery_current
    voltage = s.is_on * (_compute_open_circuit_voltage(p, charge) - sag)
    smoothing = PERIOD_S / PROTECTION_TIME_S
    filtered_voltage = s.filtered_voltage + (voltage - s.filtered_voltage) * smoothing
    return s._replace(
        charge=charge,
        filtered_voltage=filtered_voltage,
        is_on=s.is_on & (filtered_voltage > p.cut_off_voltage),
    )


def _compute_open_circuit_voltage(p: BatteryParameters, charge: Array) -> Array:
    """Return the voltage without load, (n,) V, at states of charge (n,)."""
    return p.n_cells * namespace(charge).interp(charge, CELL_CHARGE, CELL_VOLTAGE_V)
