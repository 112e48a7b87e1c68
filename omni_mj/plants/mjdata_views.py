"""Robots in a batch of MuJoCo's: what a plant reads and writes, in every step and before the first."""

from collections.abc import Iterable, Sequence
from functools import cached_property

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.lib.stride_tricks import as_strided

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config.settings import Settings, gather
from omni_mj.mjcf.robot_geometry import point_mass_inertia
from omni_mj.mjcf.robot_indices import Ids
from omni_mj.mjcf.world_builder import World
from omni_mj.plants.domain_randomization import Drawn
from omni_mj.plants.fault_effects import STUCK_NM, Faulty
from omni_mj.robot.motors import Motor

_BODY = "body_mass", "body_subtreemass", "body_ipos", "body_inertia", "body_iquat"


class Entries:
    """Some entries of an array over worlds, seen as (k, n): k numbers of each of n robots.

    Args:
        array: Live, (worlds, ...).
        columns: Indices along its second axis for the robot at each place, (places, k), or (places,
            1).
        last: Index along its third axis, if it has one. [all]
    """

    def __init__(self, array: Array, columns: Ids, last: int | None = None) -> None:
        first, end = np.lib.array_utils.byte_bounds(array)
        size = (end - first) // array.itemsize
        offsets = as_strided(np.arange(size), array.shape, array.strides)
        chosen = offsets[:, columns] if last is None else offsets[:, columns, last]
        self._at: Ids = np.ascontiguousarray(chosen.reshape(-1, chosen.shape[-1]).T)
        # Indexing one flat axis takes a tenth of the time of indexing two or three, at every step
        # of the physics.
        self._flat = as_strided(array, (size,), (array.itemsize,))

    def get(self) -> Array:
        """Return a copy of the values, (k, n)."""
        return self._flat[self._at]

    def set(self, values: Array) -> None:
        """Write values (k, n)."""
        self._flat[self._at] = values


