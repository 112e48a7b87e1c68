"""Robots in scenes of others, and their drives: firmware, motors, battery and creep."""

from dataclasses import dataclass, replace
from typing import Any
from weakref import WeakKeyDictionary, WeakSet

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from omni_control.arguments import check_array, check_integer, check_types
from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config import CYCLE_RATE_HZ
from omni_mj.config.rows import Row
from omni_mj.config.settings import Settings
from omni_mj.embed.floor_below import put_on_floor, set_margin
from omni_mj.embed.scene_views import SceneArrays, SceneViews
from omni_mj.embed.stepped_robot import SteppedRobot
from omni_mj.mjcf.attachable_robot import find_load_addresses, stiffen_slip_hinges
from omni_mj.mjcf.robot_parts import RobotIndices, find_by_names, find_roller_geoms
from omni_mj.mjcf.scene_contacts import check_scene, set_floor_contacts
from omni_mj.mjcf.world_builder import World, build_world
from omni_mj.plants.mujoco_plant import INSTABILITY_WARNINGS
from omni_mj.plants.mujoco_robots import compute_heading
from omni_mj.plants.randomization import RobotVariation
from omni_mj.robot.firmware import compute_encoder_counts
from omni_mj.simulation.simulation import MAX_SEED

_CALL_ORDER = "call before_step, mj_step and after_step in turn, or step"
MAX_SUBSTEPS = 100  # limit of `physics.substeps`


@dataclass(frozen=True)
class SceneRobot:
    """A robot that `add_robot` has attached to a scene.

    Attributes:
        settings: Settings of the robot.
        robot: Name or file of the robot.
        prefix: Prefix of the names of its elements.
        chassis: Name of the body of its chassis, to which other things may be attached.
        pose: Pose at the start, world frame of the scene, m, m, rad.
        height: Approximate height of the floor at the start, m.
    """

    settings: Settings
    robot: str
    prefix: str
    chassis: str
    pose: tuple[float, float, float]
    height: float

    @check_types
    def bind(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        seed: int = 0,
        scene_prefix: str | None = None,
    ) -> "RobotDrive":
        """Return the drive of the robot in a compiled scene, at rest at its start.

        Here and in each step, the drive writes the robot's contacts, the friction of its hinges,
        and its motors to the model. So all drives of a model share one `data`, and a robot has one
        drive until that is deleted.

        Args:
            model: Model that was compiled from the scene.
            data: Data of the model.
            seed: Seed of the noise of the gyro and other random numbers.
            scene_prefix: Prefix with which the scene was attached to another one. It is found if
                the scene was attached once.

        Raises:
            OmniError: The model does not contain the robot, there is no floor below it, the
                timestep exceeds 5 ms, options disable forces that the wheels need, or the model
                has another drive of the robot or with other data.
        """
        if (model.nq, model.nv, model.nu) != (len(data.qpos), len(data.qvel), len(data.ctrl)):
            raise OmniError("the data belong to another model: give mujoco.MjData(model)")
        return RobotDrive(self, model, data, check_integer("seed", seed, 0, MAX_SEED), scene_prefix)


