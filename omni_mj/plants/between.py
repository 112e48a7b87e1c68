"""What happens between the physics steps of the MuJoCo plant, in loops that numba compiles.

Two calls a step: `before` it sensors and commands become voltages, loads become limits of the slip hinges; `after` it
sensors are read, rollers handed over, and the battery sags. They do what `MujocoPlant` does with numpy, in the same
order, and reach into the batch's arrays themselves.
"""

from typing import NamedTuple

import numpy as np
from mujoco.batch import Batch

from omni_control.kinematics import Array
from omni_mj.mjcf import roles
from omni_mj.onboard import arrays, by_robot
from omni_mj.onboard.arrays import ChargeArrays, HeatArrays, RimArrays, TractionArrays
from omni_mj.onboard.battery import Battery
from omni_mj.onboard.firmware import Firmware
from omni_mj.onboard.kernel import compiled
from omni_mj.onboard.motors import Motors
from omni_mj.onboard.traction import EVERY, Traction
from omni_mj.worlds.build import World

# Columns of `Cells.wheels`, and of `Cells.robots`: x, y; the quaternion's w, z; vx, vy and turn rate; the wrench; gyro.
ANGLE, SPEED, CTRL, ENCODER, LOAD, SLIP_ANGLE, SLIP, BOTTOM, FOLLOWING = range(9)
X, Y, W, Z, VX, VY, RATE, WRENCH, GYRO = 0, 1, 2, 3, 4, 5, 6, 7, 13


class Cells(NamedTuple):
    """Where robots are in the batch's arrays.

    Attributes:
        state: integration states of the worlds, (worlds, numbers).
        sensors: their sensors' data.
        limit: dry friction of their joints, (worlds, nv).
        impedance: of these constraints, (worlds, nv, 5).
        wheels: columns of each place's wheels in state, those of sensors, and of slip hinges, (places, 9, W).
        robots: of each place's robot, (places, 14).
        pitch: between rollers if they are handed over, else 0, rad.
        creeps: whether there are slip hinges.
    """

    state: Array
    sensors: Array
    limit: Array
    impedance: Array
    wheels: np.ndarray
    robots: np.ndarray
    pitch: float
    creeps: bool

    @classmethod
    def of(cls, batch: Batch, world: World) -> "Cells":
        """Find them."""
        state = batch.state

        def first(name: str) -> int:
            offset: int = batch.bind(name).ctypes.data - state.ctypes.data
            return offset // state.itemsize

        qpos, qvel, ctrl, forces = (first(name) for name in ("qpos", "qvel", "ctrl", "xfrc_applied"))
        wheels = np.zeros((len(world.robots), 9, len(world.kinematics.azimuths)), np.int64)
        robots = np.zeros((len(world.robots), 14), np.int64)
        creeps = world.robots[0].slip_dofs.size > 0
        kept = creeps and world.robots[0].rollers.shape[1] == roles.KEPT
        for place, robot in enumerate(world.robots):
            wheels[place, ANGLE], wheels[place, SPEED] = qpos + np.array(robot.wheel_qpos), qvel + robot.wheel_dofs
            wheels[place, CTRL], wheels[place, ENCODER] = ctrl + robot.motors, robot.encoders
            wheels[place, LOAD] = world.loads[place]
            if creeps:
                wheels[place, SLIP_ANGLE], wheels[place, SLIP] = qpos + robot.slip_qpos, robot.slip_dofs
            if kept:
                wheels[place, BOTTOM:] = qvel + robot.roller_dofs.T
            robots[place, [X, Y, W, Z]] = qpos + np.array(robot.qpos)[[0, 1, 3, 6]]
            robots[place, [VX, VY, RATE]] = qvel + np.array(robot.dofs)[[0, 1, 5]]
            robots[place, WRENCH:GYRO] = forces + 6 * robot.chassis + np.arange(6)
            robots[place, GYRO] = robot.gyro
        return cls(
            state=state,
            sensors=batch.bind("sensordata"),
            limit=batch.expand("dof_frictionloss"),
            impedance=batch.expand("dof_solimp"),
            wheels=wheels,
            robots=robots,
            pitch=world.wheels.pitch if kept else 0.0,
            creeps=creeps,
        )


