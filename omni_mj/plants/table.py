"""Where all is that compiled loops reach between the physics steps of the MuJoCo plant, in one table.

After what is on robots (`omni_mj.onboard.table`) come the plant's own sizes, then the addresses of the arrays in
`Cells` and `Seen`, in the order of their fields.
"""

from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array
from omni_mj.onboard import table
from omni_mj.onboard.addresses import floats, numbers, truths
from omni_mj.onboard.battery import Battery
from omni_mj.onboard.firmware import Firmware
from omni_mj.onboard.motors import Motors
from omni_mj.onboard.table import ROBOTS, WHEELS, Table, battery, charge, firmware, heat, motors, past, rims, traction
from omni_mj.onboard.traction import Traction
from omni_mj.plants.cells import OF_ROBOT, OF_WHEEL, Cells

__all__ = ["ROBOTS", "Table", "battery", "charge", "firmware", "heat", "motors", "past", "rims", "traction"]


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
WORLDS, PLACES, STATE, SENSORS, DOFS, CYCLES, HELD, CREEPS = range(table.END, table.END + 8)
# Where addresses begin.
CELLS = CREEPS + 1
SEEN = CELLS + len(Cells._fields)
END = SEEN + len(Seen._fields)


class Writer(table.Writer):
    """Writes a table, and keeps what it tells of alive.

    Args:
        cells: of the batch.
        seen: of its robots.
        onboard: firmware, motors, battery and traction of the robots.
        creeps: whether there are slip hinges.
    """

    def __init__(
        self, cells: Cells, seen: Seen, onboard: tuple[Firmware, Motors, Battery, Traction], creeps: bool
    ) -> None:
        (worlds, state), cycles = cells.state.shape, seen.recorded.shape[1]
        sizes = worlds, len(cells.robots), state, cells.sensors.shape[1], cells.limit.shape[1], cycles, 0, int(creeps)
        super().__init__(onboard, sizes, [*cells, *seen])


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
