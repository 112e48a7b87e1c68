"""The physical plant: robots of models/ in worlds of one or several, stepped on all cores, driven by their firmware."""

import os
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from mujoco.batch import Batch

from omni_control.kinematics import Array, wrap_angle
from omni_mj.link.radio import Received
from omni_mj.plants import Telemetry, batches
from omni_mj.plants.bodies import MujocoBodies
from omni_mj.plants.bound import Bound, write_friction
from omni_mj.plants.variation import Drawn
from omni_mj.plants.wheeled import WheeledPlant, by_wheel
from omni_mj.robot.array_namespace import stack_records
from omni_mj.robot.carpet import carpet_parameters
from omni_mj.robot.rims import (
    Drives,
    MujocoParameters,
    MujocoState,
    accept,
    drive_cycle,
    finish_frame,
    impedance,
    start_frame,
)
from omni_mj.robot.wheel_loops import CYCLES
from omni_mj.scenarios.rows import Row
from omni_mj.worlds import build
from omni_mj.worlds.build import World
from omni_mj.worlds.wheels import contact_slip

THREADED = 16  # robots from which several threads gain more in a step than they lose by meeting at its end
TOPPLED = np.sin(np.deg2rad(45) / 2) ** 2  # sine squared of half the tilt: x^2 + y^2 of the quaternion


