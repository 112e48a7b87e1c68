"""The planar plant: robots in the plane, on wheels that creep and slide, driven by their firmware (docs/planar.md)."""

from collections.abc import Callable, Iterable, Sequence

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
from omni_mj.plants.planar.arrays import Motion, Plane, Robots, Scratch
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
        start = np.array(start, float)
        heading = np.exp(1j * start[:, 2])
        self._robots = wheels.robots(settings, geometry, bodies, self.drawn)
        self._dry = self._robots.dry
        self._motion = Motion(
            place=start[:, 0] + 1j * start[:, 1] - self._robots.middle * heading,
            heading=start[:, 2].copy(),
            velocity=np.zeros(n, complex),
            rate=np.zeros(n),
            **{name: np.zeros((n, count)) for name in ("angle", "speed", "torque", "slip", "raised", "seen_angle")},
            load=bodies.weight.copy(),
            seen_rate=np.zeros(n),
            **{name: np.zeros(n, complex) for name in ("ground", "push", "force", "tilt")},
            moment=np.zeros(n),
        )
        self._failed = np.zeros(n, bool)

        self._chance = Chance(rows)
        limit = column([s.firmware for s in settings], "current_limit_a")
        self._motors = Motors([s.motor for s in settings], count, PERIOD_S, limit, self.drawn.strength)
        self._gear = column([s.motor for s in settings], "gear")
        self._battery = Battery([s.battery for s in settings])
        self._firmware = Firmware(settings, geometry, self._motion.heading, build.CYCLE_S, PERIOD_S)
        # For an inertia of 1, see `laws.soft`.
        self._traction = Traction(
            settings, geometry, bodies.whole.centre, np.ones(1), build.CYCLE_S, self.drawn.friction, self.drawn.wear
        )
        self._faults: Faults | None = None
        if any(row.faults for row in rows):
            onboard = self._firmware, self._motors, self._battery, self._traction
            self._faults = Faults(rows, self, onboard, self._motion.seen_angle)
        self._speeds, self._voltages, self.currents = np.zeros((3, self.cycles, n, count))
        self._supplies = np.zeros((self.cycles, n, 1))  # the battery's voltage of each step
        self._held: Array | None = None
        self._frame: Callable[..., None] | None = None
        if settings[0].physics.kernel == "numba":
            self._frame = compiled(by_robot.frame)
            self._scratch, self._nothing = Scratch(*np.zeros((5, n, count))), np.full((n, count), np.nan)

    def pose(self) -> Array:
        """See `Plant`."""
        m = self._motion
        place = m.place + self._robots.middle * np.exp(1j * m.heading)
        return np.stack([place.real, place.imag, m.heading], axis=1)

    def twist(self) -> Array:
        """See `Plant`."""
        m = self._motion
        velocity = m.velocity + 1j * m.rate * self._robots.middle * np.exp(1j * m.heading)
        return np.stack([velocity.real, velocity.imag, m.rate], axis=1)

    def advance(self, received: Received) -> dict[int, str]:
        """See `Plant`."""
        motors, battery, firmware, m = self._motors, self._battery, self._firmware, self._motion
        firmware.obey(received)
        gyro_bias, push = self._chance.gyro_bias, self._chance.push()
        if self._faults is not None:
            self._faults.begin()
            push, gyro_bias = push + self._faults.push, gyro_bias + self._faults.gyro
        firmware.correct(received.heading, received.age, motors.winding)
        gyro = self._chance.gyro_error(gyro_bias)
        pushed = push[:, 0] + 1j * push[:, 1]
        m.tilt[:], place = 0.0, m.place.copy()
        robots = self._robots._replace(torque_constant=motors.constant * self._gear)
        if self._frame is not None:
            self._pass_compiled(self._frame, robots, gyro, pushed)
        else:
            self._pass(robots, gyro, pushed)
        motors.warm(self.currents, self._speeds)
        battery.discharge(PERIOD_S)
        return self._check_failed(place)

    def _pass(self, robots: Robots, gyro: Array, push: Plane) -> None:
        """Let a frame pass by numpy."""
        motors, battery, firmware, m = self._motors, self._battery, self._firmware, self._motion
        for k in range(self.cycles):
            duty = firmware.duties(m.seen_rate + gyro, m.seen_angle)
            if (held := self._holds) is not None:
                motors.hold(duty, held, m.speed, battery.voltage[:, None])
            self._speeds[k], self._supplies[k, :, 0] = m.speed, battery.voltage
            self._voltages[k], self.currents[k], _ = motors.drive(duty * self._supplies[k], m.speed)
            if k % EVERY == 0:
                cycle.drag(robots, m, self._traction, push, self._bodies.downhill)
            cycle.move(robots, m, self._traction, robots.torque_constant * self.currents[k])
            battery.load(self._voltages[k], self.currents[k])

    def _pass_compiled(self, frame: Callable[..., None], robots: Robots, gyro: Array, push: Plane) -> None:
        """Let a frame pass by a compiled loop."""
        onboard = (part.arrays() for part in (self._firmware, self._motors, self._battery, self._traction))
        held = self._nothing if (holds := self._holds) is None else holds
        recorded = self._speeds, self._voltages, self.currents, self._supplies
        robot, forces = (robots, self._motion, self._scratch), (gyro, push, self._bodies.downhill)
        frame(self._firmware.cycle, *robot, *onboard, *forces, held, *recorded)
        self._firmware.cycle += self.cycles

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
        self._robots = robots._replace(dry=dry)
        m = self._motion
        moved = (before - self._robots.middle) * np.exp(1j * m.heading)
        m.place[:] += moved
        m.velocity[:] += 1j * m.rate * moved

    def lean(self, along: Array) -> None:
        """Stand on carpets that lean so that gravity has the parts `along` (n, 2) of itself along them."""
        self._bodies.lean(along)
        self._robots = self._robots._replace(weight=self._bodies.weight)

    def block(self, stuck: np.ndarray) -> None:
        """Have these wheels stuck, (n, W), and no others."""
        self._robots = self._robots._replace(dry=np.where(stuck, STUCK_NM, self._dry))

    def put(self, robot: int, moved: tuple[float, float, float]) -> None:
        """Put a robot as far from where it is, m, m and rad in the world, at rest."""
        m, (x, y, turn) = self._motion, moved
        before = self._robots.middle[robot] * np.exp(1j * m.heading[robot])
        m.place[robot] += complex(x, y) + before - before * np.exp(1j * turn)
        m.heading[robot] += turn
        for values in (m.velocity, m.rate, m.speed, m.torque, m.slip, m.seen_rate):
            values[robot] = 0.0

    def telemetry(self) -> Telemetry:
        """See `Plant`."""
        m, recorded = self._motion, (self._voltages, self.currents, self._supplies)
        slip = np.abs(m.slip) * self._radius
        return Telemetry.of_wheels(m.angle, m.speed, slip, recorded, self._motors, self._battery)

    def _check_failed(self, place: Array) -> dict[int, str]:
        """Find who has failed, and put them to rest where they were.

        Over its wheels a robot stands as long as the point is between them that balances weight and forces: within the
        frame it may leave them, on the mean it may not.
        """
        m, r = self._motion, self._robots
        corners = r.contacts[:, np.argsort(np.angle(r.outward))]
        edges, centre = np.roll(corners, -1, axis=1) - corners, -m.tilt / self.cycles / r.weight.sum(1)
        topples = ((edges.conj() * (centre[:, None] - corners)).imag < 0).any(1)
        broken = ~np.isfinite(m.place + m.heading)
        causes = {
            int(row): "would topple over, which the plant planar does not follow" for row in np.flatnonzero(topples)
        }
        causes |= {int(row): "became unstable: its pose is not a number" for row in np.flatnonzero(broken)}
        causes = {row: cause for row, cause in causes.items() if not self._failed[row]}
        self._failed[list(causes)] = True
        if self._failed.any():
            off = self._failed
            m.place[off] = place[off]
            for values in (m.velocity, m.rate, m.speed, m.torque, m.slip, m.seen_rate):
                values[off] = 0.0
            m.load[off] = r.weight[off]
        return causes


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
