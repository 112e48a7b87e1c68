"""Builds the world that robots drive in: a scene, n robots attached to it by prefix, and the contacts between them.

What touches what is made here. Rollers touch the geom `carpet` of the scene by explicit pairs (see `contact`). Hulls
(the robot's geoms of the class `hull`) are off as modelled; with more than one robot in a world, or where it is asked
for, they are switched on, and meet each other and every geom of the scene that collides: walls, and the carpet under a
robot that has fallen.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Self

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, Kinematics
from omni_mj.mjcf.roles import Ids, Robot
from omni_mj.scenarios.robots import SCENE, scene_path
from omni_mj.scenarios.settings import CYCLE_RATE_HZ, Settings
from omni_mj.worlds import parts, two_rollers
from omni_mj.worlds.contact import RIGID, STIFFEST, Contact, creeping
from omni_mj.worlds.hulls import reach, switch_on
from omni_mj.worlds.parts import Part
from omni_mj.worlds.shape import Shape

CYCLE_S = 1 / CYCLE_RATE_HZ  # of the wheel loops: 16 in a camera frame, each of one physics step or several
SETTLING_S = 0.25

# What rollers need of the solver; why is said in models/field.xml.
_SOLVER = {
    "timestep": (CYCLE_S, "0.00104166666666666667"),
    "integrator": (mujoco.mjtIntegrator.mjINT_EULER, "Euler"),
    "cone": (mujoco.mjtCone.mjCONE_ELLIPTIC, "elliptic"),
    "jacobian": (mujoco.mjtJacobian.mjJAC_SPARSE, "sparse"),
    "impratio": (45.0, "45"),
}
# What the scene says, and nobody else.
_SCENES = ("option", "visual", "stat", "memory", "nstack", "nconmax", "njmax")


@dataclass(frozen=True, eq=False)
class World:
    """A compiled world and where its robots are in it, to be read only: it is shared by all who ask for the same.

    Args:
        model: robots named `robot_1/...` and so on by their places, all at the origin.
        robots: n of one shape, in the order of their places: all that are in it, unless it is `mixed`.
        standing: positions (nq,) with every robot at rest at the origin, its weight on its rollers.
        kinematics: of each robot's wheels.
        loads: addresses in sensordata of the forces on each robot's wheels in the direction of z, (n, wheels).
        reach: radius of the circle about a robot's middle that its hull stays in, m; 0 without a hull.
    """

    model: mujoco.MjModel
    robots: tuple[Robot, ...]
    standing: Array
    kinematics: Kinematics
    loads: Ids
    reach: float


def world(
    settings: Settings | None = None,
    places: int = 1,
    scene: str = SCENE,
    hulls: bool | None = None,
) -> World:
    """A scene with robots of one shape on it, built once.

    Args:
        settings: of the robots; what their `Shape` says counts. [the default robot's]
        places: number of robots.
        scene: name or path of its MJCF file.
        hulls: whether robots meet each other and walls. [if they are several]

    Raises:
        OmniError: numbers of which no robot can be made, a robot's or scene's file that lacks a part, or a scene that
            has other solver options than rollers need.
    """
    return mixed([settings or Settings()] * places, scene, hulls)[0]


def mixed(
    settings: Sequence[Settings],
    scene: str = SCENE,
    hulls: bool | None = None,
) -> tuple[World, ...]:
    """A scene with robots of any shapes on it, built once: for each shape the same world, with the robots that have it.

    Args:
        settings: of the robot at each place; what their `Shape` says counts.
        scene: name or path of its MJCF file.
        hulls: whether robots meet each other and walls. [if they are several]

    Returns:
        In the order in which the shapes come.

    Raises:
        OmniError: see `world`; or some robots' wheels creep and others' do not, which takes two solvers.
    """
    for each in settings:
        if each.wheels.creep == "off" and each.wheels.model != "rollers":
            raise OmniError(f"wheels.creep = off needs wheels.model = rollers, not {each.wheels.model}")
    if len({each.wheels.creep for each in settings}) > 1:
        raise OmniError("wheels.creep must be the same for all robots of a world, on or off")
    shapes = [Shape.of(each) for each in settings]
    path = scene_path(scene).resolve()
    changed = path.stat().st_mtime_ns  # a file edited since is read again
    meet = len(settings) > 1 if hulls is None else hulls
    robots = tuple((parts.of(shape), shape) for shape in shapes)
    return _worlds(robots, path, changed, settings[0].physics.substeps, meet)


@lru_cache(maxsize=16)
def _worlds(
    robots: tuple[tuple[Part, Shape], ...], scene: Path, changed: int, substeps: int, hulls: bool
) -> tuple[World, ...]:
    whole = _read(scene)
    _check_solver(whole, scene.name)
    if whole.geom("carpet") is None:
        raise OmniError(f"{scene.name}: no carpet; it is a geom of this name, on which the rollers roll")
    kinds = {robot: _Kind.of(*robot, whole, hulls) for robot in dict.fromkeys(robots)}
    for place, robot in enumerate(robots):
        kinds[robot].attach(whole, parts.prefix(place))
    if len(robots) == 1:  # what touches is one island, of which to make a list costs 7 % of a step
        whole.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    (whole.option.impratio,) = {kind.contact.impratio for kind in kinds.values()}
    whole.option.timestep = whole.option.timestep / substeps
    model = _compile(whole, ", ".join(part.file for part, _ in kinds))
    places = {kind: [place for place, robot in enumerate(robots) if robot == kind] for kind in kinds}
    found = {(part, shape): part.find(model, at) for (part, shape), at in places.items()}
    for one in (each for same in found.values() for each in same):  # backward Euler: a slip speed decays within a step
        model.dof_solref[one.slip_dofs] = -1.0, -STIFFEST / model.opt.timestep
        model.dof_solimp[one.slip_dofs, :2] = STIFFEST
    if len(robots) == 1:
        standing = _standing(model)
    else:
        standing = model.qpos0.copy()
        for kind, same in found.items():
            (alone,) = _worlds((kind,), scene, changed, substeps, False)
            for one in same:
                standing[one.qpos] = alone.standing[alone.robots[0].qpos]
    return tuple(
        World(
            model=model,
            robots=same,
            standing=standing,
            kinematics=shape.wheels.kinematics,
            loads=_loads(model, same),
            reach=kinds[part, shape].reach,
        )
        for (part, shape), same in found.items()
    )


@dataclass(frozen=True, eq=False)
class _Kind:
    """Robots of one shape, to be attached to a scene.

    Args:
        spec: to be copied.
        rollers: names of the geoms that touch the carpet.
        rims: names of the bodies whose loads are sensed.
        contact: of rollers and carpet.
        reach: see `World`.
    """

    spec: mujoco.MjSpec
    rollers: tuple[str, ...]
    rims: tuple[str, ...]
    contact: Contact
    reach: float

    @classmethod
    def of(cls, robot: Part, shape: Shape, scene: mujoco.MjSpec, hulls: bool) -> Self:
        """Make them ready for a scene."""
        part = robot.spec.copy()
        alone = _compile(part, robot.file)
        (found,) = robot.find(alone)
        if np.abs(found.phases).max() > 1e-3:
            raise OmniError(f"{robot.file}: the rollers of each wheel must be evenly spaced, one at the bottom")
        creeps = found.slip_dofs.size > 0
        contact = creeping(alone, found.rollers.ravel(), shape.body.mass_kg / len(found.wheels)) if creeps else RIGID
        rollers = robot.touching
        if shape.wheels.model == "two-rollers":
            two_rollers.reduce(part, alone, found)
            left = {geom.name for geom in part.geoms}
            rollers = tuple(name for name in rollers if name in left)
        for name in _SCENES:
            setattr(part, name, getattr(scene, name))
        if hulls:
            switch_on(part, robot)
        return cls(part, rollers, tuple(alone.body(rim).name for rim in found.rims), contact, reach(alone, robot))

    def attach(self, scene: mujoco.MjSpec, prefix: str) -> None:
        """Put one on a scene, at the origin."""
        scene.attach(self.spec.copy(), frame=scene.worldbody.add_frame(), prefix=prefix)
        for roller in self.rollers:
            self.contact.add(scene, "carpet", prefix + roller)
        for rim in self.rims:
            _add_load_sensor(scene, prefix + rim)


def _read(file: Path) -> mujoco.MjSpec:
    try:
        return mujoco.MjSpec.from_file(str(file))
    except ValueError as error:
        raise OmniError(f"{file.name}: {' '.join(str(error).split())}") from error


def _compile(spec: mujoco.MjSpec, file: str) -> mujoco.MjModel:
    try:
        return spec.compile()
    except ValueError as error:
        raise OmniError(f"{file}: {' '.join(str(error).split())}") from error


def _check_solver(scene: mujoco.MjSpec, file: str) -> None:
    """Refuse a scene with other solver options: with these, rollers would slip or robots outrun their wheels."""
    wrong = [
        f'{name}="{text}"'
        for name, (value, text) in _SOLVER.items()
        if abs(getattr(scene.option, name) - value) > 1e-12
    ]
    if not scene.option.disableflags & mujoco.mjtDisableBit.mjDSBL_EULERDAMP:
        wrong.append('<flag eulerdamp="disable"/>')
    if wrong:
        raise OmniError(f"{file}: <option> differs from what rollers need; set {', '.join(wrong)}, as field.xml does")


def _add_load_sensor(world: mujoco.MjSpec, rim: str) -> None:
    """Have the force between carpet and whatever is on a rim sensed, in the world's axes."""
    sensor = world.add_sensor(name=f"load/{rim}")
    sensor.type = mujoco.mjtSensor.mjSENS_CONTACT
    sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_GEOM, "carpet"
    sensor.reftype, sensor.refname = mujoco.mjtObj.mjOBJ_XBODY, rim
    # Data: force alone; of all contacts their sum; one of it.
    sensor.intprm[:3] = 1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), 3, 1


def _loads(model: mujoco.MjModel, robots: tuple[Robot, ...]) -> Ids:
    """Addresses of the loads of each robot's wheels, (robots, wheels)."""
    sensors = np.flatnonzero(model.sensor_type == mujoco.mjtSensor.mjSENS_CONTACT)
    address = dict(zip(model.sensor_refid[sensors].tolist(), model.sensor_adr[sensors] + 2, strict=True))  # z
    return np.array([[address[rim] for rim in robot.rims.tolist()] for robot in robots])


def _standing(model: mujoco.MjModel) -> Array:
    """Positions (nq,) of one robot at rest at the origin.

    As modelled, the rollers touch the carpet at distance zero, where rounding decides which of them carry load first.
    """
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=round(SETTLING_S / model.opt.timestep))
    return data.qpos.copy()
