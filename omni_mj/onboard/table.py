"""Where all is that compiled loops reach of what is on robots, in one table.

A table, of int64, has sizes first, then addresses: of blocks, then of other arrays in the order of their fields; then
whatever else a plant has, from `END` on. `Writer` writes it, the other functions give back what it tells of.
"""

from collections.abc import Sequence

import numpy as np

from omni_mj.onboard import addresses, arrays
from omni_mj.onboard.addresses import floats, truths, vectors
from omni_mj.onboard.arrays import (
    BatteryArrays,
    CarpetArrays,
    ChargeArrays,
    FirmwareArrays,
    HeatArrays,
    MotorArrays,
    RimArrays,
    TractionArrays,
)
from omni_mj.onboard.battery import Battery
from omni_mj.onboard.firmware import Firmware
from omni_mj.onboard.motors import Motors
from omni_mj.onboard.traction import Traction

Table = np.ndarray

ROBOTS, WHEELS, PATCHES, GAPS, FRAMES = range(5)  # sizes; of gaps, whether there are any; of headings that are kept
# Where addresses begin.
BLOCKS = FRAMES + 1
TRACTION = BLOCKS + 5
CARPET = TRACTION + 10
HEAT = CARPET + len(CarpetArrays._fields)
CHARGE = HEAT + len(HeatArrays._fields)
PAST = CHARGE + len(ChargeArrays._fields)
END = PAST + 1


class Writer:
    """Writes a table, and keeps what it tells of alive.

    Args:
        onboard: firmware, motors, battery and traction of the robots.
        sizes: of the plant's own.
        own: arrays of the plant's, which nothing takes the place of.

    Attributes:
        table: live.
    """

    def __init__(
        self, onboard: tuple[Firmware, Motors, Battery, Traction], sizes: Sequence[int], own: Sequence[np.ndarray]
    ) -> None:
        self._firmware, self._motors, self._battery, self._traction = onboard
        blocks = *self._firmware.block, self._motors.block, self._battery.block, self._traction.block
        self._always = *blocks, *own
        self.table = np.zeros(END + len(sizes) + len(own), np.int64)
        self.table[[WHEELS, ROBOTS]] = self._traction.block.shape[1:]
        self.table[BLOCKS:TRACTION] = [addresses.of(array) for array in blocks]
        self.table[END:] = *sizes, *(addresses.of(array) for array in own)
        self.look()

    def look(self) -> None:
        """Find those arrays anew in whose place others come when a fault begins or ends."""
        t, past = self._traction.arrays(), self._firmware.estimate.past
        own = t.outward, np.array([t.arm]), t.centre, t.grip, t.gap, t.bearing, t.radius, t.creep, t.friction, t.wrench
        self._now = *own, *t.carpet, *self._motors.heat_arrays(), *self._battery.charge_arrays(), past
        self.table[TRACTION:END] = [addresses.of(array) for array in self._now]
        self.table[PATCHES], self.table[GAPS], self.table[FRAMES] = len(t.carpet.patches), t.gaps, len(past)


def firmware(t: Table) -> FirmwareArrays:
    """What firmware has."""
    n, w = t[ROBOTS], t[WHEELS]
    robots = floats(t[BLOCKS], (arrays.FIRMWARE_ROBOTS, n))
    return arrays.firmware(robots, floats(t[BLOCKS + 1], (arrays.FIRMWARE_WHEELS, w, n)))


def motors(t: Table) -> MotorArrays:
    """What motors have."""
    return arrays.motors(floats(t[BLOCKS + 2], (arrays.MOTORS, t[WHEELS], t[ROBOTS])))


def battery(t: Table) -> BatteryArrays:
    """What batteries have."""
    return arrays.battery(floats(t[BLOCKS + 3], (arrays.BATTERY, t[ROBOTS])))


def rims(t: Table) -> RimArrays:
    """What rims have."""
    return arrays.rims(floats(t[BLOCKS + 4], (arrays.RIMS, t[WHEELS], t[ROBOTS])))


def traction(t: Table) -> TractionArrays:
    """What wheels have on the carpet."""
    n, w, a, b = t[ROBOTS], t[WHEELS], t[TRACTION:], t[CARPET:]
    carpet = CarpetArrays(
        floats(b[0], (w, n)),
        floats(b[1], (t[PATCHES], 4, n)),
        floats(b[2], (n,)),
        floats(b[3], (n,)),
        vectors(b[4], (n,)),
    )
    return TractionArrays(
        vectors(a[0], (w,)),
        floats(a[1], (1,))[0],
        floats(a[2], (3, n)),
        carpet,
        floats(a[3], (w, n)),
        floats(a[4], (w, n)),
        t[GAPS] != 0,
        floats(a[5], (n,)),
        floats(a[6], (w, n)),
        floats(a[7], (w, n)),
        rims(t),
        floats(a[8], (w, n)),
        floats(a[9], (6, n)),
    )


def heat(t: Table) -> HeatArrays:
    """What changes of motors from frame to frame."""
    n, w, a = t[ROBOTS], t[WHEELS], t[HEAT:]
    return HeatArrays(
        floats(a[0], (w, n)),
        floats(a[1], (w, n)),
        floats(a[2], (w, n)),
        floats(a[3], (w, n)),
        floats(a[4], (n,)),
        floats(a[5], (w, n)),
        floats(a[6], (n,)),
        floats(a[7], (n,)),
        floats(a[8], (n,)),
        floats(a[9], (n,)),
        floats(a[10], (n,)),
        floats(a[11], (n,)),
        floats(a[12], (2, 4, n)),
    )


def charge(t: Table) -> ChargeArrays:
    """What changes of batteries from frame to frame."""
    n, a = t[ROBOTS], t[CHARGE:]
    return ChargeArrays(
        floats(a[0], (n,)),
        floats(a[1], (n,)),
        truths(a[2], (n,)),
        floats(a[3], (n,)),
        floats(a[4], (n,)),
        floats(a[5], (n,)),
    )


def past(t: Table) -> np.ndarray:
    """What was held for headings."""
    return floats(t[PAST], (t[FRAMES], t[ROBOTS]))
