"""The physical plant: robots of models/ in worlds of one or several, stepped on all cores, driven by their firmware."""

import os
from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.config.rows import Row
from omni_mj.mjcf import world_builder
from omni_mj.network.radio import ReceivedCommand
from omni_mj.plants import Telemetry, world_batch
from omni_mj.plants.domain_randomization import Drawn
from omni_mj.plants.mjdata_views import Bound
from omni_mj.plants.wheeled_plant import WheeledPlant, by_wheel
from omni_mj.robot.array_namespace import rotate, stack_records
from omni_mj.robot.carpet import (
    DRAG_CYCLES,
    CarpetParameters,
    Drag,
    Motion,
    carpet_parameters,
    compute_drag,
    limit_torque,
)
from omni_mj.robot.firmware import CYCLES, set_heading
from omni_mj.robot.onboard import (
    CycleRecord,
    OnboardParameters,
    begin_frame,
    end_frame,
    hear,
    run_cycle,
)

# Robots from which several threads gain more in a step than they lose by meeting at its end
THREADED = 16
# Sine squared of half the tilt: x^2 + y^2 of the quaternion
TOPPLED = np.sin(np.deg2rad(45) / 2) ** 2
UNSTABLE = [  # MuJoCo resets an unstable simulation silently after one of these
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
]


class MujocoParameters(NamedTuple):
    """Parameters of n robots."""

    onboard: OnboardParameters
    carpet: CarpetParameters


