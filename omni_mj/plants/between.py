"""What happens between the physics steps of the MuJoCo plant, in loops that numba compiles.

Two calls a step, `before` and `after` it, do what those of `AtOnce` do with numpy, in the same order, and reach into
the batch's arrays themselves. Each is handed one array alone (`table`). Where a world is alone, one call does for many
cycles, physics steps among them (`Burst`).
"""

from collections.abc import Sequence

import numpy as np
from mujoco.batch import Batch

from omni_control.kinematics import Array, wrapped
from omni_mj.link.radio import Received
from omni_mj.onboard import addresses, by_frame, by_robot, laws
from omni_mj.onboard.arrays import RimArrays, TractionArrays
from omni_mj.onboard.battery import Battery
from omni_mj.onboard.firmware import Firmware
from omni_mj.onboard.kernel import compiled
from omni_mj.onboard.motors import Motors
from omni_mj.onboard.traction import EVERY, Traction
from omni_mj.plants import alone, table
from omni_mj.plants.alone import Alone
from omni_mj.plants.cells import (
    ANGLE,
    BOTTOM,
    CTRL,
    ENCODER,
    FOLLOWING,
    GYRO,
    LOAD,
    QW,
    QX,
    QY,
    QZ,
    RATE,
    SLIP,
    SLIP_ANGLE,
    SPEED,
    VX,
    VY,
    WRENCH,
    Cells,
    X,
    Y,
)
from omni_mj.plants.table import CREEPS, END, HELD, PLACES, ROBOTS, Seen, Table, Writer
from omni_mj.worlds.build import World


class Between:
    """What happens before and after each step; see `AtOnce`.

    Args:
        batch: of the robots' worlds.
        world: as built.
        onboard, sensed, off, heading, recorded: as of `AtOnce`.

    Attributes:
        firmware: of the robots.
        table: what loops are handed; live.
    """

    def __init__(
        self,
        batch: Batch | Alone,
        world: World,
        onboard: tuple[Firmware, Motors, Battery, Traction],
        sensed: tuple[Array, Array],
        off: np.ndarray,
        heading: Array,
        recorded: tuple[Array, Array],
    ) -> None:
        (angle, rate), n = sensed, len(off)
        shapes = (n,), (n, 2), angle.shape, (n,), angle.shape, (2, n), (2, n), (3, n), (n,), (2, n)
        self._seen = Seen._make([angle, rate, off, *recorded, *map(np.zeros, shapes), heading])
        creeps = world.robots[0].slip_dofs.size > 0
        self._writer = Writer(Cells.of(batch, world), self._seen, onboard, creeps)
        self.firmware, self.table = onboard[0], self._writer.table
        self._obey, self._begin, self._end = compiled(obey), compiled(begin), compiled(end)
        self._before, self._after = compiled(before), compiled(after)

    def look(self) -> None:
        """Find anew what others stand in for when a fault begins or ends."""
        self._writer.look()

    def obey(self, received: Received) -> None:
        """Take over commands, from the next cycle on."""
        self.firmware.note(received)
        self._obey(self.table, self.firmware.cycle)

    def begin(self, heard: tuple[Array, np.ndarray], gyro_error: Array, push: Array) -> None:
        """Begin a frame; see `AtOnce`."""
        self._seen.error[:], self._seen.push[:] = gyro_error, push
        self.firmware.listen(*heard)
        self._begin(self.table, self.firmware.estimate.frame)
        self.firmware.estimate.frame += 1

    def hold(self, held: Array | None) -> None:
        """Have drivers hold currents from now on, (n, W) A, or not a number; None for none."""
        self.table[HELD] = 0 if held is None else len(self._seen.held)
        if held is not None:
            self._seen.held[:] = held.T

    def before(self, k: int) -> None:
        """Let the wheel loops run in the cycle `k` of a frame, before physics steps."""
        self._before(self.table, k, self.firmware.cycle)
        self.firmware.cycle += 1

    def after(self, k: int, first: bool, last: bool) -> None:
        """See to what follows a physics step, the `first` or `last` in the cycle `k` of a frame."""
        self._after(self.table, k, first, last)

    def end(self, period: float) -> bool:
        """Warm motors and discharge batteries after a frame that lasted so long, s, and read headings.

        Returns:
            Whether a robot that is on has toppled.
        """
        toppled: bool = self._end(self.table, period)
        return toppled


