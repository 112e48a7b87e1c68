"""The planar plant: robots in the plane, on wheels that creep and slide, driven by their firmware (docs/planar.md)."""

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, Kinematics
from omni_mj.link.radio import Received
from omni_mj.onboard.battery import Battery
from omni_mj.onboard.firmware import Firmware
from omni_mj.onboard.kernel import compiled
from omni_mj.onboard.motors import Motors
from omni_mj.onboard.traction import EVERY, Traction
from omni_mj.plants import Telemetry
from omni_mj.plants.chance import Chance
from omni_mj.plants.faults import Faults
from omni_mj.plants.planar import by_robot, cycle, wheels
from omni_mj.plants.planar.arrays import Motion, Robots, Scratch
from omni_mj.plants.planar.bodies import Bodies
from omni_mj.plants.variation import Drawn
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.settings import PERIOD_S, column
from omni_mj.worlds import build

STUCK_NM = 1e3  # dry friction of a hub that is stuck


class PlanarPlant:
    """Robots with roller wheels on carpet, each alone in its world, without a contact solver.

    Args:
        rows: of the robots; all must have the same wheels.
        start: poses at the start, (n, 3).

    Attributes:
        geometry: of the wheels, as they are when new.
        drawn: what the robots' seeds drew for them.
        cycles: of the wheel loops in a frame.
        currents: of the motors in each cycle of the frame just past, (cycles, n, wheels) A.

    Raises:
        OmniError: rows that this plant cannot hold: robots that share a world, or differ in their wheels, a model of a
            user's own, wheels without creep, or a robot lighter than its wheels.
    """

    def __init__(self, rows: Sequence[Row], start: Array) -> None:
        _check(rows)
        settings, n = [row.settings for row in rows], len(rows)
        world = build.world(settings[0])
        geometry = world.kinematics
        self.geometry: Kinematics | None = geometry
        self._kinematics = geometry
        count, self.cycles = len(geometry.azimuths), round(PERIOD_S / build.CYCLE_S)
        self.drawn = Drawn.of(rows)
        self._settings, self._bodies = settings, Bodies(settings, self.drawn, world)
        bodies = self._bodies
        self._radius = geometry.radius - self.drawn.wear
        x, y, heading = np.array(start, float).T
        facing, shape = np.stack([np.cos(heading), np.sin(heading)]), (count, n)
        self._robots = wheels.robots(settings, geometry, bodies, self.drawn)
        self._dry = self._robots.dry
        self._motion = Motion(
            place=np.stack([x, y]) - turned(facing, self._robots.middle),
            heading=heading.copy(),
            facing=facing,
            twist=np.zeros((3, n)),
            **{name: np.zeros(shape) for name in ("angle", "speed", "torque", "rims", "standing", "seen_angle")},
            **{name: np.zeros(shape) for name in ("ripple", "turns")},
            load=bodies.weight.T.copy(),
            seen_rate=np.zeros(n),
            sway=cycle.at_rest(self._robots),
            sway_rate=np.zeros((3, n)),
            **{name: np.zeros((2, n)) for name in ("tilting", "tilt")},
            force=np.zeros((3, n)),
        )
        self._failed = np.zeros(n, bool)

        self._chance = Chance(rows)
        limit = column([s.firmware for s in settings], "current_limit_a")
        self._motors = Motors([s.motor for s in settings], count, PERIOD_S, limit, self.drawn.strength)
        self._gear = column([s.motor for s in settings], "gear")
        self._battery = Battery([s.battery for s in settings])
        self._firmware = Firmware(settings, geometry, self._motion.heading, build.CYCLE_S, PERIOD_S)
        inverse = np.full(1, 1 / build.CYCLE_S)  # with which the traction's softness is that of `laws.soft`
        self._traction = Traction(
            settings, geometry, bodies.whole.centre, inverse, build.CYCLE_S, self.drawn.friction, self.drawn.wear
        )
        self._faults: Faults | None = None
        if any(row.faults for row in rows):
            onboard = self._firmware, self._motors, self._battery, self._traction
            self._faults = Faults(rows, self, onboard, self._motion.seen_angle.T)
        self._recorded = np.zeros((3, self.cycles, count, n))
        self._speeds, self._voltages, self.currents = self._recorded.swapaxes(2, 3)
        self._supplies = np.zeros((self.cycles, n))  # the battery's voltage of each step
        self._held: Array | None = None
        self._frame: Callable[..., None] | None = None
        if settings[0].physics.kernel == "numba":
            self._frame = compiled(by_robot.frame)
            self._scratch, self._nothing, self._onboard = Scratch.of(n, count), np.zeros((0, n)), self._arrays()

    def pose(self) -> Array:
        """See `Plant`."""
        m = self._motion
        return np.array([*(m.place + turned(m.facing, self._robots.middle)), m.heading]).T.copy()

    def twist(self) -> Array:
        """See `Plant`."""
        m, (x, y) = self._motion, self._robots.middle
        ahead, aside, rate = m.twist
        return np.stack([*turned(m.facing, np.stack([ahead - rate * y, aside + rate * x])), rate], axis=1)

    def advance(self, received: Received) -> dict[int, str]:
        """See `Plant`."""
        motors, firmware, m = self._motors, self._firmware, self._motion
        firmware.obey(received)
        gyro_bias, push = self._chance.gyro_bias, self._chance.push()
        if self._faults is not None:
            self._faults.begin()
            push, gyro_bias = push + self._faults.push, gyro_bias + self._faults.gyro
        firmware.correct(received.heading, received.age, motors.winding)
        gyro, place = self._chance.gyro_error(gyro_bias), m.place.copy()
        m.tilt[:], m.facing[0], m.facing[1] = 0.0, np.cos(m.heading), np.sin(m.heading)
        np.multiply(motors.constant.T, self._gear.T, out=self._robots.torque_constant)
        if self._frame is None:
            self._pass(gyro, push.T)
        else:
            self._pass_compiled(self._frame, gyro, push.T)
        return self._check_failed(place)

    def _pass(self, gyro: Array, push: Array) -> None:
        """Let a frame pass by numpy."""
        motors, battery, firmware, r, m = self._motors, self._battery, self._firmware, self._robots, self._motion
        rims = self._traction.arrays().rims
        for k in range(self.cycles):
            duty = firmware.duties(m.seen_rate + gyro, m.seen_angle.T)
            if (held := self._holds) is not None:
                motors.hold(duty, held, m.speed.T, battery.voltage[:, None])
            self._speeds[k], self._supplies[k] = m.speed.T, battery.voltage
            self._voltages[k], self.currents[k] = motors.drive(duty * battery.voltage[:, None], m.speed.T)
            if k % EVERY == 0:
                cycle.drag(r, m, self._traction, push, self._bodies.downhill)
            cycle.move(r, m, rims.rim_friction, rims.softness, self.currents[k].T)
            battery.load(self._voltages[k], self.currents[k])
        motors.warm(self.currents, self._speeds)
        battery.discharge(PERIOD_S)

    def _pass_compiled(self, frame: Callable[..., None], gyro: Array, push: Array) -> None:
        """Let a frame pass by a compiled loop."""
        firmware = self._firmware
        onboard = self._onboard if self._faults is None else self._arrays()
        held = self._nothing if (holds := self._holds) is None else np.ascontiguousarray(holds.T)
        forces = gyro, np.ascontiguousarray(push), self._bodies.downhill, held
        robot = self._robots, self._motion, self._scratch
        frame(firmware.cycle, PERIOD_S, *robot, *onboard, *forces, *self._recorded, self._supplies)
        firmware.cycle += self.cycles

    def _arrays(self) -> tuple[NamedTuple, ...]:
        """What is on the robots, for a compiled loop; only faults put other arrays in the place of these."""
        motors, battery = self._motors, self._battery
        heat, charge = motors.heat_arrays(), battery.charge_arrays()
        return self._firmware.arrays(), motors.arrays(), heat, battery.arrays(), charge, self._traction.arrays()

    def hold(self, current: Array | None) -> None:
        """See `MujocoPlant.hold`."""
        self._held = None if current is None or np.isnan(current).all() else np.array(current, float)

    @property
    def _holds(self) -> Array | None:
        return self._held if self._faults is None else self._faults.held(self._held)

    @property
    def centre(self) -> Array:
        """Of mass of each robot, from the middle of its wheels' contacts, (n, 3) m."""
        return self._bodies.whole.centre

    def carry(self, loads: Iterable[tuple[int, float, float]]) -> None:
        """Carry these loads and no others; see `omni_mj.plants.payload.Carriers`. The robots' middles stay."""
        before, dry = self._robots.middle, self._robots.dry
        self._bodies.carry(loads)
        robots = wheels.robots(self._settings, self._kinematics, self._bodies, self.drawn)
        self._become(robots._replace(dry=dry))
        m, (x, y) = self._motion, before - self._robots.middle
        m.place[:] += turned(m.facing, np.stack([x, y]))
        m.twist[0] -= m.twist[2] * y
        m.twist[1] += m.twist[2] * x

    def lean(self, along: Array) -> None:
        """Stand on carpets that lean so that gravity has the parts `along` (n, 2) of itself along them."""
        self._bodies.lean(along)
        self._become(self._robots._replace(weight=np.ascontiguousarray(self._bodies.weight.T)))

    def block(self, stuck: np.ndarray) -> None:
        """Have these wheels stuck, (n, W), and no others."""
        self._robots = self._robots._replace(dry=np.where(stuck.T, STUCK_NM, self._dry))

    def put(self, robot: int, moved: tuple[float, float, float]) -> None:
        """Put a robot as far from where it is, m, m and rad in the world, at rest."""
        m, (x, y, turn), middle = self._motion, moved, self._robots.middle[:, robot]
        then, now = (np.array([np.cos(h), np.sin(h)]) for h in (m.heading[robot], m.heading[robot] + turn))
        m.place[:, robot] += turned(then, middle) - turned(now, middle) + np.array([x, y])
        m.heading[robot] += turn
        for values in (m.twist, m.speed, m.torque, m.rims, m.seen_rate):
            values[..., robot] = 0.0

    def telemetry(self) -> Telemetry:
        """See `Plant`."""
        m, recorded = self._motion, (self._voltages, self.currents, self._supplies[..., None])
        slip = np.abs(m.speed.T - m.rims.T) * self._radius
        return Telemetry.of_wheels(m.angle.T, m.speed.T, slip, recorded, self._motors, self._battery)

    def _check_failed(self, place: Array) -> dict[int, str]:
        """Find who has failed, and put them to rest where they were.

        Over its wheels a robot stands as long as the point is between them that balances weight and forces: within the
        frame it may leave them, on the mean it may not.
        """
        m, r = self._motion, self._robots
        (x, y), (along, across), weight = self._polygon
        outside = along * (m.tilt[1] + y * weight) > across * (m.tilt[0] + x * weight)
        whole = np.isfinite(m.place[0] + m.place[1] + m.heading)
        if not np.count_nonzero(outside) and np.count_nonzero(whole & ~self._failed) == len(whole):
            return {}
        topples, broken = outside.any(0), ~whole
        causes = {
            int(row): "would topple over, which the plant planar does not follow" for row in np.flatnonzero(topples)
        }
        causes |= {int(row): "became unstable: its pose is not a number" for row in np.flatnonzero(broken)}
        causes = {row: cause for row, cause in causes.items() if not self._failed[row]}
        self._failed[list(causes)] = True
        off = self._failed
        m.place[:, off] = place[:, off]
        for values in (m.twist, m.speed, m.torque, m.rims, m.seen_rate):
            values[..., off] = 0.0
        m.load[:, off] = r.weight[:, off]
        return causes

    @cached_property
    def _polygon(self) -> tuple[Array, Array, Array]:
        """Where wheels touch, one after the other round the robot, from each to the next, and a frame's weights."""
        corners = self._robots.contacts[:, np.argsort(np.angle(self._robots.outward))]
        return corners, np.roll(corners, -1, axis=1) - corners, self._robots.weight.sum(0) * self.cycles

    def _become(self, robots: Robots) -> None:
        """Be these from now on."""
        self._robots = robots
        vars(self).pop("_polygon", None)


def turned(facing: Array, vectors: Array) -> Array:
    """Vectors (2, n) along the world's axes, of robots whose headings' cosines and sines are `facing` (2, n)."""
    (c, s), (x, y) = facing, vectors
    return np.array([c * x - s * y, s * x + c * y])


def _check(rows: Sequence[Row]) -> None:
    """Refuse what this plant cannot do."""
    for number, row in enumerate(rows):
        settings = row.settings
        if row.place:
            raise OmniError(
                "the plant planar has one robot in a world, since nothing collides in it; take the plant mujoco"
            )
        if settings.model.file:
            raise OmniError("the plant planar knows no models of a user's own (model.file); take the plant mujoco")
        if settings.wheels.creep == "off":
            raise OmniError("the plant planar needs wheels.creep = on; without it, take the plant mujoco")
        if settings.wheels.kinematics != rows[0].settings.wheels.kinematics:
            raise OmniError(f"rows 0 and {number} differ in wheels: one batch has one geometry")