class RobotDrive:
    """Drive of a robot in a scene of others.

    Call `step`, or `before_step` and `after_step` around the scene's own `mujoco.mj_step`. The
    drive owns the controls of the robot's motors, and the external force on its chassis, to which
    `set_push_force` adds one.

    Attributes:
        model: Model of the scene.
        data: Data of the scene.
    """

    _time: float
    _is_stepping: bool
    _warnings: int

    def __init__(
        self,
        robot: SceneRobot,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        seed: int,
        scene_prefix: str | None,
    ) -> None:
        self.model, self.data = model, data
        self._row = Row(0, 0, "", seed, robot.settings, robot.robot)
        self._variation = RobotVariation.draw([self._row])
        # A robot of its kind alone on the field, with as many steps per cycle
        substeps = min(max(round(1 / (model.opt.timestep * CYCLE_RATE_HZ)), 1), MAX_SUBSTEPS)
        self._plant_world = build_world(robot.settings.replace(physics={"substeps": substeps}))
        self._scene_prefix = _find_scene_prefix(robot, self._plant_world, model, scene_prefix)
        self._robot = robot
        self._world = self._make_world()
        if self._scene_prefix:
            x, y, height, *quaternion = model.qpos0[self._world.robots[0].qpos[:7]].tolist()
            heading = float(compute_heading(np.array(quaternion)))
            self._robot = replace(robot, pose=(x, y, heading), height=height)
        self._views = SceneViews(SceneArrays(model, data), self._world)
        self._views.write_variation(self._variation)
        self.reset()
        self._register()

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make a copy, which has its own model and data."""
        self.__dict__.update(state)
        self._register()

    def reset(self, pose: ArrayLike | None = None) -> None:
        """Put the robot at rest, with battery and motors as they were at the start.

        Call it after a reset of the scene's data.

        Args:
            pose: Pose, world frame, (3,) m, m, rad. Default: that at the start.

        Raises:
            OmniError: There is no floor at the pose.
        """
        start = np.array(self._robot.pose) if pose is None else check_array("pose", pose, (3,))
        indices = self._world.robots[0]
        _write_start_values(self.model, indices, self._plant_world)
        self.data.ctrl[indices.motors] = 0.0
        self.data.xfrc_applied[indices.chassis] = 0.0
        self.data.qacc_warmstart[indices.dofs] = 0.0
        put_on_floor(self.model, self.data, self._world, self._views, start, self._robot.height)
        mujoco.mj_forward(self.model, self.data)
        self._wheels = SteppedRobot(self._row, self._world, self._views, self._variation)
        self._start_clock()

    def follow(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Go on in a scene that was compiled again while the robot moved.

        For instance::

            model, data = scene.recompile(model, data)
            drive.follow(model, data)

        Motion, heat, battery and firmware are as before.

        Args:
            model: Model that `recompile` returned.
            data: Data that it returned.

        Raises:
            OmniError: See `SceneRobot.bind`; the drive then stays in its scene.
        """
        previous = dict(vars(self))
        margin = self.model.geom_margin[find_roller_geoms(self.model, self._world.robots[0])].min()
        try:
            self.model, self.data = model, data
            self._world = self._make_world()
            self._views = SceneViews(SceneArrays(model, data), self._world)
            self._views.write_variation(self._variation)
            _write_start_values(model, self._world.robots[0], self._plant_world)
            set_margin(model, self._world.robots[0], margin)
            mujoco.mj_forward(model, data)
            self._wheels.follow(self._world, self._views)
        except OmniError:
            vars(self).update(previous)
            raise
        _drives[previous["model"]].discard(self)
        self._register()
        self._start_clock()

    def command(
        self,
        velocity: ArrayLike | None = None,
        *,
        wheel_speeds: ArrayLike | None = None,
        voltages: ArrayLike | None = None,
        currents: ArrayLike | None = None,
    ) -> None:
        """Set one kind of command, which holds until the next one.

        Args:
            velocity: Velocity forward and to the left, and turn rate, body frame, (3,) m/s, m/s,
                rad/s. The wheel loops of the firmware follow it.
            wheel_speeds: Speeds of the wheels, (wheels,) rad/s, for the same loops.
            voltages: Voltages of the motors, (wheels,) V, within those of the battery.
            currents: Currents of the motors, (wheels,) A, within the limits of the drivers.

        Wheels are numbered counter-clockwise from the front. A positive speed turns the robot
        counter-clockwise.

        Raises:
            OmniError: Not exactly one command is given, or it has another shape.
        """
        commands = {
            "velocity": velocity,
            "wheel_speeds": wheel_speeds,
            "voltages": voltages,
            "currents": currents,
        }
        chosen = {name: value for name, value in commands.items() if value is not None}
        if len(chosen) != 1:
            raise OmniError(f"give one of {', '.join(commands)}, not {len(chosen)}")
        ((name, value),) = chosen.items()
        n_wheels = len(self._world.robots[0].joints)
        values = check_array(name, value, (3 if name == "velocity" else n_wheels,))
        self._wheels.accept(name, values)

    def set_push_force(self, force: ArrayLike) -> None:
        """Push the robot at its center of mass until the next call.

        Args:
            force: Horizontal force, world frame, (2,) N.
        """
        self._wheels.set_push_force(check_array("force", force, (2,)))

    def step(self) -> None:
        """Advance the scene by one timestep. With several robots, see `before_step`."""
        self.before_step()
        mujoco.mj_step(self.model, self.data)
        self.after_step()

    def before_step(self) -> None:
        """Run the firmware and write motor voltages and friction; call it before each `mj_step`.

        Raises:
            OmniError: The scene was stepped or reset without the drive.
        """
        if self._is_stepping or self.data.time > self._time:
            raise OmniError(f"a scene was stepped without the drive: {_CALL_ORDER}")
        if self.data.time < self._time:
            raise OmniError(
                "the scene's time went back: call reset of the drive after the scene's data are "
                "reset"
            )
        self._is_stepping = True
        self._wheels.before_step()

    def after_step(self) -> None:
        """Read the sensors; call it after each `mj_step`.

        Raises:
            OmniError: The simulation became unstable, or was not advanced by one step.
        """
        if self._count_warnings() > self._warnings:
            raise OmniError(
                f"the simulation became unstable at {self._time:g} s: use a shorter timestep, or "
                "weaker actuators"
            )
        step = self.model.opt.timestep
        if not self._is_stepping or abs(self.data.time - self._time - step) > step / 2:
            raise OmniError(f"the scene was not advanced by one step: {_CALL_ORDER}")
        self._time, self._is_stepping = self.data.time, False
        self._wheels.after_step()

    @property
    def pose(self) -> Array:
        """Pose of the robot, world frame, (3,) m, m, rad; the heading is in (-pi, pi]."""
        x, y = self._views.pose.get()[:2, 0]
        return np.array([x, y, self._wheels.compute_heading()[0]])

    @property
    def encoders(self) -> Array:
        """Angles of the wheels as encoders count them, (wheels,) rad."""
        firmware = self._wheels.electronics.firmware
        parameters = self._wheels.parameters.electronics.firmware
        counts = compute_encoder_counts(parameters, firmware, self._views.encoders.get())
        return (counts / parameters.counts_per_rad)[:, 0]

    @property
    def gyro(self) -> float:
        """Turn rate as the gyro measures it, rad/s, with its error of the present frame."""
        error = self._wheels.electronics.inputs.gyro_error
        return float(self._views.gyro.get()[0, 0] + error[0])

    @property
    def voltages(self) -> Array:
        """Voltages at the motors in the last cycle, (wheels,) V."""
        return self._wheels.record.voltage[:, 0]

    @property
    def currents(self) -> Array:
        """Currents of the motors in the last cycle, (wheels,) A."""
        return self._wheels.record.current[:, 0]

    @property
    def winding_temperatures(self) -> Array:
        """Temperatures of the windings, (wheels,) deg C."""
        return self._wheels.electronics.motors.winding[:, 0]

    @property
    def battery_voltage(self) -> float:
        """Voltage at the terminals of the battery, V."""
        return float(self._wheels.electronics.battery.voltage[0])

    @property
    def battery_charge(self) -> float:
        """State of charge of the battery, from 0 (empty) to 1 (full)."""
        return float(self._wheels.electronics.battery.charge[0])

    def _start_clock(self) -> None:
        """Note the present time and warnings of the data."""
        self._time, self._is_stepping = self.data.time, False
        self._warnings = self._count_warnings()

    def _count_warnings(self) -> int:
        return sum(int(self.data.warning[kind].number) for kind in INSTABILITY_WARNINGS)

    def _make_world(self) -> World:
        """Prepare the model for the robot, and return what a plant needs to know of it.

        Raises:
            OmniError: The model does not contain the robot, no wheel can roll in it, or other
                drives write to it.
        """
        model, robot, plant_world = self.model, self._robot, self._plant_world
        (plant_robot,) = plant_world.robots
        prefixes = "robot_1/", self._scene_prefix + robot.prefix
        indices = find_by_names(plant_robot, plant_world.model, model, prefixes)
        check_scene(model, indices)
        self._check_other_drives(indices.chassis)
        if not model.actuator_ctrllimited[indices.motors].any():  # an earlier drive was here
            _restore_bodies(model, indices, plant_world)
        # The compiler rounds these differently in each pose.
        plant_model = plant_world.model
        model.body_invweight0[indices.bodies] = plant_model.body_invweight0[plant_robot.bodies]
        model.dof_invweight0[indices.dofs] = plant_model.dof_invweight0[plant_robot.dofs]
        set_floor_contacts(model, indices, robot.settings.body.mass_kg / len(indices.joints))
        # The battery limits voltages, which may exceed the model's range while motors brake.
        model.actuator_ctrllimited[indices.motors] = 0
        rest_qpos = model.qpos0.copy()
        rest_qpos[indices.qpos] = plant_world.rest_qpos[plant_robot.qpos]
        return replace(
            plant_world,
            model=model,
            robots=(indices,),
            rest_qpos=rest_qpos,
            load_addresses=find_load_addresses(model, indices, self._scene_prefix)[None],
        )

    def _check_other_drives(self, chassis: int) -> None:
        """Raise an OmniError if another drive has the body of this chassis, or other data."""
        for drive in _drives.get(self.model, ()):
            other_chassis = drive._world.robots[0].chassis
            if drive is not self and (drive.data is not self.data or other_chassis == chassis):
                name = self.model.body(other_chassis).name
                raise OmniError(
                    f"this model already has a drive of {name!r}, which writes to the model: use "
                    "that one, or delete it first; give each simulation its own model and data: "
                    "copy.deepcopy(model)"
                )

    def _register(self) -> None:
        """Note that this drive writes to the model."""
        self._check_other_drives(self._world.robots[0].chassis)
        _drives.setdefault(self.model, WeakSet()).add(self)


