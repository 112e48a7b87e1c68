"""Builds the world that robots drive in: a scene, n robots attached to it by prefix, and the contacts between them.

What touches what is made here. Rollers touch the geom `carpet` of the scene by explicit pairs, whose parameters are
those of <pair> in the main default class of the robot's file. Hulls (the robot's geoms of the class `hull`) are off as
modelled; with more than one robot in a world they are switched on, and meet each other and every geom of the scene that
collides: walls, and the carpet under a robot that has fallen.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, Kinematics
from omni_mj.scenarios import models
from omni_mj.worlds import contact_roller, roles
from omni_mj.worlds.roles import Robot
from omni_mj.worlds.wheels import Motor, WheelGeometry, kinematics, motor

CYCLE_S = 1 / 960  # of the wheel loops: 16 in a camera frame, each of one physics step or several
SETTLING_S = 0.25

# What rollers need of the solver; why is said in models/scene.xml.
_SOLVER = {
    "timestep": (CYCLE_S, "0.00104166666666666667"),
    "integrator": (mujoco.mjtIntegrator.mjINT_EULER, "Euler"),
    "cone": (mujoco.mjtCone.mjCONE_ELLIPTIC, "elliptic"),
    "jacobian": (mujoco.mjtJacobian.mjJAC_SPARSE, "sparse"),
    "impratio": (10.0, "10"),
}


@dataclass(frozen=True, eq=False)
class World:
    """A compiled world and where its robots are in it, to be read only: it is shared by all who ask for the same.

    Args:
        model: n robots, named `robot_1/...` and so on, all at the origin.
        robots: in the order of their places.
        standing: positions (nq,) with every robot at rest at the origin, its weight on its rollers.
        kinematics: of each robot's wheels.
        wheels: where each robot's rollers are, for its slip.
        motor: of each wheel.
        motor_friction: dry friction of a motor at its wheel, N m.
        pairs: contacts of carpet and rollers, numbers of each robot's, (n, pairs).
        pitch: angle between the rollers of the wheel as modelled, rad, however many the world has of them.
        one_roller: whether only one roller a wheel is there (see `contact_roller`).
    """

    model: mujoco.MjModel
    robots: tuple[Robot, ...]
    standing: Array
    kinematics: Kinematics
    wheels: WheelGeometry
    motor: Motor
    motor_friction: float
    pairs: roles.Ids
    pitch: float
    one_roller: bool

    @property
    def weight(self) -> float:
        """Of one robot, N."""
        return float(self.model.body_subtreemass[self.robots[0].chassis] * -self.model.opt.gravity[2])


def world(
    robot: str = models.DEFAULT,
    places: int = 1,
    scene: str = models.SCENE,
    one_roller: bool = False,
    substeps: int = 1,
) -> World:
    """A scene with robots on it, built once.

    Args:
        robot: name or path of its MJCF file.
        places: number of robots.
        scene: name or path of its MJCF file.
        one_roller: leave one roller of each wheel (see `contact_roller`).
        substeps: physics steps per cycle of the wheel loops.

    Raises:
        OmniError: a file that is missing or no MJCF, a robot that lacks a part, a scene that lacks the carpet or has
            other solver options than rollers need.
    """
    paths = models.model_path(robot).resolve(), models.scene_path(scene).resolve()
    changed = tuple(path.stat().st_mtime_ns for path in paths)  # a file edited since is read again
    return _world(*paths, changed, places, one_roller, substeps)


@lru_cache(maxsize=16)
def _world(robot: Path, scene: Path, changed: tuple[int, ...], places: int, one_roller: bool, substeps: int) -> World:
    part, whole = _read(robot), _read(scene)
    _check_solver(whole, scene.name)
    if whole.geom("carpet") is None:
        raise OmniError(f"{scene.name}: no carpet; it is a geom of this name, on which the rollers roll")
    for key in list(part.keys):  # of another size than the world's
        part.delete(key)
    alone = _compile(part, robot.name)
    found = roles.find(alone, robot.name)
    if len(found) != 1:
        raise OmniError(f"{robot.name}: {len(found)} robots; one file is one robot")
    pitch = 2 * np.pi / found[0].rollers.shape[1]
    touching = _name_rollers(part, found[0])
    if one_roller:
        touching = contact_roller.reduce(part, alone, found[0])
    if places > 1:
        _switch_on_hulls(part, robot.name)
    for place in range(places):
        prefix = f"robot_{place + 1}/"
        whole.attach(part.copy(), frame=whole.worldbody.add_frame(), prefix=prefix)
        for geom in touching:
            _add_pair(whole, part.default.pair, "carpet", prefix + geom)
    whole.option.timestep = whole.option.timestep / substeps
    model = _compile(whole, robot.name)
    robots = roles.find(model, robot.name)
    if places == 1:
        standing = _standing(model)
    else:
        standing = _each_standing(model, robots, _world(robot, scene, changed, 1, one_roller, substeps))
    return World(
        model=model,
        robots=robots,
        standing=standing,
        kinematics=kinematics(alone, found[0], robot.name),
        wheels=WheelGeometry.of(model, robots[0]),
        motor=motor(alone, found[0], robot.name),
        motor_friction=_motor_friction(alone, robot.name),
        pairs=_pairs(model, robots),
        pitch=pitch,
        one_roller=one_roller,
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
        raise OmniError(f"{file}: <option> differs from what rollers need; set {', '.join(wrong)}, as scene.xml does")


def _name_rollers(robot: mujoco.MjSpec, found: Robot) -> list[str]:
    """Names of the rollers' geoms, which pairs need: those without one are given one."""
    rollers = set(found.rollers.ravel().tolist())
    names = []
    for body in robot.bodies:
        if body.id in rollers:
            for number, geom in enumerate(body.geoms):
                geom.name = geom.name or f"{body.id}_{number}"
                names.append(geom.name)
    return names


def _switch_on_hulls(robot: mujoco.MjSpec, file: str) -> None:
    hulls = [geom for geom in robot.geoms if geom.classname.name == "hull"]
    if not hulls:
        raise OmniError(f"{file}: no hull; robots that share a world meet with their geoms of the class 'hull'")
    for hull in hulls:
        hull.contype = hull.conaffinity = 1


def _add_pair(world: mujoco.MjSpec, like: mujoco.MjsPair, first: str, second: str) -> None:
    world.add_pair(
        geomname1=first,
        geomname2=second,
        condim=like.condim,
        friction=like.friction,
        solref=like.solref,
        solreffriction=like.solreffriction,
        solimp=like.solimp,
        margin=like.margin,
        gap=like.gap,
    )


def _pairs(model: mujoco.MjModel, robots: tuple[Robot, ...]) -> roles.Ids:
    """Numbers of each robot's pairs, (robots, pairs)."""
    roots = model.body_rootid[model.geom_bodyid[[model.pair_geom1, model.pair_geom2]]].max(0)  # the carpet's is lower
    return np.array([np.flatnonzero(roots == robot.chassis) for robot in robots])


def _motor_friction(robot: mujoco.MjModel, file: str) -> float:
    names = [robot.numeric(i).name for i in range(robot.nnumeric)]
    if "motor_friction" not in names:
        raise OmniError(f'{file}: <custom> lacks <numeric name="motor_friction">, dry friction at a wheel in N m')
    return float(robot.numeric("motor_friction").data[0])


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
