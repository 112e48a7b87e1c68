"""Where all is that the compiled loops of this plant reach, in one table.

After what is on robots (`omni_mj.onboard.table`) come the plant's own sizes, then the addresses of the arrays in
`Robots`, `Motion`, `Scratch` and `Frame`, in the order of their fields.
"""

from omni_mj.onboard import table
from omni_mj.onboard.addresses import floats, vectors
from omni_mj.onboard.battery import Battery
from omni_mj.onboard.firmware import Firmware
from omni_mj.onboard.motors import Motors
from omni_mj.onboard.table import ROBOTS, WHEELS, Table
from omni_mj.onboard.traction import Traction
from omni_mj.plants.planar.arrays import Frame, Motion, Robots, Scratch

CYCLES, HELD = table.END, table.END + 1  # sizes; of what is held: wheels of which drivers hold a current, all or none
# Where addresses begin.
BODIES = HELD + 1
MOTION = BODIES + len(Robots._fields)
SCRATCH = MOTION + len(Motion._fields)
FRAME = SCRATCH + len(Scratch._fields)


class Writer(table.Writer):
    """Writes a table, and keeps what it tells of alive.

    Args:
        onboard: firmware, motors, battery and traction of the robots.
        robots: themselves.
        motion: theirs.
        frame: of them.
    """

    def __init__(
        self, onboard: tuple[Firmware, Motors, Battery, Traction], robots: Robots, motion: Motion, frame: Frame
    ) -> None:
        wheels, n = motion.speed.shape
        own = *robots, *motion, *Scratch.of(n, wheels), *frame
        super().__init__(onboard, (frame.recorded.shape[1], 0), own)


def robots(t: Table) -> Robots:
    """What does not change unless a robot's load does."""
    n, w, a = t[ROBOTS], t[WHEELS], t[BODIES:]
    return Robots(
        vectors(a[0], (w,)),
        floats(a[1], (2, w, n)),
        floats(a[2], (2, w, n)),
        floats(a[3], (2, w, n)),
        floats(a[4], (w, n)),
        floats(a[5], (w, 3, n)),
        floats(a[6], (w, 6, n)),
        floats(a[7], (6, n)),
        floats(a[8], (3, 3, n)),
        floats(a[9], (2, 3, n)),
        floats(a[10], (n,)),
        floats(a[11], (n,)),
        floats(a[12], (w, n)),
        floats(a[13], (w, n)),
        floats(a[14], (w, n)),
        floats(a[15], (w, n)),
        floats(a[16], (w, n)),
        floats(a[17], (w, n)),
        floats(a[18], (w, n)),
        floats(a[19], (w, n)),
        floats(a[20], (w, n)),
        floats(a[21], (w, n)),
        floats(a[22], (w, n)),
        floats(a[23], (w, n)),
        floats(a[24], (w, n)),
        floats(a[25], (n,)),
        floats(a[26], (n,)),
        floats(a[27], (n,)),
        floats(a[28], (n,)),
        floats(a[29], (2, n)),
        floats(a[30], (2, n)),
        floats(a[31], (n,)),
        floats(a[32], (n,)),
        floats(a[33], (w, n)),
        floats(a[34], (w, n)),
        floats(a[35], (w, n)),
        floats(a[36], (w, n)),
    )


def motion(t: Table) -> Motion:
    """Where robots are and what they do."""
    n, w, a = t[ROBOTS], t[WHEELS], t[MOTION:]
    return Motion(
        floats(a[0], (2, n)),
        floats(a[1], (2, n)),
        floats(a[2], (n,)),
        floats(a[3], (2, n)),
        floats(a[4], (3, n)),
        floats(a[5], (w, n)),
        floats(a[6], (w, n)),
        floats(a[7], (w, n)),
        floats(a[8], (w, n)),
        floats(a[9], (w, n)),
        floats(a[10], (w, n)),
        floats(a[11], (w, n)),
        floats(a[12], (w, n)),
        floats(a[13], (w, n)),
        floats(a[14], (3, n)),
        floats(a[15], (3, n)),
        floats(a[16], (w, n)),
        floats(a[17], (n,)),
        floats(a[18], (3, n)),
        floats(a[19], (2, n)),
        floats(a[20], (2, n)),
    )


def scratch(t: Table) -> Scratch:
    """What is noted within a cycle."""
    n, w, a = t[ROBOTS], t[WHEELS], t[SCRATCH:]
    return Scratch(
        floats(a[0], (w, n)),
        floats(a[1], (w, n)),
        floats(a[2], (w, n)),
        floats(a[3], (w, n)),
        floats(a[4], (3, n)),
        floats(a[5], (9, n)),
        floats(a[6], (3, n)),
        floats(a[7], (n,)),
        floats(a[8], (n,)),
        floats(a[9], (2, n)),
    )


def frame(t: Table) -> Frame:
    """What acts in a frame, and what is noted of it."""
    n, w, cycles, a = t[ROBOTS], t[WHEELS], t[CYCLES], t[FRAME:]
    return Frame(
        floats(a[0], (n,)),
        floats(a[1], (2, n)),
        floats(a[2], (2, n)),
        floats(a[3], (t[HELD], n)),
        floats(a[4], (3, cycles, w, n)),
        floats(a[5], (cycles, n)),
        floats(a[6], (w, n)),
        floats(a[7], (n, 10 * w + 4)),
        floats(a[8], (n, 3)),
    )