class Bound(Faulty):
    """Live numbers of n robots with W wheels, each of the shape (k, n).

    Args:
        batch: Of the robots' worlds.
        world: As built.

    Attributes:
        qpos, qvel: All positions and speeds of a robot.
        pose, velocity: Of the free joint: m and quaternion (7, n), m/s and rad/s (6, n).
        wheel_angle, wheel_speed: Of the hubs, (W, n) rad and rad/s.
        gyro, encoders: What these sensors show, (1, n) rad/s and (W, n) rad.
        voltage: Of the dcmotors, (W, n).
        resistance, constant: Of the dcmotors, (W, n).
        wrench: Force and torque on the chassis, world frame, (6, n).
        load: Of the wheels, (W, n) N.
        centre: Of mass of the chassis, from the middle of the wheels' contacts, (3, n) m.
        slip_angle, slip_speed, slip_limit, slip_impedance: Of the hinges of rims, (W, n) rad,
            rad/s, N m and 1.
        roller_speeds: Of a wheel's rollers at the bottom and next to it, (W, n) rad/s each.
    """

    def __init__(self, batch: Batch, world: World) -> None:
        self._batch, self._world, ids = batch, world, self._ids
        qpos, qvel, sensors = (batch.bind(name) for name in ("qpos", "qvel", "sensordata"))
        motors, slips, rollers = ids("motors"), ids("slip_dofs"), ids("roller_dofs")
        self._chassis = ids("chassis")[:, None]
        self.qpos, self.qvel = Entries(qpos, ids("qpos")), Entries(qvel, ids("dofs"))
        self.pose, self.velocity = (
            Entries(qpos, ids("qpos")[:, :7]),
            Entries(qvel, ids("dofs")[:, :6]),
        )
        self.wheel_angle, self.wheel_speed = (
            Entries(qpos, ids("wheel_qpos")),
            Entries(qvel, ids("wheel_dofs")),
        )
        self.gyro, self.encoders = (
            Entries(sensors, ids("gyro")[:, None]),
            Entries(sensors, ids("encoders")),
        )
        self.load = Entries(sensors, world.load_addresses)
        self.voltage = Entries(batch.bind("ctrl"), motors)
        self.resistance, self.constant = (
            self._entries("actuator_gainprm", motors, i) for i in range(2)
        )
        self.wrench = Entries(batch.bind("xfrc_applied"), self._chassis)
        self.slip_angle, self.slip_speed = Entries(qpos, ids("slip_qpos")), Entries(qvel, slips)
        self.slip_limit = self._entries("dof_frictionloss", slips)
        self.slip_impedance = self._entries("dof_solimp", slips, 0)
        self.roller_speeds = [Entries(qvel, rollers[:, :, i]) for i in range(2)]

    def _ids(self, name: str) -> Ids:
        """Return numbers of parts of the robots at each place, by their name in `Robot`."""
        return np.array([getattr(robot, name) for robot in self._world.robots])

    def _entries(self, field: str, columns: Ids, last: int | None = None) -> Entries:
        """Return entries of a field of each world's model."""
        return Entries(self._batch.expand(field), columns, last)

    def write_robots(self, settings: Sequence[Settings], drawn: Drawn) -> None:
        """Write what sets robots apart into their worlds' models: friction, wear, mass.

        Constants that MuJoCo derives from masses stay: these scale contacts and slip hinges, which
        shall be the same for all.
        """
        motors, hubs = [Motor.of(s.motor) for s in settings], self._ids("wheel_dofs")
        rollers = self._ids("roller_dofs").reshape(len(self._world.robots), -1)
        self._entries("dof_frictionloss", hubs).set(gather(settings, "hub_friction_nm"))
        self._entries("dof_damping", hubs).set(gather(motors, "wheel_viscous"))
        self._entries("dof_damping", rollers).set(gather(settings, "drive.roller_damping_nm_s"))
        chassis = self._world.robots[0].chassis
        self.centre = (
            self._world.model.body_ipos[chassis][:, None]
            + np.append(drawn.centre, 0 * drawn.mass, 1).T
        )
        if drawn.wear.any():
            self._wear_down(drawn.wear.T)
        if (drawn.mass != 1).any() or drawn.centre.any():
            self._weigh(drawn.mass.T, drawn.centre.T)

    def _wear_down(self, wear: Array) -> None:
        """Take rubber (W, n), m, from rollers, and set axles lower by as much."""
        model, first = self._world.model, self._world.robots[0]
        self._entries("body_pos", self._ids("wheels"), 2).set(
            model.body_pos[first.wheels, 2][:, None] - wear
        )
        geoms = model.body_geomadr[self._ids("rollers")].reshape(len(self._world.robots), -1)
        size, kinds = model.geom_size[geoms[0]], model.geom_type[geoms[0]]
        if (size[:, 0] != size[:, 1]).any() or (kinds != mujoco.mjtGeom.mjGEOM_ELLIPSOID).any():
            raise OmniError(
                "variation.wear_m needs a model with rollers that are ellipsoids about their z axes"
            )
        lost, radius = np.repeat(wear, first.rollers.shape[1], axis=0), size[:, :1]
        # A barrel's profile is curved as the wheel (see `shape`): its half length squared is the
        # product of the radii.
        shorter = np.sqrt((1 - lost / radius) * (1 - lost / self._world.kinematics.radius))
        for axis, value in enumerate((radius - lost, radius - lost, size[:, 2:] * shorter)):
            self._entries("geom_size", geoms, axis).set(value)

    def _weigh(self, factor: Array, shift: Array) -> None:
        """Change the chassis: its mass by a factor (1, n), its inertia in proportion, its centre by (2, n) m."""
        mass, subtree, centre, inertia = (self._entries(name, self._chassis) for name in _BODY[:4])
        more = mass.get() * (factor - 1)
        mass.set(mass.get() + more)
        subtree.set(subtree.get() + more)
        centre.set(centre.get() + np.concatenate([shift, 0 * factor]))
        inertia.set(inertia.get() * factor)

    def hand_over(self, pitch: float) -> None:
        """Turn back the rims of wheels of two rollers that are past a pitch (rad), or before the bottom one.

        To be called after every step and before anything else reads the state; see
        `omni_mj.mjcf.two_roller_wheels`.
        """
        slips = self.slip_angle.get()
        past = np.floor((self.wheel_angle.get() + slips) * (1 / pitch))
        if not past.any():
            return
        self.slip_angle.set(slips - past * pitch)
        bottom, following = (speeds.get() for speeds in self.roller_speeds)
        self.roller_speeds[0].set(np.where(past == 0, bottom, np.where(past == 1, following, 0.0)))
        self.roller_speeds[1].set(np.where(past == 0, following, np.where(past == -1, bottom, 0.0)))

    # What faults change starts from robots as they were when a fault first did.

    @cached_property
    def _empty(self) -> list[tuple[Entries, Array]]:
        """Fields of each chassis, and their values without loads."""
        fields = [self._entries(name, self._chassis) for name in _BODY]
        return [(field, field.get()) for field in fields]

    @cached_property
    def _hubs(self) -> tuple[Entries, Array]:
        """Dry friction of hubs, and its usual values, (W, n) N m."""
        hubs = self._entries("dof_frictionloss", self._ids("wheel_dofs"))
        return hubs, hubs.get()

    def carry(self, loads: Iterable[tuple[int, float, float]]) -> None:
        """See `Faulty`."""
        empty = [values for _, values in self._empty]
        mass, subtree, centre, inertia, axes = (values.copy() for values in empty)
        for row, load, height in loads:
            apart = np.array([*centre[:2, row], height or empty[2][2, row]]) - centre[:, row]
            # About the common centre of mass two bodies turn as their reduced mass does at their
            # distance.
            share = load / (mass[0, row] + load)
            more = mass[0, row] * share * point_mass_inertia(apart)
            mass[:, row] += load
            subtree[:, row] += load
            centre[:, row] += share * apart
            if more.any():
                inertia[:, row], axes[:, row] = _joined(inertia[:, row], axes[:, row], more)
        for (field, _), values in zip(
            self._empty, (mass, subtree, centre, inertia, axes), strict=True
        ):
            field.set(values)
        self.centre = centre

    def lean(self, along: Array) -> None:
        """Turn gravity in the world's axes, on every body, wheels and rollers too."""
        into = np.sqrt(np.maximum(1 - (along**2).sum(1), 0.0))
        g, places = -float(self._world.model.opt.gravity[2]), len(self._world.robots)
        self._batch.expand("opt.gravity")[:] = g * np.column_stack([along, -into])[::places]

    def block(self, stuck: np.ndarray) -> None:
        """Have hubs stuck."""
        hubs, usual = self._hubs
        hubs.set(np.where(stuck, STUCK_NM, usual))

    def put(self, robot: int, moved: tuple[float, float, float]) -> None:
        """Put a robot elsewhere, tilted and as high as it was."""
        pose, speeds = self.pose.get(), self.qvel.get()
        x, y, turn = moved
        pose[:2, robot] += x, y
        turned = np.zeros(4)
        mujoco.mju_mulQuat(
            turned, np.array([np.cos(turn / 2), 0, 0, np.sin(turn / 2)]), pose[3:, robot].copy()
        )
        pose[3:, robot], speeds[:, robot] = turned, 0.0
        self.pose.set(pose)
        self.qvel.set(speeds)


def _joined(inertia: Array, quaternion: Array, more: Array) -> tuple[Array, Array]:
    """Return principal moments (3,) and axes (4,) of a body with `more` inertia (3, 3), in its frame."""
    matrix, turned = np.zeros(9), np.zeros(4)
    mujoco.mju_quat2Mat(matrix, quaternion)
    axes = matrix.reshape(3, 3)
    moments, vectors = np.linalg.eigh(axes * inertia @ axes.T + more)
    vectors[:, 2] *= np.linalg.det(vectors)  # right-handed
    mujoco.mju_mat2Quat(turned, vectors.ravel())
    return moments, turned