# Drives that write to each model
_drives: WeakKeyDictionary[mujoco.MjModel, WeakSet[RobotDrive]] = WeakKeyDictionary()


def _find_scene_prefix(
    robot: SceneRobot, plant_world: World, model: mujoco.MjModel, chosen: str | None
) -> str:
    """Return the prefix with which the scene of a robot was attached, or an empty text.

    Raises:
        OmniError: The scene was attached several times, and none is chosen.
    """
    if chosen is not None:
        return chosen
    plant_rim = plant_world.model.body(plant_world.robots[0].rims[0]).name
    rim = plant_rim.replace("robot_1/", robot.prefix, 1)
    sensors = [model.sensor(i).name for i in range(model.nsensor)]
    suffix = f"load/{rim}"
    prefixes = [name.removesuffix(suffix) for name in sensors if name.endswith(suffix)]
    if len(prefixes) > 1 and "" not in prefixes:
        raise OmniError(
            f"the scene of {robot.chassis!r} was attached with several prefixes: give "
            f"scene_prefix=, one of {', '.join(map(repr, prefixes))}"
        )
    return "" if "" in prefixes or not prefixes else prefixes[0]


def _restore_bodies(model: mujoco.MjModel, robot: RobotIndices, plant_world: World) -> None:
    """Undo the variation that an earlier drive has written to a model."""
    (plant_robot,) = plant_world.robots
    chassis, plant_chassis = robot.chassis, plant_robot.chassis
    added_mass = model.body_mass[chassis] - plant_world.model.body_mass[plant_chassis]
    model.body_subtreemass[chassis] -= added_mass
    for name in ("body_mass", "body_ipos", "body_inertia"):
        getattr(model, name)[chassis] = getattr(plant_world.model, name)[plant_chassis]
    model.body_pos[robot.wheels] = plant_world.model.body_pos[plant_robot.wheels]
    geoms, plant_geoms = (
        find_roller_geoms(source, indices)
        for source, indices in ((model, robot), (plant_world.model, plant_robot))
    )
    model.geom_size[geoms] = plant_world.model.geom_size[plant_geoms]


def _write_start_values(model: mujoco.MjModel, robot: RobotIndices, plant_world: World) -> None:
    """Write the frictions and motors of a robot at rest, which a drive changes in each step."""
    (plant_robot,) = plant_world.robots
    for name in ("dof_frictionloss", "dof_solimp"):
        getattr(model, name)[robot.dofs] = getattr(plant_world.model, name)[plant_robot.dofs]
    model.actuator_gainprm[robot.motors] = plant_world.model.actuator_gainprm[plant_robot.motors]
    stiffen_slip_hinges(model, robot)
