"""Worlds of a scene and n robots: the same model as the plain file's, parts by role, and what is refused."""

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from driving import constant, drive, quiet
from driving import mujoco as plant_of

from omni_control.errors import OmniError
from omni_mj.scenarios import models
from omni_mj.worlds import build

ROBOT, SCENE = ((models.folder() / f"{name}.xml").read_text() for name in ("ssl_robot", "scene"))


def arrays(model: mujoco.MjModel) -> dict[str, Any]:
    """Every array and number of a model by name, options included; not names and keyframes."""
    skipped = ("_", "name", "key_", "nname", "nkey", "nbuffer", "signature")
    values = {}
    for owner, prefix in ((model, ""), (model.opt, "opt."), (model.stat, "stat.")):
        for name in dir(owner):
            value = getattr(owner, name) if not name.startswith(skipped) else None
            if isinstance(value, np.ndarray | int | float):
                values[prefix + name] = value
    return values


def test_the_plain_file_is_the_world_of_one_robot() -> None:
    plain = arrays(mujoco.MjModel.from_xml_path(str(models.folder() / "ssl_robot_on_carpet.xml")))
    built = arrays(build.world().model)
    assert plain.keys() == built.keys()
    assert len(plain) > 300
    for name, value in plain.items():
        np.testing.assert_array_equal(built[name], value, err_msg=name)


def test_every_robot_of_a_world_is_the_one_alone() -> None:
    one, three = build.world(), build.world(places=3)
    alone = one.robots[0]
    bodies, dofs = one.model.nbody - 1, one.model.nv
    for i, robot in enumerate(three.robots):
        assert robot.chassis == 1 + i * bodies
        assert robot.dofs == range(i * dofs, (i + 1) * dofs)
        assert three.model.body(robot.chassis).name == f"robot_{i + 1}/chassis"
        # Arrays by body, dof, pair, actuator and sensor, in each robot's share.
        for name, value in arrays(one.model).items():
            kind, first = name.partition("_")[0], {"body": 1}.get(name.partition("_")[0], 0)
            if kind not in ("body", "dof", "pair", "actuator", "sensor") or re.search(
                "adr|id$|root|geom|joint|pair_sig", name
            ):
                continue
            if "bvh" in name or "contype" in name or "conaffinity" in name or not isinstance(value, np.ndarray):
                continue
            size = len(value) - first
            share = getattr(three.model, name)[first + i * size :][:size]
            np.testing.assert_array_equal(share, value[first:], err_msg=name)
        np.testing.assert_array_equal(three.standing[robot.qpos], one.standing[alone.qpos])
        np.testing.assert_array_equal(robot.encoders - three.robots[0].encoders, i * one.model.nsensordata)


def test_the_parts_are_those_of_the_same_names() -> None:
    world = build.world(places=2)
    model, robot = world.model, world.robots[1]
    for i in range(4):
        name = f"robot_2/wheel_{i + 1}"
        assert robot.wheels[i] == model.body(name).id
        assert robot.joints[i] == model.joint(name).id
        assert robot.motors[i] == model.actuator(f"robot_2/motor_{i + 1}").id
        assert robot.encoders[i] == model.sensor(f"robot_2/encoder_{i + 1}").adr[0]
        rollers = [model.body(f"robot_2/roller_{i + 1}_{k:02d}") for k in range(16)]
        assert robot.rollers[i].tolist() == [roller.id for roller in rollers]
        assert robot.roller_dofs[i].tolist() == [roller.dofadr[0] for roller in rollers]
    assert robot.gyro == model.sensor("robot_2/gyro").adr[0] + 2
    touching = {model.geom(g).name for g in model.pair_geom2[world.pairs[1]]}
    assert touching == {f"robot_2/roller_{i}_{k:02d}" for i in range(1, 5) for k in range(16)}


def test_a_roller_is_at_the_bottom_when_its_turn_has_come() -> None:
    world = build.world()
    data = mujoco.MjData(world.model)
    robot = world.robots[0]
    for turn in range(16):
        data.qpos[robot.wheel_qpos] = turn * world.pitch
        mujoco.mj_kinematics(world.model, data)
        lowest = robot.rollers[np.arange(4), data.xpos[robot.rollers, 2].argmin(1)]
        assert lowest.tolist() == robot.rollers[:, turn].tolist()


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., str]:
    def write(text: str, *edits: tuple[str, str], name: str = "mine.xml") -> str:
        for pattern, new in edits:
            text, count = re.subn(pattern, new, text, flags=re.DOTALL)
            assert count, pattern
        file = tmp_path / name
        file.write_text(text)
        return str(file)

    return write


