"""The battery: open-circuit voltage over charge, sag under the motors' current, protection against deep discharge."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omni_mj.config.settings import PERIOD_S, Settings, gather
from omni_mj.robot.array_namespace import Array, clip, namespace, total

# Open-circuit voltage of a LiPo cell over its state of charge: 4.2 V full, 3.7 V nominal at half,
# steep below a tenth.
CHARGE = np.array([0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 1.0])
CELL_V = np.array([3.0, 3.4, 3.55, 3.63, 3.66, 3.70, 3.83, 4.05, 4.2])
# Time constant with which the protection averages the voltage, or every hard start would trip it
CUT_OFF_S = 1.0


class BatteryParameters(NamedTuple):
    """Batteries of n robots, (n,)."""

    cells: Array
    capacity: Array  # A s
    resistance: Array  # ohm
    cut_off: Array  # V


class Source(NamedTuple):
    """Batteries in a frame, (n,); those that give no power short the motors."""

    open_voltage: Array  # without load, V
    resistance: Array  # ohm
    barrier: Array  # infinite voltage of a battery that passes no current; 0 of others
    share: Array  # of the voltage that the contacts pass


class BatteryState(NamedTuple):
    """State of n batteries, (n,)."""

    charge: Array  # 1 is full
    average: Array  # voltage that the protection sees, V
    is_alive: (
        Array  # whether the protection lets power through; without power the motors are shorted
    )
    voltage: Array  # at the terminals, V


def battery_parameters(settings: Sequence[Settings]) -> tuple[BatteryParameters, BatteryState]:
    """Return parameters and the state at the start of n robots' batteries."""
    cells, capacity, resistance, cut_off, charge = (
        gather(settings, f"battery.{name}")
        for name in ("cells", "capacity_ah", "resistance_ohm", "cut_off_v", "charge")
    )
    p = BatteryParameters(cells, capacity * 3600, resistance, cut_off)
    voltage = cells * np.interp(charge, CHARGE, CELL_V)
    return p, BatteryState(charge, voltage, np.ones(len(settings), bool), voltage)


def open_circuit(p: BatteryParameters, s: BatteryState) -> Array:
    """Return the voltage (n,) without a load, V."""
    xp = namespace(s.charge)
    return xp.where(s.is_alive, p.cells * xp.interp(s.charge, CHARGE, CELL_V), 0.0)


def source_of(p: BatteryParameters, s: BatteryState, share: Array) -> Source:
    """Return what batteries are in a frame in which their contacts pass a share of the voltage, (n,)."""
    barrier = namespace(share).where(s.is_alive, 0.0, np.inf)
    return Source(open_circuit(p, s), s.is_alive * p.resistance, barrier, share)


def load_battery(
    s: BatteryState, source: Source, voltage: Array, current: Array
) -> tuple[BatteryState, Array]:
    """Let batteries sag under motors.

    Drivers pass power without loss, and braking motors charge the battery. A driver burns what a
    motor generates beyond the battery's voltage, or without a living battery.

    Args:
        s: State.
        source: Batteries in this frame.
        voltage: Of the motors, (W, n) V.
        current: Of the motors, (W, n) A.

    Returns:
        The state, and the currents drawn, (n,) A.
    """
    duty = clip(voltage / (s.voltage + source.barrier), -1.0, 1.0)
    drawn = total(duty * current)
    return s._replace(
        voltage=source.share * (source.open_voltage - source.resistance * drawn)
    ), drawn


def discharge(p: BatteryParameters, s: BatteryState, drawn: Array) -> BatteryState:
    """Take a frame's mean current (n,) in A from the charge."""
    charge = clip(s.charge - drawn * PERIOD_S / p.capacity, 0.0, 1.0)
    s = s._replace(charge=charge)
    loaded = open_circuit(p, s) - s.is_alive * p.resistance * drawn
    average = s.average + (loaded - s.average) * min(PERIOD_S / CUT_OFF_S, 1.0)
    return s._replace(average=average, is_alive=s.is_alive & (average > p.cut_off))