class Burst:
    """Goes through cycles of a frame, physics steps among them, of a world by itself.

    Args:
        groups: what happens to its robots between the steps, to one after the other.
        substeps: physics steps in a cycle.
    """

    def __init__(self, groups: Sequence[Between], substeps: int) -> None:
        self._groups, self._substeps = groups, substeps
        self._tables = np.array([addresses.of(each.table) for each in groups])
        self._burst = compiled(burst)

    def go(self, world: Alone, first: int, count: int, living: bool) -> None:
        """Go through some, from the `first` of their frame on, with physics steps if the world is `living`."""
        firmware = [each.firmware for each in self._groups]
        self._burst(self._tables, world.stepping, first, count, self._substeps, living, firmware[0].cycle)
        for each in firmware:
            each.cycle += count


def burst(
    tables: np.ndarray, stepping: np.ndarray, first: int, count: int, substeps: int, living: bool, cycle: int
) -> None:
    """See `Burst.go`: `tables` are addresses of the groups' tables, `stepping` is the world's.

    All of them have had as many cycles before: `cycle`.
    """
    for k in range(count):
        for address in tables:
            before(addresses.numbers(address, (END,)), first + k, cycle + k)
        for substep in range(substeps):
            if living:
                alone.step(stepping)
            for address in tables:
                after(addresses.numbers(address, (END,)), first + k, substep == 0, substep == substeps - 1)


def obey(t: Table, cycle: int) -> None:
    """Take over the commands that are noted, after so many cycles."""
    by_frame.obey((0, t[ROBOTS]), table.firmware(t), cycle)


def begin(t: Table, frame: int) -> None:
    """Begin a frame, after so many, with the headings that are noted."""
    by_frame.correct((0, t[ROBOTS]), table.firmware(t), table.heat(t), table.past(t), frame)


