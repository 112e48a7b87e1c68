"""A robot as a newcomer writes it: the example of docs/robots.md, with four wheels and with three."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from benches.plant import FRAME_S, drive, ramp

import omni_mj as om
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.robots import builtin
from omni_mj.scenarios import robots
from omni_mj.scenarios.rows import Row
from omni_mj.worlds import build

DOCUMENT = (Path(__file__).parents[2] / "docs/robots.md").read_text(encoding="utf-8")
(EXAMPLE,) = re.findall(r"^```toml mine\.toml\n(.*?)^```", DOCUMENT, re.MULTILINE | re.DOTALL)
(THREE,) = re.findall(r"Three wheels: `(azimuths_deg = .*?)`", DOCUMENT)


def write(folder: Path, text: str) -> str:
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


@pytest.fixture(params=["four", "three"])
def mine(request: pytest.FixtureRequest, tmp_path: Path) -> robots.Robot:
    text = EXAMPLE if request.param == "four" else re.sub("azimuths_deg = .*", THREE, EXAMPLE)
    return om.robot(write(tmp_path, text))


def test_it_drives_where_its_wheels_lead(mine: robots.Robot) -> None:
    """Half a second ahead, aside and turning, by a loop and a gear of its own.

    Wheels creep, K is above 0.8, and the integral makes up for some of it. And its wheels turn as those at its azimuths
    must: each by the part of the way that is along its rim.
    """
    twists = np.array([[0.4, 0, 0], [0, 0.4, 0], [0, 0, 4.0]])
    wheels = {"model": "two-rollers"}
    chosen = om.scenario("rect", robot=mine, wheels=wheels, sensors={"gyro_noise_rad_s": 0, "gyro_bias_rad_s": 0})
    rows = [Row(i, 0, "", 0, chosen.settings, chosen.robot) for i in range(3)]
    plant = MujocoPlant(rows, np.zeros((3, 3)))
    poses = drive(plant, ramp(twists, [2.0, 2.0, 20.0], 30))
    telemetry, azimuths = plant.telemetry(), np.radians(mine.settings.wheels.azimuths_deg)
    assert telemetry.wheel_angle.shape == (3, len(azimuths))
    speed = (poses[-1] - poses[-7]) / (6 * FRAME_S)
    for axis, twist in enumerate(twists):
        assert 0.78 * twist[axis] < speed[axis, axis] < 1.02 * twist[axis], axis
    across = np.abs(speed * [1, 1, 0.08])[~np.eye(3, dtype=bool)]
    assert across.max() < 0.05  # of other axes, m/s at the rim: ahead and aside are not one another
    w, arm, radius = mine.settings.wheels, 0.08, 0.0275
    assert (w.arm_m, w.radius_m) == (arm, radius)
    way = np.stack([-np.sin(azimuths), np.cos(azimuths), np.full(len(azimuths), arm)], axis=1)  # equation 3
    turned = telemetry.wheel_speed * radius
    wanted = twists @ way.T
    assert np.abs(turned - wanted).max() < 0.15 * np.abs(wanted).max()  # a loop that is not stiff


@pytest.mark.parametrize("name", builtin())
def test_every_wheel_of_every_robot_reaches_the_carpet(name: str) -> None:
    """They bear the robot's weight together, each a share of it, as statics says where there are three.

    Half a percent for what is left of the settling.
    """
    world = build.world(om.robot(name).settings)
    data = mujoco.MjData(world.model)
    data.qpos[:] = world.standing
    mujoco.mj_step(world.model, data, 20)
    loads = np.abs(data.sensordata[world.loads[0]])
    assert loads.min() > 0.1 * world.weight
    assert loads.sum() == pytest.approx(world.weight, rel=5e-3)


def test_a_robot_serves_wherever_its_name_does(tmp_path: Path) -> None:
    path = write(tmp_path, EXAMPLE)
    mine = om.robot(path)
    assert om.scenario("rect", robot=mine) == om.scenario("rect", robot=path) == om.scenario("rect", robot=Path(path))
    assert (mine.name, mine.path, mine.settings.wheels.rollers) == (path, Path(path), 18)
    assert mine.description.startswith("four wheels at 50 and 130 deg")
    assert mine.description in str(mine)
    assert om.robot("tigers-v2016").name == om.scenario("rect", robot=om.robot("tigers-v2016")).robot == "tigers-v2016"
    # Back-EMF of the nominal battery at the fastest wheel: of those at 50 and 130 deg, sin 50 ahead and cos 50 aside.
    rim = 22.2 / (0.036 * 3.6) * 0.0275
    assert mine.facts["top_speed_ahead_m_s"] == pytest.approx(rim / np.sin(np.radians(50)))
    assert mine.facts["top_speed_aside_m_s"] == pytest.approx(rim / np.cos(np.radians(50)))
    # The rear edge is cos 50 of the arm behind the middle, the centre of mass 3 mm less from it.
    assert mine.facts["tips_at_m_s2"] == pytest.approx(9.81 * (0.08 * np.cos(np.radians(50)) - 0.003) / 0.045)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("mass_kg = 2.4", "mass_kg = 0.5"), r"body\.(yaw|tilt)_inertia_kg_m2 = .* is more than body\.mass_kg = 0\.5"),
        (("yaw_inertia_kg_m2 = 0.0110", "yaw_inertia_kg_m2 = 0.001"), r".*mine\.toml: body\.yaw_inertia_kg_m2 and .*"),
        (("arm_m = 0.08\n", ""), r"wheels\.arm_m depends on the robot; give it in .*mine\.toml"),
        (("kp = 0.15", "kp = 'x'"), r"firmware\.kp must be a number from 0 to 100 V s/rad, not 'x'"),
        (("rollers = 18", "roler = 18"), r"wheels\.rollers depends on the robot"),
    ],
)
def test_what_is_wrong_with_it_is_an_error_in_lines(tmp_path: Path, change: tuple[str, str], says: str) -> None:
    with pytest.raises(om.OmniError) as error:
        om.robot(write(tmp_path, EXAMPLE.replace(*change)))
    assert all(line for line in str(error.value).splitlines())
    assert re.match(says, str(error.value)), error.value


def test_the_document_names_every_number_of_a_robot_and_every_robot() -> None:
    for section, fields in robots.sections(robots.DEFAULT).items():
        for field in fields:
            assert re.search(rf"`({section}\.)?{field}`", DOCUMENT), f"{section}.{field}"
    for name in builtin():
        assert f"`{name}`" in DOCUMENT, name