def test_a_hull_and_walls_change_nothing_with_one_robot(write: Callable[..., str]) -> None:
    """Nor does it matter where the robot is: it drives through a wall that is not there for it."""
    bare = write(ROBOT, ('<geom name="hull"[^>]*>', ""))
    start, command = [[5.05, 3.0, 0.4]], constant([1.0, 0.5, 1.0], 20, 1)
    with_hull, without = (drive(plant_of([quiet()], start, robot=robot), command) for robot in ("ssl_robot", bare))
    np.testing.assert_array_equal(with_hull, without)
    assert with_hull[-1, 0, 0] > 5.2
    for name, value in arrays(build.world(bare).model).items():
        if not re.match("n?geom|ngeom|body_geom|body_bvh|n?bvh|pair_geom|mesh|.*adr$", name):
            np.testing.assert_array_equal(arrays(build.world().model)[name], value, err_msg=name)


def test_a_scene_with_another_solver_is_refused_at_once(write: Callable[..., str]) -> None:
    plain = '<mujoco><worldbody><geom name="carpet" type="plane" size="5 5 0.1"/></worldbody></mujoco>'
    with pytest.raises(OmniError) as error:
        build.world(scene=write(plain))
    for part in ("mine.xml", 'timestep="0.00104', 'cone="elliptic"', 'jacobian="sparse"', 'impratio="10"', "eulerdamp"):
        assert part in str(error.value)
    assert "\n" not in str(error.value)
    for pattern, new in ((' cone="elliptic"', ""), ("0.00104166666666666667", "0.002"), ('"Euler"', '"implicitfast"')):
        with pytest.raises(OmniError) as error:
            build.world(scene=write(SCENE, (pattern, new)))
        assert str(error.value).count('="') == 1, "it names what differs, and nothing else"


MISSING = [
    ("no wheels.*<dcmotor>", 1, [("<dcmotor name[^>]*>", "")]),
    ("'chassis'.*<freejoint>", 1, [("<freejoint[^>]*>", "")]),
    ("'wheel_3' has no rollers", 1, [('<body name="roller_3_".*?</body>', "")]),
    ("no encoder on 'wheel_2'", 1, [('<jointpos name="encoder_2"[^>]*>', "")]),
    ("no gyro.*site of the body 'chassis'", 1, [("<gyro[^>]*>", "")]),
    ("z axis of the gyro", 1, [('name="imu"', 'name="imu" euler="90 0 0"')]),
    ("motor_friction", 1, [('<numeric name="motor_friction"[^>]*>', "")]),
    ("no hull.*'hull'", 2, [('<geom name="hull"[^>]*>', "")]),
    ("'wheel_4' must be evenly spaced", 1, [('(<frame euler="0 0 300">.*?)22.5 0 0', r"\g<1>20 0 0")]),
    ("different distances", 1, [('wheel_2" pos="0.080', 'wheel_2" pos="0.070')]),
    (
        "axis of 'wheel_1' must point to the robot's centre",
        1,
        [('<joint name="wheel_1"/>', '<joint name="wheel_1" axis="1 0 0"/>')],
    ),
    ("alike", 1, [('motor_4" joint', 'motor_4" resistance="2" joint')]),
    ("XML", 1, [("</mujoco>", "")]),
]


def test_what_a_robot_lacks_is_named_with_its_file(write: Callable[..., str]) -> None:
    for number, (message, places, edits) in enumerate(MISSING):
        with pytest.raises(OmniError, match=message) as error:
            build.world(write(ROBOT, *edits, name=f"mine_{number}.xml"), places)
        assert f"mine_{number}.xml" in str(error.value)
        assert "\n" not in str(error.value)


def test_what_is_not_there_is_named() -> None:
    with pytest.raises(OmniError, match="did you mean 'ssl_robot'"):
        build.world("ssl_robt")
    with pytest.raises(OmniError, match=r"nowhere/mine\.xml"):
        build.world("nowhere/mine.xml")


def test_a_scene_needs_a_carpet(write: Callable[..., str]) -> None:
    with pytest.raises(OmniError, match=r"mine\.xml: no carpet"):
        build.world(scene=write(SCENE, ('name="carpet" class', 'name="floor" class')))


def test_a_world_is_built_once_and_again_when_its_file_has_changed(write: Callable[..., str]) -> None:
    assert build.world() is build.world()
    file = write(ROBOT)
    first = build.world(file)
    assert build.world(file) is first
    write(ROBOT, ('mass="2.028"', 'mass="3.028"'))
    os.utime(file, ns=(1, 1))
    assert build.world(file).weight > first.weight + 9
