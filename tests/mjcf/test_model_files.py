"""Files that a model or robot names: regular, of bounded size, in its own folder or below."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from commands import run_python
from own_robot import MESH, written
from PIL import Image

import omni_mj as om
from omni_mj.config.robot_files import read_model_files

ROBOT = written((60, 180, 300))
FILES = {  # in the folder of the model, or next to it
    "in/cover.obj": MESH,
    "in/secret.txt": "secret",
    "in/parts/cover.obj": MESH,
    "in/parts/outer.xml": '<mujocoinclude><include file="inner.xml"/></mujocoinclude>',
    "in/parts/inner.xml": '<mujoco><asset><mesh name="c" file="parts/cover.obj"/></asset></mujoco>',
    "in/loop.xml": '<mujoco><include file="../in/loop.xml"/></mujoco>',
    "in/tower.xml": '<mujoco><asset><model name="t" file="tower.xml"/></asset></mujoco>',
    "in/asks.xml": '<mujoco><include file="secret.txt"/></mujoco>',
    "in/utf16.xml": '<?xml version="1.0" encoding="utf-16"?><mujoco/>',
    "out.obj": MESH,
    "out.xml": "<mujoco/>",
}
MANY = (
    "<worldbody>REPEAT<site/></replicate></replicate></replicate></replicate></worldbody>".replace(
        "REPEAT", 4 * '<replicate count="200">'
    )
)
REFUSED = {  # content of the model -> message
    '<asset><mesh name="m" file="../out.obj"/></asset>': "outside",
    '<asset><mesh name="m" file="..\\out.obj"/></asset>': "outside",
    '<asset><mesh name="m" file="HERE/out.obj"/></asset>': "outside",
    '<asset><mesh name="m" file="link.obj"/></asset>': "outside",
    '<asset><mesh name="m" file="far/out.obj"/></asset>': "outside",
    '<compiler meshdir=".."/><asset><mesh name="m" file="out.obj"/></asset>': "outside",
    '<compiler assetdir="HERE"/><asset><mesh name="m" file="out.obj"/></asset>': "outside",
    '<include file="../out.xml"/>': "outside",
    '<asset><model name="m" file="../out.xml"/></asset>': "outside",
    '<asset><mesh name="m" file="/dev/zero"/></asset>': "must end in .stl, .obj, .msh",
    '<asset><mesh name="m" file="zero.obj"/></asset>': "outside",
    '<asset><mesh name="m" file="pipe.obj"/></asset>': "not a regular file",
    '<asset><mesh name="m" file="parts"/></asset>': "must end in",
    '<asset><texture name="t" type="cube" fileup="pipe.png"/></asset>': "not a regular file",
    '<include file="pipe.xml"/>': "not a regular file",
    '<include file="/dev/zero"/>': "outside",
    '<include file="parts"/>': "not a regular file",
    '<asset><mesh name="m" file="huge.obj"/></asset>': "must not exceed 200 MB",
    '<include file="huge.xml"/>': "XML files must not exceed 4 MB",
    '<include file="half.xml"/><include file="rest.xml"/>': "XML files must not exceed 4 MB",
    '<asset><texture name="t" type="2d" file="bomb.png"/></asset>': "MuJoCo cannot compile it",
    '<asset><hfield name="h" size="1 1 1 1" file="bomb.png"/></asset>': "MuJoCo cannot compile it",
    '<asset><hfield name="h" size="1 1 1 1" nrow="60000" ncol="60000"/></asset>': (
        "MuJoCo cannot compile it with 0.5 GB"
    ),
    MANY: "MuJoCo cannot compile it",
    '<worldbody><body pos="nan 0 0"><geom size="nan"/></body></worldbody>': "nan size in geom",
    '<worldbody><site pos="nan 0 0"/></worldbody>': "XML contains a 'NaN'",
    '<worldbody><body><joint/><joint/><geom size="0.1"/></body></worldbody>': (
        "Inertia matrix is too close to singular"
    ),
    '<asset><mesh name="m" file="none.obj"/></asset>': "none.obj, which does not exist",
    '<asset><texture name="t" type="2d" file="secret.txt" content_type="image/png"/></asset>': (
        "must end in"
    ),
    '<worldbody><geom size="1" file="secret.txt"/></worldbody>': "must not have a file",
    '<include file="mine.xml"/>': "mine.xml is included twice, or includes itself",
    '<include file="loop.xml"/>': "loop.xml is included twice, or includes itself",
    '<asset><model name="m" file="tower.xml"/></asset>': "tower.xml includes itself",
    '<include file="asks.xml"/>': "XML parse error in secret.txt",
    '<include file="utf16.xml"/>': "XML parse error in utf16.xml",
}
PROGRAM = """
import sys
import omni_mj as om
for text in sys.stdin.read().split("\\0"):
    open("in/mine.xml", "w").write(text)
    try:
        om.load_scenario("rect", model="in/mine.xml")
    except om.OmniError as error:
        print(*str(error).splitlines(), sep=" | ")
    else:
        print("accepted")
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder, with files, links, pipes and sparse files for models."""
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-16" if "utf16" in name else "utf-8")
    for name, target in (("link.obj", "../out.obj"), ("far", ".."), ("zero.obj", "/dev/zero")):
        os.symlink(target, tmp_path / "in" / name)
    for suffix in ("obj", "xml", "png"):
        os.mkfifo(tmp_path / "in" / f"pipe.{suffix}")
        with (tmp_path / "in" / f"huge.{suffix}").open("wb") as file:
            file.truncate(250_000_000)
    for name in ("half", "rest"):
        (tmp_path / "in" / f"{name}.xml").write_text(f"<mujoco>{' ' * 2_000_000}</mujoco>")
    return tmp_path


def with_content(content: str) -> str:
    """Return the robot with further content."""
    return ROBOT.replace("<worldbody>", f"{content}<worldbody>", 1)


def test_a_model_reads_nothing_but_regular_files_below_its_folder(folder: Path) -> None:
    """Each is refused at once, in one line that names the model."""
    Image.new("1", (14_000, 14_000)).save(folder / "in" / "bomb.png")  # 24 kB
    texts = [with_content(content.replace("HERE", str(folder))) for content in REFUSED]
    texts += [
        with_content('<x:a xmlns:x="u"/>').replace("<mujoco ", '<mujoco xmlns="u" ', 1),
        f'<!DOCTYPE m [<!ENTITY e "x">]>{ROBOT}',
    ]
    done = run_python(code=PROGRAM, input="\0".join(texts), cwd=folder, check=True)
    messages = [*REFUSED.values(), "unrecognized element", "must not have a <!DOCTYPE>"]
    for text, message, line in zip(texts, messages, done.stdout.splitlines(), strict=True):
        assert line.startswith("mine.xml: "), text
        assert message in line, (text, line)


def test_a_model_has_the_files_that_mujoco_reads_and_no_others(folder: Path) -> None:
    """Attributes that MuJoCo ignores copy no file; comments and doubled dashes are ignored too."""
    model = folder / "in" / "mine.xml"
    contents = {
        '<asset><texture name="t" type="2d" builtin="flat" width="4" height="4" '
        'file="secret.txt" fileup="../out.obj"/></asset>': set(),
        '<!-- -- <include file="/dev/zero"/> --><!-- "> --><asset><mesh file="cover.obj"/>'
        "</asset>": {"cover.obj"},
        '<include file="parts/outer.xml"/>': {
            "parts/outer.xml",
            "parts/inner.xml",
            "parts/cover.obj",
        },
        '<compiler meshdir="parts" strippath="true"/><asset><mesh file="a\\cover.obj"/></asset>': {
            "parts/cover.obj",
            "cover.obj",
        },
    }
    for content, names in contents.items():
        model.write_text(with_content(content))
        om.load_scenario("rect", model=str(model))
        assert read_model_files(model).keys() == {"mine.xml", *names}


def test_a_robots_file_names_a_model_below_its_own_folder(folder: Path) -> None:
    (folder / "mine.xml").write_text(ROBOT)
    for name in ("../mine.xml", str(folder / "mine.xml"), "far/mine.xml"):
        (folder / "in" / "robot.toml").write_text(f"[model]\nfile = {name!r}\n")
        with pytest.raises(om.OmniError, match=r"robot.toml names .*mine.xml, which is outside"):
            om.load_robot(folder / "in" / "robot.toml")


@pytest.mark.parametrize(
    "load", [lambda path: om.load_scenario(path), om.load_robot], ids=["scenario", "robot"]
)
def test_pipes_and_devices_are_no_toml_files(folder: Path, load: Callable[[str], object]) -> None:
    os.mkfifo("pipe.toml")
    os.symlink("/dev/zero", "zero.toml")
    for name in ("pipe.toml", "zero.toml"):
        with pytest.raises(om.OmniError, match=f"{name} cannot be read: it is not a regular file"):
            load(name)
