"""The battery: open-circuit voltage over charge, sag under the motors' current, cut-off."""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array
from omni_mj.onboard import arrays, laws
from omni_mj.onboard.arrays import BatteryArrays, ChargeArrays
from omni_mj.scenarios.settings import BatterySettings, column


class Battery:
    """Batteries of n robots.

    Args:
        settings: one per robot.

    Attributes:
        charge: state of charge, 1 full, (n,).
        voltage: at the terminals, under load, V, (n,).
        share: of its voltage that comes through its contacts, (n,).
        block: state and numbers (see `arrays.battery`).
        alive: whether the battery still gives power, (n,). After its voltage has sunk below the cut-off its voltage is
            zero, which shorts the motors: the robot brakes and stays.
    """

    def __init__(self, settings: Sequence[BatterySettings]) -> None:
        self._cells = column(settings, "cells")[:, 0]
        self._capacity = column(settings, "capacity_ah")[:, 0] * 3600
        self._cut_off = column(settings, "cut_off_v")[:, 0]
        self.charge = column(settings, "charge")[:, 0].copy()
        self.alive = np.ones(len(settings), bool)
        self.block = np.zeros((arrays.BATTERY, len(settings)))
        # Dead: infinite once it is; of whatever power then, no current is drawn.
        parts = arrays.battery(self.block)
        self._open, self._resistance, self._dead, self.voltage, self._drawn, self._loads, self.share = parts
        self.share[:] = 1.0
        self._resistance[:] = column(settings, "resistance_ohm")[:, 0]
        self._open[:] = self.voltage[:] = self._average = self._cells * laws.open_circuit(self.charge)

    def load(self, voltage: Array, current: Array) -> None:
        """Sag under motors that have a `voltage` (n, wheels), V, at their terminals and a `current` (n, wheels), A.

        A driver passes on power without loss; braking motors charge the battery. What a motor generates beyond the
        battery's voltage, and beside one that gives no more power, the driver burns.
        """
        duty = laws.share(voltage, (self.voltage + self._dead)[:, None])
        drawn = arrays.total((duty * current).T)
        self._drawn += drawn
        self.voltage[:] = self.share * laws.sagged(self._open, self._resistance, drawn)
        self._loads += 1

    def arrays(self) -> BatteryArrays:
        """The parts of `block`."""
        return arrays.battery(self.block)

    def charge_arrays(self) -> ChargeArrays:
        """What a compiled loop reads and writes in place of `discharge`."""
        return ChargeArrays(self.charge, self._average, self.alive, self._cells, self._capacity, self._cut_off)

    def discharge(self, period: float) -> None:
        """Take the mean of the loads since the last call, drawn for `period` (s), from the charge."""
        mean = self._drawn / self._loads
        self._drawn[:] = self._loads[:] = 0.0
        self.charge = np.clip(self.charge - mean * period / self._capacity, 0.0, 1.0)
        self._open[:] = self._cells * laws.open_circuit(self.charge)
        # The protection against deep discharge averages, or the sag of every hard start would trip it.
        loaded = self._open - self._resistance * mean
        self._average += (loaded - self._average) * min(period / laws.CUT_OFF_S, 1.0)
        self.alive &= self._average > self._cut_off
        self._open[~self.alive] = self._resistance[~self.alive] = 0.0
        self._dead[~self.alive] = np.inf
