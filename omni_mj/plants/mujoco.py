"""The physical plant: robots of models/ in worlds of one or several, stepped on all cores, driven by their firmware."""

import os
from collections.abc import Sequence

import numpy as np
from mujoco.batch import Batch

from omni_control.kinematics import Array, Kinematics
from omni_mj.link.radio import Received
from omni_mj.onboard import kernel, laws
from omni_mj.onboard.battery import Battery
from omni_mj.onboard.firmware import Firmware
from omni_mj.onboard.motors import Motors
from omni_mj.plants import Telemetry, batches, friction
from omni_mj.plants.alone import Alone
from omni_mj.plants.at_once import AtOnce
from omni_mj.plants.between import Between
from omni_mj.plants.bodies import MujocoBodies
from omni_mj.plants.bound import Bound
from omni_mj.plants.chance import Chance
from omni_mj.plants.cycles import Cycles
from omni_mj.plants.faults import Faults
from omni_mj.plants.variation import Drawn
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.settings import PERIOD_S, column
from omni_mj.worlds import build
from omni_mj.worlds.build import World
from omni_mj.worlds.wheels import contact_slip

THREADED = 16  # robots from which several threads gain more in a step than they lose by meeting at its end


class MujocoPlant:
    """Robots with roller wheels on carpet; those of one world collide with each other and with its walls.

    Args:
        rows: of all robots, those of one world one after the other by their places; every world has as many. What
            their models are made of (`Shape`) and the physics must be the same for all.
        start: poses at the start, (n, 3).
        threads: of the physics. Results do not depend on it. [one below 16 robots, else as many as cores]
        within: a batch of one world, and where these robots are in it, perhaps with others: whoever steps it calls
            `begin` and `end` of all its plants, and `Cycles.go` in between. [a batch of their own; where they start is
            then checked]

    Attributes:
        geometry: of the wheels, as they are when new.
        drawn: what the robots' seeds drew for them.
        cycles: of the wheel loops in a frame.
        currents: of the motors in each cycle of the frame just past, (cycles, n, wheels) A.
        between: what happens between physics steps.

    Raises:
        OmniError: rows that one batch cannot hold (see `batches`), a robot that starts in another or in a wall, or a
            robot's file that lacks a part (see `build.world`).
    """

    def __init__(
        self,
        rows: Sequence[Row],
        start: Array,
        threads: int | None = None,
        within: tuple[Batch | Alone, World] | None = None,
    ) -> None:
        settings, places = [row.settings for row in rows], batches.places(rows) if within is None else len(rows)
        batches.check(rows)
        kernel.check(settings[0].physics.kernel)
        self.cycles, self._substeps = round(PERIOD_S / build.CYCLE_S), settings[0].physics.substeps
        n, worlds, checked = len(rows), len(rows) // places, within is None
        self._places = places
        self._kernel = settings[0].physics.kernel
        if within is None:
            world = build.world(settings[0], places)
            if threads is None:
                threads = 1 if n < THREADED else os.cpu_count() or 1
            within = self._made(world, worlds, min(threads, worlds)), world
        self._batch, self._world = within
        world = self._world
        self._warnings = batches.warnings(self._batch)
        self.geometry: Kinematics | None = world.kinematics
        self._creeps = world.robots[0].slip_dofs.size > 0
        self.drawn = Drawn.of(rows)
        self.drawn.write(self._batch, world)
        self._radius = world.kinematics.radius - self.drawn.wear
        self._traction = friction.set_up(self._batch, world, settings, self.drawn, self._creeps)
        self._at = Bound.of(self._batch, world)

        self._start = np.array(start, float)
        self._heading = self._start[:, 2].copy()
        self._failed = np.zeros(n, bool)
        self._living: np.ndarray | None = None  # worlds that are stepped; None for all
        self._angles, self._turn_rates = np.zeros((len(world.kinematics.azimuths), n)).T, np.zeros(n)
        self._stand(np.arange(worlds))
        if places > 1 and checked:
            batches.check_start(rows, world.model, self._batch.bind("qpos"))

        self._chance = Chance(rows)
        wheels = len(world.kinematics.azimuths)
        limit = column([s.firmware for s in settings], "current_limit_a")
        self._motors = Motors([s.motor for s in settings], wheels, PERIOD_S, limit, self.drawn.strength)
        self._battery = Battery([s.battery for s in settings])
        self._firmware = Firmware(settings, world.kinematics, self._heading, build.CYCLE_S, PERIOD_S)
        recorded = np.zeros((3, self.cycles, wheels, n))
        self._speeds, self._voltages, self.currents = recorded.swapaxes(2, 3)
        self._supplies = np.zeros((self.cycles, n, 1))  # the battery's voltage of each step
        self._held: Array | None = None
        onboard = self._firmware, self._motors, self._battery, self._traction
        self._faults: Faults | None = None
        if any(row.faults for row in rows):
            self._faults = Faults(rows, MujocoBodies(self._batch, world, n), onboard, self._angles)
        state = onboard, (self._angles.T, self._turn_rates), self._failed, self._heading, (recorded, self._supplies)
        self.between = AtOnce(self._at, *state) if self._kernel == "numpy" else Between(self._batch, world, *state)
        self._cycles, self._cycle = Cycles([self.between], self._substeps), 0
        self._nothing: tuple[Array, np.ndarray] = np.full(n, np.nan), np.zeros(n, int)
        self._heard: tuple[Array, np.ndarray] = self._nothing

    def _made(self, world: World, worlds: int, threads: int) -> Batch | Alone:
        """What steps so many worlds like one that was built."""
        return batches.made(world, worlds, threads, self._kernel)

    def pose(self) -> Array:
        """See `Plant`."""
        poses = self._at.position.get().copy()
        poses[:, 2] = self._heading
        return poses

    def twist(self) -> Array:
        """See `Plant`."""
        return self._at.velocity.get()[:, [0, 1, 5]]

    def advance(self, received: Received) -> dict[int, str]:
        """See `Plant`."""
        return self.go(self.cycles, received)

    def go(self, count: int, received: Received | None = None) -> dict[int, str]:
        """Move on by some cycles of the wheel loops, of which there are as many in a frame as `cycles` says.

        Args:
            count: how many, no more than are left of the frame.
            received: what robots hold from now on, if anything arrived; headings are compared in the next frame.

        Returns:
            As `advance`, at the end of a frame; nothing within one.
        """
        self.begin(received)
        self._cycles.go(self._batch, self._cycle, count, self._living)
        return self.end(count)

    def begin(self, received: Received | None = None) -> None:
        """Do what comes before cycles; see `go`."""
        if received is not None:
            self._obey(received)
        if self._cycle == 0:
            self._begin()

    def end(self, count: int) -> dict[int, str]:
        """Do what comes after so many; see `go`."""
        self._cycle = (self._cycle + count) % self.cycles
        if self._cycle:
            return {}
        toppled = self.between.end(PERIOD_S)
        return self._check() if toppled or np.count_nonzero(self._warnings) else {}

    def _obey(self, received: Received) -> None:
        """Take over commands, and keep vision's headings until the next frame begins."""
        self.between.obey(received)
        (seen, age), missing = self._heard, np.isnan(received.heading)
        if np.count_nonzero(missing):
            self._heard = np.where(missing, seen, received.heading), np.where(missing, age, received.age)
        else:
            self._heard = received.heading, received.age

    def _begin(self) -> None:
        """Begin a frame: what changes from frame to frame."""
        motors, gyro_bias, push = self._motors, self._chance.gyro_bias, self._chance.push()
        if self._faults is not None:
            self._faults.begin()
            push, gyro_bias = push + self._faults.push, gyro_bias + self._faults.gyro
            push[self._failed] = 0.0
            self.between.look()
            self.between.hold(self._holds)
        self._at.resistance.set(motors.resistance)
        self._at.constant.set(motors.constant)
        self.between.begin(self._heard, self._chance.gyro_error(gyro_bias), push)
        self._heard = self._nothing

    def hold(self, current: Array | None) -> None:
        """Have drivers hold currents from now on, whatever the firmware asks; with none, a robot rolls out.

        Args:
            current: (n, wheels) A, as far as the battery's voltage drives it; not a number where the firmware shall
                drive. None for all.
        """
        self._held = None if current is None or np.isnan(current).all() else np.array(current, float)
        self.between.hold(self._holds)

    @property
    def _holds(self) -> Array | None:
        return self._held if self._faults is None else self._faults.held(self._held)

    def telemetry(self) -> Telemetry:
        """See `Plant`."""
        at, recorded = self._at, (self._voltages, self.currents, self._supplies)
        return Telemetry.of_wheels(
            at.wheel_angle.get(), at.wheel_speed.get(), self._slip(), recorded, self._motors, self._battery
        )

    def _slip(self) -> Array:
        world = self._world
        if self._at.slips is not None:
            return np.abs(self._at.slips.speed.get()) * self._radius
        return contact_slip(world.wheels, world.kinematics, self._at.qpos.get(), self._at.qvel.get())

    def _sense(self) -> None:
        self._angles[:], self._turn_rates[:] = self._at.encoders.get(), self._at.gyro.get()[:, 0]

    def _stand(self, worlds: np.ndarray) -> None:
        """Put the robots of some worlds where they start, at rest on their rollers; their sensors say so."""
        places = self._places
        rows = (worlds[:, None] * places + np.arange(places)).ravel()
        standing = self._world.standing[np.array([robot.qpos for robot in self._world.robots])]
        positions, speeds = self._at.qpos.get().copy(), self._at.qvel.get().copy()
        positions[rows], speeds[rows] = standing[rows % places], 0.0
        x, y, heading = self._start[rows].T
        positions[rows, 0], positions[rows, 1] = x, y
        positions[rows, 3:7] = np.stack([np.cos(heading / 2), *np.zeros((2, len(rows))), np.sin(heading / 2)], axis=1)
        self._at.qpos.set(positions)
        self._at.qvel.set(speeds)
        self._heading[rows] = heading
        self._batch.forward(worlds)
        self._sense()

    def _check(self) -> dict[int, str]:
        """Find what has failed, and stop it."""
        causes = batches.unstable(self._batch, self._failed)
        unstable = list(causes)
        toppled = np.flatnonzero(laws.toppled(*self._at.quaternion.get().T[1:3]) & ~self._failed)
        causes |= {int(row): "toppled over" for row in toppled if int(row) not in causes}
        if causes:
            self._stop(list(causes), unstable)
        return causes

    def _stop(self, rows: list[int], unstable: list[int]) -> None:
        """Switch rows off. Worlds where none is left on are not stepped any more; unstable ones are put back first."""
        self._failed[rows], self._chance.force[rows] = True, 0.0
        if unstable:
            self._stand(np.unique(np.array(unstable) // self._places))
        over = self._failed.reshape(-1, self._places).all(1)
        self._batch.bind("qvel")[over] = 0.0
        self._living = np.flatnonzero(~over)
