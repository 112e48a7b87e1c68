"""Builds the world that robots drive in: a scene, n robots attached to it by prefix, and the contacts between them.

What touches what is made here. Rollers touch the geom `carpet` of the scene by explicit pairs (see `contact`). Hulls
(the robot's geoms of the class `hull`) are off as modelled; with more than one robot in a world, or where it is asked
for, they are switched on, and meet each other and every geom of the scene that collides: walls, and the carpet under a
robot that has fallen.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, Kinematics
from omni_mj.mjcf.roles import Ids, Robot
from omni_mj.scenarios import models
from omni_mj.scenarios.robot_settings import WheelSettings
from omni_mj.scenarios.settings import CYCLE_RATE_HZ, Settings
from omni_mj.worlds import parts, two_rollers
from omni_mj.worlds.contact import RIGID, STIFFEST, creeping
from omni_mj.worlds.parts import Part
from omni_mj.worlds.shape import Shape
from omni_mj.worlds.wheels import WheelGeometry

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
        model: n robots, named `robot_1/...` and so on, all at the origin.
        robots: in the order of their places.
        standing: positions (nq,) with every robot at rest at the origin, its weight on its rollers.
        kinematics: of each robot's wheels.
        wheels: where each robot's rollers are, for its slip.
        pairs: contacts of carpet and rollers, numbers of each robot's, (n, pairs).
        loads: addresses in sensordata of the forces on each robot's wheels in the direction of z, (n, wheels).
    """

    model: mujoco.MjModel
    robots: tuple[Robot, ...]
    standing: Array
    kinematics: Kinematics
    wheels: WheelGeometry
    pairs: Ids
    loads: Ids

    @property
    def weight(self) -> float:
        """Of one robot, N."""
        return float(self.model.body_subtreemass[self.robots[0].chassis] * -self.model.opt.gravity[2])


def world(
    settings: Settings | None = None,
    places: int = 1,
    scene: str = models.SCENE,
    substeps: int | None = None,
    hulls: bool | None = None,
) -> World:
    """A scene with robots on it, built once.

    Args:
        settings: of the robots; what their `Shape` says counts. [the default robot's]
        places: number of robots.
        scene: name or path of its MJCF file.
        substeps: physics steps per cycle of the wheel loops. [as in the settings]
        hulls: whether robots meet each other and walls. [if they are several]

    Raises:
        OmniError: numbers of which no robot can be made, a robot's or scene's file that lacks a part, or a scene that
            has other solver options than rollers need.
    """
    chosen = settings or Settings()
    if chosen.wheels.creep == "off" and chosen.wheels.model != "rollers":
        raise OmniError(f"wheels.creep = off needs wheels.model = rollers, not {chosen.wheels.model}")
    robot = parts.of(Shape.of(chosen))
    path = models.scene_path(scene).resolve()
    changed = path.stat().st_mtime_ns  # a file edited since is read again
    steps, meet = substeps or chosen.physics.substeps, places > 1 if hulls is None else hulls
    return _world(robot, path, changed, Shape.of(chosen), places, steps, meet)


def kinematics(wheels: WheelSettings) -> Kinematics:
    """Of a robot with these wheels."""
    return wheels.kinematics


