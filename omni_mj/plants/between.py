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
from omni_mj.onboard import arrays, by_robot, laws
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


class Between:
    """What happens before and after each step.

    Args:
        batch: of the robots' worlds.
        world: as built.
        onboard: firmware, motors, battery and traction of the robots.
        sensed: what encoders and gyros showed last, (n, W) rad and (n,) rad/s; written.
        recorded: written: wheel speeds, voltages and currents of a frame's cycles (3, cycles, n, W), and the battery's
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
        self._cells, self._sensed, self._recorded = Cells.of(batch, world), sensed, recorded
        self._blocks = *self._firmware.block, motors.block, battery.block, self._traction.block
        self._nothing, self._load = np.full_like(sensed[0], np.nan), np.zeros_like(sensed[0])
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
            self._travel(self._traction.arrays(), self._cells, self._load, self._sensed[0], push)
        given = self._nothing if held is None else held
        cells, sensed, cycle = self._cells, self._sensed, self._firmware.cycle
        self._before(cycle, k, *self._blocks, cells, *sensed, self._load, gyro_error, off, given, *self._recorded)
        self._firmware.cycle += 1

    def after(self, k: int, first: bool, last: bool) -> None:
        """From a physics step to the next.

        Args:
            k: the cycle's number in the frame.
            first: whether it was the cycle's first, at whose start MuJoCo sensed.
            last: whether it was the cycle's last.
        """
        *_, battery, rims = self._blocks
        self._after(k, first, last, battery, rims, self._cells, *self._sensed, self._load, self._recorded[0])

    def end(self, period: float) -> None:
        """Warm motors and discharge batteries after a frame that lasted so long, s."""
        heat, charge = self._motors.heat_arrays(), self._battery.charge_arrays()
        self._end(self._motors.block, heat, self._battery.block, charge, self._recorded[0], period)


def travel(t: TractionArrays, c: Cells, load: Array, angle: Array, push: Array) -> None:
    """Carpet and drag of all robots (see `Traction.travel`)."""
    places = c.robots.shape[0]
    for i in range(len(load)):
        state, robot = c.state[i // places], c.robots[i % places]
        _weigh(i, c, load)
        position, velocity = complex(state[robot[X]], state[robot[Y]]), complex(state[robot[VX]], state[robot[VY]])
        half = complex(state[robot[W]], state[robot[Z]])
        by_robot.travel(i, t, position, half * half, velocity, state[robot[RATE]], load, angle)
        t.wrench[i, 0] += push[i, 0]
        t.wrench[i, 1] += push[i, 1]
        for axis in range(6):
            state[robot[WRENCH + axis]] = t.wrench[i, axis]


def before(
    cycle: int,
    k: int,
    firmware_robots: Array,
    firmware_wheels: Array,
    motors: Array,
    battery: Array,
    rims: Array,
    c: Cells,
    angle: Array,
    rate: Array,
    load: Array,
    gyro_error: Array,
    off: np.ndarray,
    held: Array,
    recorded: Array,
    supply: Array,
) -> None:
    """See `Between.before`."""
    f, m = arrays.firmware(firmware_robots, firmware_wheels), arrays.motors(motors)
    b, r = arrays.battery(battery), arrays.rims(rims)
    speed, voltage, current = recorded[0, k], recorded[1, k], recorded[2, k]
    places = c.robots.shape[0]
    for i in range(len(rate)):
        state, wheels = c.state[i // places], c.wheels[i % places]
        by_robot.control(i, cycle, f, rate[i] + gyro_error[i], angle)
        supply[k, i, 0] = b.voltage[i]
        for w in range(speed.shape[1]):
            speed[i, w] = state[wheels[SPEED, w]]
            duty = f.held[i, w]
            if not np.isnan(held[i, w]):
                motor = m.speed_constant[i, w], m.resistance[i, w], m.commutation[i, w]
                wanted = laws.voltage(held[i, w], speed[i, w], *motor)
                duty = laws.share(wanted, b.voltage[i]) if b.voltage[i] > 0 else 0.0
            voltage[i, w] = 0.0 if off[i] else duty * b.voltage[i]
        by_robot.drive(i, m, speed, voltage, current)
        for w in range(speed.shape[1]):  # of the dcmotor, which knows no commutation: see `Motors.drive`
            state[wheels[CTRL, w]] = m.speed_constant[i, w] * speed[i, w] + current[i, w] * m.resistance[i, w]
        if c.creeps:
            _press(i, r, c, load)


def after(
    k: int,
    first: bool,
    last: bool,
    battery: Array,
    rims: Array,
    c: Cells,
    angle: Array,
    rate: Array,
    load: Array,
    recorded: Array,
) -> None:
    """See `Between.after`."""
    b, r = arrays.battery(battery), arrays.rims(rims)
    voltage, current = recorded[1, k], recorded[2, k]
    places = c.robots.shape[0]
    for i in range(len(rate)):
        world, place = i // places, i % places
        wheels = c.wheels[place]
        if first:
            rate[i] = c.sensors[world, c.robots[place, GYRO]]
            for w in range(angle.shape[1]):
                angle[i, w] = c.sensors[world, wheels[ENCODER, w]]
        if c.pitch > 0:
            _hand_over(c.state[world], wheels, c.pitch)
        if last:
            by_robot.load(i, b, voltage, current)
        elif c.creeps:
            _press(i, r, c, load)


def end(motors: Array, heat: HeatArrays, battery: Array, charge: ChargeArrays, recorded: Array, period: float) -> None:
    """See `Between.end`."""
    m, b = arrays.motors(motors), arrays.battery(battery)
    for i in range(battery.shape[1]):
        by_robot.warm(i, m, heat, recorded[2], recorded[0])
        by_robot.discharge(i, b, charge, period)


def _weigh(i: int, c: Cells, load: Array) -> None:
    """Read the loads of robot i's wheels."""
    places = c.robots.shape[0]
    wheels = c.wheels[i % places]
    for w in range(load.shape[1]):
        load[i, w] = c.sensors[i // places, wheels[LOAD, w]]


def _press(i: int, r: RimArrays, c: Cells, load: Array) -> None:
    """Write limit and impedance of robot i's slip hinges."""
    places = c.robots.shape[0]
    world, slips = i // places, c.wheels[i % places, SLIP]
    _weigh(i, c, load)
    by_robot.press(i, r, load)
    for w in range(load.shape[1]):
        c.limit[world, slips[w]] = r.limit[i, w]
        c.impedance[world, slips[w], 0] = r.impedance[i, w]


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