class MujocoPlant(WheeledPlant):
    """Robots with roller wheels on carpet; those of one world collide with each other and with its walls.

    Args:
        rows: Of all robots, those of one world one after the other by their places; every world has
            as many. What their models are made of (`RobotShape`) and the physics must be the same for
            all.
        start: Poses at the start, (n, 3).
        threads: Of the physics. Results do not depend on it. [one below 16 robots, else as many as
            cores]
        hulls: Whether robots meet each other and walls, wherever they start. [if a world has
            several, which may not start in each other]

    Raises:
        OmniError: Rows that one batch cannot hold (see `batches`), a robot that starts in another
            or in a wall, or a robot's file that lacks a part (see `build.world`).
    """

    cycles = CYCLES  # of the wheel loops in a frame

    def __init__(
        self,
        rows: Sequence[Row],
        start: Array,
        threads: int | None = None,
        hulls: bool | None = None,
    ) -> None:
        settings, places = [row.settings for row in rows], max(row.slot for row in rows) + 1
        world_batch.check(rows)
        n, worlds = len(rows), len(rows) // places
        self._places, self.substeps = places, settings[0].physics.substeps
        self._world = world = world_builder.build_world(settings[0], places, with_hulls=hulls)
        if threads is None:
            threads = 1 if n < THREADED else os.cpu_count() or 1
        self._batch = world_batch.made(world, worlds, min(threads, worlds))
        first, last = int(UNSTABLE[0]), int(UNSTABLE[-1])
        self._warnings = np.asarray(self._batch.warning)[
            :, first : last + 1, 1
        ]  # (worlds, 3), live
        drawn = Drawn.of(rows)
        self._at = Bound(self._batch, world)
        self._at.write_robots(settings, drawn)
        self._start_poses = np.array(start, float)
        self._heading = self._start_poses[:, 2].copy()
        super().__init__(rows, world.kinematics, drawn, self._heading)

        robot = world.robots[0]
        inertia = world.model.dof_invweight0[robot.slip_dofs][:, None]
        carpet = carpet_parameters(
            settings, world.kinematics, by_wheel(drawn.friction), by_wheel(drawn.wear)
        )
        carpet = carpet._replace(creep=carpet.creep / (world.model.opt.timestep * inertia))
        wheels = settings[0].wheels
        self._pitch = 2 * np.pi / wheels.rollers if wheels.model == "two-rollers" else None
        self._failed = np.zeros(n, bool)
        self._living: np.ndarray | None = None  # worlds that are stepped; None for all
        self._stand(np.arange(worlds))
        if places > 1 and hulls is None:
            world_batch.check_start(rows, world.model, self._batch.bind("qpos"))
        p, s = self._onboard
        self.parameters = MujocoParameters(p, carpet)
        count = np.floor(self._sensed[1] * p.loops.counts_per_rad)
        self.onboard = s._replace(loops=s.loops._replace(last_count=count))
        self._drag: Drag
        self._cycle, self._records = 0, list[CycleRecord]()
        self._nothing: tuple[Array, np.ndarray] = np.full(n, np.nan), np.zeros(n, int)
        self._heard: tuple[Array, np.ndarray] = self._nothing
        self._start_faults(self._at)

    def pose(self) -> Array:
        """See `Plant`."""
        poses = self._at.pose.get()[:3].T
        poses[:, 2] = self._heading
        return poses

    def twist(self) -> Array:
        """See `Plant`."""
        return self._at.velocity.get()[[0, 1, 5]].T

    def advance(self, received: ReceivedCommand) -> dict[int, str]:
        """See `Plant`."""
        return self.go(self.cycles, received)

    def go(self, count: int, received: ReceivedCommand | None) -> dict[int, str]:
        """Go through some cycles of the wheel loops, no more than are left of the frame.

        Args:
            count: How many.
            received: What robots hold from now on, if anything arrived; headings are compared in
                the next frame.

        Returns:
            As `advance` at the end of a frame.
        """
        if received is not None:
            self._accept(received)
        if self._cycle == 0:
            self._begin()
        for _ in range(count):
            self._before_step()
            for substep in range(self.substeps):
                self._batch.step(self._living)
                self._after_step(substep == 0, substep == self.substeps - 1)
        self._cycle = (self._cycle + count) % self.cycles
        if self._cycle:
            return {}
        self._record = stack_records(self._records)
        self.onboard = end_frame(self.parameters.onboard, self.onboard, self._record)
        self._records.clear()
        self._heading += wrap_angle(self.quaternion_heading() - self._heading)
        toppled = (self._toppled() & ~self._failed).any()
        return self._check() if toppled or np.count_nonzero(self._warnings) else {}

    def _before_step(self) -> None:
        """Turn what sensors show into voltages, forces on the chassis, and limits of the slip hinges."""
        at, carpet, is_due = self._at, self.parameters.carpet, self.onboard.cycle % DRAG_CYCLES == 0
        gyro, angle = self._sensed
        speed, load = at.wheel_speed.get(), at.load.get()
        self.onboard, record = run_cycle(self.parameters.onboard, self.onboard, gyro, angle, speed)
        self._records.append(record)
        if is_due:
            motion = self._motion()
            self._drag = compute_drag(carpet, motion, load, angle)
            at.wrench.set(self._wrench(motion))
        motors = self.onboard.motors
        # MuJoCo's dcmotor knows a constant R in place of R + X |w|.
        at.voltage.set(motors.back_emf * speed + record.current * motors.resistance)
        self._limit_slips(load)

    def _after_step(self, is_first: bool, is_last: bool) -> None:
        """See to what follows a physics step, the first or last of a cycle."""
        if (
            is_first
        ):  # what MuJoCo sensed at its start: a cycle ago, however many steps there are in it
            self._sense()
        if self._pitch is not None:
            self._at.hand_over(self._pitch)
        if not is_last:
            self._limit_slips(self._at.load.get())

    def telemetry(self) -> Telemetry:
        """See `Plant`."""
        at = self._at
        slip = abs(at.slip_speed.get()) * self.parameters.carpet.radius
        return self._telemetry(self.onboard, at.wheel_angle.get(), at.wheel_speed.get(), slip)

    def quaternion_heading(self) -> Array:
        """Headings in (-pi, pi], however robots are tilted, (n,) rad."""
        w, x, y, z = self._at.pose.get()[3:]
        return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

    def know_heading(self, robot: int, heading: float) -> None:
        """Have a robot, which somebody has put down, know its heading (rad) and forget what was before."""
        chosen, headings = np.arange(len(self._rows)) == robot, np.full(len(self._rows), heading)
        self.onboard = self.onboard._replace(
            loops=set_heading(self.onboard.loops, chosen, headings)
        )

    def _accept(self, received: ReceivedCommand) -> None:
        """Take over commands, and keep vision's headings until the next frame begins."""
        self.onboard = hear(self.parameters.onboard, self.onboard, self._command(received))
        (seen, age), missing = self._heard, np.isnan(received.heading)
        self._heard = (
            np.where(missing, seen, received.heading),
            np.where(missing, age, received.age),
        )

    def _begin(self) -> None:
        """Begin a frame: what changes from frame to frame."""
        inputs = self._inputs(*self._heard, self._failed)  # which may change parameters
        p = self.parameters.onboard
        self.onboard = begin_frame(p, self.onboard, inputs, self._sensed[1])
        motors = self.onboard.motors
        self._at.resistance.set(motors.resistance)
        self._at.constant.set(motors.back_emf / p.motors.gear)
        self._heard = self._nothing

    def _motion(self) -> Motion:
        """Return the motion of robots that stand upright."""
        x, y, _, w, _, _, z = self._at.pose.get()
        velocity_x, velocity_y, _, _, _, turn_rate = self._at.velocity.get()
        cosine, sine = w * w - z * z, 2 * w * z
        ahead, aside = rotate(velocity_x, velocity_y, cosine, -sine)
        return Motion(x, y, cosine, sine, ahead, aside, turn_rate)

    def _wrench(self, motion: Motion) -> Array:
        """Return the wrench of drag and pushes on the chassis, world frame, (6, n) N and N m."""
        drag, inputs = self._drag, self.onboard.inputs
        x, y = rotate(drag.ahead, drag.aside, motion.cosine, motion.sine)
        centre_x, centre_y, height = self._at.centre
        moment = drag.moment - centre_x * drag.aside + centre_y * drag.ahead
        return np.stack(
            [x + inputs.push_x, y + inputs.push_y, 0 * moment, height * y, -height * x, moment]
        )

    def _limit_slips(self, load: Array) -> None:
        """Write limits and impedances of slip hinges under a load (W, n) in N; see `omni_mj.robot.carpet`."""
        limit, pressed = limit_torque(self._drag.rim_friction, load)
        self._at.slip_limit.set(limit)
        self._at.slip_impedance.set(pressed / (pressed + self._drag.softness))

    def _sense(self) -> None:
        self._sensed = self._at.gyro.get()[0], self._at.encoders.get()

    def _toppled(self) -> np.ndarray:
        _, x, y, _ = self._at.pose.get()[3:]
        return np.asarray(x * x + y * y > TOPPLED)

    def _stand(self, worlds: np.ndarray) -> None:
        """Put the robots of some worlds where they start, at rest on their rollers; their sensors say so."""
        places = self._places
        rows = (worlds[:, None] * places + np.arange(places)).ravel()
        standing = self._world.rest_qpos[np.array([robot.qpos for robot in self._world.robots])]
        positions, speeds = self._at.qpos.get(), self._at.qvel.get()
        x, y, heading = self._start_poses[rows].T
        positions[:, rows], speeds[:, rows] = standing[rows % places].T, 0.0
        positions[:2, rows] = x, y
        positions[3:7, rows] = np.cos(heading / 2), 0 * x, 0 * x, np.sin(heading / 2)
        self._at.qpos.set(positions)
        self._at.qvel.set(speeds)
        self._heading[rows] = heading
        self._batch.forward(worlds)
        self._sense()

    def _check(self) -> dict[int, str]:
        """Find what has failed, and stop it."""
        causes: dict[int, str] = {}
        for warning, counts in zip(UNSTABLE, self._warnings.T, strict=True):
            broken = np.repeat(counts > 0, self._places) & ~self._failed
            causes = (
                dict.fromkeys(
                    np.flatnonzero(broken).tolist(), f"became unstable (MuJoCo: {warning.name})"
                )
                | causes
            )
        unstable = list(causes)
        toppled = np.flatnonzero(self._toppled() & ~self._failed)
        causes |= {row: "toppled over" for row in toppled.tolist() if row not in causes}
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