class MujocoPlant(WheeledPlant):
    """Robots with roller wheels on carpet; those of one world collide with each other and with its walls.

    Args:
        rows: Of all robots, those of one world one after the other by their places; every world has as many. What
            their models are made of (`Shape`) and the physics must be the same for all.
        start: Poses at the start, (n, 3).
        threads: Of the physics. Results do not depend on it. [one below 16 robots, else as many as cores]
        within: A batch of one world, and where these robots are in it, perhaps with others: whoever steps it calls
            `begin` and `end` of all its plants, and `run_cycles` in between. [a batch of their own; where they start is
            then checked]

    Raises:
        OmniError: Rows that one batch cannot hold (see `batches`), a robot that starts in another or in a wall, or a
            robot's file that lacks a part (see `build.world`).
    """

    name, cycles = "mujoco", CYCLES

    def __init__(
        self,
        rows: Sequence[Row],
        start: Array,
        threads: int | None = None,
        within: tuple[Batch, World] | None = None,
    ) -> None:
        settings, places = [row.settings for row in rows], batches.places(rows) if within is None else len(rows)
        batches.check(rows)
        n, worlds, checked = len(rows), len(rows) // places, within is None
        self._places, self.substeps = places, settings[0].physics.substeps
        if within is None:
            world = build.world(settings[0], places)
            if threads is None:
                threads = 1 if n < THREADED else os.cpu_count() or 1
            within = batches.made(world, worlds, min(threads, worlds)), world
        self._batch, self._world = within
        world = self._world
        self._warnings = batches.warnings(self._batch)
        drawn = Drawn.of(rows)
        drawn.write(self._batch, world)
        write_friction(self._batch, world, settings)
        self._at = Bound(self._batch, world)
        self._start_poses = np.array(start, float)
        self._heading = self._start_poses[:, 2].copy()
        super().__init__(rows, world.kinematics, drawn, self._heading)

        robot = world.robots[0]
        inertia = world.model.dof_invweight0[robot.slip_dofs][:, None] if self._at.creeps else 1.0
        carpet = carpet_parameters(settings, world.kinematics, by_wheel(drawn.friction), by_wheel(drawn.wear))
        carpet = carpet._replace(creep=carpet.creep / (world.model.opt.timestep * inertia))
        centre = world.model.body_ipos[robot.chassis][:, None] + np.vstack([drawn.centre.T, np.zeros(n)])
        self._failed = np.zeros(n, bool)
        self._living: np.ndarray | None = None  # worlds that are stepped; None for all
        self._stand(np.arange(worlds))
        if places > 1 and checked:
            batches.check_start(rows, world.model, self._batch.bind("qpos"))
        self._bodies = MujocoBodies(self._batch, world, n)
        parameters = MujocoParameters(self._onboard[0], carpet, centre)
        self._start(parameters, MujocoState.at_rest(self._onboard, carpet, self._sensed))
        self._cycle, self._drives = 0, list[Drives]()
        self._nothing: tuple[Array, np.ndarray] = np.full(n, np.nan), np.zeros(n, int)
        self._heard: tuple[Array, np.ndarray] = self._nothing

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
            count: How many, no more than are left of the frame.
            received: What robots hold from now on, if anything arrived; headings are compared in the next frame.

        Returns:
            As `advance`, at the end of a frame; nothing within one.
        """
        self.begin(received)
        run_cycles([self], self._batch, count, self._living)
        return self.end(count)

    def begin(self, received: Received | None = None) -> None:
        """Do what comes before cycles; see `go`."""
        if received is not None:
            self._accept(received)
        if self._cycle == 0:
            self._begin()

    def end(self, count: int) -> dict[int, str]:
        """Do what comes after so many; see `go`."""
        self._cycle = (self._cycle + count) % self.cycles
        if self._cycle:
            return {}
        self._record = stack_records([drives.record for drives in self._drives])
        self._kernel.run(finish_frame, self._record)
        self._drives.clear()
        self._heading += wrap_angle(self.quaternion_heading() - self._heading)
        toppled = (self._toppled() & ~self._failed).any()
        return self._check() if toppled or np.count_nonzero(self._warnings) else {}

    def before_step(self) -> None:
        """Turn what sensors show into voltages, and loads of wheels into limits of the slip hinges."""
        at = self._at
        drives = self._kernel.run(drive_cycle, at.read(*self._sensed))
        self._drives.append(drives)
        at.write(drives)

    def after_step(self, is_first: bool, is_last: bool) -> None:
        """See to what follows a physics step, the first or last of a cycle."""
        if is_first:  # what MuJoCo sensed at its start: a cycle ago, however many steps there are in it
            self._sense()
        if self._at.handover is not None:
            self._at.handover()
        if not is_last and self._at.creeps:
            drives = self._drives[-1]
            self._at.limit_slips(*impedance(drives.rim_friction, drives.softness, self._at.load.get().T))

    def telemetry(self) -> Telemetry:
        """See `Plant`."""
        at = self._at
        state: Any = self._kernel.state
        return self._telemetry(state.onboard, at.wheel_angle.get().T, at.wheel_speed.get().T, self._slip())

    def quaternion_heading(self) -> Array:
        """Headings in (-pi, pi], however robots are tilted, (n,) rad."""
        w, x, y, z = self._at.quaternion.get().T
        return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

    # What faults change; see `omni_mj.plants.faults.Faulty`.

    def carry(self, loads: Iterable[tuple[int, float, float]]) -> None:
        """Carry these loads and no others."""
        before = self._bodies.centre
        self._bodies.carry(loads)
        shift = (self._bodies.centre - before).T
        self.parameters = self.parameters._replace(centre=self.parameters.centre + shift)

    def lean(self, along: Array) -> None:
        """Stand on carpets that lean so that gravity has the parts `along` (n, 2) of itself along them."""
        self._bodies.lean(along)

    def block(self, stuck: np.ndarray) -> None:
        """Have these wheels stuck, (W, n), and no others."""
        self._bodies.block(stuck.T)

    def put(self, robot: int, moved: tuple[float, float, float]) -> None:
        """Put a robot as far from where it is, m, m and rad in the world, at rest."""
        self._bodies.put(robot, moved)

    def _accept(self, received: Received) -> None:
        """Take over commands, and keep vision's headings until the next frame begins."""
        self._kernel.run(accept, self._command(received))
        (seen, age), missing = self._heard, np.isnan(received.heading)
        if np.count_nonzero(missing):
            self._heard = np.where(missing, seen, received.heading), np.where(missing, age, received.age)
        else:
            self._heard = received.heading, received.age

    def _begin(self) -> None:
        """Begin a frame: what changes from frame to frame."""
        inputs = self._inputs(*self._heard, self._failed)
        resistance, constant = self._kernel.run(start_frame, inputs, self._sensed[1])
        self._at.resistance.set(resistance.T)
        self._at.constant.set(constant.T)
        self._heard = self._nothing

    def _slip(self) -> Array:
        world = self._world
        if self._at.creeps:
            return abs(self._at.slip_speed.get()).T * self.parameters.carpet.radius
        return contact_slip(world.wheels, world.kinematics, self._at.qpos.get(), self._at.qvel.get()).T

    def _sense(self) -> None:
        self._sensed = self._at.gyro.get()[:, 0].copy(), by_wheel(self._at.encoders.get())

    def _toppled(self) -> np.ndarray:
        _, x, y, _ = self._at.quaternion.get().T
        return np.asarray(x * x + y * y > TOPPLED)

    def _stand(self, worlds: np.ndarray) -> None:
        """Put the robots of some worlds where they start, at rest on their rollers; their sensors say so."""
        places = self._places
        rows = (worlds[:, None] * places + np.arange(places)).ravel()
        standing = self._world.standing[np.array([robot.qpos for robot in self._world.robots])]
        positions, speeds = self._at.qpos.get().copy(), self._at.qvel.get().copy()
        positions[rows], speeds[rows] = standing[rows % places], 0.0
        x, y, heading = self._start_poses[rows].T
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
        toppled = np.flatnonzero(self._toppled() & ~self._failed)
        causes |= {int(row): "toppled over" for row in toppled if int(row) not in causes}
        if causes:
            self._stop(list(causes), unstable)
        return causes

    def _stop(self, rows: list[int], unstable: list[int]) -> None:
        """Switch rows off. Worlds where none is left on are not stepped any more; unstable ones are put back first."""
        self._failed[rows] = True
        if unstable:
            self._stand(np.unique(np.array(unstable) // self._places))
        over = self._failed.reshape(-1, self._places).all(1)
        self._batch.bind("qvel")[over] = 0.0
        self._living = np.flatnonzero(~over)


def run_cycles(plants: Sequence[MujocoPlant], batch: Batch, count: int, living: np.ndarray | None = None) -> None:
    """Go through cycles of the wheel loops, physics steps among them.

    Args:
        plants: Those of a batch, one after the other.
        batch: Of all their robots.
        count: Of the cycles.
        living: Worlds that are stepped; None for all.
    """
    substeps = plants[0].substeps
    for _ in range(count):
        for plant in plants:
            plant.before_step()
        for substep in range(substeps):
            batch.step(living)
            for plant in plants:
                plant.after_step(substep == 0, substep == substeps - 1)
