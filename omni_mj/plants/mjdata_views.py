"""Views of robots in a batch of MuJoCo worlds, through which a plant reads and writes values."""

from collections.abc import Iterable, Sequence
from functools import cached_property, partial
from typing import Any, Self

import mujoco
import numpy as np
from mujoco.batch import DATA_FIELDS, Batch
from numpy.lib.stride_tricks import as_strided

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config.faults import Payload
from omni_mj.config.settings import Settings, gather
from omni_mj.mjcf.robot_geometry import compute_point_mass_inertia
from omni_mj.mjcf.robot_parts import Ids
from omni_mj.mjcf.world_builder import World
from omni_mj.plants.fault_effects import BLOCKED_HUB_NM, ChangeableBodies
from omni_mj.plants.randomization import RobotVariation
from omni_mj.robot.array_ops import rotate
from omni_mj.robot.wheel_carpet_forces import ChassisMotion, Drag, compute_torque_limit

_MASS_FIELDS = "body_mass", "body_subtreemass", "body_ipos", "body_inertia", "body_iquat"


class CopyableBatch(Batch):  # type: ignore[misc]
    """Batch that can be copied and pickled, with its states, models and outputs."""

    def __getstate__(self) -> dict[str, Any]:
        return {
            "arguments": (self.model, self.nsim, self.nthread),
            "fields": {name: self.expand(name).copy() for name in self._expanded},
            "outputs": {name: self.bind(name).copy() for name in self._bound},
            "state": self.state.copy(),
            "warning": np.array(self.warning),
        }

    def __setstate__(self, saved: dict[str, Any]) -> None:
        super().__init__(*saved["arguments"])
        for name, values in saved["fields"].items():
            self.expand(name)[:] = values
        for name, values in saved["outputs"].items():
            output = self.bind(name)
            output.flags.writeable = True
            output[:] = values
            output.flags.writeable = False
        self.state[:] = saved["state"]
        np.asarray(self.warning)[:] = saved["warning"]


class EntryView:
    """View of some entries of a batch array as (k, n): k values for each of n robots.

    The robots are in the order of their worlds, then of their slots in a world.

    Args:
        batch: The batch.
        field: Name of the array in its states, outputs or models, (worlds, ...).
        columns: Indices along its second axis for the robot in each slot, (slots, k), or (slots, 1)
            if `component` is None and the array has three axes.
        component: Index along its third axis. Default: all components of the one column.
    """

    def __init__(
        self, batch: Batch, field: str, columns: Ids, component: int | None = None
    ) -> None:
        self._arguments = batch, field, columns, component
        array = batch.bind(field) if field in DATA_FIELDS else batch.expand(field)
        low, high = np.lib.array_utils.byte_bounds(array)
        size = (high - low) // array.itemsize
        offsets = as_strided(np.arange(size), array.shape, array.strides)
        entries = offsets[:, columns] if component is None else offsets[:, columns, component]
        self._indices: Ids = np.ascontiguousarray(entries.reshape(-1, entries.shape[-1]).T)
        # This runs at every step of the physics. Indexing one flat axis takes a tenth of the time
        # of indexing two or three.
        self._flat = as_strided(array, (size,), (array.itemsize,))

    def __reduce__(self) -> tuple[type[Self], tuple[Any, ...]]:
        """Let copies view the copy of the batch."""
        return type(self), self._arguments

    def get(self) -> Array:
        """Return a copy of the values, (k, n)."""
        return self._flat[self._indices]

    def set(self, values: Array) -> None:
        """Write values (k, n)."""
        self._flat[self._indices] = values