@lru_cache(maxsize=16)
def _world(robot: Part, scene: Path, changed: int, kind: Shape, places: int, substeps: int, hulls: bool) -> World:
    part, whole = robot.spec.copy(), _read(scene)
    _check_solver(whole, scene.name)
    if whole.geom("carpet") is None:
        raise OmniError(f"{scene.name}: no carpet; it is a geom of this name, on which the rollers roll")
    alone = _compile(part, robot.file)
    (found,) = robot.find(alone)
    if np.abs(found.phases).max() > 1e-3:
        raise OmniError(f"{robot.file}: the rollers of each wheel must be evenly spaced, one at the bottom")
    creeps = found.slip_dofs.size > 0
    contact = creeping(alone, found.rollers.ravel(), kind.body.mass_kg / len(found.wheels)) if creeps else RIGID
    rollers = robot.touching
    if kind.wheels.model == "two-rollers":
        two_rollers.reduce(part, alone, found)
        left = {geom.name for geom in part.geoms}
        rollers = tuple(name for name in rollers if name in left)
    for name in _SCENES:
        setattr(part, name, getattr(whole, name))
    if hulls:
        _switch_on_hulls(part, robot)
    rims = [alone.body(rim).name for rim in found.rims]
    for place in range(places):
        prefix = parts.prefix(place)
        whole.attach(part.copy(), frame=whole.worldbody.add_frame(), prefix=prefix)
        for roller in rollers:
            contact.add(whole, "carpet", prefix + roller)
        for rim in rims:
            _add_load_sensor(whole, prefix + rim)
    if places == 1:  # what touches is one island, of which to make a list costs 7 % of a step
        whole.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    whole.option.impratio = contact.impratio
    whole.option.timestep = whole.option.timestep / substeps
    model = _compile(whole, robot.file)
    robots = robot.find(model, places)
    for one in robots:  # backward Euler: a slip speed decays within a step
        model.dof_solref[one.slip_dofs] = -1.0, -STIFFEST / model.opt.timestep
        model.dof_solimp[one.slip_dofs, :2] = STIFFEST
    if places == 1:
        standing = _standing(model)
    else:
        standing = _each_standing(model, robots, _world(robot, scene, changed, kind, 1, substeps, False))
    return World(
        model=model,
        robots=robots,
        standing=standing,
        kinematics=kinematics(kind.wheels),
        wheels=WheelGeometry.of(model, robots[0], 2 * np.pi / kind.wheels.rollers),
        pairs=_pairs(model, robots),
        loads=_loads(model, places),
    )


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


def _switch_on_hulls(part: mujoco.MjSpec, robot: Part) -> None:
    if not robot.hull:
        raise OmniError(
            f"{robot.file}: no hull; robots that share a world meet with their geoms of the class 'hull', or those "
            "that 'hull' names"
        )
    for name in robot.hull:
        hull = part.geom(name)
        hull.contype = hull.conaffinity = 1


def _add_load_sensor(world: mujoco.MjSpec, rim: str) -> None:
    """Have the force between carpet and whatever is on a rim sensed, in the world's axes."""
    sensor = world.add_sensor(name=f"load/{rim}")
    sensor.type = mujoco.mjtSensor.mjSENS_CONTACT
    sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_GEOM, "carpet"
    sensor.reftype, sensor.refname = mujoco.mjtObj.mjOBJ_XBODY, rim
    # Data: force alone; of all contacts their sum; one of it.
    sensor.intprm[:3] = 1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), 3, 1


def _loads(model: mujoco.MjModel, places: int) -> Ids:
    sensors = np.flatnonzero(model.sensor_type == mujoco.mjtSensor.mjSENS_CONTACT)
    return np.asarray(model.sensor_adr[sensors].reshape(places, -1) + 2)  # z


def _pairs(model: mujoco.MjModel, robots: tuple[Robot, ...]) -> Ids:
    """Numbers of each robot's pairs, (robots, pairs)."""
    roots = model.body_rootid[model.geom_bodyid[[model.pair_geom1, model.pair_geom2]]].max(0)  # the carpet's is lower
    return np.array([np.flatnonzero(roots == robot.chassis) for robot in robots])


def _standing(model: mujoco.MjModel) -> Array:
    """Positions (nq,) of one robot at rest at the origin.

    As modelled, the rollers touch the carpet at distance zero, where rounding decides which of them carry load first.
    """
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=round(SETTLING_S / model.opt.timestep))
    return data.qpos.copy()


def _each_standing(model: mujoco.MjModel, robots: tuple[Robot, ...], one: World) -> Array:
    """Positions (nq,) of robots that stand as the one of another world does."""
    standing = model.qpos0.copy()
    for robot in robots:
        standing[robot.qpos] = one.standing[one.robots[0].qpos]
    return standing
