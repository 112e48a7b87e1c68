"""`omni-mj export`: a folder that MuJoCo simulates without this program."""

from pathlib import Path

import mujoco
import pytest
from commands import invoke, run_python
from own_robot import MESH, written

# Each scene for a second with random voltages, as the tests of MuJoCo Menagerie do.
PROGRAM = """
import mujoco, sys
model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)
for i in range(500):
    for j, (low, high) in enumerate(model.actuator_ctrlrange):
        data.ctrl[j] = low + (high - low) * mujoco.mju_Halton(i, j + 2)
    mujoco.mj_step(model, data)
assert not data.warning.number.any(), data.warning.number
assert 0 <= data.qpos[2] + 1e-3 < 0.01, data.qpos
print(model.nu)
"""


def simulate(folder: Path) -> int:
    """Simulate scene.xml of a folder without this program; return the number of motors."""
    done = run_python(folder / "scene.xml", code=PROGRAM)
    assert (done.returncode, done.stderr) == (0, "")
    return int(done.stdout)


def test_a_robot_becomes_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As MuJoCo Menagerie lays it out, with the comments of the robot's file as sources."""
    out = tmp_path / "out"
    options = "--set wheels.azimuths_deg=[60, 180, 300]"
    assert invoke("export --robot tigers-v2020", options, "--out", out) == 0
    text = capsys.readouterr()
    names = {path.name for path in out.iterdir()}
    pictures = {"tigers-v2020.png"} if "no tigers-v2020.png" not in text.err else set()
    assert names - pictures == {
        *("tigers-v2020.xml", "scene.xml", "README.md", "LICENSE", "CHANGELOG.md"),
        "provenance.json",
    }
    assert all((out / name).read_bytes().startswith(b"\x89PNG") for name in pictures)
    readme = (out / "README.md").read_text()
    robot_file = Path(__file__).parents[2] / "omni_mj" / "robots" / "tigers-v2020.toml"
    assert robot_file.read_text().strip() in readme
    assert "| `motor_3` | wheel 3 | 300 deg |" in readme
    assert "Changed for this model: wheels.azimuths_deg=[60, 180, 300]." in readme
    assert simulate(out) == 3


@pytest.fixture
def no_opengl(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let programs fail to load OpenGL."""
    monkeypatch.setenv("PYOPENGL_PLATFORM", "osmesa")  # MuJoCo wants egl


@pytest.mark.usefixtures("no_opengl")
def test_a_robot_with_its_own_mjcf_keeps_its_files(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "cover.obj").write_text(MESH)
    xml = written((60, 180, 300), more='<geom type="mesh" mesh="cover" mass="0" contype="0"/>')
    asset = '<compiler meshdir="parts"/><asset><mesh name="cover" file="cover.obj"/></asset>'
    (tmp_path / "mine.xml").write_text(xml.replace("<worldbody>", f"{asset}<worldbody>"))
    out = tmp_path / "moved"
    assert invoke("export --model", tmp_path / "mine.xml", "--out", out) == 0
    out = out.rename(tmp_path / "elsewhere")
    (tmp_path / "parts" / "cover.obj").unlink()
    assert (out / "parts" / "cover.obj").read_text() == MESH
    assert "`m_drive_a`" in (out / "README.md").read_text()
    assert not (out / "LICENSE").exists()
    assert simulate(out) == 3


@pytest.mark.usefixtures("no_opengl")
def test_a_folder_is_replaced_only_on_request(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert invoke("export --out", out, "--quiet") == 0
    text = capsys.readouterr()
    assert text.err.startswith("warning: no tigers-v2016.png, because MuJoCo cannot draw here: ")
    assert text.err.count("\n") == 1
    assert text.out == ""
    before = (out / "README.md").read_bytes()
    assert invoke("export --out", out) == 2
    assert "is not empty" in capsys.readouterr().err
    assert (out / "README.md").read_bytes() == before
    assert invoke("export --robot robojackets --out", out, "--overwrite") == 0
    assert mujoco.MjModel.from_xml_path(str(out / "scene.xml")).nu == 4


def test_a_robot_that_does_not_exist_makes_no_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words, error in (
        ("--robot nobody", "unknown robot 'nobody'"),
        ("--set wheels.roller_radius_m=0.02", "leaves no room for an axle"),
        ("--model none.xml", "there is no model"),
    ):
        assert invoke("export", words, "--out", tmp_path / "out") == 2
        assert error in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


SIZES = "--radius 0.05 --width 0.05 --rollers 12 --roller-radius 0.008"


@pytest.mark.usefixtures("no_opengl")
@pytest.mark.parametrize(
    ("angle", "wheels"), [(90, {"wheel.xml"}), (45, {"left_wheel.xml", "right_wheel.xml"})]
)
def test_a_wheel_becomes_a_folder(angle: int, wheels: set[str], tmp_path: Path) -> None:
    """The base in the scene has velocity servos, and can be attached to another scene twice."""
    out = tmp_path / "out"
    assert invoke(f"export --wheel {SIZES} --roller-angle {angle} --out", out) == 0
    names = {path.name for path in out.iterdir()}
    assert names == wheels | {"scene.xml", "README.md", "LICENSE", "provenance.json"}
    assert "radius, width | 0.05 m, 0.05 m" in (out / "README.md").read_text()
    attach = "".join(f'<attach model="base" body="base" prefix="{name}_"/>' for name in "ab")
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><asset><model name="base" file="{out}/scene.xml"/></asset>'
        f'<worldbody><geom type="plane" size="9 9 1"/>{attach}</worldbody></mujoco>'
    )
    assert model.nu == (6 if angle == 90 else 8)


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (
            "--wheel --width 0.05 --rollers 12 --roller-radius 0.008",
            "radius is missing: radius over the rollers",
        ),
        (f"--wheel {SIZES} --rows 3", "rows must be less than or equal to 2"),
        (f"--wheel {SIZES} --width 0.01", "width must be at least 0.016, that of the rollers"),
        (f"--wheel {SIZES} --robot tigers-v2016", "without --robot, --model and --set"),
        ("--roller-angle 45", "--roller-angle needs --wheel"),
    ],
)
def test_an_impossible_wheel_makes_no_folder(
    words: str, error: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert invoke("export", words, "--out", tmp_path / "out") == 2
    text = capsys.readouterr().err
    assert error in text
    assert text.count("\n") == 1
    assert not (tmp_path / "out").exists()
