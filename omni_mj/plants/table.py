"""Where all is that compiled loops reach between the physics steps of the MuJoCo plant, in one table.

A table, of int64, has sizes first, then addresses: of the blocks of what is on robots, then of the arrays in `Cells`,
`Seen` and others, in the order of their fields. `Writer` writes it, the other functions give back what it tells of.
"""

from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array
from omni_mj.onboard import addresses, arrays
from omni_mj.onboard.addresses import floats, numbers, truths, vectors
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
from omni_mj.plants.cells import OF_ROBOT, OF_WHEEL, Cells

Table = np.ndarray


class Seen(NamedTuple):
    """What loops read and note of n robots, from one call to another or within one."""

    angle: Array  # of the wheels, as encoders showed it last, (W, n) rad
    rate: Array  # as gyros did, (n,) rad/s
    off: np.ndarray  # robots that are switched off, (n,)
    recorded: Array  # wheel speeds, voltages and currents of a frame's cycles, (3, cycles, W, n)
    supplies: Array  # the battery's voltage in them, (cycles, n)
    error: Array  # what gyros show too much in this frame, (n,) rad/s
    push: Array  # on the chassis in this frame, (n, 2) N
    held: Array  # currents that drivers hold, (W, n) A, or not a number
    gyro: Array  # with their errors, (n,) rad/s
    load: Array  # of the wheels, (W, n) N
    place: Array  # (2, n) m
    facing: Array  # cosine and sine of the heading, (2, n)
    twist: Array  # of the robot's middle, in its frame, (3, n) m/s and rad/s
    drawn: Array  # from batteries, (n,) A
    heats: Array  # of the motors, (2, n)
    heading: Array  # at the end of the last frame, full turns counted, (n,) rad


# Sizes; of what is held: wheels of which drivers hold a current, all or none.
ROBOTS, WHEELS, WORLDS, PLACES, STATE, SENSORS, DOFS, CYCLES, PATCHES, GAPS, HELD, CREEPS = range(12)
# Where addresses begin.
BLOCKS = CREEPS + 1
CELLS = BLOCKS + 5
SEEN = CELLS + len(Cells._fields)
TRACTION = SEEN + len(Seen._fields)
CARPET = TRACTION + 10
HEAT = CARPET + len(CarpetArrays._fields)
CHARGE = HEAT + len(HeatArrays._fields)
END = CHARGE + len(ChargeArrays._fields)


class Writer:
    """Writes a table, and keeps what it tells of alive.

    Args:
        cells: of the batch.
        seen: of its robots.
        onboard: firmware, motors, battery and traction of the robots.
        creeps: whether there are slip hinges.

    Attributes:
        table: live.
    """

    def __init__(
        self, cells: Cells, seen: Seen, onboard: tuple[Firmware, Motors, Battery, Traction], creeps: bool
    ) -> None:
        firmware, self._motors, self._battery, self._traction = onboard
        blocks = *firmware.block, self._motors.block, self._battery.block, self._traction.block
        self._always = *blocks, *cells, *seen
        self.table = np.zeros(END, np.int64)
        self.table[[WHEELS, ROBOTS]], self.table[CYCLES] = seen.angle.shape, seen.recorded.shape[1]
        self.table[[WORLDS, STATE]], self.table[SENSORS] = cells.state.shape, cells.sensors.shape[1]
        self.table[PLACES], self.table[DOFS], self.table[CREEPS] = len(cells.robots), cells.limit.shape[1], creeps
        self.table[BLOCKS:TRACTION] = [addresses.of(array) for array in self._always]
        self.look()

    def look(self) -> None:
        """Find those arrays anew in whose place others come when a fault begins or ends."""
        t = self._traction.arrays()
        own = t.outward, np.array([t.arm]), t.centre, t.grip, t.gap, t.bearing, t.radius, t.creep, t.friction, t.wrench
        self._now = *own, *t.carpet, *self._motors.heat_arrays(), *self._battery.charge_arrays()
        self.table[TRACTION:] = [addresses.of(array) for array in self._now]
        self.table[PATCHES], self.table[GAPS] = len(t.carpet.patches), t.gaps


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


def cells(t: Table) -> Cells:
    """Where robots are in the batch."""
    worlds, places, a = t[WORLDS], t[PLACES], t[CELLS:]
    return Cells(
        floats(a[0], (worlds, t[STATE])),
        floats(a[1], (worlds, t[SENSORS])),
        floats(a[2], (worlds, t[DOFS])),
        floats(a[3], (worlds, t[DOFS], 5)),
        numbers(a[4], (places, OF_WHEEL, t[WHEELS])),
        numbers(a[5], (places, OF_ROBOT)),
        floats(a[6], (1,)),
    )


def seen(t: Table) -> Seen:
    """What is noted."""
    n, w, a = t[ROBOTS], t[WHEELS], t[SEEN:]
    return Seen(
        floats(a[0], (w, n)),
        floats(a[1], (n,)),
        truths(a[2], (n,)),
        floats(a[3], (3, t[CYCLES], w, n)),
        floats(a[4], (t[CYCLES], n)),
        floats(a[5], (n,)),
        floats(a[6], (n, 2)),
        floats(a[7], (t[HELD], n)),
        floats(a[8], (n,)),
        floats(a[9], (w, n)),
        floats(a[10], (2, n)),
        floats(a[11], (2, n)),
        floats(a[12], (3, n)),
        floats(a[13], (n,)),
        floats(a[14], (2, n)),
        floats(a[15], (n,)),
    )


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
