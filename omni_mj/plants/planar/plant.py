"""The planar plant: robots in the plane, on wheels that creep and slide, driven by their firmware (docs/planar.md)."""

from collections.abc import Iterable, Sequence

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, Kinematics
from omni_mj.link.radio import Received
from omni_mj.onboard.battery import Battery
from omni_mj.onboard.firmware import Firmware
from omni_mj.onboard.motors import Motors
from omni_mj.onboard.traction import Traction
from omni_mj.plants import Telemetry
from omni_mj.plants.chance import Chance
from omni_mj.plants.faults import Faults
from omni_mj.plants.planar import cycle, wheels
from omni_mj.plants.planar.arrays import Frame, Motion
from omni_mj.plants.planar.bodies import Bodies
from omni_mj.plants.planar.laws import turned
from omni_mj.plants.planar.passing import AtOnce, Loops
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
        x, y, heading = np.array(start, float).T
        facing, shape = np.stack([np.cos(heading), np.sin(heading)]), (count, n)
        self._robots = wheels.robots(settings, geometry, bodies, self.drawn)
        self._dry = self._robots.dry.copy()
        self._motion = Motion(
            place=np.stack([x, y]) - turned(*facing, *self._robots.middle),
            before=np.zeros((2, n)),
            heading=heading.copy(),
            facing=facing,
            twist=np.zeros((3, n)),
            **{
                name: np.zeros(shape)
                for name in ("angle", "speed", "torque", "rims", "drift", "standing", "seen_angle")
            },
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
        self._battery = Battery([s.battery for s in settings])
        self._firmware = Firmware(settings, geometry, self._motion.heading, build.CYCLE_S, PERIOD_S)
        inverse = np.full(1, 1 / build.CYCLE_S)  # with which the traction's softness is that of `laws.soft`
        self._traction = Traction(
            settings, geometry, bodies.whole.centre, inverse, build.CYCLE_S, self.drawn.friction, self.drawn.wear
        )
        self._frame = Frame.of(n, count, self.cycles)
        self._frame.downhill[:] = bodies.downhill
        self._speeds, self._voltages, self.currents = self._frame.recorded.swapaxes(2, 3)
        onboard = self._firmware, self._motors, self._battery, self._traction
        self._faults: Faults | None = None
        if any(row.faults for row in rows):
            self._faults = Faults(rows, self, onboard, self._motion.seen_angle.T)
        self._held: Array | None = None
        passes = Loops if settings[0].physics.kernel == "numba" else AtOnce
        self._passes = passes(onboard, self._robots, self._motion, self._frame)

    def pose(self) -> Array:
        """See `Plant`."""
        return self._passes.pose()

    def twist(self) -> Array:
        """See `Plant`."""
        m, (x, y) = self._motion, self._robots.middle
        ahead, aside, rate = m.twist
        return np.stack([*turned(m.facing[0], m.facing[1], ahead - rate * y, aside + rate * x), rate], axis=1)

    def advance(self, received: Received) -> dict[int, str]:
        """See `Plant`."""
        passes, m = self._passes, self._motion
        passes.obey(received)
        gyro_bias, push = self._chance.gyro_bias, self._chance.push()
        if self._faults is not None:
            self._faults.begin()
            push, gyro_bias = push + self._faults.push, gyro_bias + self._faults.gyro
            passes.look()
        self._frame.gyro[:], self._frame.push[:] = self._chance.gyro_error(gyro_bias), push.T
        np.cos(m.heading, out=m.facing[0])
        np.sin(m.heading, out=m.facing[1])
        stand = passes.go(received, self._holds)
        return {} if stand and not np.count_nonzero(self._failed) else self._check_failed()

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
        before = self._robots.middle.copy()
        self._bodies.carry(loads)
        robots = wheels.robots(self._settings, self._kinematics, self._bodies, self.drawn)
        for mine, new in zip(self._robots, robots._replace(dry=self._robots.dry), strict=True):
            mine[:] = new
        self._frame.downhill[:] = self._bodies.downhill
        m, (x, y) = self._motion, before - self._robots.middle
        m.place[:] += turned(m.facing[0], m.facing[1], x, y)
        m.twist[0] -= m.twist[2] * y
        m.twist[1] += m.twist[2] * x

    def lean(self, along: Array) -> None:
        """Stand on carpets that lean so that gravity has the parts `along` (n, 2) of itself along them."""
        self._bodies.lean(along)
        self._robots.weight[:], self._frame.downhill[:] = self._bodies.weight.T, self._bodies.downhill

    def block(self, stuck: np.ndarray) -> None:
        """Have these wheels stuck, (n, W), and no others."""
        self._robots.dry[:] = np.where(stuck.T, STUCK_NM, self._dry)

    def put(self, robot: int, moved: tuple[float, float, float]) -> None:
        """Put a robot as far from where it is, m, m and rad in the world, at rest."""
        m, (x, y, turn), middle = self._motion, moved, self._robots.middle[:, robot]
        then, now = (np.array([np.cos(h), np.sin(h)]) for h in (m.heading[robot], m.heading[robot] + turn))
        m.place[:, robot] += np.subtract(turned(*then, *middle), turned(*now, *middle)) + np.array([x, y])
        m.heading[robot] += turn
        for values in (m.twist, m.speed, m.torque, m.rims, m.seen_rate):
            values[..., robot] = 0.0

    def telemetry(self) -> Telemetry:
        """See `Plant`."""
        return self._passes.telemetry()

    def _check_failed(self) -> dict[int, str]:
        """Find who has failed, and put them to rest where they were when the frame began."""
        m, off = self._motion, self._failed
        topples, broken = cycle.falls(self._robots, m, self.cycles), ~np.isfinite(cycle.where(m))
        causes = {
            int(row): "would topple over, which the plant planar does not follow" for row in np.flatnonzero(topples)
        }
        causes |= {int(row): "became unstable: its pose is not a number" for row in np.flatnonzero(broken)}
        causes = {row: cause for row, cause in causes.items() if not off[row]}
        off[list(causes)] = True
        m.place[:, off] = m.before[:, off]
        for values in (m.twist, m.speed, m.torque, m.rims, m.seen_rate):
            values[..., off] = 0.0
        m.load[:, off] = self._robots.weight[:, off]
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