class RobotViews(ChangeableBodies):
    """Views of n robots with W wheels in a batch, each of shape (k, n).

    Args:
        batch: Batch of the robots' worlds.
        world: Model of each world.

    Attributes:
        qpos: Positions of all joints of a robot.
        qvel: Velocities of all joints of a robot.
        pose: Position and quaternion (w, x, y, z) of the free joint, (7, n) m and dimensionless.
        velocity: Velocity (world frame) and angular velocity (body frame) of the free joint, (6, n)
            m/s and rad/s.
        wheel_angle: Angles of the hubs, (W, n) rad.
        wheel_speed: Speeds of the hubs, (W, n) rad/s.
        gyro: Turn rate at the gyro sensors, (1, n) rad/s.
        encoders: Angles at the encoder sensors, (W, n) rad.
        voltage: Voltages of the dcmotors, (W, n) V.
        resistance: Resistances of the dcmotors, (W, n) ohm.
        torque_constant: Torque constants of the dcmotors, (W, n) N m/A.
        wrench: Force and torque on the chassis, world frame, (6, n) N and N m.
        load: Normal forces of the wheels, (W, n) N.
        center_of_mass: Center of mass of the chassis, body frame from the center of the wheels'
            contacts, (3, n) m. An array, not a view; `write_variation` sets it.
        slip_angle: Angles of the slip hinges, which turn rims on hubs, (W, n) rad.
        slip_speed: Speeds of the slip hinges, (W, n) rad/s.
        slip_limit: Dry friction of the slip hinges, (W, n) N m.
        slip_impedance: Impedances of the slip hinges, (W, n) 1.
        roller_speeds: Two views: speeds of each wheel's roller at the bottom, and of the one that
            follows it, (W, n) rad/s each.
    """

    def __init__(self, batch: Batch, world: World) -> None:
        self._batch = batch
        self._world = world
        self._view = view = partial(EntryView, batch)
        ids = self._ids
        self._chassis = ids("chassis")[:, None]
        self.qpos = view("qpos", ids("qpos"))
        self.qvel = view("qvel", ids("dofs"))
        self.pose = view("qpos", ids("qpos")[:, :7])
        self.velocity = view("qvel", ids("dofs")[:, :6])
        self.wheel_angle = view("qpos", ids("wheel_qpos"))
        self.wheel_speed = view("qvel", ids("wheel_dofs"))
        self.gyro = view("sensordata", ids("gyro")[:, None])
        self.encoders = view("sensordata", ids("encoders"))
        self.load = view("sensordata", world.load_addresses)
        self.voltage = view("ctrl", ids("motors"))
        self.resistance = view("actuator_gainprm", ids("motors"), 0)
        self.torque_constant = view("actuator_gainprm", ids("motors"), 1)
        self.wrench = view("xfrc_applied", self._chassis)
        self.slip_angle = view("qpos", ids("slip_qpos"))
        self.slip_speed = view("qvel", ids("slip_dofs"))
        self.slip_limit = view("dof_frictionloss", ids("slip_dofs"))
        self.slip_impedance = view("dof_solimp", ids("slip_dofs"), 0)
        self.roller_speeds = [view("qvel", ids("roller_dofs")[:, :, i]) for i in range(2)]

    def _ids(self, name: str) -> Ids:
        """Return a field of `RobotIndices` for the robot in each slot, (slots, ...)."""
        return np.array([getattr(robot, name) for robot in self._world.robots])

    def write_variation(self, variation: RobotVariation) -> None:
        """Write roller wear and chassis mass of each robot into the models.

        Call it before `write_drag`, which uses what it stores. Constants that MuJoCo derives from
        masses are not updated: they scale contacts and slip hinges, which must be the same for all
        robots.

        Args:
            variation: Deviations of the robots from their settings.
        """
        nominal_center = self._world.model.body_ipos[self._world.robots[0].chassis]
        mass_factor = variation.mass_factor
        shift = np.append(variation.center_offset, 0 * mass_factor, 1).T
        self.center_of_mass = nominal_center[:, None] + shift
        if variation.wear.any():
            self._wear_rollers(variation.wear.T)
        if (mass_factor != 1).any() or variation.center_offset.any():
            self._change_chassis_mass(mass_factor.T, shift)

    def write_friction(self, settings: Sequence[Settings]) -> None:
        """Write the friction of hubs and rollers of each robot into the models.

        Call it before `block_hubs`, which uses what it stores.
        """
        hubs = self._ids("wheel_dofs")
        rollers = self._ids("roller_dofs").reshape(len(self._world.robots), -1)
        self._hub_friction = self._view("dof_frictionloss", hubs)
        self._nominal_hub_friction = gather(settings, "hub_friction_nm")
        self._dry_friction = self._nominal_hub_friction
        self._view("dof_damping", hubs).set(gather(settings, "motor.wheel_viscous_friction_nm_s"))
        self._view("dof_damping", rollers).set(gather(settings, "drivetrain.roller_damping_nm_s"))

    def _wear_rollers(self, wear: Array) -> None:
        """Reduce the rollers' radii by the wear (W, n) in m, and lower the axles by as much."""
        model = self._world.model
        robot = self._world.robots[0]
        axle_height = model.body_pos[robot.wheels, 2][:, None]
        self._view("body_pos", self._ids("wheels"), 2).set(axle_height - wear)
        geoms = model.body_geomadr[self._ids("rollers")].reshape(len(self._world.robots), -1)
        size = model.geom_size[geoms[0]]
        is_ellipsoid = model.geom_type[geoms[0]] == mujoco.mjtGeom.mjGEOM_ELLIPSOID
        if (size[:, 0] != size[:, 1]).any() or not is_ellipsoid.all():
            raise OmniError(
                "randomization.max_wear_m needs rollers that are ellipsoids about their z axes"
            )
        roller_wear = np.repeat(wear, robot.rollers.shape[1], axis=0)
        radius = size[:, :1]
        # The profile of a roller has the wheel's radius of curvature, so the square of its half
        # length is the product of the roller's radius and the wheel's.
        wheel_radius = self._world.kinematics.radius
        length_ratio = np.sqrt((1 - roller_wear / radius) * (1 - roller_wear / wheel_radius))
        worn_radius = radius - roller_wear
        for axis, values in enumerate((worn_radius, worn_radius, size[:, 2:] * length_ratio)):
            self._view("geom_size", geoms, axis).set(values)

    def _change_chassis_mass(self, factor: Array, shift: Array) -> None:
        """Change mass, inertia and center of mass of the chassis.

        Args:
            factor: Factors of mass and inertia, (1, n).
            shift: Displacements of the center of mass, body frame, (3, n) m.
        """
        mass, subtree_mass, center, inertia = (
            self._view(name, self._chassis) for name in _MASS_FIELDS[:4]
        )
        added_mass = mass.get() * (factor - 1)
        for view in (mass, subtree_mass):
            view.set(view.get() + added_mass)
        center.set(center.get() + shift)
        inertia.set(inertia.get() * factor)

    def place_robots(self, rows: Ids, poses: Array) -> None:
        """Put robots at rest, on their wheels, on a floor at the height 0.

        Args:
            rows: Indices of the robots, (k,).
            poses: Their poses, world frame, (k, 3) m, m, rad.
        """
        rest_qpos = self._world.rest_qpos[self._ids("qpos")]
        positions = self.qpos.get()
        speeds = self.qvel.get()
        x, y, heading = poses.T
        positions[:, rows] = rest_qpos[rows % len(rest_qpos)].T
        positions[:2, rows] = x, y
        positions[3:7, rows] = np.cos(heading / 2), 0 * x, 0 * x, np.sin(heading / 2)
        speeds[:, rows] = 0.0
        self.qpos.set(positions)
        self.qvel.set(speeds)

    def wrap_rollers(self, pitch: float) -> None:
        """Turn the rims of two-roller wheels back by the whole pitches that they have turned.

        See "Two rollers per wheel" in `omni_mj.mjcf.rollers`. Call this after every step, before
        other code reads the state.

        Args:
            pitch: Angle between neighboring rollers, rad.
        """
        slip_angle = self.slip_angle.get()
        n_pitches = np.floor((self.wheel_angle.get() + slip_angle) * (1 / pitch))
        if not n_pitches.any():
            return
        self.slip_angle.set(slip_angle - n_pitches * pitch)
        bottom, following = (speeds.get() for speeds in self.roller_speeds)
        # After one pitch forward, the following roller becomes the bottom one. After one pitch
        # backward, the bottom roller becomes the following one. Other rollers that reach the carpet
        # are at rest.
        new_bottom = np.where(n_pitches == 1, following, 0.0)
        new_following = np.where(n_pitches == -1, bottom, 0.0)
        self.roller_speeds[0].set(np.where(n_pitches == 0, bottom, new_bottom))
        self.roller_speeds[1].set(np.where(n_pitches == 0, following, new_following))

    # Forces of the carpet, by the laws of `omni_mj.robot.wheel_carpet_forces`

    def read_motion(self) -> ChassisMotion:
        """Return the motion of each robot's center of its wheels, for robots that stand upright."""
        x, y, _, w, _, _, z = self.pose.get()
        velocity = self.velocity.get()
        # The quaternion of the heading a is (w, 0, 0, z) = (cos(a / 2), 0, 0, sin(a / 2)).
        cosine = w * w - z * z
        sine = 2 * w * z
        body_velocity = rotate(velocity[:2], cosine, -sine)
        return ChassisMotion(x, y, cosine, sine, body_velocity, velocity[5])

    def write_drag(self, drag: Drag, motion: ChassisMotion, push_force: Array) -> None:
        """Write drag and push forces to the chassis.

        MuJoCo applies the force at the chassis's center of mass. Drag acts on the carpet, at the
        center of the wheels, so its moments about the center of mass are added.

        Args:
            drag: Drag of carpet and bearings.
            motion: Motion of the center of the wheels.
            push_force: Push forces on the center of mass, world frame, (2, n) N.
        """
        x, y = rotate(drag.force, motion.cosine, motion.sine)
        forward, sideways = drag.force
        push_x, push_y = push_force
        center_x, center_y, height = self.center_of_mass
        moment = drag.moment - center_x * sideways + center_y * forward
        self.wrench.set(
            np.stack([x + push_x, y + push_y, 0 * moment, height * y, -height * x, moment])
        )

    def write_hub_friction(self, load_friction: Array) -> None:
        """Write the friction of the hubs.

        Args:
            load_friction: Friction torque by the load of the motors, (W, n) N m.
        """
        self._hub_friction.set(self._dry_friction + load_friction)

    def write_slip_limits(self, drag: Drag, load: Array) -> None:
        """Write Coulomb's limits and impedances of creep to the slip hinges.

        Args:
            drag: Latest drag. Its slip compliance is Q / A times the normal force; see
                `omni_mj.robot.wheel_carpet_forces`.
            load: Normal forces of the wheels, (W, n) N.
        """
        limit, positive_load = compute_torque_limit(drag.torque_per_load, load)
        self.slip_limit.set(limit)
        # d = A / (A + Q), with numerator and denominator multiplied by the normal force over A
        self.slip_impedance.set(positive_load / (positive_load + drag.slip_compliance))

    # Changes by faults, relative to the values before the first fault

    @cached_property
    def _unloaded_chassis(self) -> list[tuple[EntryView, Array]]:
        """Views of the mass properties of each chassis, and their values without payloads."""
        views = [self._view(name, self._chassis) for name in _MASS_FIELDS]
        return [(view, view.get()) for view in views]

    def set_payloads(self, payloads: Iterable[tuple[int, Payload]]) -> None:
        """See `ChangeableBodies`."""
        mass, subtree_mass, center, inertia, axes = (
            values.copy() for _, values in self._unloaded_chassis
        )
        chassis_height = center[2].copy()
        for row, payload in payloads:
            payload_kg = payload.mass_kg
            height = payload.height_m or chassis_height[row]
            position = np.array([*center[:2, row], height])
            offset = position - center[:, row]
            # Parallel axis theorem: the inertia of two bodies about their common center of mass
            # exceeds the sum of their own inertias by that of the reduced mass m M / (m + M) at
            # the distance between them.
            fraction = payload_kg / (mass[0, row] + payload_kg)
            added_inertia = mass[0, row] * fraction * compute_point_mass_inertia(offset)
            mass[:, row] += payload_kg
            subtree_mass[:, row] += payload_kg
            center[:, row] += fraction * offset
            if added_inertia.any():
                inertia[:, row], axes[:, row] = _add_inertia(
                    inertia[:, row], axes[:, row], added_inertia
                )
        for (view, _), values in zip(
            self._unloaded_chassis, (mass, subtree_mass, center, inertia, axes), strict=True
        ):
            view.set(values)
        self.center_of_mass = center

    def set_slope(self, slope: Array) -> None:
        """See `ChangeableBodies`. Tilt gravity in the world frame, for all bodies of a world."""
        normal = np.sqrt(np.maximum(1 - (slope**2).sum(1), 0.0))
        gravity = -float(self._world.model.opt.gravity[2])
        robots_per_world = len(self._world.robots)
        directions = np.column_stack([slope, -normal])[::robots_per_world]
        self._batch.expand("opt.gravity")[:] = gravity * directions

    def block_hubs(self, is_blocked: np.ndarray) -> None:
        """See `ChangeableBodies`."""
        self._dry_friction = np.where(is_blocked, BLOCKED_HUB_NM, self._nominal_hub_friction)

    def displace_robot(self, row: int, displacement: tuple[float, float, float]) -> None:
        """See `ChangeableBodies`. Tilt and height do not change; all speeds become zero."""
        pose = self.pose.get()
        speeds = self.qvel.get()
        x, y, turn = displacement
        pose[:2, row] += x, y
        # Product of the quaternions of the turn and of the robot. A turn about z rotates the pairs
        # (w, z) and (x, y) by half its angle.
        for pair in ([3, 6], [4, 5]):
            pose[pair, row] = rotate(pose[pair, row], np.cos(turn / 2), np.sin(turn / 2))
        speeds[:, row] = 0.0
        self.pose.set(pose)
        self.qvel.set(speeds)


def _add_inertia(moments: Array, quaternion: Array, added: Array) -> tuple[Array, Array]:
    """Add inertia to a body and diagonalize the sum.

    Args:
        moments: Principal moments of the body, (3,) kg m^2.
        quaternion: Orientation of its principal axes, (4,).
        added: Inertia to add, in the body's frame, (3, 3) kg m^2.

    Returns:
        Principal moments (3,), kg m^2, and quaternion (4,) of the sum.
    """
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    axes = matrix.reshape(3, 3)
    new_moments, new_axes = np.linalg.eigh(axes * moments @ axes.T + added)
    new_axes[:, 2] *= np.linalg.det(new_axes)  # right-handed
    new_quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(new_quaternion, new_axes.ravel())
    return new_moments, new_quaternion
