"""A robot is the same however its MJCF is put together: names, attached and included files."""

import re
from collections.abc import Callable
from math import radians
from pathlib import Path

import numpy as np
import pytest
from own_robot import written

import omni_mj as om
from omni_mj.mjcf import world_builder

# Wheels are turned by a third of the pitch of their rollers.
ROBOT = written((60, 180, 300)).replace(' childclass="wheel"', ' euler="8 0 0" childclass="wheel"')
ALONE = re.sub("<light[^>]*>|<geom name=.floor[^>]*>", "", ROBOT)
FIELDS = (
    "qpos0",
    "sensor_cutoff",
    "sensor_delay",
    "body_mass",
    "body_inertia",
    "body_pos",
    "jnt_axis",
    "geom_size",
)
FIELDS += ("dof_armature", "dof_frictionloss", "actuator_gear", "actuator_gainprm", "pair_solref")


def edit(text: str, *edits: tuple[str, str | Callable[[re.Match[str]], str]]) -> str:
    for pattern, new in edits:
        text, count = re.subn(pattern, new, text, flags=re.DOTALL)
        assert count, pattern
    return text


ACTUATORS = edit(
    re.search("<actuator>.*</actuator>", ROBOT)[0],  # type: ignore[index]
    ("drive_", "team/robot_1/drive_"),
    ('joint="team/robot_1/drive_a"', 'joint="slip_of_team/robot_1/drive_b"'),
    ("<dcmotor", '<dcmotor class="drive"'),
)
# Names with slashes and those that the program makes, motors in a nested class and an included
# file, frames, and other things in the scene that the robot's parts refer to
SCENE = edit(
    ROBOT,
    ("<actuator>.*</actuator>", '<include file="parts/drive.xml"/>'),
    ("drive_", "team/robot_1/drive_"),
    ('joint (name=)"team/robot_1/drive_a"', r'joint \1"slip_of_team/robot_1/drive_b"'),
    ('(<jointpos name="[^"]*") joint="team/robot_1/drive_a"',
     r'\1 joint="slip_of_team/robot_1/drive_b"'),
    ('"plate"', '"unnamed_geom_5"'),
    ("(<dcmotor motorconst[^>]*>)", r'<default class="k"><default class="drive">\1</default>'
     "</default>"),
    ("<body name=.base..*</body>(?=\\s*</worldbody>)", r'<frame pos="0 0 1" euler="90 0 30">\g<0>'
     '</frame><body name="ball"><freejoint/><geom name="ball" size="0.02"/><site name="ball"/>'
     '</body><body name="cart"><joint name="crank" axis="0 1 0"/><geom size="0.01"/>'
     '<replicate count="4" euler="0 90 0"><body pos="0 0 0.03"><joint/><geom size="0.005"/></body>'
     "</replicate></body>"),
    ('<site name="imu"/>', r'\g<0><camera name="eye" mode="targetbody" target="ball"/>'),
    ("<sensor>", '<contact><pair geom1="ball" geom2="unnamed_geom_5"/></contact><tendon>'
     r'<spatial><site site="ball"/><site site="imu"/></spatial></tendon>\g<0>'),
)  # fmt: skip
# A wheel with its own slip hinge, in radians; inertias are those of geoms, sensors have a limit
WHEEL = edit(
    ALONE,
    ('<body name="base".*?(<body name="drive_a") pos="[^"]*"(.*?</body>)\\s*</frame>.*</body>',
     r"\1\2"),
    ("<actuator>.*</mujoco>", '<actuator><dcmotor name="m" joint="drive_a"/></actuator>'
     '<sensor><jointpos name="e" joint="drive_a" cutoff="0.1" delay="0.1" nsample="9"/></sensor>'
     "</mujoco>"),
    ("<compiler ", '<compiler angle="radian" inertiafromgeom="true" '),
    ('euler="([0-9.]+ 0 0|0 90 0)"',
     lambda match: f'euler="{" ".join(str(radians(float(a))) for a in match[1].split())}"'),
    ('<joint name="drive_a"[^>]*>',
     r'\g<0><joint name="slip" axis="-1 0 0" armature="0"/>'),
)  # fmt: skip
FROM_WHEELS = edit(
    ROBOT,
    ("<actuator>.*</actuator>", '<asset><model name="w" file="parts/wheel.xml"/></asset>'),
    ("<jointpos[^>]*>", ""),
    ('<body name="(drive_.)" (pos="[^"]*").*?</body>\\s*</frame>',
     r'<frame \2><attach model="w" body="drive_a" prefix="\1_"/></frame></frame>'),
    ('integrator="implicitfast"', 'integrator="RK4"'),
)  # fmt: skip
FROM_ROBOT = (
    '<mujoco><asset><model name="r" file="parts/robot.xml"/></asset><worldbody>'
    '<frame pos="1 2 3" euler="40 0 70"><attach model="r" prefix="x_"/></frame></worldbody>'
    "</mujoco>"
)
FROM_GEOMS = edit(
    ROBOT,
    ("<compiler ", '<compiler inertiafromgeom="true" '),
    ('<site name="imu"/>', r'\g<0><inertial pos="0 0 1" mass="9" diaginertia="1 1 1"/>'),
)


@pytest.mark.parametrize("text", [SCENE, FROM_WHEELS, FROM_ROBOT, FROM_GEOMS])
def test_a_composed_robot_is_the_robot(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], text: str
) -> None:
    """Its world has the same bodies, joints, motors and contacts, without a word of MuJoCo."""
    (tmp_path / "parts").mkdir()
    files = {
        "mine.xml": ROBOT,
        "composed.xml": text,
        "parts/drive.xml": f"<mujocoinclude>{ACTUATORS}</mujocoinclude>",
        "parts/wheel.xml": WHEEL,
        "parts/robot.xml": ALONE,
    }
    for name, content in files.items():
        (tmp_path / name).write_text(content)
    expected, composed = (
        world_builder.build_world(
            om.load_scenario(
                "rect", model=str(tmp_path / name), wheels={"model": "two-rollers"}
            ).settings
        ).model
        for name in ("mine.xml", "composed.xml")
    )
    for field in FIELDS:
        np.testing.assert_allclose(
            getattr(composed, field), getattr(expected, field), rtol=1e-6, atol=1e-8, err_msg=field
        )
    assert not capfd.readouterr().err