def before(t: Table, k: int, cycle: int) -> None:
    """From what was sensed to voltages and the limits of slip hinges, in the cycle `k` of a frame."""
    c, s = table.cells(t), table.seen(t)
    f, m, b = table.firmware(t), table.motors(t), table.battery(t)
    places, n = t[PLACES], t[ROBOTS]
    if k % EVERY == 0:
        _travel(table.traction(t), c, s)
    speed, voltage, current = s.recorded[0, k], s.recorded[1, k], s.recorded[2, k]
    for i in range(n):
        s.gyro[i], s.supplies[k, i] = s.rate[i] + s.error[i], b.voltage[i]
        for w in range(speed.shape[0]):
            speed[w, i] = c.state[i // places, c.wheels[i % places, SPEED, w]]
    by_robot.control((0, n), cycle, f, s.gyro, s.angle)
    by_robot.supply((0, n), f, m, b, s.held, speed, voltage)
    for i in range(n):
        for w in range(speed.shape[0]):
            voltage[w, i] = 0.0 if s.off[i] else voltage[w, i]
    by_robot.drive((0, n), m, speed, voltage, current)
    for i in range(n):  # of the dcmotor, which knows no commutation: see `Motors.told`
        for w in range(speed.shape[0]):
            told = m.speed_constant[w, i] * speed[w, i] + current[w, i] * m.resistance[w, i]
            c.state[i // places, c.wheels[i % places, CTRL, w]] = told
    if t[CREEPS]:
        _press(table.rims(t), c, s.load)


def after(t: Table, k: int, first: bool, last: bool) -> None:
    """From a physics step, the `first` or `last` in the cycle `k` of a frame, to the next.

    MuJoCo senses at a step's start: what loops see is of the first step's, however many there are in a cycle.
    """
    c, s = table.cells(t), table.seen(t)
    places, pitch = t[PLACES], c.pitch[0]
    for i in range(t[ROBOTS]):
        world, place = i // places, i % places
        if first:
            s.rate[i] = c.sensors[world, c.robots[place, GYRO]]
            for w in range(s.angle.shape[0]):
                s.angle[w, i] = c.sensors[world, c.wheels[place, ENCODER, w]]
        if pitch > 0:
            _hand_over(c.state[world], c.wheels[place], pitch)
    if last:
        by_robot.load((0, t[ROBOTS]), table.battery(t), s.recorded[1, k], s.recorded[2, k], s.drawn)
    elif t[CREEPS]:
        _press(table.rims(t), c, s.load)


def end(t: Table, period: float) -> bool:
    """See `Between.end`."""
    c, s, places, toppled = table.cells(t), table.seen(t), t[PLACES], False
    by_robot.warm((0, t[ROBOTS]), table.motors(t), table.heat(t), s.recorded[2], s.recorded[0], s.heats)
    by_robot.discharge((0, t[ROBOTS]), table.battery(t), table.charge(t), period)
    for i in range(t[ROBOTS]):
        state, robot = c.state[i // places], c.robots[i % places]
        w, x, y, z = state[robot[QW]], state[robot[QX]], state[robot[QY]], state[robot[QZ]]
        s.heading[i] += wrapped(laws.heading(w, x, y, z) - s.heading[i])
        toppled = toppled or (laws.toppled(x, y) and not s.off[i])
    return toppled


def _travel(t: TractionArrays, c: Cells, s: Seen) -> None:
    """Carpet and drag of all robots (see `Traction.travel`)."""
    places, n = c.robots.shape[0], len(s.rate)
    _weigh(c, s.load)
    for i in range(n):
        state, robot = c.state[i // places], c.robots[i % places]
        half = complex(state[robot[QW]], state[robot[QZ]])
        facing = half * half
        body = complex(state[robot[VX]], state[robot[VY]]) * facing.conjugate()
        s.place[0, i], s.place[1, i] = state[robot[X]], state[robot[Y]]
        s.facing[0, i], s.facing[1, i] = facing.real, facing.imag
        s.twist[0, i], s.twist[1, i], s.twist[2, i] = body.real, body.imag, state[robot[RATE]]
    by_robot.travel((0, n), t, s.place, s.facing, s.twist, s.load, s.angle)
    for i in range(n):
        state, robot = c.state[i // places], c.robots[i % places]
        t.wrench[0, i] += s.push[i, 0]
        t.wrench[1, i] += s.push[i, 1]
        for axis in range(6):
            state[robot[WRENCH + axis]] = t.wrench[axis, i]


def _weigh(c: Cells, load: Array) -> None:
    """Read the loads of all robots' wheels."""
    places = c.robots.shape[0]
    for i in range(load.shape[1]):
        for w in range(load.shape[0]):
            load[w, i] = c.sensors[i // places, c.wheels[i % places, LOAD, w]]


def _press(r: RimArrays, c: Cells, load: Array) -> None:
    """Write limits and impedances of all robots' slip hinges."""
    places, n = c.robots.shape[0], load.shape[1]
    _weigh(c, load)
    by_robot.press((0, n), r, load)
    for i in range(n):
        for w in range(load.shape[0]):
            world, slip = i // places, c.wheels[i % places, SLIP, w]
            c.limit[world, slip] = r.limit[w, i]
            c.impedance[world, slip, 0] = r.impedance[w, i]


def _hand_over(state: Array, wheels: np.ndarray, pitch: float) -> None:
    """See `two_rollers.Handover`."""
    for w in range(wheels.shape[1]):
        slip, bottom, following = wheels[SLIP_ANGLE, w], wheels[BOTTOM, w], wheels[FOLLOWING, w]
        past = np.floor((state[wheels[ANGLE, w]] + state[slip]) * (1 / pitch))
        if past != 0:
            state[slip] -= past * pitch
            spins = state[bottom], state[following]
            state[bottom] = spins[1] if past == 1 else 0.0
            state[following] = spins[0] if past == -1 else 0.0