class Seen(NamedTuple):
    """What loops note of n robots, from one call to another or within one."""

    angle: Array  # of the wheels, as encoders showed it last, (W, n) rad
    rate: Array  # as gyros did, (n,) rad/s
    gyro: Array  # with their errors, (n,) rad/s
    load: Array  # of the wheels, (W, n) N
    place: Array  # (2, n) m
    facing: Array  # cosine and sine of the heading, (2, n)
    twist: Array  # of the robot's middle, in its frame, (3, n) m/s and rad/s
    drawn: Array  # from batteries, (n,) A
    heats: Array  # of the motors, (2, n)


class Between:
    """What happens before and after each step.

    Args:
        batch: of the robots' worlds.
        world: as built.
        onboard: firmware, motors, battery and traction of the robots.
        sensed: what encoders and gyros showed last, (W, n) rad and (n,) rad/s; written.
        recorded: written: wheel speeds, voltages and currents of a frame's cycles (3, cycles, W, n), and the battery's
            voltage (cycles, n, 1).
    """

    def __init__(
        self,
        batch: Batch,
        world: World,
        onboard: tuple[Firmware, Motors, Battery, Traction],
        sensed: tuple[Array, Array],
        recorded: tuple[Array, Array],
    ) -> None:
        self._firmware, motors, battery, self._traction = onboard
        self._cells, self._recorded = Cells.of(batch, world), recorded
        self._blocks = *self._firmware.block, motors.block, battery.block, self._traction.block
        (angle, rate), n = sensed, len(sensed[1])
        shapes = (n,), angle.shape, (2, n), (2, n), (3, n), (n,), (2, n)
        self._seen = Seen(angle, rate, *map(np.zeros, shapes))
        self._nothing = np.zeros((0, n))
        self._travel, self._before, self._after = compiled(travel), compiled(before), compiled(after)
        self._motors, self._battery, self._end = motors, battery, compiled(end)

    def before(self, k: int, gyro_error: Array, push: Array, off: np.ndarray, held: Array | None) -> None:
        """From what was sensed to voltages and the limits of slip hinges.

        Args:
            k: the cycle's number in the frame.
            gyro_error: what gyros show too much, (n,) rad/s.
            push: on the chassis, (n, 2) N.
            off: robots that are switched off, (n,).
            held: currents that drivers hold, (n, W) A, or not a number.
        """
        if k % EVERY == 0:
            self._travel(self._traction.arrays(), self._cells, self._seen, push)
        given = self._nothing if held is None else np.ascontiguousarray(held.T)
        cycle = self._firmware.cycle
        self._before(cycle, k, *self._blocks, self._cells, self._seen, gyro_error, off, given, *self._recorded)
        self._firmware.cycle += 1

    def after(self, k: int, first: bool, last: bool) -> None:
        """From a physics step to the next.

        Args:
            k: the cycle's number in the frame.
            first: whether it was the cycle's first, at whose start MuJoCo sensed.
            last: whether it was the cycle's last.
        """
        *_, battery, rims = self._blocks
        self._after(k, first, last, battery, rims, self._cells, self._seen, self._recorded[0])

    def end(self, period: float) -> None:
        """Warm motors and discharge batteries after a frame that lasted so long, s."""
        heat, charge = self._motors.heat_arrays(), self._battery.charge_arrays()
        self._end(self._motors.block, heat, self._battery.block, charge, self._recorded[0], self._seen.heats, period)


def travel(t: TractionArrays, c: Cells, s: Seen, push: Array) -> None:
    """Carpet and drag of all robots (see `Traction.travel`)."""
    places, n = c.robots.shape[0], len(s.rate)
    _weigh(c, s.load)
    for i in range(n):
        state, robot = c.state[i // places], c.robots[i % places]
        half = complex(state[robot[W]], state[robot[Z]])
        facing = half * half
        body = complex(state[robot[VX]], state[robot[VY]]) * facing.conjugate()
        s.place[0, i], s.place[1, i] = state[robot[X]], state[robot[Y]]
        s.facing[0, i], s.facing[1, i] = facing.real, facing.imag
        s.twist[0, i], s.twist[1, i], s.twist[2, i] = body.real, body.imag, state[robot[RATE]]
    by_robot.travel(0, n, t, s.place, s.facing, s.twist, s.load)
    for i in range(n):
        state, robot = c.state[i // places], c.robots[i % places]
        t.wrench[0, i] += push[i, 0]
        t.wrench[1, i] += push[i, 1]
        for axis in range(6):
            state[robot[WRENCH + axis]] = t.wrench[axis, i]


def before(
    cycle: int,
    k: int,
    firmware_robots: Array,
    firmware_wheels: Array,
    motors: Array,
    battery: Array,
    rims: Array,
    c: Cells,
    s: Seen,
    gyro_error: Array,
    off: np.ndarray,
    held: Array,
    recorded: Array,
    supplies: Array,
) -> None:
    """See `Between.before`."""
    f, m = arrays.firmware(firmware_robots, firmware_wheels), arrays.motors(motors)
    b, r = arrays.battery(battery), arrays.rims(rims)
    speed, voltage, current = recorded[0, k], recorded[1, k], recorded[2, k]
    places, n = c.robots.shape[0], len(s.rate)
    for i in range(n):
        s.gyro[i], supplies[k, i, 0] = s.rate[i] + gyro_error[i], b.voltage[i]
        for w in range(speed.shape[0]):
            speed[w, i] = c.state[i // places, c.wheels[i % places, SPEED, w]]
    by_robot.control(0, n, cycle, f, s.gyro, s.angle)
    by_robot.supply(0, n, f, m, b, held, speed, voltage)
    for i in range(n):
        for w in range(speed.shape[0]):
            voltage[w, i] = 0.0 if off[i] else voltage[w, i]
    by_robot.drive(0, n, m, speed, voltage, current)
    for i in range(n):  # of the dcmotor, which knows no commutation: see `Motors.drive`
        for w in range(speed.shape[0]):
            told = m.speed_constant[w, i] * speed[w, i] + current[w, i] * m.resistance[w, i]
            c.state[i // places, c.wheels[i % places, CTRL, w]] = told
    if c.creeps:
        _press(r, c, s.load)


def after(k: int, first: bool, last: bool, battery: Array, rims: Array, c: Cells, s: Seen, recorded: Array) -> None:
    """See `Between.after`."""
    b, r = arrays.battery(battery), arrays.rims(rims)
    places, n = c.robots.shape[0], len(s.rate)
    for i in range(n):
        world, place = i // places, i % places
        if first:
            s.rate[i] = c.sensors[world, c.robots[place, GYRO]]
            for w in range(s.angle.shape[0]):
                s.angle[w, i] = c.sensors[world, c.wheels[place, ENCODER, w]]
        if c.pitch > 0:
            _hand_over(c.state[world], c.wheels[place], c.pitch)
    if last:
        by_robot.load(0, n, b, recorded[1, k], recorded[2, k], s.drawn)
    elif c.creeps:
        _press(r, c, s.load)


def end(
    motors: Array, heat: HeatArrays, battery: Array, charge: ChargeArrays, recorded: Array, heats: Array, period: float
) -> None:
    """See `Between.end`."""
    m, b = arrays.motors(motors), arrays.battery(battery)
    by_robot.warm(m, heat, recorded[2], recorded[0], heats)
    by_robot.discharge(b, charge, period)


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
    by_robot.press(0, n, r, load)
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
